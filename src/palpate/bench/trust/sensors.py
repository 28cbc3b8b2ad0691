"""Random sensors: lines, areas and small groups of taxels, on half-spaces and glued layers, that measure stress,
strain or displacement.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

from palpate.elastic import BondedLayers, HalfSpace, Layer
from palpate.elastic.channels import find_channel
from palpate.elastic.pad import Floats, Pad
from palpate.sensing import AreaArray, AreaGrid, LineArray, LineGrid, Uncertainty
from palpate.sensing.grids import Grid
from palpate.skin import Skin

__all__ = ["Sensor", "random_sensor"]

_STRESS = ("stress_xz", "stress_yz", "stress_zz")
_STRAIN = ("strain_xz", "strain_yz", "strain_zz")
_MOVES = ("displacement_x", "displacement_y", "displacement_z")

#: Channels of a line, and their probabilities.
_LINES: dict[tuple[str, ...], float] = {
    ("stress_zz",): 0.40,
    ("stress_xz", "stress_zz"): 0.20,
    ("strain_zz",): 0.10,
    ("strain_xz", "strain_zz"): 0.06,
    ("displacement_z",): 0.12,
    ("displacement_x", "displacement_z"): 0.12,
}
#: Channels of an area and their probabilities; "gel" and "in plane" are marker displacements near the surface of a
#: glued gel.
_AREAS: dict[tuple[str, ...], float] = {
    ("stress_zz",): 0.28,
    _STRESS: 0.24,
    ("stress_xz", "stress_zz"): 0.04,
    ("stress_yz", "stress_zz"): 0.02,
    ("strain_zz",): 0.07,
    _STRAIN: 0.05,
    ("displacement_z",): 0.06,
    _MOVES: 0.14,
    _MOVES[:2]: 0.10,
}
#: Small groups of taxels: shape and channels, and their probabilities.
_TINY: dict[tuple[tuple[int, int], tuple[str, ...]], float] = {
    ((3, 3), ("stress_zz",)): 0.25,
    ((3, 5), ("stress_zz",)): 0.25,
    ((4, 4), _STRESS): 0.35,
    ((4, 4), ("stress_zz",)): 0.15,
}


@dataclass(frozen=True)
class Sensor:
    """A pad and its array as plain numbers, so that truth and description may differ.

    Attributes
    ----------
    kind : str
        "line", "area" or "tiny".
    shape, pitch, depth, aperture, channels
        Properties of the array; lengths in m.
    modulus, ratio : float
        Young's modulus [Pa] and Poisson's ratio of the pad (of its lowest layer).
    layers : tuple of (thickness [m], modulus over that of the pad)
        From the surface down to a rigid base; empty: a half-space.
    gel : bool
        Markers near the surface of a glued gel, as a camera sees them.
    """

    kind: str
    shape: tuple[int, ...]
    pitch: float
    depth: float
    aperture: float
    channels: tuple[str, ...]
    modulus: float
    ratio: float
    layers: tuple[tuple[float, float], ...] = ()
    gel: bool = False

    @property
    def sensing(self) -> str:
        """ "stress", "strain" or "displacement"."""
        return find_channel(self.channels[0]).kind.name

    @property
    def thickness(self) -> float:
        """Depth of the rigid base [m]; infinite without a base."""
        return sum(t for t, _ in self.layers) if self.layers else math.inf

    @property
    def shears(self) -> str:
        """Axes of shear that the channels separate from pressure."""
        if len(self.shape) == 1:
            return "x" if len(self.channels) > 1 else ""
        if len(self.channels) == 1:
            return ""
        return "".join(a for a in "xy" if any(find_channel(c).odd == a for c in self.channels))

    def skin(
        self,
        noise: Any = None,
        *,
        surface: Grid | None = None,
        uncertainty: Mapping[str, float] | None = None,
        limits: float | None = None,
    ) -> Skin:
        """Return the skin with this description. ``uncertainty`` is as `palpate.Uncertainty` accepts it, ``limits`` is
        the largest reading.
        """
        same: dict[str, Any] = {
            "pitch": self.pitch,
            "depth": self.depth,
            "channels": self.channels,
            "aperture": self.aperture,
            "noise": noise,
            "limits": limits,
        }
        array: LineArray | AreaArray
        if len(self.shape) == 1:
            array = LineArray(count=self.shape[0], **same)
        else:
            array = AreaArray(shape=(self.shape[0], self.shape[1]), **same)
        stated = Uncertainty(**uncertainty) if uncertainty else None
        return Skin(self._pad(), array, surface=surface, uncertainty=stated)

    def _pad(self) -> Pad:
        if not self.layers:
            return HalfSpace(youngs_modulus=self.modulus, poissons_ratio=self.ratio)
        return BondedLayers(
            [
                Layer(thickness=t, youngs_modulus=part * self.modulus, poissons_ratio=self.ratio)
                for t, part in self.layers
            ]
        )

    def fine_grid(self, low: Floats, high: Floats, finer: int) -> Grid:
        """Return cells ``finer`` times smaller than the pitch over the box from ``low`` to ``high`` (x, or x and y)
        [m].

        These cells do not coincide with those of the surface on which traction is estimated, so that the truth does not favour
        the estimate.
        """
        spacing = self.pitch / finer
        counts = [max(2, math.ceil((b - a) / spacing)) for a, b in zip(low, high)]
        centers = [float(0.5 * (a + b)) for a, b in zip(low, high)]
        if len(counts) == 1:
            return LineGrid(count=counts[0], spacing=spacing, center=centers[0])
        return AreaGrid(shape=(counts[1], counts[0]), spacing=spacing, center=(centers[0], centers[1]))

    def __str__(self) -> str:
        size = " x ".join(str(n) for n in self.shape)
        body = "half-space" if not self.layers else f"{len(self.layers)} layer{'s' if len(self.layers) > 1 else ''}"
        return (
            f"{self.kind} of {size}, {'+'.join(self.channels)}, depth {self.depth / self.pitch:.2g} pitches, {body}, "
            f"E {self.modulus:.3g} Pa, pitch {1e3 * self.pitch:.3g} mm"
        )


def _draw(rng: np.random.Generator, table: Mapping[Any, float]) -> Any:
    weights = np.array(list(table.values()))
    return list(table)[int(rng.choice(len(weights), p=weights / weights.sum()))]


def _log(rng: np.random.Generator, low: float, high: float) -> float:
    return float(np.exp(rng.uniform(math.log(low), math.log(high))))


def random_sensor(rng: np.random.Generator, suits: Callable[[Sensor], bool] = lambda s: True) -> Sensor:
    """Return a random sensor for which ``suits`` is true."""
    while True:
        found = _any_sensor(rng)
        if suits(found):
            return found


def _any_sensor(rng: np.random.Generator) -> Sensor:
    kind = str(rng.choice(["line", "area", "tiny"], p=[0.32, 0.48, 0.20]))
    modulus, ratio = _log(rng, 2e4, 3e6), float(rng.uniform(0.3, 0.5))
    if kind == "tiny":
        shape, channels = _draw(rng, _TINY)
        pitch = 4.7e-3 if rng.random() < 0.5 else _log(rng, 2e-3, 6e-3)
        depth = float(rng.uniform(2e-3, 4e-3)) * pitch / 4.7e-3
    elif kind == "line":
        shape, channels = (int(rng.integers(15, 41)),), _draw(rng, _LINES)
        pitch = _log(rng, 5e-4, 5e-3)
        depth = pitch * _log(rng, 0.5, 3.0)
    else:
        shape, channels = tuple(int(n) for n in rng.integers(6, 13, size=2)), _draw(rng, _AREAS)
        if rng.random() < 0.5:
            shape = (shape[0], shape[0])
        pitch = _log(rng, 1e-3, 5e-3)
        depth = pitch * _log(rng, 0.5, 3.0)
    wide = rng.random() < 0.4
    gel = kind == "area" and (channels == _MOVES[:2] or (channels == _MOVES and rng.random() < 0.5))
    layers: tuple[tuple[float, float], ...] = ()
    which = rng.random()
    if gel:
        # dots of a camera gel, which is glued to a window: near the surface
        thickness = pitch * float(rng.uniform(1.5, 4.0))
        depth, ratio = float(rng.choice([0.0, 0.1, 0.2])) * thickness, 0.48
        layers = ((thickness, 1.0),)
    elif which < 0.25 or (kind == "area" and channels == _MOVES):
        layers = ((depth * float(rng.uniform(1.2, 3.0)), 1.0),)
    elif which < 0.35:
        top = depth * float(rng.uniform(0.2, 0.8))
        layers = ((top, float(rng.uniform(1.5, 5.0))), (depth * float(rng.uniform(1.1, 3.0)) - top, 1.0))
    if layers:
        ratio = min(ratio, 0.495)
    # no wide taxels in layers: averaging over them takes seconds to prepare and changes little
    aperture = 0.7 * pitch if wide and not layers else 0.0
    return Sensor(kind, shape, pitch, depth, aperture, channels, modulus, ratio, layers, gel)
