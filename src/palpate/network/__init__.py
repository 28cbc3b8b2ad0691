"""Frames over the network: a small binary form by UDP, TCP or WebSocket, for drivers in any language.

`frames` is the form of a frame, `admission` decides which frames are taken and from whom, `listener` holds the sockets,
`waiting` the few frames that nobody has taken yet.
"""

from palpate.network.admission import Admission, Limits
from palpate.network.frames import frame_bytes, frame_from_bytes, zero_bytes
from palpate.network.listener import FrameListener

__all__ = ["Admission", "FrameListener", "Limits", "frame_bytes", "frame_from_bytes", "zero_bytes"]
