"""Determine how much memory is free, and refuse work that needs more.

Estimates are beside the code whose memory they describe; this module only compares. Allocating too much memory does
not fail at once: later the system kills the program, or another one. So the estimate is made from sizes alone, before
any work.
"""

from __future__ import annotations

import os
from pathlib import Path

from palpate.errors import Unsupported

__all__ = ["SHARE", "SMALL", "available", "gigabytes", "require"]

#: Fraction of the free memory that may be used: the rest of the program, and other programs, need some.
SHARE = 0.9
#: For less than this [bytes] free memory is not checked.
SMALL = 50_000_000


def available() -> int | None:
    """Bytes that can still be allocated: the least that the machine, the control group and the process's own limit leave; None if unknown."""
    found = [v for v in (_machine(), *_control_groups(), _address_space()) if v is not None]
    return max(0, min(found)) if found else None


def require(peak: float, what: str, remedy: str) -> None:
    """Raise `Unsupported` if ``peak`` bytes are not free.

    Parameters
    ----------
    peak : float
        The most that is allocated at a time, estimated from sizes.
    what, remedy : str
        The work that needs the memory, and what to do with this input instead.
    """
    if peak < SMALL:
        return
    free = available()
    if free is not None and peak > SHARE * free:
        raise Unsupported(f"{what} need about {gigabytes(peak)} of memory, and {gigabytes(free)} are free. {remedy}")


def gigabytes(size: float) -> str:
    return f"{size / 1e9:.1f} GB" if size >= 1e9 else f"{size / 1e6:.0f} MB"


def _machine() -> int | None:
    for line in _text(Path("/proc/meminfo")).splitlines():
        if line.startswith("MemAvailable:"):
            return int(line.split()[1]) * 1024
    sizes: dict[str, int] = getattr(os, "sysconf_names", {})
    # macOS reports the total, not the free memory
    pages = next((n for n in ("SC_AVPHYS_PAGES", "SC_PHYS_PAGES") if n in sizes), None)
    return None if pages is None else os.sysconf(pages) * os.sysconf("SC_PAGE_SIZE")


def _control_groups() -> list[int | None]:
    """Memory left by the control groups of the process (Linux: containers, job systems), with their file cache counted as free."""
    left: list[int | None] = []
    for line in _text(Path("/proc/self/cgroup")).splitlines():
        _, controllers, name = (*line.split(":", 2), "", "")[:3]
        if controllers not in ("", "memory") and "memory" not in controllers.split(","):
            continue
        root = Path("/sys/fs/cgroup" if not controllers else "/sys/fs/cgroup/memory")
        limit, usage = (
            ("memory.max", "memory.current") if not controllers else ("memory.limit_in_bytes", "memory.usage_in_bytes")
        )
        here = root / name.strip("/")
        # in a container the name may be that of the host: its own group is then the root
        for folder in [here, *here.parents]:
            if not folder.is_relative_to(root):
                break
            most, used = _number(folder / limit), _number(folder / usage)
            if most is not None and used is not None:
                left.append(most - used + _file_cache(folder))
    return left


def _file_cache(folder: Path) -> int:
    for line in _text(folder / "memory.stat").splitlines():
        name, _, value = line.partition(" ")
        if name in ("inactive_file", "total_inactive_file") and value.isdigit():
            return int(value)
    return 0


def _address_space() -> int | None:
    try:
        import resource
    except ImportError:  # not on Windows
        return None
    most = resource.getrlimit(resource.RLIMIT_AS)[0]
    used = _text(Path("/proc/self/statm")).split()
    if most == resource.RLIM_INFINITY or not used:
        return None
    return most - int(used[0]) * resource.getpagesize()


def _number(path: Path) -> int | None:
    text = _text(path).strip()
    return int(text) if text.isdigit() else None  # "max": no limit


def _text(path: Path) -> str:
    try:
        return path.read_text(encoding="utf-8")
    except OSError:
        return ""
