"""The live view: a page on this machine that shows what touches the pad while it happens."""

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
