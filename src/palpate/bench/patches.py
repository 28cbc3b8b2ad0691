"""Traction of either sign with known truth, for the constants of `method="local"`: patches in the plane, such as cells
exert on gels.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from palpate.elastic import BondedLayers, HalfSpace, Layer
from palpate.elastic.pad import Floats, Pad
from palpate.sensing import AreaArray
from palpate.sensing.grids import block_means, refined
from palpate.sensing.uncertainty import EXACT
from palpate.skin import Skin

__all__ = ["PulledFrame", "pulled"]

#: The cells of the truth are this many times finer than those of the estimate.
FINER = 3


@dataclass(frozen=True, eq=False)
class PulledFrame:
    """One frame: the skin, readings (channel, *array), and the true traction (component, *surface) along x and y."""

    skin: Skin
    readings: Floats
    truth: Floats


def pulled(rng: np.random.Generator) -> PulledFrame:
    """Return a random frame: array of markers, pad, patches and noise.

    The array has 16 to 40 markers each way, at the surface or up to a pitch below it, on a half-space or a layer of 5
    to 30 pitches. One to twelve elliptic patches of 0.7 to 5 pitches are uniform, Hertzian, Gaussian or long-tailed,
    directed to the middle or anywhere, balanced or not; in two of five frames there is also weak traction as wide as
    the field. Noise is 0.3 to 10 %, in one of four frames shared by neighbours; every other frame has a shift of the
    image by a fifth of the largest displacement.
    """
    import scipy.ndimage

    count = int(rng.choice([16, 24, 32, 40]))
    pad: Pad = HalfSpace(youngs_modulus=8e3, poissons_ratio=float(rng.choice([0.45, 0.48, 0.5])))
    if rng.random() < 0.5:
        pad = BondedLayers([Layer(thickness=float(rng.uniform(5, 30)), youngs_modulus=8e3, poissons_ratio=0.48)])
    depth = float(rng.choice([0.0, 0.0, 0.5, 1.0]))
    array = AreaArray(shape=(count, count), pitch=1.0, depth=depth, channels=["displacement_x", "displacement_y"])
    skin = Skin(pad, array, uncertainty=EXACT)
    maker = Skin(pad, array, surface=refined(skin.surface, FINER, 0), uncertainty=EXACT)
    x, y = np.meshgrid(maker.surface.axes[1], maker.surface.axes[0])
    fine = np.zeros((3, *maker.surface.shape))
    profile = str(rng.choice(["even", "even", "hertz", "gauss", "exponential", "power"]))
    size = float(np.exp(rng.uniform(math.log(0.7), math.log(5.0))))
    inwards = rng.random() < 0.6
    for _ in range(int(rng.integers(1, 13))):
        r, around = 0.375 * count * math.sqrt(rng.random()), 2 * math.pi * rng.random()
        way = around if inwards else 2 * math.pi * rng.random()
        length = size * rng.uniform(0.7, 1.4)
        width = length * rng.uniform(0.4, 1.0)
        dx, dy = x - r * math.cos(around), y - r * math.sin(around)
        along, across = dx * math.cos(way) + dy * math.sin(way), dy * math.cos(way) - dx * math.sin(way)
        q = (along / length) ** 2 + (across / width) ** 2
        shape = {
            "even": (q < 1).astype(float),
            "hertz": np.sqrt(np.maximum(1 - q, 0)),
            "gauss": np.exp(-q),
            "exponential": np.exp(-2.0 * np.sqrt(q)),
            "power": (1 + 2.0 * q) ** -1.5,
        }[profile]
        strength = float(rng.uniform(200.0, 1000.0))
        fine[0] -= strength * math.cos(way) * shape
        fine[1] -= strength * math.sin(way) * shape
    strong = np.hypot(fine[0], fine[1])
    on = strong > 0.05 * strong.max()
    if rng.random() < 0.7:
        for c in (0, 1):
            fine[c][on] -= fine[c].sum() / max(on.sum(), 1)
    if rng.random() < 0.4:
        wide = rng.uniform(0.03, 0.12) * strong.max() * np.exp(-(x**2 + y**2) / (count * rng.uniform(0.15, 0.35)) ** 2)
        way = 2 * math.pi * rng.random()
        fine[0] += wide * math.cos(way)
        fine[1] += wide * math.sin(way)
    clean = np.asarray(maker.sense(fine))
    top = float(np.abs(clean).max())
    noise = float(np.exp(rng.uniform(math.log(0.003), math.log(0.1)))) * top
    white = rng.standard_normal(clean.shape)
    if rng.random() < 0.25:
        white = scipy.ndimage.gaussian_filter(white, (0, 0.75, 0.75), mode="wrap")
        white /= white.std()
    shift = float(rng.choice([0.0, 0.2])) * top * np.array([0.8, -0.6])[:, None, None]
    return PulledFrame(skin, clean + noise * white + shift, block_means(fine, FINER, 2)[:2])
