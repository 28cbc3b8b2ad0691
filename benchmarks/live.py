"""From source to screen: the live page in headless Chromium, its latency, and its screenshots.

python benchmarks/live.py [--rate 200] [--size 32] [--seconds 60 | --painted 100] [--shots FOLDER]

Without --rate, what ``palpate live --demo`` shows. With it, a recording of --size x --size x 3 at that rate, friction known. Prints
frames in, reconstructed and painted, and the latency from the frame's birth to the end of its painting (one clock); the last line is the
same as JSON. Needs Chromium. One thread for arithmetic: set OPENBLAS_NUM_THREADS=1.
"""

from __future__ import annotations

import argparse
import asyncio
import base64
import contextlib
import json
import shutil
import socket
import subprocess
import tempfile
import threading
import time
import urllib.request
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import uvicorn
import websockets

import palpate as pp
from palpate import simulation
from palpate.live import Live, Session

#: Seconds after which a page that shows nothing is given up.
PATIENCE = 120.0


def free_port() -> int:
    with socket.socket() as s:
        s.bind(("127.0.0.1", 0))
        return int(s.getsockname()[1])


def make_session(rate: float | None, size: int) -> Session:
    if rate is None:
        skin, source = simulation.demonstration()
    else:
        pad = pp.HalfSpace(youngs_modulus=2e5, poissons_ratio=0.48)
        array = pp.AreaArray(
            shape=(size, size), pitch=1e-3, depth=2e-3, channels=["stress_xz", "stress_yz", "stress_zz"]
        )
        skin = pp.Skin(pad, array)
        story = [
            (f.time, np.asarray(f.readings, dtype=np.float32))
            for f in simulation.stream(
                skin, simulation.handling(1.0, 0.05e-3 * size), friction=0.6, radius=20e-3, rate=min(rate, 200.0)
            )
        ]
        noise = np.float32(0.01 * max(float(np.abs(r).max()) for _, r in story))
        rng = np.random.default_rng(0)
        spread = [noise * rng.standard_normal(story[0][1].shape).astype(np.float32) for _ in range(64)]
        repeat = max(1, round(rate / 200.0))

        def source() -> Iterator[tuple[float, Any]]:
            i = 0
            for _, reading in story:
                for _ in range(repeat):
                    yield i / rate, reading + spread[i % 64]
                    i += 1

    tracker = skin.track(friction=0.6, baseline=20, budget=0.02 if rate is None else 0.8 / rate)
    return Session(skin, source, tracker, pp.GraspMonitor(friction=0.6), name="benchmark", loop=True)


class Browser:
    """Headless Chromium, spoken to over its debugging protocol."""

    def __init__(self) -> None:
        program = shutil.which("chromium") or shutil.which("chromium-browser") or shutil.which("google-chrome")
        if program is None:
            raise SystemExit("no Chromium on this machine.")
        self.port, self.folder = free_port(), tempfile.mkdtemp()
        self.process = subprocess.Popen(
            [
                program, "--headless=new", "--no-sandbox", "--disable-gpu", "--hide-scrollbars", "--no-first-run",
                f"--remote-debugging-port={self.port}", f"--user-data-dir={self.folder}", "about:blank",
            ],
            stdout=subprocess.DEVNULL,
            stderr=subprocess.DEVNULL,
        )  # fmt: skip
        self.count, self.errors = 0, []  # type: ignore[var-annotated]

    async def open(self) -> None:
        for _ in range(200):
            with contextlib.suppress(OSError, IndexError, StopIteration):
                with urllib.request.urlopen(f"http://127.0.0.1:{self.port}/json/list", timeout=2) as answer:
                    target = next(t for t in json.load(answer) if t["type"] == "page")
                self.socket = await websockets.connect(target["webSocketDebuggerUrl"], max_size=2**26)
                await self("Runtime.enable")
                await self("Page.enable")
                return
            await asyncio.sleep(0.1)
        raise SystemExit("Chromium did not answer.")

    async def __call__(self, method: str, **params: Any) -> Any:
        self.count += 1
        await self.socket.send(json.dumps({"id": self.count, "method": method, "params": params}))
        while True:
            message = json.loads(await self.socket.recv())
            if message.get("method") == "Runtime.exceptionThrown":
                self.errors.append(message["params"]["exceptionDetails"].get("text", ""))
            if message.get("id") == self.count:
                return message.get("result", {})

    async def value(self, script: str) -> Any:
        found = await self("Runtime.evaluate", expression=script, returnByValue=True)
        return found.get("result", {}).get("value")

    async def until(self, condition: str, seconds: float) -> bool:
        """Whether a condition of the page came true in time."""
        deadline = time.monotonic() + seconds
        while not await self.value(condition):
            if time.monotonic() > deadline:
                return False
            await asyncio.sleep(0.05)
        return True

    async def shot(self, path: Path, address: str, width: int, height: int) -> None:
        await self("Emulation.setDeviceMetricsOverride", width=width, height=height, deviceScaleFactor=1, mobile=False)
        await self("Page.navigate", url=address)
        await self.until("palpate.painted > 2", PATIENCE)
        # the moment to show is when slip is announced
        await self.until("!document.getElementById('alarm').hidden", 8.0)
        await asyncio.sleep(0.2)
        await self.picture(path)

    async def press(self, key: str, code: int, *, text: str = "", times: int = 1) -> None:
        for _ in range(times):
            await self("Input.dispatchKeyEvent", type="keyDown", key=key, windowsVirtualKeyCode=code, text=text)
            await self("Input.dispatchKeyEvent", type="keyUp", key=key, windowsVirtualKeyCode=code)

    async def picture(self, path: Path) -> None:
        found = await self("Page.captureScreenshot", format="png")
        path.write_bytes(base64.b64decode(found["data"]))

    def close(self) -> None:
        self.process.terminate()
        self.process.wait(timeout=20)
        shutil.rmtree(self.folder, ignore_errors=True)


async def watch(
    address: str, session: Session, seconds: float, enough: int | None, shots: Path | None, axe: Path | None
) -> dict[str, Any]:
    browser = Browser()
    try:
        await browser.open()
        await browser("Page.navigate", url=address)
        await browser.until("palpate.painted > 2", PATIENCE)
        await asyncio.sleep(1.0)
        begun = time.monotonic()
        before = (
            session.count,
            session.behind,
            await browser.value("palpate.painted"),
            await browser.value("palpate.received"),
        )
        await browser.value("palpate.latencies.length = 0")
        if enough is None:
            await asyncio.sleep(seconds)
        else:
            await browser.until(f"palpate.painted >= {before[2] + enough}", PATIENCE)
        painted = await browser.value("palpate.painted")
        found = {
            "seconds": time.monotonic() - begun,
            "reconstructed": session.count - before[0],
            "skipped": session.behind - before[1],
            "received": await browser.value("palpate.received") - before[3],
            "painted": painted - before[2],
            "latency_p50_ms": await browser.value("palpate.latency(0.5)"),
            "latency_p99_ms": await browser.value("palpate.latency(0.99)"),
            "failures": await browser.value("palpate.failures"),
            "approximate": session.tracker.health.approximate,
        }
        if shots is not None:
            for theme in ("light", "dark"):
                for width, height in ((1280, 680), (400, 1420)):
                    await browser.shot(shots / f"live-{theme}-{width}.png", f"{address}?theme={theme}", width, height)
        await browser("Emulation.setDeviceMetricsOverride", width=1280, height=720, deviceScaleFactor=1, mobile=False)
        await browser("Page.navigate", url=address)
        await browser.until("palpate.painted > 10", PATIENCE)
        switched = await by_switch(browser, address)
        found["keys"] = {**await by_keys(browser), **switched}
        if shots is not None:
            await browser.picture(shots / "live-looking-back.png")
        found["cut off"] = await cut_off(browser)
        if axe is not None:
            found["axe"] = await checked(browser, address, axe)
        found["errors"] = browser.errors
        return found
    finally:
        browser.close()


async def by_switch(browser: Browser, address: str) -> dict[str, Any]:
    """Single keys switched off do nothing, also when the page is opened again; and they act again when they are switched on."""
    theme, checked_ = "document.documentElement.dataset.theme", "document.getElementById('keys').ariaChecked"
    before = await browser.value(theme)
    await browser.value("document.getElementById('keys').click(); 0")
    off: dict[str, Any] = {"checked": await browser.value(checked_)}
    await browser.press("t", 84, text="t")
    await browser.press(" ", 32, text=" ")
    off["theme"] = before != await browser.value(theme)
    off["space"] = await browser.value("document.getElementById('pause').textContent")
    await browser("Page.navigate", url=address)
    await browser.until("palpate.painted > 10", PATIENCE)
    off["kept"] = await browser.value(checked_)
    await browser.value("document.getElementById('keys').click(); document.activeElement.blur(); 0")
    await browser.press("t", 84, text="t")
    on = before != await browser.value(theme)
    await browser.press("t", 84, text="t")
    return {"switched off": off, "switched on": on}


async def by_keys(browser: Browser) -> dict[str, Any]:
    """What the page does for somebody without a mouse: it stays paused, looking back."""
    found: dict[str, Any] = {}
    theme = "document.documentElement.dataset.theme"
    before = await browser.value(theme)
    await browser.press("t", 84, text="t")
    found["theme"] = before != await browser.value(theme)
    await browser.press("t", 84, text="t")
    reached = []
    for _ in range(6):
        await browser.press("Tab", 9)
        reached.append(await browser.value("document.activeElement.id"))
    found["tab"] = [name for name in reached if name]
    await browser.value("document.activeElement.blur(); 0")
    await browser.press(" ", 32, text=" ")
    found["space"] = await browser.value("document.getElementById('pause').textContent")
    found["paused"] = await browser.value("document.getElementById('ago').textContent")
    await browser.press("ArrowLeft", 37, times=5)
    # resumed where no other frame ever comes, the page shows the last one; what is looked through does not move on
    await browser.value("window.kept = palpate.socket.onmessage; palpate.socket.onmessage = null; 0")
    await browser.press(" ", 32, text=" ")
    found["resumed"] = await browser.until("shown === frames[frames.length - 1]", 10.0)
    await browser.value("palpate.socket.onmessage = window.kept; 0")
    await browser.press(" ", 32, text=" ")
    at = await browser.value("shown.time")
    await browser.until("frames[frames.length - 1] !== held.frames[held.frames.length - 1]", PATIENCE)
    await browser.press("ArrowLeft", 37)
    await browser.press("ArrowRight", 39, times=3)
    found["still"] = at == await browser.value("shown.time")
    await browser.press("ArrowLeft", 37, times=5)
    found["back"] = await browser.value("document.getElementById('ago').textContent")
    await asyncio.sleep(0.3)  # charts are drawn at the next turn
    # the time axis ends with the frame that is shown
    found["axis"] = await browser.value(
        "charts.forces.scales.x.max === shown.time && shown !== frames[frames.length - 1]"
    )
    return found


async def cut_off(browser: Browser) -> dict[str, Any]:
    """What the page says while it has no connection, and that this ends."""
    said = "/connection is lost/.test(document.getElementById('alarm').textContent)"
    await browser.value("palpate.socket.close(); 0")
    lost = await browser.until(f"{said} && document.getElementById('zero').disabled", PATIENCE)
    return {"lost": lost, "again": await browser.until(f"palpate.connected && !{said}", PATIENCE)}


async def checked(browser: Browser, address: str, axe: Path) -> dict[str, list[str]]:
    """What axe-core finds, while the page runs."""
    found = {}
    await browser("Page.setBypassCSP", enabled=True)
    for theme in ("light", "dark"):
        for width in (1280, 400):
            await browser(
                "Emulation.setDeviceMetricsOverride", width=width, height=900, deviceScaleFactor=1, mobile=False
            )
            await browser("Page.navigate", url=f"{address}?theme={theme}")
            await browser.until("window.palpate && palpate.painted > 2", PATIENCE)
            await browser.value(axe.read_text() + "; 0")
            await browser.value("axe.run().then((r) => { window.found = r; }); 0")
            await browser.until("window.found !== undefined", PATIENCE)
            found[f"{theme} {width}"] = await browser.value(
                "found.violations.map((v) => `${v.id} (${v.impact}): ${v.nodes.map((n) => n.target.join(' ')).join(', ')}`)"
            )
    return found


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--rate", type=float)
    parser.add_argument("--size", type=int, default=32)
    parser.add_argument("--seconds", type=float, default=60.0)
    parser.add_argument("--painted", type=int, help="stop after so many pictures instead")
    parser.add_argument("--shots", type=Path)
    parser.add_argument("--axe", type=Path, help="axe.min.js of axe-core: what it finds in both themes and widths")
    args = parser.parse_args()
    session = make_session(args.rate, args.size)
    port = free_port()
    live = Live(session, token="")
    server = uvicorn.Server(
        uvicorn.Config(
            live.app, host="127.0.0.1", port=port, log_level="warning", ws_max_size=1024, ws_per_message_deflate=False
        )
    )
    thread = threading.Thread(target=server.run, daemon=True)
    thread.start()
    while not server.started:
        time.sleep(0.05)
    if args.shots is not None:
        time.sleep(4.0)
    found = asyncio.run(watch(f"http://127.0.0.1:{port}/", session, args.seconds, args.painted, args.shots, args.axe))
    server.should_exit = True
    thread.join(timeout=20)
    due = found["reconstructed"] + found["skipped"]
    print(
        f"{due} frames in {found['seconds']:.1f} s, {found['reconstructed']} reconstructed ({found['approximate']} approximately), "
        f"{found['skipped']} skipped as late, {found['received']} received, {found['painted']} painted; birth to paint p50 "
        f"{found['latency_p50_ms']:.0f} ms, p99 {found['latency_p99_ms']:.0f} ms"
    )
    print(json.dumps(found))


if __name__ == "__main__":
    main()
