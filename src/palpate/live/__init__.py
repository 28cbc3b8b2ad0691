"""The live view: a page on this machine that shows the touches of a stream.

In: frames from a source (recording, network, camera, Python) and a tracker.
Out: packets for the page, for Foxglove, Rerun and the sinks of `recordings`.
Open first: `session.py`.
"""

from palpate.live.foxglove import FoxgloveServer
from palpate.live.rerun import RerunSink
from palpate.live.server import Live, address, serve, show
from palpate.live.session import Session, packed, unpacked
from palpate.live.zenoh import publish_touches

__all__ = [
    "FoxgloveServer",
    "Live",
    "RerunSink",
    "Session",
    "address",
    "packed",
    "publish_touches",
    "serve",
    "show",
    "unpacked",
]
