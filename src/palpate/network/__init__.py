"""Frames over UDP, TCP or WebSocket in a small binary form, for drivers in any language.

In: packets of any sender (`frames.py` has their form, `admission.py` decides which are taken).
Out: frames with readings and times in order, and the few that still wait (`waiting.py`).
Open first: `listener.py`.
"""

from palpate.network.admission import Admission, Limits
from palpate.network.frames import frame_bytes, frame_from_bytes, zero_bytes
from palpate.network.listener import FrameListener

__all__ = ["Admission", "FrameListener", "Limits", "frame_bytes", "frame_from_bytes", "zero_bytes"]
