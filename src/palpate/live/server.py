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
from collections.abc import AsyncIterator
from pathlib import Path
from typing import Any
from urllib.parse import urlsplit

from palpate.errors import InvalidInput, PalpateError, Unsupported
from palpate.live.session import Session

__all__ = ["Live", "serve"]

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
