"""Test whether the axes of a displacement field are right. The traction of a cell acts at its adhesions; a wrong sign
of v, or exchanged components, spread it over the gel.

A point force moves a gel along and across the force as the pad's response says. If v has the wrong sign, or u and v
are exchanged, no point force explains the field: the traction that explains it then reaches far from the adhesions and
decays as 1 / distance^2. So the field is inverted as given, and as it may have been meant. Each wavevector is inverted
on its own by

    t = sum_i  v_i s_i S / (s_i^2 S + sigma^2) (w_i . u),      S = q / k^2,

with singular values s_i and vectors w_i, v_i of the pad's response, the scale q of the largest evidence, and the noise
sigma of the displacements. The spreads

    sum |t| / sqrt(sum |t|^2)

are compared, each with the error due to noise. For a slender cell, exchanged components give nearly as concentrated a
traction, but with a torque, which a cell in balance does not have.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
import scipy.fft

from palpate.elastic.pad import Floats, Pad
from palpate.microscopy.fields import Field, mended

__all__ = ["suspected"]

#: Possible errors of the axes: the question to ask the user, and a function that undoes the error.
AXES_TRIED: tuple[tuple[str, Callable[[Any], Any]], ...] = (
    ("", lambda u: u),
    ("v's sign", lambda u: np.stack([u[0], -u[1]])),
    ("u for v", lambda u: u[::-1]),
    ("u for v and a sign", lambda u: np.stack([u[1], -u[0]])),
)
#: Number of repetitions with added noise that estimate the error of the spread.
REPEATS = 8
#: Spreads [log] that differ by less than this count as equal: a pad that differs a little from the gel, or an
#: interpolated field, changes them as much.
SAME_SPREAD = 0.01
#: Axes are rejected if they give a torque, as a fraction of the first moments, that exceeds the one of the field as
#: given by more than this.
TURNS = 0.1
#: Values of q that are tried, as multiples of (displacement / response)^2.
SIZES = np.logspace(-6.0, 2.0, 25)


def suspected(field: Field, pad: Pad, *, depth: float, noise: float) -> str:
    """Return which of the axes looks wrong: "v's sign", "u for v", "u for v and a sign"; "" if traction is most
    concentrated with the axes as given.

    Examples
    --------
    >>> import numpy as np
    >>> import palpate as pp
    >>> from palpate.microscopy import Field
    >>> from palpate.microscopy.orientation import suspected
    >>> gel = pp.HalfSpace(youngs_modulus=8e3, poissons_ratio=0.48)
    >>> array = pp.AreaArray(shape=(24, 24), pitch=1e-6, depth=0.0, channels=["displacement_x", "displacement_y"])
    >>> skin = pp.Skin(gel, array)
    >>> traction = np.zeros((3, *skin.surface.shape))
    >>> middle = skin.surface.shape[1] // 2
    >>> traction[0, middle, middle - 6], traction[0, middle, middle + 5] = 500.0, -500.0
    >>> u = skin.sense(traction) + 1e-9 * np.random.default_rng(0).standard_normal((2, 24, 24))
    >>> right = Field(displacement=u, start=(4.5, 4.5), step=10.0, pixel=0.1e-6)
    >>> wrong = Field(displacement=u * np.array([1.0, -1.0])[:, None, None], start=(4.5, 4.5), step=10.0, pixel=0.1e-6)
    >>> [suspected(one, gel, depth=0.0, noise=1e-9) for one in (right, wrong)]
    ['', "v's sign"]
    """
    values = mended(field.displacement / field.pixel)[0] * field.pixel
    response = _Response(field, pad, depth)
    rng = np.random.default_rng(0)
    repeated = values + noise * rng.standard_normal((REPEATS, *values.shape))
    spreads, torques = [], []
    for _, meant in AXES_TRIED:
        size = response.size(meant(values), noise)
        made = [response.traction(meant(u), noise, size) for u in (values, *repeated)]
        spreads.append([_spread(t) for t in made])
        torques.append(_torque(made[0]))
    found = np.log(spreads)
    off = found[:, 0] - found[0, 0]
    error = (found[:, 1:] - found[:1, 1:]).std(axis=1, ddof=1)
    better = (off < -np.maximum(error, SAME_SPREAD)) & (np.array(torques) <= torques[0] + TURNS)
    return AXES_TRIED[int(np.argmin(np.where(better, off, np.inf)))][0] if better.any() else ""


def _spread(t: Floats) -> float:
    """Return the sum of the magnitudes of traction, divided by the root of the sum of their squares."""
    force = np.hypot(*t)
    return float(force.sum() / max(np.sqrt((force**2).sum()), 1e-300))


def _torque(t: Floats) -> float:
    """Return the fraction (0 to 1) of the first moments about the middle of the forces that is torque."""
    weight = (t**2).sum(axis=0)
    places = [(g - (g * weight).sum() / max(weight.sum(), 1e-300)) for g in np.indices(t.shape[1:])[::-1]]
    moments = np.array([[(force * place).sum() for place in places] for force in t])
    return float(abs(moments[0, 1] - moments[1, 0]) / max(np.sqrt(2.0) * np.linalg.norm(moments), 1e-300))


class _Response:
    """Response of the displacements to traction along x and y, for each wavevector of a field."""

    def __init__(self, field: Field, pad: Pad, depth: float) -> None:
        kx, ky = np.meshgrid(*(2.0 * np.pi * np.fft.fftfreq(n, field.pitch) for n in field.shape[::-1]), indexing="xy")
        self.k = np.hypot(kx, ky)
        at = self.k > 0
        safe = np.where(at, self.k, 1.0)
        direction = np.stack([np.where(at, kx / safe, 1.0), ky / safe], axis=-1)
        response = pad.states(safe, direction, depth)[..., :2, :2] / safe[..., None, None]
        # the data are squares of displacements
        blur = np.sinc(kx * field.aperture / (2.0 * np.pi)) * np.sinc(ky * field.aperture / (2.0 * np.pi))
        self.left, self.sizes, self.right = np.linalg.svd(response * (blur * at)[..., None, None])
        self.prior = (at / safe**2)[..., None]

    def _parts(self, u: Floats) -> Any:
        spectrum = scipy.fft.fft2(u - u.mean(axis=(1, 2), keepdims=True), norm="ortho")
        return np.einsum("...ji,j...->...i", self.left.conj(), spectrum)

    def size(self, u: Floats, noise: float) -> float:
        """Return the q of the largest evidence."""
        power = np.abs(self._parts(u)) ** 2
        gain = self.sizes**2 * self.prior
        unit = float(power.sum() / gain.sum())

        def evidence(q: float) -> float:
            variance = gain * q + noise**2
            return -float((np.log(variance) + power / variance).sum())

        return max((unit * size for size in SIZES), key=evidence)

    def traction(self, u: Floats, noise: float, q: float) -> Floats:
        gain = self.sizes * self.prior * q
        parts = self._parts(u) * gain / (self.sizes * gain + noise**2)
        spectrum = np.einsum("...ij,...i->j...", self.right.conj(), parts)
        return np.asarray(scipy.fft.ifft2(spectrum, norm="ortho").real)
