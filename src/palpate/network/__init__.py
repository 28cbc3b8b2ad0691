"""Receive frames over UDP, TCP, WebSocket or zenoh in a small binary form, from drivers in any language.

In: packets of any sender (`frames.py` has their form, `admission.py` decides which are accepted).
Out: frames with readings and times in order, of which few wait in a queue (`waiting.py`).
Open first: `listener.py` (sockets; `zenoh.py` does the same over zenoh).
"""

from palpate.network.admission import Admission, Limits
from palpate.network.frames import frame_bytes, frame_from_bytes, zero_bytes
from palpate.network.listener import FrameListener
from palpate.network.zenoh import ZenohListener, zenoh_key, zenoh_session

__all__ = [
    "Admission",
    "FrameListener",
    "Limits",
    "ZenohListener",
    "frame_bytes",
    "frame_from_bytes",
    "zenoh_key",
    "zenoh_session",
    "zero_bytes",
]
