"""The modulus of a gel from presses with a known force: with displacements, every force is proportional to it."""

from __future__ import annotations

import math
import re
import tempfile
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from palpate._arrays import to_numpy
from palpate.camera.displacements import Displacements, Reading
from palpate.camera.touches import Touches, camera_of, gel_skin
from palpate.elastic.half_space import HalfSpace
from palpate.elastic.layers import BondedLayers
from palpate.elastic.pad import Floats
from palpate.errors import InvalidInput, Unsupported
from palpate.inverse.fit import POOR_FIT
from palpate.sensing.view import View
from palpate.skin import Skin
from palpate.units import UNKNOWN

__all__ = ["Weighed", "weigh"]

#: A frame belongs to the press where dots move by this part of the most; of these, the middle ones are solved, so many.
PRESSED, SOLVED = 0.8, 3
#: What a modulus that is unknown begins with: any.
BEGUN = "100 kPa"
#: A 95 % interval is so many standard deviations wide to each side.
WIDE = 1.96


@dataclass(frozen=True)
class Weighed:
    """What presses with known forces tell of the modulus.

    Attributes
    ----------
    youngs_modulus, std : float
        Of the uppermost layer [Pa]; layers below in the same proportion.
    factor : float
        Over what the skin says; NaN where that is "unknown".
    ratios, ratio_std : array (press,)
        Known force over the force found with the skin's modulus (where that is unknown: with `youngs_modulus`), and its standard deviation.
    agreement : float
        Probability of ratios that differ as much where the model holds: below 0.01, pad, depth or scale are wrong. NaN for one press.
    fit : array (press,)
        How well the pad explains the dots: `Touch.fit`.
    before : float
        Standard deviation of the modulus by what the skin says, as a part of it; infinite where that is "unknown".
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
        """Whether the presses tell the modulus better than the skin says it is known.

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
        said = f" ({self.factor:.3g} times what the skin says)" if math.isfinite(self.factor) else ""
        lines = [
            f"modulus         {1e-3 * self.youngs_modulus:.4g} kPa +- {100 * self.std / self.youngs_modulus:.2g} %{said}"
        ]
        for i, (ratio, std, fit) in enumerate(zip(self.ratios, self.ratio_std, self.fit)):
            lines.append(f"press {i}         {ratio:.3g} +- {std:.2g} times; fit {fit:.2g}")
        if not self.better:
            lines.append(
                f"keep            what the skin says, +-{100 * self.before:.2g} %, is better than what these presses tell: dots that move sideways on the surface hardly show what "
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
    forces: npt.ArrayLike,
    *,
    view: View | None = None,
    rate: float | None = None,
    **options: Any,
) -> Weighed:
    """The modulus from pictures of presses with known normal forces.

    Parameters
    ----------
    sources : one or a list
        Of videos, folders and so on (`open_pictures`), each a press that begins with the gel at rest.
    skin : path of a skin.toml, or Skin
        With a guess of the modulus, or ``youngs_modulus = "unknown"``.
    forces : float or sequence
        Normal force of each press [N]: mass times 9.81 m/s^2 for a weight that rests on the gel.
    view, rate
        As for `palpate.camera.follow`.
    **options
        Of `Skin.reconstruct`, such as friction.

    Raises
    ------
    InvalidInput
        Forces that are not positive or not one for each press, a press in which nothing presses.
    Unsupported
        A pad without one modulus.

    Examples
    --------
    >>> import palpate as pp
    >>> from palpate.camera import Dots, Scene, dot_grid, weigh
    >>> gel = pp.BondedLayers([pp.Layer(thickness=4e-3, youngs_modulus=3e5, poissons_ratio=0.48)])
    >>> scene = Scene(pad=gel, depth=0.5e-3, print=Dots(dot_grid((5, 7), 2e-3), 0.8e-3), size=(160, 120), scale=0.1e-3)
    >>> ball = pp.solutions.hertz_point(radius=2.5e-3, force=1.0)
    >>> pictures = list(scene.pictures([None] * 5 + [ball]))
    >>> array = pp.AreaArray(shape=(5, 7), pitch=2e-3, depth=0.5e-3, channels=["displacement_x", "displacement_y"])
    >>> guess = pp.Skin(gel, array, surface=pp.AreaGrid(shape=(13, 16), spacing=1e-3))
    >>> weighed = weigh(pictures, guess, 2.0, view=scene.view)  # it was twice the force: the gel is twice as stiff
    >>> bool(abs(weighed.factor - 2.0) < 0.3)
    True
    """
    listed = list(sources) if isinstance(sources, list | tuple) and not _is_images(sources) else [sources]
    known = np.atleast_1d(np.asarray(forces, dtype=np.float64))
    if known.shape != (len(listed),) or not (np.isfinite(known).all() and (known > 0).all()):
        raise InvalidInput(f"forces must be positive, one for each of {len(listed)} presses [N]; got {known.tolist()}.")
    with tempfile.TemporaryDirectory() as folder:
        given = skin if isinstance(skin, Skin) else Path(skin)
        begun = given if isinstance(given, Skin) else _begun(given, Path(folder))
        return _weighed(listed, begun, known, view, rate, options, guessed=begun is not given)


def _begun(skin: Path, folder: Path) -> Path:
    """The skin with a modulus to begin with where it says "unknown": displacements give forces over the modulus, whatever that is."""
    text = skin.read_text(encoding="utf-8") if skin.is_file() else ""
    key = re.compile(r'^(\s*youngs_modulus\s*=\s*)("[^"\n]*"|\'[^\'\n]*\')', re.MULTILINE)
    values = [value.strip("\"'").strip().lower() for _, value in key.findall(text)]
    if UNKNOWN not in values:
        return skin
    if any(value != UNKNOWN for value in values):
        raise InvalidInput(
            f"{skin}: the modulus of one layer is unknown and that of another is not: a weight tells how stiff they are together. Guess the unknown one, in proportion."
        )
    path = folder / skin.name
    path.write_text(key.sub(rf'\g<1>"{BEGUN}"', text), encoding="utf-8")
    return path


def _weighed(
    listed: list[Any],
    skin: Skin | Path,
    known: Floats,
    view: View | None,
    rate: float | None,
    options: dict[str, Any],
    *,
    guessed: bool,
) -> Weighed:
    settings = camera_of(skin, view)
    lies: Any = settings if view is None else view
    ratios, stds, fits, modulus, before = [], [], [], math.nan, math.inf
    for source, force in zip(listed, known):
        with Displacements(source, lies, rate=rate, texture=settings.texture if settings else None) as readings:
            full = gel_skin(skin, readings.positions)
            modulus = _modulus(full)
            before = math.inf if guessed else full.uncertainty.youngs_modulus or math.inf
            # the modulus is what is sought: only the rest is uncertain
            full = Skin(
                full.pad,
                full.planes,
                surface=full.surface if full.problem().fixed else None,
                uncertainty=replace(full.uncertainty, youngs_modulus=0.0),
            )
            found, std, fit = _force(readings, full, settings.distance if settings else None, options)
        ratios.append(force / found)
        stds.append(force / found * std / found)
        fits.append(fit)
    ratio, each = np.array(ratios), np.array(stds)
    weight = 1.0 / each**2
    mean = float((weight * ratio).sum() / weight.sum())
    # what presses share (depth, thickness) does not average out: no better than the best press
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


def _force(
    readings: Displacements, skin: Skin, distance: float | None, options: dict[str, Any]
) -> tuple[float, float, float]:
    """Normal force of a press, its standard deviation, and the fit."""
    taken: list[tuple[float, Reading]] = []
    for reading in readings:
        size = np.hypot(*reading.values)
        size = np.sort(size[np.isfinite(size)])  # of the dots that are not lost
        if not reading.fault and len(size):
            taken.append((float(np.median(size[-8:])), reading))
    most = max((size for size, _ in taken), default=0.0)
    quiet = np.median([np.nanmedian(r.std) for _, r in taken]) if taken else 0.0
    if not most > 10.0 * quiet:
        raise InvalidInput(
            f"{readings.pictures.name}: nothing presses in these pictures: the dots move by {1e6 * most:.2g} um at most. Show the gel at rest first, then the press."
        )
    held = [reading for size, reading in taken if size > PRESSED * most]
    middle = [
        held[i]
        for i in np.unique(np.linspace(0.25 * (len(held) - 1), 0.75 * (len(held) - 1), SOLVED).round().astype(int))
    ]
    way = Touches(readings, skin, distance=distance, track=False, every=1, options=options)
    forces, spreads, fits = [], [], []
    for reading in middle:
        touch = way.alone(reading)
        force = float(to_numpy(touch.force)[2])
        if not force > 0:
            raise InvalidInput(
                f"{readings.pictures.name}: no pressing force is found in picture {reading.index} ({touch.notes[-1] if touch.notes else 'no contact'})."
            )
        low, high = (float(to_numpy(end)[2]) for end in touch.interval(0.95, "force"))
        forces.append(force)
        spreads.append((high - low) / (2.0 * WIDE))
        fits.append(float(np.asarray(touch.fit)) if touch.fit is not None else math.nan)
    return float(np.mean(forces)), math.hypot(float(np.mean(spreads)), float(np.std(forces))), float(np.min(fits))
