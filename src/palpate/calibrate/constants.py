"""Estimate the posterior of a pad's constants from balls pressed straight into it with known forces, and compare pad
models.

A press is a Hertz pressure with unknown position and radius. These unknowns are fitted together with the constants and
integrated out (Laplace's approximation in the logarithms of all positive numbers). The fields of an axisymmetric
pressure are Hankel transforms of the pad's response, computed on one table of radii.
"""

from __future__ import annotations

import json
import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, fields, replace
from typing import Any

import numpy as np
import numpy.typing as npt
from scipy.interpolate import CubicSpline
from scipy.optimize import least_squares
from scipy.special import j0, j1

from palpate._numbers import plain_number
from palpate.calibrate.labels import BALL, Labelled, spread_over
from palpate.elastic import BondedLayers, HalfSpace, Layer
from palpate.elastic.pad import Floats
from palpate.errors import InvalidInput

__all__ = ["CONSTANTS", "REJECTED", "PadConstants", "fit_constants", "labelled_constants", "model_of"]

#: Constants that can be fitted, with the prior standard deviation of their logarithm: modulus guessed within a factor
#: of 3, lengths known to 20 %, gains to 5 %, any unit.
CONSTANTS = {"youngs_modulus": 1.1, "thickness": 0.2, "depth": 0.2, "gain": 0.05, "pixel_scale": 0.2, "unit": 5.0}
#: Constants that are not fitted, and where to state them instead.
STATED = {
    "poissons_ratio": "state it with the pad (poissons_ratio in skin.toml; 0.48 to 0.5 for rubber).",
    "creep": 'state it with the pad (prony = [[0.2, "0.5 s"]] under [pad]).',
    "temperature": "take a new zero before each recording (baseline=, --baseline), and calibrate again when it has changed (again=True, --again).",
}
#: Mean and standard deviation of the log of the ratio of moduli, of the lower layer or base to the upper layer.
RATIO = {"stack": (0.0, 1.5), "soft base": (math.log(0.1), 1.0)}
#: Standard deviation of the log of the contact radius of a known ball. On a half-space: a third of the errors of force
#: (1 %) and radius (2 %). On a layer it is larger, because Hertz's pressure is not exact there (a convention).
CONTACT_STD, LAYER_CONTACT_STD = 0.0075, 0.02
#: Standard deviation of the log of the contact radius of an unknown ball; number of nodes in radius and wavenumber;
#: wavenumber at which the spectrum is cut off, in units of 1/depth and of 1/(contact radius).
UNKNOWN_STD, RADII, CUT_DEPTH, CUT_CONTACT = 0.7, 160, 25.0, 60.0
#: The data do not determine a constant if its standard deviation is still this fraction of the prior one. A pad model
#: is selected at odds of 20 to 1.
UNTOLD, ODDS = 0.7, math.log(20.0)
#: Two materials count as one, and the pad as the simpler model in `PLAINER`, if the log of the ratio of their moduli has a
#: standard deviation below ALIKE and a 95 % interval that contains 0.
ALIKE, PLAINER = 0.25, {"stack": "bonded", "soft base": "half-space"}
#: A pad model is rejected if its residuals exceed this many times the noise (a chi-square of 2 for each reading).
REJECTED = 1.4
#: At most this many labelled frames are fitted: half spread over time, half over force.
MAX_PRESSES = 20
STEP = 1e-5
#: Channels that can be fitted, and whether each measures the radial or the vertical field.
CHANNEL_FIELDS = {
    "stress_xz": "stress_x", "stress_yz": "stress_x", "stress_zz": "stress_z",
    "displacement_x": "displacement_x", "displacement_y": "displacement_x", "displacement_z": "displacement_z",
}  # fmt: skip


@dataclass(frozen=True, eq=False)
class PadConstants:
    """Posterior of the constants of a pad: a normal distribution of their logarithms.

    Attributes
    ----------
    model : str
        The pad model that the constants belong to.
    names : tuple of str
        One for each constant; "gain 3" is the factor of reading 3.
    values : array (constant,)
        Values in SI units; gains and pixel scale are factors relative to those of the skin; "unit" divides readings to
        give SI units.
    covariance : array (constant, constant)
        Covariance of the logarithms: the square root of its diagonal is a relative standard deviation.
    before : array (constant,)
        Relative standard deviations before the presses.
    evidence : mapping of str to float
        Logarithm of the evidence of each candidate model, without a stack or soft base with two equal materials, which is the simpler model.
    misfit : float
        Root mean square of the residuals over the noise; above `REJECTED` no model is best, and the standard deviations are wider by this factor.
    said : tuple of str
        Sentences on what the data do not determine.
    span : float
        Largest extent of the readings' positions [m] according to the skin before the presses, to which the pixel scale
        refers.
    """

    model: str
    names: tuple[str, ...]
    values: Floats
    covariance: Floats
    before: Floats
    evidence: Mapping[str, float]
    misfit: float
    said: tuple[str, ...] = ()
    span: float = math.nan

    @property
    def pixel_scale(self) -> float:
        """Factor on lengths that a camera measured; 1 if it was not fitted."""
        return float(self.values[self.names.index("pixel_scale")]) if "pixel_scale" in self.names else 1.0

    @property
    def std(self) -> Floats:
        """Relative standard deviation of each constant."""
        return np.asarray(np.sqrt(np.diag(self.covariance)))

    @property
    def told(self) -> Any:
        """Whether the presses determine each constant: bool (constant,)."""
        return self.std < UNTOLD * self.before

    @property
    def best_model(self) -> str | None:
        """The pad model with odds of at least 20 to 1 against every other; None if the data do not decide, or if no
        model fits.
        """
        if self.misfit > REJECTED:
            return None
        order = sorted(self.evidence, key=lambda m: -self.evidence[m])
        if len(order) > 1 and self.evidence[order[0]] - self.evidence[order[1]] < ODDS:
            return None
        return order[0]

    def json(self) -> str:
        """Return the posterior as text, for `from_json`."""
        held = {f.name: getattr(self, f.name) for f in fields(self)}
        return json.dumps({k: v.tolist() if isinstance(v, np.ndarray) else v for k, v in held.items()})

    @classmethod
    def from_json(cls, text: str) -> PadConstants:
        """Restore the posterior from `json`; ValueError if it is damaged."""
        held = json.loads(text)
        values, covariance, before = (
            np.array(held.pop(n), dtype=np.float64) for n in ("values", "covariance", "before")
        )
        names, said = tuple(held.pop("names")), tuple(held.pop("said"))
        if covariance.shape != (len(names), len(names)) or not values.shape == before.shape == (len(names),):
            raise ValueError("constants of other counts")
        return cls(names=names, values=values, covariance=covariance, before=before, said=said, **held)

    def __str__(self) -> str:
        units = {"youngs_modulus": "Pa", "thickness": "m", "depth": "m"}
        if self.misfit > REJECTED:
            return "\n".join(["constants of the pad", *(f"- {s}" for s in self.said)])
        lines = [f"constants of the pad ({self.model}; value and 95 % interval)"]
        for name, value, std, told in zip(self.names, self.values, self.std, self.told):
            if name.startswith("gain"):
                continue
            unit = f" {units[name]}" if name in units else ""
            if told:
                low, high = (plain_number(float(value * math.exp(s * 1.96 * std)), 3) for s in (-1, 1))
                lines.append(f"  {name:<16}{plain_number(float(value), 3)}{unit} ({low} to {high})")
            else:
                lines.append(f"  {name:<16}the presses do not determine it")
        gains = [i for i, n in enumerate(self.names) if n.startswith("gain")]
        if gains:
            worst = plain_number(100.0 * float(self.std[gains].max()), 2)
            lines.append(f"  {'gains':<16}{len(gains)}, each known to {worst} % or better")
        return "\n".join([*lines, *(f"- {s}" for s in self.said)])


def fit_constants(
    skin: Any,
    readings: Any,
    force: Any,
    *,
    constants: Sequence[str],
    noise: Any,
    ball_radius: Any = None,
    places: Any = None,
    place_std: float | None = None,
    models: Sequence[str] | None = None,
    before: PadConstants | None = None,
) -> PadConstants:
    """Estimate the posterior of ``constants`` from balls pressed straight into the pad; `palpate.calibrate.calibrate`
    calls it with ``constants=``.

    Parameters
    ----------
    skin : Skin
        A skin with one plane over an area, on a half-space or bonded layers; its numbers are the prior means.
    readings : array (press, channel, *array)
        Without their zero, in SI units.
    force : array (press,)
        Normal force of each [N].
    constants : sequence of str
        Some of `CONSTANTS`.
    noise : float or array (channel,)
        Standard deviation of a reading.
    ball_radius : float or array (press,), optional
        [m], NaN where unknown.
    places : array (press, 2), optional
        Place of each press [m] with standard deviation ``place_std`` [m]; NaN if unknown.
    models : sequence of str, optional
        Models to compare: any of "half-space", "bonded", "stack", "soft base". Default: only that of the skin's pad.
    before : PadConstants, optional
        A posterior to start from.

    Raises
    ------
    InvalidInput
        Another pad or array, unknown names, or fewer than three presses with force.

    Examples
    --------
    >>> import numpy as np
    >>> import palpate as pp
    >>> from palpate.calibrate.constants import fit_constants
    >>> array = pp.AreaArray(shape=(5, 5), pitch=2e-3, depth=2e-3, channels=["stress_zz"])
    >>> skin = pp.Skin(pp.HalfSpace(youngs_modulus=1e5, poissons_ratio=0.5), array)
    >>> force = np.array([1.0, 2.0, 3.0])
    >>> presses = np.stack([np.asarray(skin.sense(pp.solutions.hertz_point(contact_radius=2e-3, force=f))) for f in force])
    >>> found = fit_constants(skin, presses, force, constants=["youngs_modulus", "depth"], noise=100.0)
    >>> dict(zip(found.names, found.told.tolist()))  # stress under a given load does not depend on the modulus
    {'youngs_modulus': False, 'depth': True}
    """
    unknown = [c for c in constants if c not in CONSTANTS]
    if stated := [c for c in unknown if c in STATED]:
        raise InvalidInput(
            f"{stated[0]} is not fitted: {STATED[stated[0]]} Constants to fit are {', '.join(CONSTANTS)}."
        )
    if unknown or not constants:
        raise InvalidInput(
            f"constants names {', '.join(map(repr, unknown)) or 'nothing'}; accepted: {', '.join(CONSTANTS)}."
        )
    own = model_of(skin.pad)
    asked = (own,) if models is None else tuple(models)
    if bad := [m for m in asked if m not in ("half-space", "bonded", "stack", "soft base")]:
        raise InvalidInput(f"models names {bad[0]!r}; accepted: half-space, bonded, stack, soft base.")
    values, newtons = np.asarray(readings, dtype=np.float64), np.asarray(force, dtype=np.float64)
    at = (
        np.isfinite(newtons)
        & (newtons > 0.0)
        & np.isfinite(values[..., skin.planes[0].valid]).reshape(len(values), -1).all(axis=1)
    )
    if at.sum() < 3:
        raise InvalidInput(
            f"the constants of a pad need three presses with a known force and complete readings; got {int(at.sum())}."
        )
    radius = np.broadcast_to(np.asarray(math.nan if ball_radius is None else ball_radius, dtype=np.float64), at.shape)
    if (radius <= 0.0).any():
        raise InvalidInput("ball_radius must be positive [m]; write NaN for presses whose ball is unknown.")
    where = np.full((len(at), 2), math.nan) if places is None else np.asarray(places, dtype=np.float64)
    fits = {
        name: _Fit(name, skin, values[at], newtons[at], radius[at], where[at], place_std, tuple(constants), noise, before).solve()
        for name in asked
    }  # fmt: skip
    fits = {name: one for name, one in fits.items() if PLAINER.get(name) not in fits or not one.alike}
    evidence = {name: float(one.evidence) for name, one in fits.items()}
    best = max(evidence, key=lambda m: evidence[m])
    found = fits[best].result(evidence)
    return replace(found, said=tuple(_words(found, fits[best])))


def labelled_constants(
    skin: Any, data: Labelled, constants: Sequence[str], models: Sequence[str] | None, before: PadConstants | None
) -> PadConstants | None:
    """Return the posterior of the requested constants from labelled frames; without labels, return the earlier
    posterior.
    """
    if not constants:
        if models is not None:
            raise InvalidInput(
                'pad_models= ranks models by constants fitted to each: give constants=["thickness"] too.'
            )
        return before
    if "fz" not in data.known:
        raise InvalidInput("constants= needs the normal force fz of each press: give it in reference=.")
    pressed = np.flatnonzero(np.nan_to_num(data.known["fz"]) > 0.0)
    if not len(pressed):
        raise InvalidInput("constants= needs presses with fz > 0: pushing into the pad is positive. Change the sign.")
    at = pressed[spread_over(data.known["fz"][pressed, None], MAX_PRESSES)]
    places = np.stack([data.known.get(n, np.full(len(data.flat), math.nan))[at] for n in ("x", "y")], axis=1)
    # one noise for each channel, plus that of the zero: the median of n frames at rest has the variance pi / (2 n)
    count = len(data.rest)
    valid = np.concatenate([np.broadcast_to(p.valid, (len(p.channels), *p.shape)) for p in skin.planes])
    variance = data.rest.var(axis=0, ddof=1).reshape(len(valid), -1)
    scatter = np.sqrt(np.mean(variance, axis=1, where=valid.reshape(len(valid), -1)))
    noise = np.maximum(scatter * math.sqrt(1.0 + 0.5 * math.pi / count), 1e-9 * float(np.abs(data.flat).max()))
    radius = data.known[BALL][at] if BALL in data.known else None
    return fit_constants(
        skin, data.planes[at], data.known["fz"][at], constants=constants, noise=noise, ball_radius=radius,
        places=places, models=models, before=before,
    )  # fmt: skip


def model_of(pad: Any) -> str:
    if isinstance(pad, HalfSpace):
        return "half-space"
    if isinstance(pad, BondedLayers) and len(pad.layers) <= 2:
        return "soft base" if pad.base is not None else "bonded" if len(pad.layers) == 1 else "stack"
    raise InvalidInput(
        f"constants= takes a half-space, one or two bonded layers, or a layer on a half-space; got {type(pad).__name__}. Leave constants= out."
    )


class _Fit:
    """One pad model fitted to presses. Parameters: logs of constants, then for each press x, y [contact lengths] and
    log contact radius.
    """

    def __init__(
        self, model: str, skin: Any, readings: Floats, force: Floats, radius: Floats, places: Floats,
        place_std: float | None, constants: tuple[str, ...], noise: Any, before: PadConstants | None,
    ) -> None:  # fmt: skip
        planes = skin.planes
        if len(planes) != 1 or planes[0].points.shape[1] != 2 or not set(planes[0].channels) <= set(CHANNEL_FIELDS):
            what = "; ".join(f"{', '.join(p.channels)} at {p.points.shape[1]}-dimensional places" for p in planes)
            raise InvalidInput(
                f"constants= takes one plane over an area with channels {', '.join(CHANNEL_FIELDS)}; got {what}. Leave constants= out."
            )
        plane, pad = skin.planes[0], skin.pad
        self.model, self.force, self.ball, self.channels = model, force, radius, tuple(plane.channels)
        self.points = np.asarray(plane.points, dtype=np.float64).reshape(-1, 2)[plane.valid.ravel(), ::-1]  # (x, y)
        self.readings = readings[..., plane.valid].reshape(len(force), len(self.channels), -1)
        each = np.broadcast_to(np.asarray(noise, dtype=np.float64), (len(self.channels),))
        self.noise = np.broadcast_to(each[:, None], self.readings[0].shape)
        top = pad.layers[0] if isinstance(pad, BondedLayers) else pad
        self.ratio = top.poissons_ratio
        self.depth0 = float(pad.thickness if plane.depth == "base" else plane.depth)
        thick = pad.thickness if pad.thickness is not None else 2.0 * self.depth0
        if not thick > 0.0:
            raise InvalidInput("constants= needs the thickness of the pad, or taxels below its surface.")
        self.at_base = pad.thickness is not None and math.isclose(self.depth0, pad.thickness)
        wanted = [c for c in constants if c != "gain" and not (c == "depth" and (self.at_base or self.depth0 == 0.0))]
        if model == "half-space" and not self.at_base:
            wanted = [c for c in wanted if c != "thickness"]
        start = {
            "youngs_modulus": top.youngs_modulus,
            "thickness": thick,
            "depth": self.depth0,
            "pixel_scale": 1.0,
            "unit": 1.0,
        }
        self.start = start
        self.names = [*wanted, *(["lower modulus ratio"] if model in RATIO else [])]
        self.plain = len(self.names)
        if "gain" in constants:
            self.names += [f"gain {i}" for i in range(self.readings[0].size)]
        mean = [math.log(start[n]) if n in start else RATIO[model][0] if n in ("lower modulus ratio",) else 0.0 for n in self.names]  # fmt: skip
        std = [CONSTANTS["gain"] if n.startswith("gain") else CONSTANTS.get(n, 0.0) or RATIO[model][1] for n in self.names]  # fmt: skip
        self.mean, self.before = np.array(mean), np.array(std)
        self.root = np.diag(1.0 / self.before)
        if before is not None and before.model == model and before.names == tuple(self.names):
            self.mean, self.before = np.log(before.values), before.before
            self.root = np.linalg.cholesky(np.linalg.inv(before.covariance)).T
        span = float(np.ptp(self.points, axis=0).max())
        if before is not None and math.isfinite(before.span):  # the positions of a calibrated skin are scaled already
            self.points = self.points * (before.span / span)
            span = before.span
        self.span, self.length = span, span / 4.0
        center = self.points.mean(axis=0)
        upright = [i for i, c in enumerate(self.channels) if CHANNEL_FIELDS[c].endswith("z")]
        square = (self.readings[:, upright or slice(None)] ** 2).sum(axis=1)
        weight = square / np.maximum(square.sum(axis=1, keepdims=True), 1e-300)
        known: npt.NDArray[np.bool_] = np.asarray(np.isfinite(places).all(axis=1))
        self.place = np.where(known[:, None], places, center)
        self.place_std = np.where(known, place_std or 0.02 * span, 0.5 * span)
        self.guess = np.where(known[:, None], places, weight @ self.points)
        self.contact = math.log(0.1 * span)
        self.contact_std = CONTACT_STD if model == "half-space" else LAYER_CONTACT_STD
        self.radii = np.linspace(0.0, 2.2 * span, RADII)
        cut = min(CUT_DEPTH / self.depth0 if self.depth0 else math.inf, CUT_CONTACT / (0.1 * span))
        x, w = np.polynomial.legendre.leggauss(int(100 + 0.8 * cut * self.radii[-1]))
        self.k, self.weight = 0.5 * cut * (x + 1.0), 0.5 * cut * w / (2.0 * math.pi)
        self.bessel = (j0(np.outer(self.radii, self.k)), j1(np.outer(self.radii, self.k)))
        self.q, self.q_weight = (0.5 * CUT_CONTACT * (x + 1.0) for x in np.polynomial.legendre.leggauss(120))
        self.q_weight -= 0.5 * CUT_CONTACT

    def pad(self, value: Mapping[str, float]) -> tuple[Any, float]:
        """Return the pad, and the depth of the readings [m]."""
        get = {**self.start, **value}
        modulus, thick = get["youngs_modulus"], get["thickness"]
        depth = thick if self.at_base else get["depth"]
        if self.model == "half-space":
            return HalfSpace(youngs_modulus=modulus, poissons_ratio=self.ratio), depth
        lower = modulus * get.get("lower modulus ratio", 1.0)
        parts = [(thick, modulus)] if self.model != "stack" else [(0.5 * thick, modulus), (0.5 * thick, lower)]
        layers = [Layer(thickness=h, youngs_modulus=e, poissons_ratio=self.ratio) for h, e in parts]
        base = HalfSpace(youngs_modulus=lower, poissons_ratio=self.ratio) if self.model == "soft base" else None
        return BondedLayers(layers, base=base), min(depth, thick)

    def contact_radius(self, pad: Any, modulus: float) -> Floats:
        """Return the log of the contact radius of known balls: Hertz's radius, corrected so that the surface sinks a^2
        / (2 R) more at the centre than at the edge.
        """
        plane = modulus / (1.0 - self.ratio**2)
        out: Floats = np.asarray(np.log((0.75 * self.force * self.ball / plane) ** (1.0 / 3.0)))
        if self.model == "half-space":
            return np.asarray(out)
        spectrum = 3.0 * (np.sin(self.q) - self.q * np.cos(self.q)) / self.q**3 * (1.0 - j0(self.q)) * self.q_weight
        at = np.flatnonzero(np.isfinite(self.ball))
        for _ in range(6 if len(at) else 0):  # damped fixed-point iteration: a ~ sunk^(1/3) on a half-space
            a = np.exp(out[at])[:, None]
            k = self.q / a
            states = pad.states(k, np.broadcast_to([1.0, 0.0], (*k.shape, 2)), 0.0)[..., 2, 2].real
            sunk = self.force[at] * (states @ spectrum) / (2.0 * math.pi * a[:, 0])
            out[at] += np.log(2.0 * self.ball[at] * sunk / a[:, 0] ** 2) / 3.0
        return np.asarray(out)

    def model_readings(self, theta: Floats) -> tuple[Floats, Floats]:
        """Model readings (press, channel, taxel), and the expected log radii of contact."""
        count = len(self.names)
        value = dict(zip(self.names, np.exp(theta[:count])))
        pad, depth = self.pad(value)
        own = theta[count:].reshape(-1, 3)
        scale = value.get("pixel_scale", 1.0)
        states = pad.states(self.k, np.tile([1.0, 0.0], (len(self.k), 1)), depth)[:, :, 2]
        moves = any(c.startswith("displacement") for c in self.channels)
        u = states[:, :3] / self.k[:, None] if moves else states[:, :3]
        fields = {"displacement_x": -u[:, 0].imag, "displacement_z": u[:, 2].real, "stress_x": -states[:, 3].imag, "stress_z": states[:, 5].real}  # fmt: skip
        q = self.k * np.exp(own[:, 2:])
        shape = np.where(q < 0.02, 1.0 - 0.1 * q**2, 3.0 * (np.sin(q) - q * np.cos(q)) / np.maximum(q, 1e-9) ** 3)
        pressed = self.force[:, None] * shape * self.k * self.weight
        offset = self.points * scale - own[:, None, :2] * self.length
        r = np.minimum(np.hypot(offset[..., 0], offset[..., 1]), self.radii[-1])
        unit = offset / np.maximum(r, 1e-12)[..., None]
        keys = [CHANNEL_FIELDS[c] for c in self.channels]
        kinds = list(dict.fromkeys(keys))
        tables = [self.bessel[0 if n[-1] == "z" else 1] @ (pressed * fields[n]).T for n in kinds]
        spline = CubicSpline(self.radii, np.stack(tables, axis=-1)).c  # (power, interval, press, kind)
        cell = np.minimum((r / self.radii[1]).astype(int), RADII - 2)
        rest = (r - self.radii[cell])[..., None]
        c3, c2, c1, c0 = spline[:, cell, np.arange(len(own))[:, None]]
        made = ((c3 * rest + c2) * rest + c1) * rest + c0  # (press, taxel, kind)
        out = np.empty_like(self.readings)
        for j, name in enumerate(self.channels):
            key = keys[j]
            turn = 1.0 if key[-1] == "z" else unit[..., 1 if "_y" in name else 0]
            out[:, j] = made[..., kinds.index(key)] * turn / (scale if name.startswith("displacement") else 1.0)
        out *= value.get("unit", 1.0)
        if count > self.plain:
            out *= np.exp(theta[self.plain : count]).reshape(self.readings[0].shape)
        expected = self.contact_radius(pad, value.get("youngs_modulus", self.start["youngs_modulus"]))
        return out, expected

    def residuals(self, theta: Floats) -> Floats:
        made, expected = self.model_readings(theta)
        own = theta[len(self.names) :].reshape(-1, 3)
        known = np.isfinite(expected)
        radius = (own[:, 2] - np.where(known, expected, self.contact)) / np.where(known, self.contact_std, UNKNOWN_STD)
        scale = math.exp(theta[self.names.index("pixel_scale")]) if "pixel_scale" in self.names else 1.0
        place = (own[:, :2] * self.length / scale - self.place) / self.place_std[:, None]
        return np.concatenate(
            [((made - self.readings) / self.noise).ravel(), self.root @ (theta[: len(self.names)] - self.mean), place.ravel(), radius]
        )  # fmt: skip

    def jacobian(self, theta: Floats) -> Floats:
        """Return the Jacobian by forward differences. The three parameters of a press affect only its own readings, so
        that those of all presses are varied at the same time.
        """
        count, presses = len(self.names), len(self.force)
        base = self.residuals(theta)
        out = np.zeros((len(base), len(theta)))
        rows = presses * self.readings[0].size
        made = base[:rows].reshape(presses, -1)
        for i in range(self.plain):
            step = theta.copy()
            step[i] += STEP
            out[:, i] = (self.residuals(step) - base) / STEP
        for i in range(self.plain, count):
            reading = i - self.plain
            full = made[:, reading] * self.noise.ravel()[reading] + self.readings.reshape(presses, -1)[:, reading]
            out[np.arange(presses) * made.shape[1] + reading, i] = full / self.noise.ravel()[reading]
            out[rows : rows + count, i] = self.root[:, i]
        for j in range(3):
            step = theta.copy()
            step[count + j :: 3] += STEP
            change = (self.residuals(step) - base) / STEP
            for p in range(presses):
                own = slice(p * made.shape[1], (p + 1) * made.shape[1])
                out[own, count + 3 * p + j] = change[own]
                tail = rows + count + (2 * p + j if j < 2 else 2 * presses + p)
                out[tail, count + 3 * p + j] = change[tail]
        return out

    def solve(self) -> _Fit:
        first = self.contact_radius(self.pad({})[0], self.start["youngs_modulus"])
        first = np.where(np.isfinite(first), first, self.contact)
        own = np.column_stack([self.guess / self.length, first])
        if (
            "unit" in self.names and self.mean[self.names.index("unit")] == 0.0
        ):  # the unit is unknown: start with a factor that makes modelled and measured readings equally large
            made, _ = self.model_readings(np.concatenate([self.mean, own.ravel()]))
            self.mean[self.names.index("unit")] = 0.5 * math.log(float((self.readings**2).sum() / (made**2).sum()))
        start = np.concatenate([self.mean, own.ravel()])
        least = least_squares(self.residuals, start, self.jacobian, x_scale="jac", max_nfev=40, xtol=1e-7, ftol=1e-6)
        self.theta, hessian = least.x, least.jac.T @ least.jac
        self.covariance = np.linalg.inv(hessian)
        prior = (
            2.0 * float(np.log(np.diag(np.linalg.cholesky(self.root.T @ self.root))).sum()) if len(self.root) else 0.0
        )
        prior -= 2.0 * float(2.0 * np.log(self.place_std / self.length).sum())
        prior -= 2.0 * float(np.log(np.where(np.isfinite(self.ball), self.contact_std, UNKNOWN_STD)).sum())
        self.evidence = -least.cost + 0.5 * prior - 0.5 * float(np.linalg.slogdet(hessian)[1])
        self.chi2 = float((least.fun[: self.readings.size] ** 2).sum()) / max(self.readings.size - len(start), 1)
        return self

    @property
    def alike(self) -> bool:
        """Return whether both materials of a stack or soft base have the same modulus within the errors."""
        i = self.names.index("lower modulus ratio")
        std = math.sqrt(self.covariance[i, i])
        return std < ALIKE and abs(float(self.theta[i])) < 1.96 * std

    def result(self, evidence: Mapping[str, float]) -> PadConstants:
        n = len(self.names)
        return PadConstants(
            self.model, tuple(self.names), np.exp(self.theta[:n]), max(self.chi2, 1.0) * self.covariance[:n, :n],
            self.before, evidence, math.sqrt(self.chi2), span=self.span,
        )  # fmt: skip

    def next_press(self, index: int) -> str:
        """Return the press that would lower the variance of a constant most, among nine combinations of ball and place
        at the largest force used.
        """
        best, least = "", math.inf
        count = len(self.names)
        half = 0.5 * np.ptp(self.points, axis=0)
        middle = self.points.mean(axis=0)
        information = np.linalg.inv(self.covariance[:count, :count])
        for where, at in (("in the middle", middle), ("near the edge", middle + np.array([0.8 * half[0], 0.0]))):
            for size, share in (("a small ball", 0.04), ("a ball of middle size", 0.1), ("a large ball", 0.25)):
                for known in (False, True):
                    radius = share * float(np.ptp(self.points, axis=0).max())
                    one = _copy(self, float(self.force.max()), at, radius, known)
                    jac = one.jacobian(np.r_[self.theta[:count], at / one.length, math.log(radius)])
                    jac = np.delete(jac, np.s_[one.readings.size : one.readings.size + count], axis=0)
                    whole = jac.T @ jac
                    whole[:count, :count] += information
                    left = float(np.linalg.inv(whole)[index, index])
                    if left < 0.98 * least:
                        best = f"{size}{' of known radius' if known else ''} {where}, which would leave {plain_number(100 * math.sqrt(left), 2)} %"
                        least = left
        return best


def _copy(fit: _Fit, force: float, place: Floats, contact: float, known: bool) -> _Fit:
    """Return the fit with one further press that was not made."""
    out = object.__new__(_Fit)
    out.__dict__.update(fit.__dict__)
    out.force, out.readings = np.array([force]), np.zeros((1, *fit.readings.shape[1:]))
    modulus = math.exp(fit.theta[fit.names.index("youngs_modulus")]) if "youngs_modulus" in fit.names else fit.start["youngs_modulus"]  # fmt: skip
    out.ball = np.array([contact**3 * modulus / (1.0 - fit.ratio**2) / (0.75 * force) if known else math.nan])
    out.place, out.place_std = place[None], fit.place_std[:1] * 0 + 0.5 * fit.length
    return out


def _words(found: PadConstants, fit: _Fit) -> list[str]:
    """Return sentences on the constants that the data do not determine, and on the press that would determine each."""
    if found.misfit > REJECTED:
        return [
            f"none of the requested pad models explains the presses: residuals are {plain_number(found.misfit, 3)} times the noise, so the constants are not given"
        ]
    said = []
    correlation = found.covariance / np.outer(found.std, found.std)
    for i, name in enumerate(found.names[: fit.plain]):
        if not found.told[i]:
            why = ""
            if name == "youngs_modulus" and all(c.startswith("stress") for c in fit.channels):
                why = ": stress under a given load does not depend on it unless the ball's radius is known"
            said.append(
                f"the presses do not determine {name}{why}. The most informative next press: {fit.next_press(i)}"
            )
        for j in range(i):
            if abs(correlation[i, j]) > 0.9:
                said.append(
                    f"{found.names[j]} and {name} are determined only in combination (correlation {correlation[i, j]:.2f}): measure one of them to determine the other"
                )
    if len(found.evidence) > 1:
        best = found.best_model
        order = sorted(found.evidence, key=lambda m: -found.evidence[m])
        lead = found.evidence[order[0]] - found.evidence[order[1]]
        said.append(
            f"the presses cannot distinguish {order[0]} from {order[1]} (odds {plain_number(math.exp(lead), 2)} to 1)"
            if best is None
            else f"pad model: {best}; next is {order[1]}, e^{plain_number(lead, 3)} times less likely"
        )
    return said
