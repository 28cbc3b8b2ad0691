"""The page's server: Starlette on this machine, with one binary WebSocket that only ever sends the newest packet.

It listens on this machine only (127.0.0.1) unless another host is given, and answers only requests that bring the
token, as notebooks do, because other users and programs of this machine reach 127.0.0.1 too. Without a token it only
answers requests under a name of this machine, so that a foreign name that resolves to 127.0.0.1 (DNS rebinding) gets
nothing. It refuses pages of another origin and messages of more than a kilobyte. A page that does not read for
`STALLED` seconds is disconnected; `palpate.live.connections` limits idle connections.
"""

from __future__ import annotations

import asyncio
import contextlib
import ipaddress
import json
import logging
import secrets
import socket as sockets
import time
from collections import deque
from collections.abc import AsyncIterator, Iterable, Sequence
from pathlib import Path
from typing import Any
from urllib.parse import quote, urlsplit

from palpate._extras import missing
from palpate.errors import InvalidInput, PalpateError
from palpate.grasp import GraspMonitor
from palpate.live.connections import BACKLOG, OPEN, Connections, accept_failures_are_warnings, bounded, seldom
from palpate.live.session import Session
from palpate.recordings import Sink
from palpate.skin import Skin

__all__ = ["BUDGET", "LOCAL", "Live", "address", "is_local", "serve", "show"]

#: Names of this machine.
LOCAL = ("127.0.0.1", "localhost", "::1")
#: Time in which a live view should process a frame [s].
BUDGET = 0.02

STATIC = Path(__file__).parent / "static"
#: Files of the page besides the page itself; uPlot draws the charts (MIT licence, in its folder).
PAGE_FILES = ("live.js", "map.js", "readings.js", "charts.js", "live.css", "uplot/uplot.js", "uplot/uplot.css")
MEDIA_TYPES = {"js": "text/javascript", "css": "text/css"}
#: Largest message that a page may send [bytes].
LARGEST = 1024
#: Largest number of pages that are open at the same time.
PAGES = 16
#: A page that does not read for this long is disconnected [s].
STALLED = 10.0
#: Seconds between reports of refused packets, and largest number of recordings that pages may start in a minute.
REPORT, RECORDINGS = 1.0, 60
_SAFE = {
    "Content-Security-Policy": "default-src 'self'; connect-src 'self' ws: wss:; img-src 'self' data:; frame-ancestors 'none'",
    "X-Content-Type-Options": "nosniff",
    "Referrer-Policy": "no-referrer",
    "Cache-Control": "no-store",
}


class Live:
    """The web application for a session: a server runs ``app``.

    Parameters
    ----------
    session : Session
    token : str, optional
        What a page must send as ``?token=...`` or ``Authorization: Bearer ...``; default: a random one (``live.token``). ``""`` requires none:
        anybody on this machine may then look, under this machine's own names (localhost, 127.0.0.1, ::1), and no page may request a new zero.
    folder : str or Path, optional
        Folder of recordings that the page starts; without it the page cannot record.
    """

    def __init__(self, session: Session, *, token: str | None = None, folder: str | Path | None = None) -> None:
        try:
            from starlette.applications import Starlette
            from starlette.responses import FileResponse, JSONResponse
            from starlette.routing import Route, WebSocketRoute
        except ImportError as error:
            raise missing("live pages", error) from error
        self.session, self.token = session, secrets.token_urlsafe(16) if token is None else token
        self.folder = None if folder is None else Path(folder)
        self.refused: dict[str, int] = {}
        self._begun: deque[float] = deque()
        self.pages = 0

        @contextlib.asynccontextmanager
        async def lifespan(_: Any) -> AsyncIterator[None]:
            accept_failures_are_warnings(asyncio.get_running_loop(), logging.getLogger("palpate.live"))
            session.start()
            yield
            await asyncio.to_thread(session.stop)

        def page(name: str, kind: str) -> Any:
            async def send(request: Any) -> Any:
                if name == "index.html" and not self._admitted(request):
                    return self._refuse("token", JSONResponse({"error": "this page needs its token: ?token=..."}, 403))
                return FileResponse(STATIC / name, media_type=kind, headers=_SAFE)

            return send

        async def health(request: Any) -> Any:
            if not self._admitted(request):
                return self._refuse("token", JSONResponse({"error": "this needs the token: ?token=..."}, 403))
            known = session.tracker.health
            return JSONResponse(
                {
                    "frames": known.frames,
                    "late": known.late,
                    "approximate": known.approximate,
                    "behind": session.behind,
                    "pages": self.pages,
                    "refused": self.refused,
                    **session.state(),
                },
                headers=_SAFE,
            )

        async def stream(socket: Any) -> None:
            reason = self._unwelcome(socket.headers.get("origin"), socket.headers.get("host"))
            if reason is None and not self._admitted(socket):
                reason = "token"
            if reason is None and self.pages >= PAGES:
                reason = "pages"
            if reason is not None:
                self._refuse(reason)
                await socket.close(1008, reason)
                return
            await socket.accept()
            self.pages += 1
            try:
                await self._serve(socket)
            finally:
                self.pages -= 1

        inner = Starlette(
            routes=[
                Route("/", page("index.html", "text/html")),
                *(
                    Route(f"/{path.rsplit('/')[-1]}", page(path, MEDIA_TYPES[path.rsplit(".")[-1]]))
                    for path in PAGE_FILES
                ),
                Route("/health", health),
                WebSocketRoute("/stream", stream),
            ],
            lifespan=lifespan,
        )

        async def app(scope: Any, receive: Any, send: Any) -> None:
            if scope["type"] in ("http", "websocket") and not self._known(scope):
                self._refuse("host")
                if scope["type"] == "http":
                    text = "without a token this page is only at http://127.0.0.1 and http://localhost"
                    await JSONResponse({"error": text}, 421)(scope, receive, send)
                else:
                    await send({"type": "websocket.close", "code": 1008, "reason": "host"})
                return
            await inner(scope, receive, send)

        self.app = app

    def _known(self, scope: Any) -> bool:
        """Return whether a request used a name of this machine; with a token the name does not matter."""
        if self.token:
            return True
        hosts = [value.decode("latin-1") for key, value in scope["headers"] if key == b"host"]
        return len(hosts) == 1 and is_local(hosts[0])

    def _refuse(self, why: str, answer: Any = None) -> Any:
        self.refused[why] = self.refused.get(why, 0) + 1
        return answer

    def _admitted(self, request: Any) -> bool:
        """Return whether a request has the token, in its address or its header."""
        token = request.query_params.get("token")
        kind, _, bearer = request.headers.get("authorization", "").partition(" ")
        if token is None and kind.lower() == "bearer":
            token = bearer.strip()
        return not self.token or (token is not None and secrets.compare_digest(token.encode(), self.token.encode()))

    @staticmethod
    def _unwelcome(origin: str | None, host: str | None) -> str | None:
        """Return "origin" if the page of a request comes from another origin, else None. A malformed origin counts as
        another.
        """
        if origin is None:
            return None
        try:
            return None if urlsplit(origin).netloc == host else "origin"
        except ValueError:
            return "origin"

    async def _serve(self, socket: Any) -> None:
        from starlette.websockets import WebSocketDisconnect

        session = self.session
        loop, fresh = asyncio.get_running_loop(), asyncio.Event()
        answers: deque[dict[str, Any]] = deque(maxlen=PAGES)

        def wake() -> None:
            with contextlib.suppress(RuntimeError):  # the loop may have ended
                loop.call_soon_threadsafe(fresh.set)

        async def send(what: dict[str, Any] | bytes) -> None:
            # a page that never reads is disconnected
            async with asyncio.timeout(STALLED):
                await (socket.send_bytes(what) if isinstance(what, bytes) else socket.send_text(json.dumps(what)))

        end = session.listen(wake)
        listener = asyncio.create_task(self._listen(socket, answers, fresh))
        try:
            layout = session.layout()
            sent, noted, state, reported = -1, layout["noted"], session.state(), time.monotonic()
            await send({**layout, "may_record": self.folder is not None, "may_zero": bool(self.token), "state": state})
            while not listener.done():
                waiting = asyncio.create_task(fresh.wait())
                await asyncio.wait({waiting, listener}, timeout=REPORT, return_when=asyncio.FIRST_COMPLETED)
                waiting.cancel()
                fresh.clear()
                while answers:
                    await send(answers.popleft())
                news = session.state()
                urgent = any(news[k] != state[k] for k in ("failure", "ended", "recording", "sender"))
                if urgent or (news != state and time.monotonic() - reported >= REPORT):
                    state, reported = news, time.monotonic()
                    await send({"state": state})
                noted, texts = session.noted(noted)
                if texts:
                    await send({"log": texts})
                if session.packet is not None and session.count != sent:
                    # send only the newest packet, and the next one only when this one is sent: nothing queues up
                    sent = session.count
                    await send(session.packet)
        except TimeoutError:
            self._refuse("stalled")
        except (WebSocketDisconnect, RuntimeError):
            pass
        finally:
            end()
            listener.cancel()
            with contextlib.suppress(asyncio.CancelledError, WebSocketDisconnect, RuntimeError):
                await listener

    async def _listen(self, socket: Any, answers: deque[dict[str, Any]], fresh: asyncio.Event) -> None:
        """Handle the page's requests: start or stop a recording, take a new zero. Anything else is counted and
        ignored.
        """
        while True:
            message = await socket.receive()
            if message["type"] == "websocket.disconnect":
                return
            text = message.get("text")
            try:
                if text is None or len(text) > LARGEST:
                    raise ValueError("not a short text")
                wish = json.loads(text)
                if wish == {"zero": True} and self.token:
                    self.session.rezero()
                    await asyncio.sleep(0)
                    continue
                record = wish["record"]
                if not isinstance(record, bool):
                    raise ValueError("record must be true or false")
            except (ValueError, KeyError, TypeError, RecursionError):
                self._refuse("message")
                await asyncio.sleep(0)  # let other tasks run even if a page sends many of these
                continue
            try:
                name = await asyncio.to_thread(self.session.record, self._path() if record else None)
                answers.append({"recording": name})
            except PalpateError as error:
                answers.append({"refused": str(error), "recording": self.session.recording})
            fresh.set()

    def _path(self) -> Path:
        """Return the path of the next recording, which never is an existing file."""
        if self.folder is None:
            raise InvalidInput("recording from the page is off: start with --record-to FOLDER.")
        now = time.monotonic()
        while self._begun and now - self._begun[0] > 60.0:
            self._begun.popleft()
        if len(self._begun) >= RECORDINGS:
            self._refuse("recordings")
            raise InvalidInput(f"{RECORDINGS} recordings were begun in the last minute; wait a little.")
        self._begun.append(now)
        stem = time.strftime("palpate-%Y%m%d-%H%M%S")
        names = (f"{stem}.mcap" if i == 1 else f"{stem}-{i}.mcap" for i in range(1, 10_000))
        return next(path for path in map(self.folder.joinpath, names) if not path.exists())


def is_local(host: str) -> bool:
    """Whether a Host header names this machine: localhost or a loopback address, with a port or without.

    >>> is_local("localhost:8765"), is_local("[::1]:8765"), is_local("evil.example:8765")
    (True, True, False)
    """
    try:
        name = urlsplit(f"//{host}").hostname or ""
        return name == "localhost" or ipaddress.ip_address(name).is_loopback
    except ValueError:
        return False


def address(live: Live, host: str, port: int) -> str:
    """Return the address to open in a browser."""
    query = f"?token={quote(live.token)}" if live.token else ""
    return f"http://{f'[{host}]' if ':' in host else host}:{port}/{query}"


def serve(live: Live, *, host: str = "127.0.0.1", port: int = 8765) -> None:
    """Serve the live view until interrupted."""
    try:
        import uvicorn
        from uvicorn.protocols.http.h11_impl import H11Protocol
    except ImportError as error:
        raise missing("live pages", error) from error
    if host not in LOCAL and not live.token:
        raise InvalidInput(
            f"host {host} opens the page to other machines: give a token, which they must send (?token=...)."
        )

    logger = logging.getLogger("palpate.live")

    def crowded() -> None:
        live.refused["connections"] = live.refused.get("connections", 0) + 1
        logger.warning("%d connections are open, the most that the page takes: the oldest was closed.", OPEN)

    family = sockets.AF_INET6 if ":" in host else sockets.AF_INET
    with sockets.socket(family, sockets.SOCK_STREAM) as bound:
        bound.setsockopt(sockets.SOL_SOCKET, sockets.SO_REUSEADDR, 1)
        if hasattr(sockets, "TCP_USER_TIMEOUT"):
            # disconnect a page that does not read for this long; the library alone would not
            bound.setsockopt(sockets.IPPROTO_TCP, sockets.TCP_USER_TIMEOUT, round(1e3 * STALLED))
        try:
            bound.bind((host, port))
        except OSError as error:
            raise InvalidInput(f"cannot listen on {host}:{port} ({error.strerror}).") from error
        config = uvicorn.Config(
            live.app, http=bounded(H11Protocol, Connections(crowded, limit=OPEN)), backlog=BACKLOG, log_level="warning",
            ws_max_size=LARGEST, ws_per_message_deflate=False, timeout_graceful_shutdown=5,
        )  # fmt: skip
        with contextlib.suppress(KeyboardInterrupt), seldom(logger, logging.getLogger("uvicorn.error")):
            uvicorn.Server(config).run(sockets=[bound])


def show(
    skin: Skin,
    frames: Iterable[tuple[float, Any]],
    *,
    monitor: GraspMonitor | None = None,
    sinks: Sequence[Sink] = (),
    name: str = "",
    host: str = "127.0.0.1",
    port: int = 8765,
    token: str | None = None,
    **tracking: Any,
) -> None:
    """Show frames, given as (time [s], readings), in the browser until interrupted.

    Parameters
    ----------
    skin : Skin
    frames : iterable of (float, array)
        A generator that waits for its sensor, for example.
    monitor : GraspMonitor, optional
        Default: one with the same friction.
    sinks : sequence of Sink
        Other receivers of the stream: a `palpate.recordings.recorder`, a `FoxgloveServer`, a `RerunSink`.
    name : str
        Shown on the page.
    host, port
        Where the page is; this machine alone by default.
    token : str, optional
        What a page must send; default: a random one. ``""`` requires none, on this machine only. The address to open is
        logged (``logging.getLogger("palpate.live")``).
    **tracking
        Options of `Skin.track`, such as ``friction`` and ``baseline``; the default ``budget`` suits a page.

    Raises
    ------
    InvalidInput, Unsupported
        A host open to others without a token, a port that is taken, or what `Skin.track` refuses.
    """
    if host not in LOCAL and token == "":
        raise InvalidInput(
            f"host {host} opens the page to other machines: give a token, which they must send (?token=...)."
        )
    tracker = skin.track(**{"budget": BUDGET, **tracking})
    monitor = GraspMonitor(friction=tracking.get("friction")) if monitor is None else monitor
    session = Session(skin, lambda: frames, tracker, monitor, name=name, pace=False, sinks=sinks)
    live = Live(session, token=token)
    logging.getLogger("palpate.live").warning("open %s", address(live, host, port))
    serve(live, host=host, port=port)
