"""Observability: which components of traction the channels can separate, from the condition of each wavevector's
matrix.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from palpate.elastic.channels import find_channel, mirror_parity
from palpate.elastic.pad import Floats, Pad, shear_modulus
from palpate.elastic.quantities import COMPONENTS, transfer
from palpate.errors import InvalidInput, NotObservable
from palpate.sensing.arrays import Array

__all__ = ["Observability", "check_observable", "is_observable", "observability", "observable_components"]

#: A combination of components is invisible if the ratio of singular values is below this at every wavelength.
BLIND = 1e-9
#: Channels without any larger response, in units of stress, read rounding errors: strain_zz at the base of an
#: incompressible layer has 1e-14 of its usual response.
VANISHING = 1e-11
#: Pressure confounds shear if its effect on the readings is at least this fraction of that of equal shear.
ACTS = 0.1
#: On a bonded pad, pressure is sought by default if its effect is at least this fraction of that of shear; with
#: pressure fixed at zero, every load would read 0 N. Markers on the surface of an incompressible gel (Poisson's ratio
#: 0.48) have 0.02 to 0.09. The interval of the force is then wide.
FELT = 0.01
#: Largest number of readings for which this is the default: on a slow machine a frame of 48 x 48 markers takes 1 s, or
#: 20 to 27 s if contact covers a third of them; one of 64 x 64 with such a contact takes minutes.
NARROWED_READINGS = 5000
#: Channels normal to the surface, on which pressure has the largest effect.
NORMAL = ("displacement_z", "strain_zz", "stress_zz")


@dataclass(frozen=True)
class Observability:
    """How well the channels determine traction at each wavelength.

    Attributes
    ----------
    wavelength : array (n,) [m]
    singular_values : array (n, component)
        Of the matrix channel x component of that wavelength, channels divided by their noise (or balanced where no
        noise is given); in area contact for the worst of eight directions.
    condition : array (n,)
        Ratio of the largest to the smallest; infinite where a combination is invisible.
    components : tuple of str
    """

    wavelength: Floats
    singular_values: Floats
    condition: Floats
    components: tuple[str, ...]


def _whitened(
    pad: Pad,
    planes: Sequence[Array],
    k: Floats,
    angle: float | Floats,
    *,
    scaled: Floats | None = None,
    plain: bool = False,
) -> npt.NDArray[np.complex128]:
    """Transfer matrix divided by each channel's noise. Without noise, or if ``plain``, in units of stress, at the
    wavenumbers ``scaled`` if given instead of ``k``.
    """
    d = planes[0].dimensions
    modulus = 2 * shear_modulus(pad, 0.0)
    rows = []
    for array in planes:
        matrix = transfer(pad, k * np.cos(angle), k * np.sin(angle), array.depth, array.channels, line=d == 1)
        if d == 1:
            matrix = matrix[..., [0, 2]]
        if array.noise_std is not None and not plain:
            scale: Floats = np.broadcast_to(np.asarray(array.noise_std), (len(k), len(array.channels)))
        else:  # in units of stress: strain times 2 mu, displacement times 2 mu k
            scale = np.stack(
                [find_channel(c).kind.scale(modulus, k if scaled is None else scaled) for c in array.channels], axis=-1
            )
        rows.append(matrix / scale[..., None])
    return np.concatenate(rows, axis=-2)


def observability(
    pad: Pad, planes: Sequence[Array], wavelength: npt.ArrayLike, components: Sequence[str]
) -> Observability:
    """Singular values and condition of each wavelength's matrix for the components sought."""
    names = COMPONENTS[planes[0].dimensions]
    columns = [names.index(c) for c in components]
    lengths = np.atleast_1d(np.asarray(wavelength, dtype=np.float64))
    if not (np.isfinite(lengths).all() and (lengths > 0).all()):
        raise InvalidInput("wavelength must be positive and finite [m].")
    k = 2 * np.pi / lengths
    angles = np.zeros(1) if planes[0].dimensions == 1 else np.arange(8) * np.pi / 8 + 0.05
    matrix = _whitened(pad, planes, np.tile(k, len(angles)), np.repeat(angles, len(k)))[..., columns]
    s = np.linalg.svd(matrix, compute_uv=False)
    s = np.concatenate([s, np.zeros((len(s), len(columns) - s.shape[-1]))], axis=-1).reshape(len(angles), len(k), -1)
    found = s[s[..., -1].argmin(axis=0), np.arange(len(k))]
    observable = found[:, -1] > BLIND * found[:, 0]
    condition = np.full(len(k), np.inf)
    condition[observable] = found[observable, 0] / found[observable, -1]
    return Observability(lengths, found, condition, tuple(components))


def _probe(planes: Sequence[Array]) -> Floats:
    depth = max(max(p.depth for p in planes), 1e-30)
    if max(p.depth for p in planes) == 0:
        extents = np.ptp(planes[0].points, axis=0)
        depth = float(extents[0] or extents.max()) / 20
    return np.asarray(depth * 2 * np.pi / np.geomspace(0.05, 3.0, 7))


def is_observable(pad: Pad, planes: Sequence[Array], components: Sequence[str]) -> bool:
    """Whether the channels determine these components, and every combination of them, at some wavelength."""
    lengths = _probe(planes)
    if not np.abs(_whitened(pad, planes, 2 * np.pi / lengths, 0.05, plain=True)).max() > VANISHING:
        return False
    return bool(np.isfinite(observability(pad, planes, lengths, components).condition).any())


def observable_components(pad: Pad, planes: Sequence[Array]) -> tuple[str, ...]:
    """The components sought by default: as many as the channels can separate.

    All of them, if possible. Otherwise, if a channel normal to the surface (stress_zz, strain_zz, displacement_z) is
    measured: pressure, and shear along x (or y) if a channel is odd in that axis, as stress_xz and displacement_x are.
    (With pressure fixed at zero, pressure would appear as shear.) Otherwise, on a pad bonded to a base, all of them if
    pressure affects the readings too (`presses`). Otherwise both shears; or one, if every channel is odd in that axis;
    or pressure.
    """
    line = planes[0].dimensions == 1
    channels = [c for p in planes for c in p.channels]
    axes = "x" if line else "xy"
    candidates: list[tuple[str, ...]] = [("x", "z")] if line else [("x", "y", "z")]
    if any(c in NORMAL for c in channels):
        candidates += [(a, "z") for a in axes if any(mirror_parity(c, a) < 0 for c in channels)]
        candidates.append(("z",))
    shears = [(axis,) for axis in axes] if line else [("x", "y")]
    bonded = getattr(pad, "thickness", None) is not None
    if bonded and not is_observable(pad, planes, candidates[0]) and presses(pad, planes, shears[0], FELT):
        readings = sum(int(p.valid.sum()) * len(p.channels) for p in planes)
        if readings <= NARROWED_READINGS and not any(is_observable(pad, planes, c) for c in candidates):
            return candidates[0]
    if not line:
        candidates.append(("x", "y"))
    candidates += [(axis,) for axis in axes if all(mirror_parity(c, axis) < 0 for c in channels)]
    for candidate in [*candidates, ("z",), ("x",)]:
        if is_observable(pad, planes, candidate):
            return candidate
    raise NotObservable(
        f"the channels {', '.join(c for p in planes for c in p.channels)} do not fix any set of traction components. "
        "Measure stress_zz, or two components of displacement."
    )


def presses(pad: Pad, planes: Sequence[Array], shears: Sequence[str], least: float = ACTS) -> bool:
    """Whether pressure affects readings that these shears also explain: by at least ``least`` times the effect of
    equal shear, at some wavelength.
    """
    return is_observable(pad, planes, shears) and bool((pressing(pad, planes, shears, most=True) > least).any())


def pressing(pad: Pad, planes: Sequence[Array], shears: Sequence[str], *, most: bool = False) -> Floats:
    """Effect of pressure on the readings relative to that of equal shear, at nine wavelengths from the array's width
    to a tenth of it.

    In area contact the smaller value of the two axes, or the larger with ``most``: a channel with less noise counts
    more, and may belong to either axis.
    """
    names = COMPONENTS[planes[0].dimensions]
    size = float(np.ptp(planes[0].points, axis=0).max())
    k = 2 * np.pi / np.geomspace(size, 0.1 * size, 9)
    along = [0.0] if len(names) == 2 else [0.05, 0.5 * np.pi - 0.05]
    ratios = []
    for angle in along:
        matrix = _whitened(pad, planes, k, angle)
        shear = np.linalg.norm(matrix[..., [names.index(c) for c in shears]], axis=(-2, -1))
        ratios.append(np.linalg.norm(matrix[..., -1], axis=-1) / shear)
    return np.asarray(np.max(ratios, axis=0) if most else np.min(ratios, axis=0))


def check_observable(
    pad: Pad, planes: Sequence[Array], components: Sequence[str], *, narrowed: bool = False, remedied: bool = False
) -> None:
    """Raise `NotObservable`, naming a remedy, unless the channels can separate the components.

    ``narrowed``: constraints of the method may separate components that the channels cannot; each component must still
    affect the readings. ``remedied``: there is such a method for this skin.
    """
    measured = getattr(pad, "components", components)
    unknown = [c for c in components if c not in measured]
    if unknown:
        raise NotObservable(
            f"the response of this pad was measured for {', '.join(measured)}, and never for {', '.join(unknown)}: no press of its table acts that way. Seek "
            f"components={list(measured)}, or press sideways too."
        )
    if is_observable(pad, planes, components):
        return
    if narrowed and "z" in components and all(is_observable(pad, planes, (c,)) for c in components):
        return
    channels = ", ".join(f"{c} at depth {p.depth:g} m" for p in planes for c in p.channels)
    remedy = (
        "Add stress_xz to the channels, or a second plane of the same channel at another depth"
        if planes[0].dimensions == 1
        else "Measure three independent channels (stress_xz, stress_yz, stress_zz, or three displacements)"
    )
    raise NotObservable(
        f"the components {', '.join(components)} cannot be told apart from {channels}: at every wavelength some "
        f'combination of them has no effect on the readings. {remedy}, or seek fewer components (components=["z"])'
        + (', or use method="adaptive", which knows that pressure pushes.' if remedied else ".")
    )


def without_mean(pad: Pad, planes: Sequence[Array], boundary: str) -> bool:
    """Whether the mean traction is undetermined: absolute displacements of a periodic half-space."""
    if boundary != "periodic" or pad.mean_compliance(0.0) is not None:
        return False
    return all(find_channel(c).kind.absolute for p in planes for c in p.channels)


def blind_to_force(pad: Pad, planes: Sequence[Array], components: Sequence[str]) -> tuple[str, ...]:
    """Components whose mean (net force) has no effect on any channel as the wavelength grows."""
    names = COMPONENTS[planes[0].dimensions]
    size = float(np.ptp(planes[0].points, axis=0).max())
    k = np.array([1e-5, 1.0]) * 2 * np.pi / size
    # Use the same units for both: the displacement of a bonded layer stays constant as the wavelength grows.
    matrix = _whitened(pad, planes, k, 0.3 if len(names) == 3 else 0.0, scaled=np.full(2, k[-1]))
    response = np.abs(matrix).max(axis=-2)
    # (wavelength, component): the response at wavelengths far above the size of the array.
    left = response[0] / np.maximum(response.max(axis=0), 1e-300)
    return tuple(c for c in components if left[names.index(c)] < 1e-3)
