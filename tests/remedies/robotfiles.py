"""LeRobot's datasets: columns, episodes, folders and versions; what a refusal says that they must be."""

from __future__ import annotations

import json
from functools import lru_cache
from pathlib import Path
from typing import Any

import numpy as np

import palpate as pp
from palpate.lerobot import Episode, add_columns, read_dataset, tactile_columns, write_dataset
from remedies._remedy import Remedy, value

__all__ = ["REMEDIES"]

ACTION = np.arange(6.0).reshape(3, 2)
SKIN = pp.Skin(
    pp.HalfSpace(youngs_modulus=2e5, poissons_ratio=0.48),
    pp.AreaArray(shape=(3, 3), pitch=2e-3, depth=2e-3, channels=["stress_zz"]),
)


def episode(**changed: Any) -> Episode:
    return Episode({"action": ACTION, **changed}, task="press")


def readings(frames: int) -> Any:
    return np.random.default_rng(0).uniform(1.0, 2.0, (frames, 1, 3, 3))


@lru_cache
def touch(frames: int | None = 3) -> pp.Touch:
    return SKIN.reconstruct(readings(3) if frames else readings(1)[0], method="tikhonov", parameter=1e-3)


def felt() -> Any:
    """The readings of an episode that was written with them."""
    return Episode(tactile_columns(touch(), name="thumb", readings=readings(3)))


def there() -> None:
    write_dataset("presses", [episode(), episode()], fps=30)


def older() -> None:
    """As a dataset of version 2.1 says of itself."""
    there()
    file = Path("presses/meta/info.json")
    info = json.loads(file.read_text(encoding="utf-8"))
    file.write_text(json.dumps({**info, "codebase_version": "v2.1"}), encoding="utf-8")


def added(first: Any, second: Any, target: str = "felt") -> Any:
    return add_columns("presses", target, [{"wrench": first}, {"wrench": second}])


WRENCH = np.ones((3, 6))

REMEDIES = [
    value("an episode needs at least one column", lambda c: Episode(c), {}, {"action": ACTION}),
    value("must hold one entry for each frame, of", lambda v: episode(note=v), ["a", "b", "c"], [1, 2, 3]),
    value(
        "axes after the frame axis; the LeRobot format allows at most 5",
        lambda s: episode(cube=np.ones(s)),
        (3,) + (1,) * 6,
        (3, 1),
    ),
    Remedy(
        "is the format's own; leave it out",
        lambda: episode(timestamp=np.arange(3.0)),
        episode,
    ),
    value("all columns must have one entry for each frame", lambda n: episode(state=np.ones(n)), 4, 3),
    value(
        "the episode has no readings of",
        lambda name: felt().recording(name, ["stress_zz"]),
        "finger",
        "thumb",
        right=lambda r: r.readings.shape == (3, 1, 3, 3),
    ),
    Remedy(
        "touch must hold frames, values",
        lambda: tactile_columns(touch(None)),
        lambda: tactile_columns(SKIN.reconstruct(readings(1), method="tikhonov", parameter=1e-3)),
    ),
    value("readings must hold the {} frames", lambda n: tactile_columns(touch(), readings=readings(n)), 2, 3),
    value("fps must be a positive whole number", lambda v: write_dataset("new", [episode()], fps=v), 29.97, 30),
    value("episodes is empty", lambda v: write_dataset("new", v, fps=30), [], [episode()]),
    value(
        "is there already: choose a new folder, or add_columns",
        lambda name: write_dataset(name, [episode()], fps=30),
        "presses",
        "more",
        given=there,
    ),
    Remedy(
        "has other columns, shapes or kinds than the first",
        lambda: write_dataset("new", [episode(), episode(state=np.ones(3))], fps=30),
        lambda: write_dataset("new", [episode(state=np.zeros(3)), episode(state=np.ones(3))], fps=30),
        right=lambda path: len(read_dataset(path).episodes) == 2,
    ),
    Remedy(
        "the format cannot hold an axis of length 0",
        lambda: write_dataset("new", [episode(nothing=np.ones((3, 0)))], fps=30),
        lambda: write_dataset("other", [episode()], fps=30),
    ),
    Remedy(
        "columns must be given for each of {} episodes",
        lambda: add_columns("presses", "felt", [{"wrench": WRENCH}]),
        lambda: added(WRENCH, WRENCH),
        given=there,
    ),
    value(
        "the episodes have different columns, shapes or kinds",
        lambda v: added(WRENCH, v),
        np.ones((3, 3)),
        WRENCH,
        given=there,
    ),
    value(
        "is there already: choose a new folder.",
        lambda name: added(WRENCH, WRENCH, name),
        "presses",
        "felt",
        given=there,
    ),
    value("its columns have {}. Give one entry", lambda n: added(np.ones((n, 6)), np.ones((n, 6))), 2, 3, given=there),
    value("holds no LeRobot dataset", read_dataset, "presses/data", "presses", given=there),
]
