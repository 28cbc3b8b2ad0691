"""Frames over the network: a small binary form by UDP, TCP, WebSocket or zenoh, for drivers in any language.

`frames` is the form of a frame, `admission` decides which frames are taken and from whom, `listener` holds the sockets,
`zenoh` the same by zenoh,
`waiting` the few frames that nobody has taken yet.
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
