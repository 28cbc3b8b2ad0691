"""Estimate the modulus of a gel from presses with a known force: with displacements, every force is proportional to
it.
"""

from __future__ import annotations

import math
import re
import tempfile
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from palpate._arrays import to_numpy
from palpate._numbers import plain_number, relative
from palpate.camera.displacements import Displacements, Reading
from palpate.camera.pictures import is_pictures
from palpate.camera.touches import Touches, camera_of, gel_skin
from palpate.camera.traces import ForceTrace, read_force_trace
from palpate.elastic.channels import channel_unit
from palpate.elastic.half_space import HalfSpace
from palpate.elastic.layers import BondedLayers
from palpate.elastic.pad import Floats
from palpate.errors import InvalidInput, Unsupported
from palpate.inverse.fit import POOR_FIT
from palpate.recordings import Recording, read_columns, read_recording, read_stream
from palpate.recordings.formats import endings
from palpate.recordings.skinfile import skin_text
from palpate.sensing.view import View
from palpate.skin import Skin
from palpate.touch import Touch
from palpate.units import UNKNOWN

__all__ = ["Weighed", "weigh"]

#: A frame belongs to the press if dots move by at least this fraction of the largest motion; and number of these
#: frames, from the middle, to solve.
PRESSED, SOLVED = 0.8, 3
#: The same if the force is known at each time: the forces of a whole press determine the modulus.
TRACED, SOLVED_TRACE = 0.3, 6
#: Number of frames at the start of a recording that show the gel at rest, and largest motion in them, as a fraction of
#: the largest motion.
REST, STILL = 5, 0.2
#: Smallest ratio of the dots' motion to the noise in a press.
PRESS_TO_NOISE = 10.0
#: Smallest rank correlation of force and displacement, and smallest number of frames to test it.
TOGETHER, RANKED = 0.5, 8
#: Start value of an unknown modulus; any value would do.
BEGUN = "100 kPa"
#: Half-width of a 95 % interval in standard deviations.
WIDE = 1.96


@dataclass(frozen=True)
class Weighed:
    """A modulus from presses with known forces.

    Attributes
    ----------
    youngs_modulus, std : float
        Modulus of the uppermost layer and its standard deviation [Pa]; moduli of layers below change in proportion.
    factor : float
        Ratio of the modulus to that of the skin; NaN if the latter is "unknown".
    ratios, ratio_std : array (press,)
        Known force over the force with the skin's modulus (if unknown: with `youngs_modulus`), and its standard deviation.
    agreement : float
        Probability of ratios that differ as much if the model holds: below 0.01, pad, depth or scale are wrong. NaN for one press.
    fit : array (press,)
        Misfit probability of each press: `Touch.fit`.
    before : float
        Relative standard deviation of the skin's modulus, 0 if it is exact; infinite if the skin states none.
    """

    youngs_modulus: float
    std: float
    factor: float
    ratios: Floats
    ratio_std: Floats
    agreement: float
    fit: Floats
    before: float = math.inf

    @property
    def better(self) -> bool:
        """Whether the presses give the modulus with a smaller error than the skin states.

        Examples
        --------
        >>> import numpy as np
        >>> from palpate.camera import Weighed
        >>> one = np.ones(1)
        >>> Weighed(3e5, 2e5, 1.0, one, one, float("nan"), one, before=0.3).better  # 67 % where 30 % was known
        False
        """
        return self.std / self.youngs_modulus < self.before

    def __str__(self) -> str:
        said = f" ({plain_number(self.factor, 3)} times what the skin says)" if math.isfinite(self.factor) else ""
        lines = [
            f"modulus         {plain_number(1e-3 * self.youngs_modulus, 4)} kPa {relative(self.std / self.youngs_modulus)}{said}"
        ]
        for i, (ratio, std, fit) in enumerate(zip(self.ratios, self.ratio_std, self.fit)):
            lines.append(f"press {i}         {plain_number(ratio, 3)} +- {plain_number(std, 2)} times; fit {fit:.2g}")
        if not self.better:
            lines.append(
                f"keep            what the skin says, +-{plain_number(100 * self.before, 2)} %, is better than what these presses tell: dots that move sideways on the surface hardly show what "
                "presses. Heavier weights do not help; dots 0.5 to 1 mm deep do"
            )
        poor = [str(i) for i, fit in enumerate(self.fit) if fit < POOR_FIT]
        if poor:
            lines.append(
                f"fit             the pad does NOT explain how the dots of press {', '.join(poor)} move: do not use this modulus before depth, scale, axes and signs "
                "of the dots, and that something presses, are sure"
            )
        if math.isfinite(self.agreement):
            word = (
                "they agree"
                if self.agreement > 0.01
                else "they do NOT agree: pad, depth of the dots or scale are wrong"
            )
            lines.append(f"presses         differ as by chance with probability {self.agreement:.2g}: {word}")
        return "\n".join(lines)


def weigh(
    sources: Sequence[Any] | Any,
    skin: Skin | str | Path,
    forces: Any,
    *,
    view: View | None = None,
    rate: float | None = None,
    reference: int | None = None,
    **options: Any,
) -> Weighed:
    """Estimate the modulus from presses with known normal forces, in pictures of a gel or in recordings of its
    displacements.

    Parameters
    ----------
    sources : one or a list
        Each a press that begins with the gel at rest: videos, folders and so on (`open_pictures`); recordings of displacements or strains (a `Recording`, or a
        file of one: tables of markers too, by the section [columns] of the skin.toml).
    skin : path of a skin.toml, or Skin
        With a guess of the modulus, or ``youngs_modulus = "unknown"``.
    forces : one or a list
        Normal force of each press: a number [N] (mass times 9.81 m/s^2 for a weight that rests on the gel), or force over time on the clock of the press, as a
        `ForceTrace` or a table of it (`read_force_trace`). The trace's mean with the gel at rest is its zero.
    view, rate
        As for `palpate.camera.follow`.
    reference : int, optional
        Frames at the start that show the gel at rest; default: 5, or that of the skin.toml for pictures.
    **options
        Options of `Skin.reconstruct`, such as friction.

    Raises
    ------
    InvalidInput
        Forces that are not positive or not one for each press, a press in which nothing presses, a trace of another time.
    Unsupported
        A pad without one modulus, readings of stress, which do not depend on it.

    Examples
    --------
    >>> import palpate as pp
    >>> from palpate.camera import Dots, Scene, dot_grid, weigh
    >>> gel = pp.BondedLayers([pp.Layer(thickness=4e-3, youngs_modulus=3e5, poissons_ratio=0.48)])
    >>> scene = Scene(pad=gel, depth=0.5e-3, print=Dots(dot_grid((5, 7), 2e-3), 0.8e-3), size=(160, 120), scale=0.1e-3)
    >>> ball = pp.solutions.hertz_point(contact_radius=2.5e-3, force=1.0)
    >>> pictures = list(scene.pictures([None] * 5 + [ball]))
    >>> array = pp.AreaArray(shape=(5, 7), pitch=2e-3, depth=0.5e-3, channels=["displacement_x", "displacement_y"])
    >>> guess = pp.Skin(gel, array, surface=pp.AreaGrid(shape=(13, 16), spacing=1e-3))
    >>> weighed = weigh(pictures, guess, 2.0, view=scene.view)  # it was twice the force: the gel is twice as stiff
    >>> bool(abs(weighed.factor - 2.0) < 0.3)
    True
    """
    listed = list(sources) if isinstance(sources, list | tuple) and not _is_images(sources) else [sources]
    known = [_parse_force(f) for f in (forces if isinstance(forces, list | tuple) else np.atleast_1d(forces).tolist())]
    if len(known) != len(listed):
        raise InvalidInput(f"forces must be one for each of {len(listed)} presses; got {len(known)}.")
    with tempfile.TemporaryDirectory() as folder:
        given = skin if isinstance(skin, Skin) else Path(skin)
        begun = given if isinstance(given, Skin) else _with_start_modulus(given, Path(folder))
        return _weighed(listed, begun, known, view, rate, reference, options, guessed=begun is not given)


def _parse_force(force: Any) -> float | ForceTrace:
    """A force, or one over time."""
    if isinstance(force, ForceTrace):
        return force
    if isinstance(force, str | Path):
        return read_force_trace(force)
    if not (isinstance(force, int | float | np.number) and np.isfinite(force) and force > 0):
        raise InvalidInput(f"forces must be positive [N], or tables of force over time; got {force!r}.")
    return float(force)


def _with_start_modulus(skin: Path, folder: Path) -> Path:
    """The skin with a start value if its modulus is "unknown": displacements give force over modulus, whatever the value."""
    text = skin_text(skin)
    key = re.compile(r'^(\s*youngs_modulus\s*=\s*)("[^"\n]*"|\'[^\'\n]*\')', re.MULTILINE)
    values = [value.strip("\"'").strip().lower() for _, value in key.findall(text)]
    if UNKNOWN not in values:
        return skin
    if any(value != UNKNOWN for value in values):
        raise InvalidInput(
            f"{skin}: the modulus of one layer is unknown and that of another is not: a weight determines how stiff they are together. Give a guess of the unknown one: their ratio is kept."
        )
    path = folder / skin.name
    path.write_text(key.sub(rf'\g<1>"{BEGUN}"', text), encoding="utf-8")
    return path


def _weighed(
    listed: list[Any],
    skin: Skin | Path,
    known: list[float | ForceTrace],
    view: View | None,
    rate: float | None,
    reference: int | None,
    options: dict[str, Any],
    *,
    guessed: bool,
) -> Weighed:
    ratios, stds, fits, modulus, before = [], [], [], math.nan, math.inf
    for index, (source, force) in enumerate(zip(listed, known)):
        if isinstance(source, Recording) or (isinstance(source, str | Path) and not is_pictures(source)):
            press = _recorded(source, skin, reference, options, f"press {index}")
            modulus, before = _modulus(press.skin), press.before
            found = _ratio(press, force)
        else:
            settings = camera_of(skin, view)
            lies: Any = settings if view is None else view
            texture = settings.texture if settings else None
            rest = settings.reference if reference is None and settings else reference
            stage = settings.stage if settings else None
            with Displacements(source, lies, rate=rate, reference=rest, stage=stage, texture=texture) as readings:
                full = gel_skin(skin, readings.positions)
                modulus = _modulus(full)
                before = _stated(full)
                full = _without_modulus(full)
                press = _filmed(readings, full, settings.distance if settings else None, options)
                found = _ratio(press, force)
        ratios.append(found[0])
        stds.append(found[1])
        fits.append(found[2])
    ratio, each = np.array(ratios), np.array(stds)
    weight = 1.0 / each**2
    mean = float((weight * ratio).sum() / weight.sum())
    # The common errors of the presses (depth, thickness) do not average out: the error is at least that of the best
    # press.
    shared = float(each.min())
    agreement = math.nan
    scatter = 0.0
    if len(ratio) > 1:
        from scipy.stats import chi2

        misfit = float((weight * (ratio - mean) ** 2).sum())
        agreement = float(chi2.sf(misfit, len(ratio) - 1))
        scatter = float(ratio.std(ddof=1)) / math.sqrt(len(ratio))
    std = math.hypot(shared, scatter)
    if guessed:
        return Weighed(mean * modulus, std * modulus, math.nan, ratio / mean, each / mean, agreement, np.array(fits))
    return Weighed(mean * modulus, std * modulus, mean, ratio, each, agreement, np.array(fits), before)


def _is_images(sources: Sequence[Any]) -> bool:
    return bool(len(sources)) and all(isinstance(one, np.ndarray) and one.ndim in (2, 3) for one in sources)


def _modulus(skin: Skin) -> float:
    pad = skin.pad
    if isinstance(pad, HalfSpace):
        return float(pad.youngs_modulus)
    if isinstance(pad, BondedLayers):
        return float(pad.layers[0].youngs_modulus)
    raise Unsupported(
        f"the modulus of a {type(pad).__name__} cannot be weighed: describe a half-space or bonded layers without creep."
    )


def _stated(skin: Skin) -> float:
    """Relative standard deviation of the modulus that the skin states; infinite if it states none."""
    known = skin.uncertainty.youngs_modulus
    return math.inf if known is None else known


def _without_modulus(skin: Skin) -> Skin:
    """The skin with an exact modulus: the modulus is the unknown, and only other properties are uncertain."""
    problem = skin.problem()
    return Skin(
        skin.pad,
        skin.planes,
        surface=skin.surface if problem.fixed else None,
        boundary=problem.boundary,
        nuisance="auto" if problem.nuisance is None else problem.nuisance,
        uncertainty=replace(skin.uncertainty, youngs_modulus=0.0),
    )


@dataclass(frozen=True, eq=False)
class _Press:
    """A press, frame by frame: motion of the gel [m, or of strain], times, and a function that solves a frame.
    ``quiet`` is the motion due to noise, ``rest`` the number of frames without a press, ``before`` the prior
    uncertainty of the modulus.
    """

    name: str
    what: str
    skin: Skin
    size: Floats
    time: Floats
    number: list[int]
    quiet: float
    rest: int
    solve: Callable[[int], Touch]
    before: float = math.inf


def _filmed(readings: Displacements, skin: Skin, distance: float | None, options: dict[str, Any]) -> _Press:
    """A press in pictures."""
    taken: list[Reading] = [reading for reading in readings if not reading.fault]
    way = Touches(readings, skin, distance=distance, track=False, every=1, options=options)
    return _Press(
        name=readings.pictures.name,
        what="picture",
        skin=skin,
        size=np.array([_moved(r.values) for r in taken]),
        time=np.array([r.time for r in taken]),
        number=[r.index for r in taken],
        quiet=float(np.median([np.nanmedian(r.std) for r in taken])) if taken else 0.0,
        rest=readings.reference,
        solve=lambda i: way.alone(taken[i]),
    )


def _recorded(source: Any, skin: Skin | Path, reference: int | None, options: dict[str, Any], name: str) -> _Press:
    """A press in a recording of displacements or strains."""
    if not isinstance(source, Recording):
        name = str(source)
        mapping: Any = None
        if not isinstance(skin, Skin):
            table = Path(source).suffix.lower() in endings("read_mapped")
            mapping = read_columns(skin) if table else read_stream(skin)
        source = read_recording(source, mapping=mapping)
    full = skin if isinstance(skin, Skin) else Skin.from_file(skin, recording=source)
    channels = tuple(c for plane in full.planes for c in plane.channels)
    if source.channels != channels or any(plane.shape != source.readings.shape[2:] for plane in full.planes):
        raise InvalidInput(
            f"{name}: holds {', '.join(source.channels)} of {'x'.join(map(str, source.readings.shape[2:]))} places, and the skin describes {', '.join(channels)} of "
            f"{' and '.join('x'.join(map(str, p.shape)) for p in full.planes)}: weigh with the skin of this recording."
        )
    stress = [c for c in channels if channel_unit(c) == "Pa"]
    if stress:
        raise Unsupported(
            f"{name}: {', '.join(stress)} give forces without the modulus: a known force would correct their unit. palpate weigh is for displacements and strains."
        )
    rest = REST if reference is None else reference
    if not 0 <= rest < len(source.readings):
        raise InvalidInput(
            f"{name}: {rest} frames at rest are taken of {len(source.readings)}: give fewer with reference= (--baseline), and a press after them."
        )
    values = source.readings - (_mean(source.readings[:rest]) if rest else 0.0)
    size = np.array([_moved(v.reshape(len(channels), -1)) for v in values])
    # Use differences between successive frames, so that a press among them has no effect.
    quiet = _middle(np.abs(np.diff(values[:rest], axis=0))) / math.sqrt(2.0) if rest > 1 else 0.0
    if rest and size.max() > PRESS_TO_NOISE * quiet and size[:rest].max() > STILL * size.max():
        raise InvalidInput(
            f"{name}: the gel moves in the first {rest} frames, which are taken to show it at rest: give the number that do with reference= (--baseline)."
        )
    before = _stated(full)
    full = _without_modulus(full)
    cut = list(np.cumsum([len(plane.channels) for plane in full.planes])[:-1])

    def solve(i: int) -> Touch:
        lost = np.isnan(values[i]).any(axis=0)
        seen = full.masked(~lost) if lost.any() else full
        parts = np.split(np.where(lost, 0.0, values[i]), cut)
        return seen.reconstruct(parts[0] if len(parts) == 1 else parts, **options)

    return _Press(
        name,
        "frame",
        full,
        size,
        np.asarray(source.time, dtype=np.float64),
        list(range(len(values))),
        quiet,
        rest,
        solve,
        before,
    )


def _mean(values: Floats) -> Floats:
    """Mean over the frames that show a marker; NaN if none does."""
    there = np.isfinite(values)
    count = there.sum(axis=0)
    return np.where(count > 0, np.where(there, values, 0.0).sum(axis=0) / np.maximum(count, 1), np.nan)


def _middle(values: Floats) -> float:
    """The median without missing values; 0 if all are missing."""
    there = values[np.isfinite(values)]
    return float(np.median(there)) if there.size else 0.0


def _moved(values: Floats) -> float:
    """Size of the motion at the places (channel, place) that move most."""
    size = np.sqrt((values**2).sum(axis=0))
    size = np.sort(size[np.isfinite(size)])  # of the places that are not lost
    return float(np.median(size[-8:])) if len(size) else 0.0


def _ratio(press: _Press, known: float | ForceTrace) -> tuple[float, float, float]:
    """Ratio of the known force to the estimated one, its standard deviation, and the fit."""
    most = float(press.size.max(initial=0.0))
    if not most > PRESS_TO_NOISE * press.quiet:
        raise InvalidInput(
            f"{press.name}: nothing presses in these {press.what}s: the dots move by {plain_number(1e6 * most, 2)} um at most. Show the gel at rest first, then the press."
        )
    force, at = _held(press, known, most)
    found, spreads, fits = [], [], []
    for i in at:
        touch = press.solve(i)
        value = float(to_numpy(touch.force)[2])
        if not value > 0:
            raise InvalidInput(
                f"{press.name}: no pressing force is found in {press.what} {press.number[i]} ({touch.notes[-1] if touch.notes else 'no contact'})."
            )
        low, high = (float(to_numpy(end)[2]) for end in touch.interval(0.95, "force"))
        found.append(value)
        spreads.append((high - low) / (2.0 * WIDE))
        fits.append(float(np.asarray(touch.fit)) if touch.fit is not None else math.nan)
    mean, ratio = float(np.mean(found)), float(np.mean(force) / np.mean(found))
    # Errors of one frame are also those of the next.
    std = ratio * math.hypot(float(np.mean(spreads)), float(np.std(force / ratio - np.array(found)))) / mean
    return ratio, std, float(np.min(fits))


def _held(press: _Press, known: float | ForceTrace, most: float) -> tuple[Floats, list[int]]:
    """The known forces in the frames to solve, and the indices of these frames."""
    if isinstance(known, float):
        held = np.flatnonzero(press.size > PRESSED * most)
        middle = np.linspace(0.25 * (len(held) - 1), 0.75 * (len(held) - 1), SOLVED)
        at = [int(held[i]) for i in np.unique(middle.round().astype(int))]
        return np.full(len(at), known), at
    force = known.at(press.time)
    rest = force[: press.rest][np.isfinite(force[: press.rest])]
    force = force - (rest.mean() if len(rest) else 0.0)
    held = np.flatnonzero((press.size > TRACED * most) & np.isfinite(force))
    if not len(held):
        raise InvalidInput(
            f"{known.name}: its times go from {known.time[0]:g} to {known.time[-1]:g} s, and {press.name} presses from {press.time[press.size > TRACED * most].min():g} to "
            f"{press.time[press.size > TRACED * most].max():g} s: give both on one clock, such as by taking the time of the first {press.what} from the trace's."
        )
    if force[held].mean() < 0:  # the reading of a cell below the gel, or one that pulls
        force = -force
    both = np.isfinite(force)
    if both.sum() >= RANKED:
        from scipy.stats import spearmanr

        rank = float(spearmanr(press.size[both], force[both]).statistic)
        if not rank > TOGETHER:
            raise InvalidInput(
                f"{known.name}: its forces and how far the gel moves in {press.name} do not rise together (rank correlation {rank:.2g}): give both on one clock."
            )
    held = held[force[held] > 0]
    ordered = held[np.argsort(force[held])]
    picked = np.unique(np.linspace(0, len(ordered) - 1, SOLVED_TRACE).round().astype(int))
    at = [int(ordered[i]) for i in picked]
    return force[at], at
