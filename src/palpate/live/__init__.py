"""The live view: a page on this machine that shows what touches the pad while it happens."""

from palpate.live.server import Live, serve
from palpate.live.session import Session, packed, unpacked

__all__ = ["Live", "Session", "packed", "serve", "unpacked"]
