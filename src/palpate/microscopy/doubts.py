"""Find reasons to doubt the traction of a cell, and say what to check for each."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import numpy.typing as npt
import scipy.fft

from palpate._numbers import plain_number
from palpate.elastic.pad import Floats
from palpate.microscopy.blobs import work_of
from palpate.microscopy.fields import Field
from palpate.microscopy.inversion import Inverted
from palpate.microscopy.orientation import suspected

__all__ = ["doubts", "reworded"]

#: A net force or torque of at least this many standard deviations is questioned, and so are principal moments of
#: opposite signs: those of a cell that pulls have the same sign.
QUESTIONED = 3.0
OPPOSED = 0.3
#: What the user should check if the field concentrates traction better with other axes (`suspected`).
AXES = {
    "v's sign": "with v of the other sign it does not: is v's sign right? Where v alone grows upwards, say v_up=True (--v-up); where y does too, up=True (--up)",
    "u for v": "with u and v exchanged it does not: are u and v the right way round, and are rows and columns those of the picture?",
    "u for v and a sign": "with u and v exchanged, and one of them turned, it does not: are u and v and their signs right, and are rows and columns those of the picture?",
}
#: Residuals of at least this many times the noise are questioned.
MISFIT = 2.0
#: Strains above STRAINED are beyond linear elasticity. Displacements below SMALLEST [px] are smaller than any picture
#: can show.
STRAINED, SMALLEST = 0.3, 0.02
#: The energy is said to depend on the window if it falls below RESTS of its value when the window is taken as zero.
#: SOME samples are used to test this, and blobs keep at least NARROWEST of their variance.
RESTS, SOME, NARROWEST = 0.8, 12, 0.1
#: A mask is doubtful if it contains less than HELD of the traction, and would contain more than FOUND of it at another
#: position.
HELD, FOUND = 0.5, 0.8
#: That test of the mask uses traction of at least this many standard deviations.
SIGNIFICANT_TRACTION = 1.5
#: Advice in the notes of the inversion, and the same advice in words of microscopy.
REMEDIES = {
    "If the image cannot drift, pass Skin(..., nuisance=[])": "If the picture cannot have moved, pass drift=False (--still)",
    "Give the array its noise=..., and noise_correlation=... if neighbours share it, as windows that overlap do": "Give noise=... (--noise)",
    "where something presses, seek it as well (components x, y, z)": "where the cell presses too, that is an error",
    "Give the array its noise=..., or a larger parameter": "Give noise=... (--noise)",
    'to change this: "200 kPa +- 5 %" in skin.toml, or uncertainty=': 'to change this: --youngs-modulus "8 kPa +- 20 %", or so in the file of --skin',
}


def reworded(note: str) -> str:
    """Return a note with its advice in words of microscopy."""
    for theirs, ours in REMEDIES.items():
        note = note.replace(theirs, ours)
    return note


def doubts(
    numbers: dict[str, Any],
    principal: tuple[float, float, float],
    field: Field,
    inside: npt.NDArray[np.bool_],
    masked: bool,
    done: Inverted,
) -> list[str]:
    """Return the reasons to doubt a result, as sentences."""
    said = []

    def own(q: Any) -> float:
        """The error but that of modulus and scale, which change no sign."""
        return math.sqrt(max(q.std**2 - (done.touch._scale_std * q.value) ** 2, 0.0))

    moment = numbers["contractile_moment"]
    large, small = max(principal[:2], key=abs), min(principal[:2], key=abs)
    sure = abs(large) > QUESTIONED * own(moment)
    noise = field.noise or (None if done.touch.noise_std is None else float(np.mean(done.touch.noise_std)))
    # with wrong axes no traction explains the field, so its energy may be uncertain although the field is far above noise
    signal = math.sqrt(float(np.nanmean(np.square(field.displacement))))
    shown = numbers["strain_energy"].value > QUESTIONED * own(numbers["strain_energy"]) or signal > QUESTIONED * (
        noise or math.inf
    )
    axes = suspected(field, done.skin.pad, depth=done.skin.planes[0].depth, noise=noise) if shown and noise else ""
    if axes:
        said.append(f"the field spreads its traction far over the gel, as no cell does, and {AXES[axes]}")
    elif sure and large * small < 0 and abs(small) > OPPOSED * abs(large):
        said.append(
            "the field pulls inwards along one direction and pushes outwards across it, as no cell does: is v's sign right (v_up, --v-up), are u and v the right way round, "
            "are rows and columns those of the picture?"
        )
    elif sure and moment.value < -QUESTIONED * own(moment):
        said.append(
            "the cell pushes outwards, as hardly any does: are the pictures in order (at rest first, pulled second), or do the displacements have the opposite sign?"
        )
    torque = numbers["torque"]
    if not axes and abs(torque.value) > max(2.0 * own(torque), 2.0 * abs(moment.value)):
        said.append(
            "the field turns more than it contracts, as no cell does: are u and v the right way round, and are rows and columns those of the picture?"
        )
    for key in ("net_force_x", "net_force_y", "torque"):
        q = numbers[key]
        if abs(q.value) > QUESTIONED * own(q):
            said.append(
                f"{q.label} is {str(q).partition(': ')[2]}, and a cell that is wholly in view has none: it reaches beyond the field of view or the mask, or a neighbour pulls"
            )
    edge = inside.copy()
    edge[1:-1, 1:-1] = False
    if masked and edge.any():
        said.append("the mask reaches the edge of the field of view: what lies beyond is missing from every number")
    if "background" in numbers:
        share = numbers["background"].value / max(numbers["traction_rms"].value, 1e-300)
        if share > 0.5:
            said.append(
                f"traction outside the cell is {100 * share:.0f} % of that inside: noise, a neighbour, or a mask that misses part of the cell; energy and sums of sizes are partly that"
            )
    if not shown:
        said.append("strain energy may be zero: no traction exceeds the noise")
    if field.std is not None and done.touch.residual is not None and float(done.touch.residual) > MISFIT:
        said.append(
            f"the traction leaves {plain_number(float(done.touch.residual), 2)} times the noise of the displacements unexplained: outliers, or a gel that is not as described"
        )
    u = field.displacement - np.nanmedian(field.displacement, axis=(1, 2), keepdims=True)
    steep = max(float(np.nanquantile(np.abs(np.diff(u, axis=a)), 0.99)) / field.pitch for a in (1, 2))
    if steep > STRAINED:
        said.append(
            f"displacements change by {100 * steep:.0f} % of the distance between vectors: beyond linear elasticity, or outliers, or another unit or pixel than was said"
        )
    largest = float(np.nanmax(np.abs(u))) / field.pixel
    if largest < SMALLEST:
        said.append(
            f"the largest displacement is {largest:.2g} px, less than pictures can resolve. Check the unit, and that the pixel is that of the picture"
        )
    if field.aperture == 0:
        usual = 2 * field.step
        more = _with_window(done, usual * field.pixel, 0.0)
        about = (
            ""
            if more is None
            else f" (with windows of {usual:.3g} px the energy would be about {more:.2g} times as large)"
        )
        said.append(
            f"each vector is taken as the displacement of a point: where it is the mean over a window, what the window blurs is missing from energy and peaks{about}; say window= "
            "(--window)"
        )
    elif (less := _with_window(done, 0.0, field.aperture)) is not None and less < RESTS:
        said.append(
            f"energy and peaks rest on the window of {field.aperture / field.pixel:.3g} px: without it the energy would be about {less:.2g} times as large. Check that it is that of the correlation"
        )
    if (patch := _largest_patch(done)) is not None and patch < field.aperture:
        said.append(
            f"the largest traction is that of a patch about {1e6 * patch:.2g} um wide, finer than the window of {1e6 * field.aperture:.2g} um. The window determines its force and not its profile: "
            "of adhesions that are even over several windows it is too large, by up to 2.5 times. Compare it with that of a wider window (--window)"
        )
    unlike = int(field.unlike.sum())
    if unlike and done.samples is None:
        said.append(
            f"{unlike} of {field.valid.size} vectors differ from all about them, and make traction of their own: if they are bad ones, leave them out with without_outliers() "
            "(--drop-outliers)"
        )
    # the fit has its own note on excluded vectors
    lost = int((~field.valid).sum()) - field.left_out
    if lost > 0:
        said.append(
            f"{lost} of {field.valid.size} vectors are missing: traction there is what their neighbours suggest"
        )
    if masked and len(done.draws):
        said += _misplaced(done.traction, done.draws.std(axis=0), inside, field)
    return said


def _with_window(done: Inverted, window: float, was: float) -> float | None:
    """Return the energy if windows had the side ``window`` [m] instead of ``was``, relative to the energy found. Blobs
    keep the second moments that the vectors show, and lose those of the window.
    """
    if done.samples is None or done.response is None:
        return None
    before = after = 0.0
    for sample in done.samples[:: max(1, len(done.samples) // SOME)]:
        other = np.maximum(sample.variance + (was**2 - window**2) / 12, NARROWEST * sample.variance)
        before += float(work_of(sample.places, sample.variance, sample.forces, done.response).sum())
        after += float(work_of(sample.places, other, sample.forces, done.response).sum())
    return after / before if before > 0 else None


def _largest_patch(done: Inverted) -> float | None:
    """Return the side [m] of the square of even traction that has the second moments of the blob with the largest
    traction; median over the samples.
    """
    sides = [
        math.sqrt(12.0 * float(s.variance[int((np.hypot(*s.forces.T) / s.variance).argmax())]))
        for s in done.samples or ()
        if len(s.forces)
    ]
    return float(np.median(sides)) if sides else None


def _misplaced(traction: Floats, std: Floats, inside: npt.NDArray[np.bool_], field: Field) -> list[str]:
    """Return a sentence if the mask would contain most of the traction at another position."""
    size = np.hypot(*traction)
    # keep only significant traction
    size = np.where(size > SIGNIFICANT_TRACTION * np.hypot(*std), size, 0.0)
    if not size.any():
        return []
    whole = max(float(size.sum()), 1e-300)
    share = float(size[inside].sum()) / whole
    if share > HELD:
        return []
    room = [2 * n for n in size.shape]
    # sum of the traction inside the mask for every shift of the mask
    sums = (
        scipy.fft.irfft2(scipy.fft.rfft2(size, room) * np.conj(scipy.fft.rfft2(inside.astype(float), room)), room)
        / whole
    )
    row, column = np.unravel_index(int(sums.argmax()), sums.shape)
    best = float(sums[row, column])
    if best < max(FOUND, share + 0.3):
        return []
    down, right = (int(n) - r if n >= r // 2 else int(n) for n, r in zip((row, column), room))
    where = f"{abs(right) * field.step:.3g} px to the {'right' if right >= 0 else 'left'} and {abs(down) * field.step:.3g} px {'down' if down >= 0 else 'up'}"
    start = ", ".join(f"{s:g}" for s in field.start)
    return [
        f"{100 * share:.0f} % of the traction lies in the mask, and {100 * best:.0f} % would if the mask lay {where}: is it the mask of this picture, and of this cell, and does the first vector "
        f"lie at pixel ({start}), column and row (start=, --start)?"
    ]
