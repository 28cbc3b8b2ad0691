"""The page's server: Starlette on this machine, one binary WebSocket, only the newest packet is ever sent.

It answers to this machine alone (127.0.0.1) unless told otherwise, and then only to those who bring the token. A page of another origin is
refused, and so are messages of more than a kilobyte.
"""

from __future__ import annotations

import asyncio
import contextlib
import json
import secrets
import time
from collections.abc import AsyncIterator, Iterable, Sequence
from pathlib import Path
from typing import Any
from urllib.parse import urlsplit

from palpate.errors import InvalidInput, PalpateError, Unsupported
from palpate.grasp import GraspMonitor
from palpate.live.session import Session
from palpate.recordings import Sink
from palpate.skin import Skin

__all__ = ["BUDGET", "LOCAL", "Live", "serve", "show"]

#: This machine, by its names.
LOCAL = ("127.0.0.1", "localhost", "::1")
#: What a frame of a live view may take [s].
BUDGET = 0.02

STATIC = Path(__file__).parent / "static"
#: Largest message that a page may send [bytes].
LARGEST = 1024
#: Pages at the same time.
PAGES = 16
_SAFE = {
    "Content-Security-Policy": "default-src 'self'; connect-src 'self' ws: wss:; img-src 'self' data:; frame-ancestors 'none'",
    "X-Content-Type-Options": "nosniff",
    "Referrer-Policy": "no-referrer",
    "Cache-Control": "no-store",
}


class Live:
    """The application around a session: ``app`` is what a server runs.

    Parameters
    ----------
    session : Session
    token : str, optional
        What a page must bring as ``?token=...``.
    folder : str or Path, optional
        Where recordings started from the page go; without it the page cannot record.
    """

    def __init__(self, session: Session, *, token: str | None = None, folder: str | Path | None = None) -> None:
        try:
            from starlette.applications import Starlette
            from starlette.responses import FileResponse, JSONResponse
            from starlette.routing import Route, WebSocketRoute
        except ImportError as error:
            raise Unsupported('the live view needs more packages: pip install "palpate[live]".') from error
        self.session, self.token = session, token
        self.folder = None if folder is None else Path(folder)
        self.refused: dict[str, int] = {}
        self.pages = 0

        @contextlib.asynccontextmanager
        async def lifespan(_: Any) -> AsyncIterator[None]:
            session.start()
            yield
            await asyncio.to_thread(session.stop)

        def page(name: str, kind: str) -> Any:
            async def send(request: Any) -> Any:
                if name == "index.html" and not self._admitted(request.query_params.get("token")):
                    return self._refuse("token", JSONResponse({"error": "this page needs its token"}, 403))
                return FileResponse(STATIC / name, media_type=kind, headers=_SAFE)

            return send

        async def health(request: Any) -> Any:
            if not self._admitted(request.query_params.get("token")):
                return self._refuse("token", JSONResponse({"error": "token"}, 403))
            known = session.tracker.health
            return JSONResponse(
                {
                    "frames": known.frames,
                    "late": known.late,
                    "approximate": known.approximate,
                    "behind": session.behind,
                    "received": dict(session.counts),
                    "pages": self.pages,
                    "refused": self.refused,
                    "failure": session.failure,
                    "recording": session.recording,
                },
                headers=_SAFE,
            )

        async def stream(socket: Any) -> None:
            reason = self._unwelcome(socket.headers.get("origin"), socket.headers.get("host"))
            if reason is None and not self._admitted(socket.query_params.get("token")):
                reason = "token"
            if reason is None and self.pages >= PAGES:
                reason = "pages"
            if reason is not None:
                self.refused[reason] = self.refused.get(reason, 0) + 1
                await socket.close(1008, reason)
                return
            await socket.accept()
            self.pages += 1
            try:
                await self._serve(socket)
            finally:
                self.pages -= 1

        self.app = Starlette(
            routes=[
                Route("/", page("index.html", "text/html")),
                Route("/live.js", page("live.js", "text/javascript")),
                Route("/live.css", page("live.css", "text/css")),
                Route("/health", health),
                WebSocketRoute("/stream", stream),
            ],
            lifespan=lifespan,
        )

    def _refuse(self, why: str, answer: Any) -> Any:
        self.refused[why] = self.refused.get(why, 0) + 1
        return answer

    def _admitted(self, token: str | None) -> bool:
        return self.token is None or (token is not None and secrets.compare_digest(token.encode(), self.token.encode()))

    @staticmethod
    def _unwelcome(origin: str | None, host: str | None) -> str | None:
        """A browser says where its page came from; it must be from here."""
        if origin is not None and urlsplit(origin).netloc != host:
            return "origin"
        return None

    async def _serve(self, socket: Any) -> None:
        from starlette.websockets import WebSocketDisconnect

        session = self.session
        loop, fresh = asyncio.get_running_loop(), asyncio.Event()

        def wake() -> None:
            with contextlib.suppress(RuntimeError):  # the loop has ended
                loop.call_soon_threadsafe(fresh.set)

        end = session.listen(wake)
        listener = asyncio.create_task(self._listen(socket))
        try:
            await socket.send_text(json.dumps({**session.layout(), "may_record": self.folder is not None}))
            sent = -1
            while not listener.done():
                waiting = asyncio.create_task(fresh.wait())
                await asyncio.wait({waiting, listener}, return_when=asyncio.FIRST_COMPLETED)
                waiting.cancel()
                fresh.clear()
                if session.failure is not None:
                    await socket.send_text(json.dumps({"failure": session.failure}))
                if session.packet is not None and session.count != sent:
                    # only the newest, and the next not before this one has gone: nothing queues
                    sent = session.count
                    await socket.send_bytes(session.packet)
        except (WebSocketDisconnect, RuntimeError):
            pass
        finally:
            end()
            listener.cancel()
            with contextlib.suppress(asyncio.CancelledError, WebSocketDisconnect, RuntimeError):
                await listener

    async def _listen(self, socket: Any) -> None:
        """What the page asks for: recording, on or off. Anything else is counted and left."""
        while True:
            message = await socket.receive()
            if message["type"] == "websocket.disconnect":
                return
            text = message.get("text")
            try:
                if text is None or len(text) > LARGEST:
                    raise ValueError("not a short text")
                wish = json.loads(text)
                record = wish["record"]
                if not isinstance(record, bool):
                    raise ValueError("record must be true or false")
            except (ValueError, KeyError, TypeError):
                self.refused["message"] = self.refused.get("message", 0) + 1
                continue
            try:
                path = None
                if record:
                    if self.folder is None:
                        raise InvalidInput("recording from the page is off: start with --record-to FOLDER.")
                    path = self.folder / time.strftime("palpate-%Y%m%d-%H%M%S.mcap")
                name = await asyncio.to_thread(self.session.record, path)
                await socket.send_text(json.dumps({"recording": name}))
            except PalpateError as error:
                await socket.send_text(json.dumps({"failure": str(error), "recording": None}))


def serve(live: Live, *, host: str = "127.0.0.1", port: int = 8765) -> None:
    """Run until interrupted."""
    try:
        import uvicorn
    except ImportError as error:
        raise Unsupported('the live view needs more packages: pip install "palpate[live]".') from error
    uvicorn.run(live.app, host=host, port=port, log_level="warning", ws_max_size=LARGEST, ws_per_message_deflate=False)


def show(
    skin: Skin,
    frames: Iterable[tuple[float, Any]],
    *,
    friction: float | None = None,
    baseline: int | Any = 0,
    monitor: GraspMonitor | None = None,
    sinks: Sequence[Sink] = (),
    name: str = "",
    host: str = "127.0.0.1",
    port: int = 8765,
    token: str | None = None,
) -> None:
    """Show whatever comes as (time [s], readings) in the browser, until interrupted.

    Parameters
    ----------
    skin : Skin
    frames : iterable of (float, array)
        A generator that waits for its sensor, for example.
    friction, baseline
        As in `Skin.track`.
    monitor : GraspMonitor, optional
        Default: one with the same friction.
    sinks : sequence of Sink
        Where the stream goes besides: a `palpate.recordings.recorder`, a `FoxgloveServer`, a `RerunSink`.
    name : str
        Shown on the page.
    host, port, token
        Where the page is; anything but this machine needs a token.
    """
    if host not in LOCAL and token is None:
        raise InvalidInput(f"host {host} opens the page to others: give a token that they must bring (?token=...).")
    bound = friction if {"z"} < set(skin.components) else None
    tracker = skin.track(friction=bound, baseline=baseline, budget=BUDGET)
    monitor = GraspMonitor(friction=friction) if monitor is None else monitor
    session = Session(skin, lambda: frames, tracker, monitor, name=name, pace=False, sinks=sinks)
    serve(Live(session, token=token), host=host, port=port)
