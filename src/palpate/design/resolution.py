"""Resolution of a sensor: highest wavenumbers, the point-spread function, and the closest pair that is resolved."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np
import scipy.special

from palpate.design.bounds import PressModel, covariance
from palpate.design.press import Press
from palpate.design.responses import pitch_of
from palpate.elastic.pad import Complexes, Floats, Pad
from palpate.elastic.quantities import COMPONENTS, transfer
from palpate.sensing.arrays import Array
from palpate.sensing.uncertainty import Uncertainty

__all__ = ["highest_wavenumbers", "point_spread", "separable_pair"]

#: A pattern is recoverable if its amplitude is at least this many standard deviations (95 %, two-sided).
RECOVERABLE_SIGMAS = 1.96
#: Number of wavenumbers tried, from a tenth of the array's up to Nyquist's, and directions in area contact.
WAVES, ANGLES = 160, (0.0, 0.25 * math.pi, 0.5 * math.pi, 0.75 * math.pi)
#: Number of wavenumbers of the point-spread function: its period is this many half-widths of the finest detail.
SAMPLES = 192
#: Distances tried for a pair, in units of depth plus contact radius: first, last, number.
PAIRS = (0.1, 3.0, 9)


def _sensed(pad: Pad, planes: Sequence[Array], kx: Floats, ky: Floats) -> Complexes:
    """Return rows (..., channel, component) divided by the noise of a taxel, averaged over its aperture, and
    multiplied by the square root of the number of taxels per area (or length).
    """
    line = planes[0].dimensions == 1
    rows = []
    for array in planes:
        matrix = transfer(pad, kx, ky, array.depth, array.channels, line=line)
        matrix = matrix[..., [0, 2]] if line else matrix
        matrix = np.nan_to_num(matrix, nan=0.0)
        for k, width in zip((kx,) if line else (ky, kx), array.apertures):
            matrix = matrix * np.sinc(k * width / (2.0 * np.pi))[..., None, None]
        noise = np.asarray(array.noise_std)
        rows.append(matrix / noise[:, None] / pitch_of(array) ** (0.5 * array.dimensions))
    return np.concatenate(rows, axis=-2)


def highest_wavenumbers(
    pad: Pad, planes: Sequence[Array], press: Press, components: tuple[str, ...]
) -> dict[str, tuple[float, str]]:
    """Return for each component the highest wavenumber [rad/m] that is recovered at the amplitude of the press's mean
    traction, and what limits it.

    A wave t cos(k.x) over an array of area A has the information (A/2) M^H W M, where M(k) is the response matrix.
    Components are estimated together. The amplitude of shear is that of pressure times the coefficient of friction.
    """
    d = planes[0].dimensions
    names = COMPONENTS[d]
    columns = [names.index(c) for c in components]
    points = np.concatenate([p.points for p in planes])
    pitch = max(pitch_of(p) for p in planes)
    extent = np.ptp(points, axis=0) + pitch
    k = np.geomspace(0.2 * np.pi / extent.max(), np.pi / pitch, WAVES)
    amplitude = {c: press.mean_pressure(d) * (1.0 if c == "z" else press.friction) for c in components}
    ratio = np.full((WAVES, len(components)), math.inf)
    for angle in ANGLES if d == 2 else (0.0,):
        rows = _sensed(pad, planes, k * math.cos(angle), k * math.sin(angle))[..., columns]
        _, s, vh = np.linalg.svd(rows, full_matrices=True)
        s = np.concatenate([s, np.zeros((WAVES, len(columns) - s.shape[-1]))], axis=1)
        seen = s > 1e-9 * s[:, :1]
        part = np.where(
            seen[..., None], np.abs(vh[:, : len(columns)]) ** 2 / np.where(seen, s, 1.0)[..., None] ** 2, 0.0
        )
        variance = part.sum(axis=1) * 2.0 / float(np.prod(extent))
        variance[((np.abs(vh[:, : len(columns)]) > 1e-6) & ~seen[..., None]).any(axis=1)] = math.inf
        ratio = np.minimum(
            ratio, np.array([amplitude[c] for c in components]) / (RECOVERABLE_SIGMAS * np.sqrt(variance))
        )
    out = {}
    for i, c in enumerate(components):
        # the recovered waves form one band: displacement and strain may not observe the longest waves
        last = int(np.flatnonzero(ratio[:, i] >= 1.0).max(initial=-1))
        if last < 0 or last == WAVES - 1:
            out[c] = (0.0, "noise") if last < 0 else (float(k[-1]), "pitch")
            continue
        before, after = np.log(np.maximum(ratio[last : last + 2, i], 1e-300))
        out[c] = (float(k[last] * (k[last + 1] / k[last]) ** (before / (before - after))), "noise")
    return out


def point_spread(
    pad: Pad, planes: Sequence[Array], press: Press, components: tuple[str, ...]
) -> tuple[Floats, dict[str, Floats]]:
    """Return distances [m] and, for each component, the best linear estimate of a point load (normalised to 1 in the
    middle).

    The estimate is Wiener's filter for traction that is white up to the size of the press: S M^H (M S M^H + N)^-1 M
    for each wavevector below Nyquist's, where S is the squared mean traction times the contact area, and N the squared
    noise times the area of a taxel.
    """
    d = planes[0].dimensions
    names = COMPONENTS[d]
    columns = [names.index(c) for c in components]
    pitch = max(pitch_of(p) for p in planes)
    length = min(p.depth for p in planes) + press.contact_radius
    widest = 8.0 * (length + pitch)
    k = np.linspace(0.0, np.pi / pitch, max(SAMPLES, math.ceil(widest / pitch)))
    k[0] = 1e-6 * k[1]
    share = np.array([1.0 if c == "z" else press.friction for c in components])
    power = press.mean_pressure(d) ** 2 * press.contact_area(d) * share**2
    x = np.linspace(0.0, widest, 400)
    out = {}
    # pressure has one profile; for shear average the profiles along and across the wave
    rows = _sensed(pad, planes, k, np.zeros_like(k))[..., columns]
    scaled = rows * np.sqrt(power)
    middle = np.linalg.solve(np.einsum("kic,kjc->kij", scaled, scaled.conj()) + np.eye(rows.shape[1]), scaled)
    filtered = np.einsum("kic,kic->kc", scaled.conj(), middle).real
    if d == 2 and {"x", "y"} <= set(components):
        i, j = components.index("x"), components.index("y")
        filtered[:, i] = filtered[:, j] = 0.5 * (filtered[:, i] + filtered[:, j])
    for i, c in enumerate(components):
        if d == 1:
            wave, weight = np.cos(np.outer(x, k)), filtered[:, i]
        else:
            wave, weight = scipy.special.j0(np.outer(x, k)), filtered[:, i] * k
        profile = wave @ weight
        out[c] = profile / profile[0] if profile[0] > 0 else np.full(len(x), np.nan)
    return x, out


def full_width(x: Floats, profile: Floats) -> float:
    """Return the full width at half maximum [m] of an even profile that starts at its middle; infinite if it does not
    fall to half.
    """
    below = np.flatnonzero(profile < 0.5)
    if not len(below):
        return math.inf
    i = int(below[0])
    return 2.0 * float(np.interp(0.5, [profile[i], profile[i - 1]], [x[i], x[i - 1]]))


def separable_pair(
    model: PressModel, kinds: Sequence[str] | None, uncertainty: Uncertainty | None, farthest: float
) -> float:
    """Return the smallest distance [m] at which two tips are resolved along the worse axis; infinite if it is more
    than ``farthest``.

    Each tip has half of the force and half of the radius. Unknown are the forces and places of both tips, their common radius,
    their elongation along the axis (otherwise one long contact would count as two), offsets, and the uncertain
    properties of the skin. The tips are resolved if the distance is at least `RECOVERABLE_SIGMAS` of its own standard
    deviations (S. T. Smith, IEEE Trans. Signal Process. 53, 2005, 1597-1609, with that factor).
    """
    low, high, count = PAIRS
    length = model.responses.length
    tried = np.geomspace(low * length, min(high * length, farthest), count)
    unknowns = model.unknowns(kinds, uncertainty)
    return max(_pair_along(model, unknowns, axis, tried) for axis in range(model.responses.dimensions))


def _pair_along(model: PressModel, unknowns: tuple[Floats, Floats, Floats], axis: int, tried: Floats) -> float:
    weights, known, prior = unknowns
    r, d = model.responses, model.responses.dimensions
    units = model.units
    forces = 0.5 * model.forces
    ratio: list[float] = []
    for distance in tried:
        sides, radius, drawn = [], np.zeros(len(weights)), np.zeros(len(weights))
        for side in (-0.5, 0.5):
            middle = r.middle.copy()
            middle[axis] += side * distance
            shapes = np.stack(r.derivatives(middle, 0.5 * model.press.contact_radius))
            by_force = r.read(np.repeat(shapes[:1], len(units), axis=0), units)
            by_shape = r.read(shapes[1:], np.repeat(forces[None], d + 1, axis=0))
            sides.append((by_force, by_shape[:d]))
            radius = radius + by_shape[d]
            drawn = drawn + r.read(r.elongated(middle, 0.5 * model.press.contact_radius, axis)[None], forces[None])[0]
        (force_1, place_1), (force_2, place_2) = sides
        across = [place[a] for place in (place_1, place_2) for a in range(d) if a != axis]
        apart, together = 0.5 * (place_2[axis] - place_1[axis]), place_1[axis] + place_2[axis]
        own = np.stack([apart, together, *across, radius, drawn, *force_1, *force_2], axis=1)
        jacobian = np.concatenate([own, known], axis=1)
        deviation = covariance(jacobian, weights, 1, np.concatenate([np.zeros(own.shape[1]), prior]))[0, 0] ** 0.5
        ratio.append(distance / deviation)
        if ratio[-1] >= RECOVERABLE_SIGMAS:
            break
    if ratio[-1] < RECOVERABLE_SIGMAS:
        return math.inf
    if len(ratio) == 1:
        return float(tried[0])
    before, last = max(ratio[-2], 1e-12), ratio[-1]
    share = math.log(RECOVERABLE_SIGMAS / before) / math.log(last / before)
    a, b = tried[len(ratio) - 2], tried[len(ratio) - 1]
    return float(a * (b / a) ** share)
