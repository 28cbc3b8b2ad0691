"""Arrays on pads, the contacts they meet, and the yardstick.

The yardstick is the clairvoyant Wiener filter: the linear shift-invariant filter with the least expected error for one contact,
given that contact's true power spectrum and the noise, on the array's own field repeated for ever. With fine wavevectors k + K
that alias to the k of the taxels, response H, cell average C = sinc, power P per component,

    E |error|^2 = sum_k  S - A (B + sigma^2 N)^{-1} A*,   S = sum_K C^2 P,  A = sum_K C P H*,  B = sum_K H P H*

which is the mean over the contact's position within a cell. No linear filter that does not know where the contact is does
better. Data are made on a surface ten (line) or six (area) times finer than the one sought, and wider.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from palpate._arrays import fftn
from palpate._threads import cached_property
from palpate.bench.contacts import (
    AREA_PATCHES,
    CROSSING,
    FRICTION,
    LINE_CONTACTS,
    SHEARED,
    Traction,
    area_contact,
    line_contact,
)
from palpate.elastic import BondedLayers, HalfSpace, Layer
from palpate.elastic.pad import Floats, Pad
from palpate.elastic.quantities import transfer
from palpate.errors import Unsupported
from palpate.sensing import AreaArray, LineArray, ScatteredArray
from palpate.sensing.arrays import Array
from palpate.sensing.grids import block_means, refined
from palpate.sensing.uncertainty import EXACT
from palpate.skin import Skin
from palpate.uncertainty import Case

__all__ = ["LAYOUTS", "Layout"]

#: For the surface on which data are computed: number of cells per cell of the estimate, and number of cells by which it
#: is wider on each side.
FINER, WIDER = {1: 10, 2: 6}, {1: 24, 2: 3}


@dataclass
class Layout:
    """An array on a pad, its contacts, and the quantities to estimate.

    If contacts cross the edge of the array, ``middle`` holds the same contacts in its middle, for comparison.
    """

    name: str
    pad: Pad
    array: Array
    contacts: dict[str, Traction]
    components: tuple[str, ...] = ("z",)
    friction: float | None = None
    methods: tuple[str, ...] = ("tikhonov",)
    middle: dict[str, Traction] = field(default_factory=dict)
    yardsticks: dict[tuple[str, float], float] = field(default_factory=dict)

    @property
    def case(self) -> Case:
        """Case that selects the constants of the error bars."""
        return self.skin.case(self.components)

    @cached_property
    def skin(self) -> Skin:
        """The skin of a user who states no noise. The pad is exact, so that intervals test only the method."""
        return Skin(self.pad, self.array, uncertainty=EXACT)

    @cached_property
    def maker(self) -> Skin:
        """The finer and wider skin on which data are computed."""
        grid = self.skin.surface
        return Skin(self.pad, self.array, surface=refined(grid, FINER[grid.dimensions], WIDER[grid.dimensions]))

    def make(self, traction: Traction) -> tuple[Floats, Floats]:
        """Return noise-free readings, and the mean traction (component, *surface) in each cell of the estimate."""
        fine = traction(self.maker.surface)
        d = self.skin.surface.dimensions
        middle: tuple[Any, ...] = (..., *(slice(WIDER[d], -WIDER[d]),) * d)
        mean = block_means(fine, FINER[d], d)[middle]
        return np.nan_to_num(np.asarray(self.maker.sense(fine))), mean

    def clairvoyant(self, traction: Traction, noise: float) -> float:
        """Smallest expected relative error of a linear shift-invariant filter that knows the true spectrum."""
        array = self.array
        if isinstance(array, ScatteredArray):
            raise Unsupported("the clairvoyant filter needs a regular array; got a ScatteredArray.")
        grid = array.grid
        ratio, d = FINER[grid.dimensions], grid.dimensions
        fine = refined(grid, ratio)
        columns = [grid.components.index(c) for c in self.components]
        values = traction(fine)[columns]
        power = np.abs(fftn(values, d) / ratio**d) ** 2
        waves = [2 * np.pi * np.fft.fftfreq(n, dx) for n, dx in zip(fine.shape, fine.spacings)]
        ky, kx = (np.zeros(1), waves[0]) if d == 1 else (waves[0][:, None], waves[1][None, :])
        response = transfer(self.pad, kx, ky, array.depth, array.channels, line=d == 1)
        response = np.nan_to_num(response)
        columns3 = [{"x": 0, "y": 1, "z": 2}[c] for c in self.components]
        h = np.moveaxis(response[..., columns3], (-2, -1), (0, 1)).reshape(
            len(array.channels), len(columns), *fine.shape
        )
        average = np.ones(fine.shape)
        for axis, (k, dx) in enumerate(zip(waves, grid.spacings)):
            average = average * np.sinc(k * dx / (2 * np.pi)).reshape([-1 if a == axis else 1 for a in range(d)])

        def fold(x: Any) -> Any:
            lead = x.shape[: x.ndim - d]
            split: list[int] = []
            for n in grid.shape:
                split += [ratio, n]
            return x.reshape(*lead, *split).sum(axis=tuple(len(lead) + 2 * a for a in range(d)))

        cross = fold((average * power)[None] * np.conj(h))  # (channel, component, *k)
        data = fold(np.einsum("cj...,dj...,j...->cd...", h, np.conj(h), power))
        signal = fold(average**2 * power)
        count = math.prod(grid.shape)
        data = np.moveaxis(data, (0, 1), (-2, -1)) + noise**2 * count * np.eye(len(array.channels))
        rows = np.moveaxis(cross, (0, 1), (-2, -1))
        gain = np.real((rows * np.linalg.solve(data, np.conj(rows))).sum(axis=-2))
        left = np.moveaxis(signal, 0, -1) - gain
        return float(np.sqrt(left.sum() / signal.sum()))


def _layouts() -> dict[str, Layout]:
    soft = HalfSpace(youngs_modulus=1.0, poissons_ratio=0.49)
    line = LineArray(count=121, pitch=0.5, depth=1.5, channels=["stress_zz"])
    area = AreaArray(shape=(32, 32), pitch=1.0, depth=2.0, channels=["stress_zz"])
    three = AreaArray(shape=(32, 32), pitch=1.0, depth=2.0, channels=["stress_xz", "stress_yz", "stress_zz"])
    gel = BondedLayers([Layer(thickness=3.0, youngs_modulus=1.0, poissons_ratio=0.48)])
    markers = AreaArray(
        shape=(20, 20), pitch=1.0, depth=1.5, channels=["displacement_x", "displacement_y", "displacement_z"]
    )
    pressed = {name: area_contact(*patches) for name, patches in AREA_PATCHES.items()}
    sheared = {name: area_contact(*AREA_PATCHES[p], shear=s, friction=FRICTION) for name, (p, s) in SHEARED.items()}
    few = {k: sheared[k] for k in ("sliding ball", "sticking ball", "sliding block", "pressed cone")}
    comparisons = ("tikhonov", "nnls", "elastic_net", "tv", "maxent", "network")
    rubber = HalfSpace(youngs_modulus=1.0, poissons_ratio=0.5)
    dead = line.masked(np.random.default_rng(0).random(line.shape) > 0.1)
    crossing = {name: line_contact((kind, x, w, 1.0)) for name, (kind, x, w) in CROSSING.items()}
    middle = {name: line_contact((kind, 0.0, w, 1.0)) for name, (kind, x, w) in CROSSING.items()}
    return {
        "line": Layout("line", rubber, line, LINE_CONTACTS, methods=comparisons),
        "dead taxels": Layout("dead taxels", rubber, dead, LINE_CONTACTS),
        "across the edge": Layout("across the edge", rubber, line, crossing, middle=middle),
        "area": Layout("area", soft, area, pressed),
        "three channels": Layout("three channels", soft, three, sheared, ("x", "y", "z"), FRICTION),
        "bonded displacement": Layout("bonded displacement", gel, markers, few, ("x", "y", "z"), FRICTION),
    }


#: Layouts on which accuracy is measured, by name.
LAYOUTS = _layouts()
