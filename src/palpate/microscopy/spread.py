"""Value, standard deviation and 95 % interval of a number from samples of adhesions."""

from __future__ import annotations

import math

import numpy as np

from palpate.elastic.pad import Floats

__all__ = ["LOGARITHMIC", "read"]

#: Numbers that are positive and uncertain by a factor.
LOGARITHMIC = ("strain_energy", "traction_peak")
#: Half-width of a 95 % interval in standard deviations.
SIDE = 1.96
#: What the samples leave out: adhesions are no Gaussians, and chains are short. The standard deviation of the samples is so many times larger, and this part of the
#: number (of its logarithm for those above) is added to it in quadrature. Fitted by `python benchmarks/cells.py --cells 0:48 --rows constants`, and rounded up.
WIDER: dict[str, tuple[float, float]] = {
    "strain_energy": (1.65, 0.04),
    "traction_peak": (1.0, 0.10),
    "contractile_moment": (1.6, 0.02),
    "contractility": (1.4, 0.03),
    "force": (1.6, 0.03),
}
OTHER_SPREAD = (1.2, 0.02)
# Of the energy the fit says 1.3, about the shift below. The shift is a mean over cells, and a cell's own is uncertain by 0.6 of it: what is hidden, and how wide adhesions are that no window
# resolves, is common to all adhesions of a cell. 1.65 is both; set on cells 5000 to 5030 with 5 % noise (27 of 31 held with 1.3).
# Of contractility the fit says 1.1. Weak adhesions that no vector tells are missing from it too (0.98 of the truth): at 5 % noise 1.2 and 0.02 held 0.85 to 0.88 of 51 cells
# (7000 to 7011, 20000 to 20014, 30000 to 30023), 1.4 and 0.03 all of the last 24, and 0.97 of cells 3000 to 3030, which did not set them.
#: Forces that no vector tells are missing from the samples, and wide blobs stand for several adhesions: the number is larger by so many standard deviations of its logarithm,
#: by the same cells, and by no more than the next.
SHIFT: dict[str, float] = {"strain_energy": 1.7, "traction_peak": 0.2}
MAX_MISSING = 0.6
#: Adhesions of one cell have a size in common that is not the middle of the prior: it differs from cell to cell by this standard deviation of its logarithm, a factor of 1.3.
COMMON_SIZE = 0.25


def read(
    key: str, samples: Floats, common: float, scores: Floats | None = None
) -> tuple[float, float, tuple[float, float]]:
    """Of ``samples``; ``common`` is the relative standard deviation that modulus and scale bring, and ``scores`` are the derivatives of the samples' log prior by the size that adhesions
    have in common.

    The mean of a number f over the posterior changes with a parameter of the prior by the covariance of f and the score. Where windows are too coarse to determine sizes, narrower
    adhesions are as likely and do more work.
    """
    factor, part = WIDER.get(key, OTHER_SPREAD)
    if key in LOGARITHMIC and (samples > 0).all():
        logs = np.log(samples)
        own = float(logs.std(ddof=1))
        middle = float(logs.mean()) + min(SHIFT.get(key, 0.0) * own, MAX_MISSING)
        # narrower adhesions never do less work: a covariance above zero is chance
        sizes = 0.0 if scores is None else COMMON_SIZE * max(0.0, -float(np.cov(logs, scores)[0, 1]))
        spread = math.sqrt((factor * own) ** 2 + part**2 + common**2 + sizes**2)
        value = math.exp(middle)
        return value, value * spread, (value * math.exp(-SIDE * spread), value * math.exp(SIDE * spread))
    value = float(samples.mean())
    std = math.sqrt((factor * float(samples.std(ddof=1))) ** 2 + (part**2 + common**2) * value**2)
    return value, std, (value - SIDE * std, value + SIDE * std)
