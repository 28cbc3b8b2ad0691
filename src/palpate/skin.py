"""The main entry point: a pad and its array."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
import numpy.typing as npt

from palpate._skin_properties import SkinProperties
from palpate.elastic.pad import Floats, Pad, check_pad
from palpate.elastic.viscoelastic import Viscoelastic
from palpate.errors import InvalidInput, Unsupported
from palpate.inverse.contact.methods import Constrained
from palpate.inverse.method import Method, Prepared
from palpate.inverse.observability import (
    check_observable,
    without_mean,
)
from palpate.inverse.problem import Kept, Problem
from palpate.inverse.registry import method_named, requested_method
from palpate.inverse.words import notes, surface_strain
from palpate.recordings.prepared import read_prepared, write_prepared
from palpate.sensing.arrays import AreaArray, Array, LineArray, Noise, ScatteredArray
from palpate.sensing.contacts import contact_readings, sampled
from palpate.sensing.grids import Grid
from palpate.sensing.limits import check_creep, saturation_notes
from palpate.sensing.maps import body_of
from palpate.sensing.nuisance import check_nuisance
from palpate.sensing.operator import Boundary
from palpate.sensing.readings import (
    Layout,
    as_sensed,
    checked_traction,
    frame_times,
    with_creep,
)
from palpate.sensing.surface import surface_of
from palpate.sensing.uncertainty import Uncertainty
from palpate.sensing.zero import Rest, given_rest, rest_frames, with_noise
from palpate.solutions import AreaContact, LineContact
from palpate.touch import Touch
from palpate.touch.fields import ErrorParts
from palpate.tracking.settings import check_settings, check_sought, on_coarser_cells
from palpate.tracking.single import SingleSolve
from palpate.tracking.tracker import Tracker

if TYPE_CHECKING:
    from palpate.calibrate import SkinCalibration
    from palpate.recordings.recording import Recording

__all__ = ["Skin"]

#: Largest number of cached prepared methods; `Problem` caches what they share.
PREPARED = 8
#: Largest number of cached zeros.
RESTS = 2


class Skin(SkinProperties):
    """An elastic pad with sensing elements in or under it; expensive parts are prepared at first use and cached.

    Parameters
    ----------
    pad : Pad
        The body: `HalfSpace`, `BondedLayers`, or one of these as `Viscoelastic`.
    array : LineArray, AreaArray, ScatteredArray, or a sequence of them
        The sensing elements; several planes at different depths as a list.
    surface : LineGrid or AreaGrid, optional
        The grid of the traction. By default it covers the array, reaches past its edge and is no finer than the depth
        allows (see `palpate.sensing.default_surface`). On thousands of cells finer than these, contact is found on cells as
        coarse as these, and the traction is interpolated.
    boundary : "free" or "periodic"
        "free" (default): the pad continues beyond the surface grid without load. "periodic": the surface is
        the array's own grid, repeated periodically, as in Fourier-transform traction cytometry; fast, but a contact near an edge touches its copy,
        and displacements of a half-space do not determine the net force.
    nuisance : "auto" or sequence of str
        Nuisances of the readings: "offset" (of each channel; of displacement, a shift of the image), "ramp" (a
        linear change across the array), "rotation" (of an image). "auto" (default): offsets and rotation if a frame is evidence for them, ramps if
        the outermost taxels show one too (not of markers that only move sideways), offsets of a row, column, half or quarter of up to 400 taxels, and in the intervals the
        shifts and tilts of displacements that contact may hide; () for none.

    Raises
    ------
    InvalidInput
        No pad, no array, line arrays together with area arrays, or a depth below a rigid base.

    Examples
    --------
    >>> import palpate as pp
    >>> pad = pp.HalfSpace(youngs_modulus=1e5, poissons_ratio=0.5)
    >>> array = pp.LineArray(count=21, pitch=1e-3, depth=1e-3, channels=["stress_xz", "stress_zz"])
    >>> skin = pp.Skin(pad, array)
    >>> readings = skin.sense(pp.solutions.hertz_line(half_width=3e-3, force=10.0))
    >>> touch = skin.reconstruct(readings, method="tikhonov")
    >>> round(float(touch.force[1]))  # normal force [N/m]
    10
    """

    def __init__(
        self,
        pad: Pad,
        array: Array | Sequence[Array],
        *,
        surface: Grid | None = None,
        boundary: Boundary = "free",
        nuisance: Sequence[str] | str = "auto",
        uncertainty: Uncertainty | None = None,
    ) -> None:
        check_pad(pad)
        planes = (array,) if isinstance(array, LineArray | AreaArray | ScatteredArray) else tuple(array)
        if not planes or not all(isinstance(p, LineArray | AreaArray | ScatteredArray) for p in planes):
            raise InvalidInput(
                "array must be a LineArray, AreaArray or ScatteredArray, or a list of them; got "
                f"{type(array).__name__}."
            )
        if len({p.dimensions for p in planes}) != 1:
            raise InvalidInput("the planes mix line and area contact; use one kind.")
        planes = tuple(p.at_base(pad.thickness) for p in planes)
        for p in planes:
            pad.compliance(p.depth)  # raises an error for a depth below a rigid base
        if boundary not in ("free", "periodic"):
            raise InvalidInput(f'boundary must be "free" or "periodic"; got {boundary!r}.')
        # spatial computations use the instantaneous pad; creep is a filter in time
        self._elastic: Pad = check_creep(pad, planes) if isinstance(pad, Viscoelastic) else pad
        # a finite pad cannot be touched beyond its end
        self._given = surface is not None or body_of(self._elastic) is not None
        if surface is None:
            if boundary == "periodic" and not isinstance(planes[0], ScatteredArray):
                surface = planes[0].grid
            else:
                surface = surface_of(self._elastic, planes)
        self._pad, self._planes, self._boundary, self._surface = pad, planes, boundary, surface
        self._problem = Problem(
            self._elastic,
            planes,
            surface,
            boundary,
            surface.components,
            fixed=self._given,
            nuisance=check_nuisance(nuisance),
            uncertainty=uncertainty,
        )
        self._problem.uncertainty.check(self._elastic)
        self._methods, self._problems = Kept(entries=PREPARED), Kept()
        self._rests, self._whole = Kept(entries=RESTS), planes
        self._calibration: SkinCalibration | None = None
        self._gaps = False  # whether readings may be missing (NaN)
        self._plain: Skin | None = None

    # -- properties ----------------------------------------------------------------------------------------------------

    @classmethod
    def from_file(cls, path: str | Path, *, recording: Recording | None = None) -> Skin:
        """Read a skin.toml (see the file format in the documentation).

        ``recording`` gives the positions of a scattered plane, or the shape and pitch of a gridded one, that the file
        leaves out.

        Examples
        --------
        >>> import tempfile
        >>> from pathlib import Path
        >>> import palpate as pp
        >>> text = '''
        ... [pad]
        ... kind = "half_space"
        ... youngs_modulus = "200 kPa"
        ... poissons_ratio = 0.48
        ...
        ... [[plane]]
        ... kind = "line"
        ... count = 21
        ... pitch = "1 mm"
        ... depth = "2 mm"
        ... channels = ["stress_zz"]
        ... '''
        >>> with tempfile.TemporaryDirectory() as folder:
        ...     path = Path(folder) / "skin.toml"
        ...     _ = path.write_text(text)
        ...     skin = pp.Skin.from_file(path)
        >>> skin.pad.youngs_modulus, skin.planes[0].shape
        (200000.0, (21,))
        """
        from palpate.calibrate import read_calibration, with_calibration
        from palpate.recordings import read_skin, read_uncertainty

        pad, planes, surface, boundary = read_skin(path, recording)
        out = cls(pad, planes, surface=surface, boundary=boundary, uncertainty=read_uncertainty(path))
        return with_calibration(out, read_calibration(path))

    def masked(self, working: npt.ArrayLike | Sequence[npt.ArrayLike]) -> Skin:
        """The same skin without the taxels where ``working`` is False; of several planes, one mask for each.

        Raises
        ------
        InvalidInput
            Not one mask for each plane, one of another shape, or one that leaves no taxel.

        Examples
        --------
        >>> import palpate as pp
        >>> pad = pp.HalfSpace(youngs_modulus=1e5, poissons_ratio=0.5)
        >>> skin = pp.Skin(pad, pp.LineArray(count=3, pitch=1e-3, depth=1e-3, channels=["stress_zz"]))
        >>> skin.masked([True, False, True]).planes[0].valid.tolist()  # the middle taxel is dead
        [True, False, True]
        """
        masks = [working] if len(self._planes) == 1 else list(working)  # type: ignore[arg-type]
        if len(masks) != len(self._planes):
            raise InvalidInput(f"working must hold one mask for each of {len(self._planes)} planes; got {len(masks)}.")
        return self._with(self._pad, [p.masked(m) for p, m in zip(self._planes, masks)])

    def without_creep(self) -> Skin:
        """The same skin with the instantaneous pad, for readings from which creep was removed.

        Examples
        --------
        >>> import palpate as pp
        >>> gel = pp.HalfSpace(youngs_modulus=1e5, poissons_ratio=0.5)
        >>> array = pp.LineArray(count=3, pitch=1e-3, depth=1e-3, channels=["strain_zz"])
        >>> pp.Skin(pp.Viscoelastic(gel, prony=[(0.3, 1.0)]), array).without_creep().pad is gel
        True
        """
        return self._with(self._elastic, self._planes)

    def at_rest(self, rest: Rest | npt.ArrayLike) -> Skin:
        """The skin for readings minus a zero: its noise is that of the frames at rest, and stress and strain no longer have offsets.

        Parameters
        ----------
        rest : array (frame, channel, *array), or palpate.sensing.zero.Rest
            Readings without contact. Five frames or more also give the noise; a stated noise of the array takes precedence.

        Raises
        ------
        InvalidInput
            No frames, or frames of another shape.
        Unsupported
            Planes of different shapes do not fit one array: subtract the zero yourself, and state the noise of each.

        Examples
        --------
        >>> import numpy as np
        >>> import palpate as pp
        >>> pad = pp.HalfSpace(youngs_modulus=1e5, poissons_ratio=0.5)
        >>> skin = pp.Skin(pad, pp.LineArray(count=11, pitch=1e-3, depth=1e-3, channels=["stress_zz"]))
        >>> frames = 500.0 + 2.0 * np.random.default_rng(0).standard_normal((50, 1, 11))
        >>> [round(n, 1) for n in skin.at_rest(frames).planes[0].noise]
        [2.0]
        """
        found = rest if isinstance(rest, Rest) else Rest.of(rest_frames(rest, self._planes))
        out = self._with(self._pad, found.taken_from(self._planes))
        out._problem.zeroed = True
        counts = np.cumsum([len(p.channels) for p in self._planes])[:-1]
        out._problem.zero = [np.nan_to_num(part) for part in np.split(found.zero, counts)]
        return out

    def _with(self, pad: Pad, planes: Sequence[Array], surface: Grid | None = None) -> Skin:
        """A skin with other taxels on the same surface, so that results stay comparable. The components to estimate are those of the whole array, even if taxels are left out."""
        out = Skin(
            pad,
            planes,
            surface=self._surface if surface is None else surface,
            boundary=self._boundary,
            nuisance="auto" if self._problem.nuisance is None else self._problem.nuisance,
            uncertainty=self._problem.uncertainty,
        )
        out._given = out._problem.fixed = self._given
        out._problem.zeroed, out._problem.zero = self._problem.zeroed, self._problem.zero
        out._whole = self._whole
        out._calibration = self._calibration
        return out

    # -- forward -------------------------------------------------------------------------------------------------------

    def sample(self, contact: LineContact | AreaContact) -> Floats:
        """Mean traction (component, *surface) [Pa] of a closed-form contact in each surface cell.

        Raises
        ------
        InvalidInput
            A line contact on an area array, or an area contact on a line array.

        Examples
        --------
        >>> import palpate as pp
        >>> pad = pp.HalfSpace(youngs_modulus=1e5, poissons_ratio=0.5)
        >>> skin = pp.Skin(pad, pp.LineArray(count=11, pitch=1e-3, depth=1e-3, channels=["stress_zz"]))
        >>> traction = skin.sample(pp.solutions.hertz_line(half_width=3e-3, force=10.0))
        >>> traction.shape, (traction[1].sum() * skin.surface.cell).round(6).item()  # the force [N/m]
        ((2, 15), 10.0)
        """
        return sampled(contact, self._surface)

    def sense(self, traction: Any, *, rng: np.random.Generator | None = None, time: npt.ArrayLike | None = None) -> Any:
        """Readings for a traction.

        Parameters
        ----------
        traction : array (*batch, component, *surface) [Pa], or a contact of `palpate.solutions`
            A contact is read exactly, independent of the surface's cells, also beyond them; on a periodic surface it repeats.
        rng : numpy Generator, optional
            Adds the arrays' own noise.
        time : array (frame,), optional
            Time of each frame [s], needed for a pad that creeps: the traction then has shape (frame, component, *surface).

        Returns
        -------
        array (*batch, channel, *array)
            In the unit of each channel. Planes of one shape are joined along the channel axis; planes of different shapes
            come as a list. Missing taxels read NaN, and no reading is beyond the `limits` of its array.

        Raises
        ------
        InvalidInput
            A traction of another shape or not finite; times that are missing where the pad creeps; ``rng`` for an
            array without noise; a contact of the other kind.
        Unsupported
            Times where the pad does not creep; a concentrated load on taxels at depth 0.

        Examples
        --------
        >>> import palpate as pp
        >>> pad = pp.HalfSpace(youngs_modulus=1e5, poissons_ratio=0.5)
        >>> skin = pp.Skin(pad, pp.LineArray(count=3, pitch=1e-3, depth=1e-3, channels=["stress_zz"]))
        >>> skin.sense(pp.solutions.strip(half_width=0.5e-3, traction=1000.0)).round(1).tolist()
        [[184.8, 549.8, 184.8]]
        """
        if isinstance(traction, LineContact | AreaContact):
            out: list[Any] = list(contact_readings(self.operator, traction))
        else:
            out = self.operator.forward(checked_traction(traction, self._surface))
        if isinstance(self._pad, Viscoelastic):
            out = with_creep(out, self._planes, self._pad.prony, frame_times(traction, out, self._planes, time), "add")
        elif time is not None:
            raise Unsupported("time has a meaning in sense() only where the pad creeps (Viscoelastic).")
        return as_sensed(out, self._planes, rng)

    @property
    def _layout(self) -> Layout:
        """The layout of the readings, by which they are checked and ordered."""
        return Layout(self._planes, self._elastic, self._gaps)

    # -- inverse -------------------------------------------------------------------------------------------------------

    def reconstruct(
        self,
        readings: Any,
        *,
        method: str | Method | None = None,
        components: Sequence[str] | None = None,
        friction: float | None = None,
        noise: Noise = None,
        zero: npt.ArrayLike | None = None,
        rng: np.random.Generator | None = None,
        time: npt.ArrayLike | None = None,
        **options: Any,
    ) -> Touch:
        """Traction on the surface from readings.

        From readings alone, the method estimates noise and prior from the frame, excludes pulling pressure, and gives error bars (`Touch.std`,
        `Touch.interval`). On a real sensor give frames at rest (``zero``): readings above their noise are contact, or unexplained, but never "no
        contact".

        Parameters
        ----------
        readings : array (*batch, channel, *array), or a list with one per plane
            In SI units, compression positive. Missing taxels (``mask``) may hold anything.
        method : str or Method, optional
            A short name, or a method with its options, e.g. ``pp.Tikhonov(order=2, rule="gcv")``; `palpate.methods` lists all.
            "automatic" (default): "adaptive" (learned, constrained, with error bars), and "tikhonov" for frames that pull, without pressure, on a
            periodic boundary, or with ``order``, ``parameter`` or ``rule``.
        components : sequence of str, optional
            The components to estimate, e.g. ["z"]; the others are zero. Default: `Skin.components`.
        friction : float, optional
            Coefficient of friction, for methods with the option ``friction``: |shear| <= friction * pressure in every cell.
        noise : float or sequence of float, optional
            Standard deviation of the noise in the unit of the channel, one for all channels or one each (of all planes
            in turn), instead of the array's.
        zero : array (frame, channel, *array), optional
            Frames at rest, or one. Their mean is subtracted from the readings; five or more also give the noise (`at_rest`).
        rng : numpy Generator
            Source of the draws (default: a fixed seed).
        time : array (frame,), optional
            Time of each frame [s] of readings (frame, channel, *array); labels the result. Needed for a pad that creeps (`Viscoelastic`), to subtract
            the creep.
        **options
            Options of the method, as its class documents them: ``draws`` of `Adaptive`, ``order``, ``rule`` and
            ``parameter`` of `Tikhonov`, ``length`` of `Hilgers`, ``spectrum`` of `Wiener`, and so on. None is the method's default.

        Returns
        -------
        Touch

        Raises
        ------
        InvalidInput
            Readings of the wrong shape, not finite, or far outside linear elasticity (wrong units).
        NotObservable
            Components that do not affect these channels, or that they cannot separate.
        Unsupported
            An option that the method does not take, a layout that it does not support, or a batch that does not fit
            into memory; the message names an alternative.

        Examples
        --------
        >>> import numpy as np
        >>> import palpate as pp
        >>> pad = pp.HalfSpace(youngs_modulus=1e5, poissons_ratio=0.5)
        >>> array = pp.LineArray(count=21, pitch=1e-3, depth=1e-3, channels=["stress_xz", "stress_zz"], noise=5.0)
        >>> skin = pp.Skin(pad, array)
        >>> ball = pp.solutions.hertz_line(half_width=3e-3, force=10.0).sliding(0.3)
        >>> readings = skin.sense(ball, rng=np.random.default_rng(0))
        >>> skin.reconstruct(readings, method="tikhonov").force.round().tolist()  # (x, z) [N/m]
        [3.0, 10.0]
        """
        options |= {} if friction is None else {"friction": friction}
        named = {"method": method, "components": components, "rng": rng, **options}
        if noise is not None:
            return self._noisy(noise).reconstruct(readings, zero=zero, time=time, **named)
        if zero is not None:
            rest = Rest.of(rest_frames(zero, self._planes))
            less, time = self._layout.without_zero(readings, rest.zero, time)
            return self._zeroed(rest).reconstruct(less, time=time, **named)
        if self._calibration is not None:
            return self._answer_by(self._calibration, readings, time, named)
        chosen = requested_method(method, options)
        if rng is not None and "draws" not in chosen.options():
            raise Unsupported(f'method="{chosen.name}" does not take rng: it draws no samples.')
        parts = self._layout.checked(readings, self._surface, draws=getattr(chosen, "draws", 0))
        times = frame_times(readings, parts, self._planes, time)
        if isinstance(self._pad, Viscoelastic):
            parts = with_creep(parts, self._planes, self._pad.prony, times, "remove")
        chosen, names, prepared = self._ready(chosen, components)
        estimate = prepared.solve(parts, rng)
        sought = chosen.returns(names)
        found_by = [chosen.name] if estimate.method is None else np.unique(estimate.method)
        heeded = () if estimate.at_limit is not None else saturation_notes(parts, self._planes)
        return Touch(
            estimate.traction,
            prepared.grid,
            sought,
            str(found_by[0]),
            (*notes(self._seeking(sought), self.components, chosen, prepared), *estimate.remarks(), *heeded),
            estimate.parameter,
            estimate.noise_std,
            estimate.residual,
            sought if without_mean(self._elastic, self._planes, self._boundary) else (),
            times,
            case=self.case(sought),
            friction=chosen.friction_given,
            _errors=ErrorParts.of(estimate.errors, estimate.stated, self._problem.common_std),
            converged=estimate.converged,
            touching=estimate.contact,
            outliers=estimate.outliers,
            draws=estimate.draws,
            resolution=estimate.resolution,
            sliding=estimate.sliding,
            found_by=estimate.method if len(found_by) > 1 else None,
            status=estimate.status(),
            pushing=estimate.pushed,
            fit=estimate.fit,
            nuisance=estimate.nuisance,
            nuisance_std=estimate.nuisance_std,
            nuisance_names=estimate.nuisance_names,
            at_limit=estimate.at_limit,
            discrepancy=estimate.discrepancy,
            force_bounds=estimate.force_bounds,
            strain=surface_strain(self._problem, estimate.traction),
            reading_names={row: self._layout.reading_name(row) for row in estimate.left_out()},
        )

    # -- calibrated ----------------------------------------------------------------------------------------------------

    def calibrate(self, presses: Any, *, again: bool = False, **options: Any) -> Skin:
        """The same skin with a net force calibrated by presses with known forces: newtons from a few weights.

        With few labels, the elastic model of the pad is the prior of the map; with many, the map is a regression. Pad and array may be guesses.
        `calibration` then gives the cross-validation error of the map, beside plain regressions, and whether the elastic model fits; if it does not,
        `reconstruct` and `track` give net force (and centre, if places were labelled) with intervals, and no pressure map.

        Parameters
        ----------
        presses : Recording, array (frame, channel, *array), or a list of them
            Readings in the sensor's own unit.
        again : bool
            Start from the existing calibration of this skin: its labels are kept, and a note says whether the sensor has aged.
        **options
            Of `palpate.calibrate.calibrate`: ``reference`` and ``reference_time`` (a force sensor, on a clock of its own), ``weights``
            (such as ["200 g, 12 s to 20 s"]), ``time``, ``baseline``, ``labels``, ``constants``, ``pad_models``. ``this_run=True``: the
            frames to come are of the same run as these presses, of which one corrects the gain of the existing calibration.

        Raises
        ------
        InvalidInput
            No labelled frame, labels of another length, clocks that do not match, labels without any force.

        Examples
        --------
        >>> import numpy as np
        >>> import palpate as pp
        >>> pad = pp.BondedLayers([pp.Layer(thickness=8e-3, youngs_modulus=1e5, poissons_ratio=0.48)])
        >>> skin = pp.Skin(pad, pp.AreaArray(shape=(2, 2), pitch=12e-3, depth="base", channels=["stress_zz"]))
        >>> marble = skin.sense(pp.solutions.hertz_point(contact_radius=3e-3, force=1.0)) / 37.0  # of an unknown unit
        >>> weights = [0.0, 1.0, 2.0, 4.0]  # [N]
        >>> skin = skin.calibrate(np.stack([w * marble for w in weights]), reference=weights)
        >>> round(float(skin.reconstruct(3.0 * marble).force[2]), 1)  # [N]
        3.0
        """
        from palpate.calibrate import calibrate, with_calibration

        out, before = self._uncalibrated(), self._calibration if again or options.get("this_run") else None
        return with_calibration(out, calibrate(out, presses, before=before, **options))

    def _uncalibrated(self) -> Skin:
        """The same skin, whose readings are in SI units."""
        out = self._with(self._pad, self._planes)
        out._calibration = None
        return out

    def _answer_by(self, found: SkinCalibration, readings: Any, time: Any, options: dict[str, Any]) -> Touch:
        """Do `reconstruct` for a calibrated skin."""
        from palpate.calibrate.answer import calibrated_touch, elastic_skin

        if self._plain is None and found.elastic:
            self._plain = elastic_skin(self, found)
        return calibrated_touch(found, self, self._plain, readings, time, options)

    def _zeroed(self, rest: Rest) -> Skin:
        """Do `at_rest`, cached for the next frames with the same zero."""
        key = (rest.zero.tobytes(), b"" if rest.noise is None else rest.noise.tobytes())
        found: Skin = self._rests.get(key, lambda: self.at_rest(rest))
        return found

    def _noisy(self, noise: Noise, rest: Rest | None = None) -> Skin:
        """The skin with this noise, or that of frames at rest where none is stated; cached for the next frames."""
        planes = list(self._planes) if noise is None else with_noise(self._planes, noise)
        planes = planes if rest is None else rest.with_noise(planes)
        stds = [p.noise_std for p in planes]
        if stds == [p.noise_std for p in self._planes]:
            return self
        found: Skin = self._rests.get(repr(stds), lambda: self._with(self._pad, planes))
        return found

    def prepare(
        self, *, method: str | Method | None = None, components: Sequence[str] | None = None, **options: Any
    ) -> None:
        """Compute now what all frames share, which the first `reconstruct` with the same method, components and options would otherwise compute. Unsuitable options raise the same errors.

        Raises
        ------
        NotObservable, Unsupported
            As `reconstruct`.

        Examples
        --------
        >>> import palpate as pp
        >>> pad = pp.HalfSpace(youngs_modulus=1e5, poissons_ratio=0.5)
        >>> skin = pp.Skin(pad, pp.LineArray(count=11, pitch=1e-3, depth=1e-3, channels=["stress_zz"]))
        >>> skin.prepare(method="tikhonov")
        """
        self._ready(requested_method(method, options), components)

    def save_prepared(self, path: str | Path) -> None:
        """Write the prepared arrays (influences, decompositions) to a file, completely or not at all, for `load_prepared` in another run.

        `Unsupported` for a pad of your own class, which has no digest; `InvalidInput` if nothing is prepared yet.

        Examples
        --------
        >>> import tempfile
        >>> import palpate as pp
        >>> array = pp.LineArray(count=11, pitch=1e-3, depth=1e-3, channels=["stress_zz"])
        >>> skin = pp.Skin(pp.HalfSpace(youngs_modulus=1e5, poissons_ratio=0.5), array)
        >>> skin.prepare()
        >>> with tempfile.TemporaryDirectory() as folder:
        ...     skin.save_prepared(f"{folder}/a.prepared")
        """
        write_prepared(self._problem, path)

    def load_prepared(self, path: str | Path) -> None:
        """Load what an earlier run prepared for this very skin; `InvalidInput` says what differs, or that the file is damaged.

        Examples
        --------
        >>> import palpate as pp
        >>> array = pp.LineArray(count=11, pitch=1e-3, depth=1e-3, channels=["stress_zz"])
        >>> skin = pp.Skin(pp.HalfSpace(youngs_modulus=1e5, poissons_ratio=0.5), array)
        >>> skin.load_prepared("a.prepared") if Path("a.prepared").exists() else skin.prepare()
        """
        self._problem.recall = read_prepared(self._problem, path)
        # objects prepared before remain valid for those who hold them
        for kept in (self._problem.kept, self._methods, self._problems):
            kept.clear()

    def _ready(self, chosen: Method, components: Sequence[str] | None) -> tuple[Method, tuple[str, ...], Any]:
        """Return the method for this skin, the components it estimates, and the prepared method."""
        names = chosen.seeks if chosen.seeks is not None and components is None else self._names(components)
        chosen = chosen.resolved(self._seeking(names))
        return chosen, names, self._prepared(chosen, names)

    def track(
        self,
        *,
        components: Sequence[str] | None = None,
        friction: float | None = None,
        noise: Noise = None,
        zero: npt.ArrayLike | None = None,
        baseline: int = 0,
        parameter: float | str | None = None,
        tolerance: float = 1e-3,
        budget: float | None = None,
        rezero: float | None = 2.0,
        rate: float = 100.0,
    ) -> Tracker:
        """Contact followed from frame to frame: what ``reconstruct(method="constrained")`` finds, at the rate of a sensor.

        Parameters
        ----------
        components, friction, noise, zero, parameter
            As for `reconstruct`.
        baseline : int
            Frames at the start of the stream that are the ``zero``. 0 (default): none of them, the readings are zero already or ``zero`` is given.
        tolerance : float
            Change of traction, as a part of its peak, at which a frame's iteration ends.
        budget : float, optional
            Seconds that a frame may take. Without it every frame is finished; with it the iteration stops in time (`Touch.converged` is then False),
            and longer work runs in a thread beside the stream.
        rezero : float, optional
            Time constant [s], and at least ten frames, with which the zero follows drift while nothing touches; None: a fixed zero. Contact that
            grows by less than a few standard deviations of noise in this time counts as drift.
        rate : float
            Frames a second, for frames that are given without a time.

        Returns
        -------
        Tracker
            Its ``step(reading, time)`` takes one frame and returns a `Touch`.

        Examples
        --------
        >>> import palpate as pp
        >>> pad = pp.HalfSpace(youngs_modulus=1e5, poissons_ratio=0.5)
        >>> array = pp.LineArray(count=21, pitch=1e-3, depth=1e-3, channels=["stress_xz", "stress_zz"], noise=5.0)
        >>> skin = pp.Skin(pad, array)
        >>> tracker = skin.track(friction=0.6, rate=100.0)
        >>> touch = tracker.step(skin.sense(pp.solutions.hertz_line(half_width=3e-3, force=10.0)))
        >>> round(float(touch.force[1]))  # normal force [N/m]
        10
        """
        check_settings(tolerance=tolerance, rate=rate, budget=budget, rezero=rezero)
        rest = given_rest(zero, baseline, self._planes)
        skin, remarks = on_coarser_cells(self._noisy(noise, rest))
        # Without an elastic model, the calibration alone gives the force, whatever components the tracker estimates.
        known = skin._calibration
        made: Callable[..., Tracker] = Tracker
        if known is not None:
            from palpate.calibrate.answer import skin_for_pad
            from palpate.calibrate.tracked import CalibratedTracker

            skin, made = skin_for_pad(skin, known), partial(CalibratedTracker, calibration=known)
        everything = components is None and known is not None and not known.elastic
        names = skin.surface.components if everything else skin._names(components)
        check_sought(names, skin.boundary)
        method = method_named(Constrained.name, {"friction": friction, "parameter": parameter})
        solver = skin._prepared(method, names)
        prony = skin._pad.prony if isinstance(skin._pad, Viscoelastic) else None
        return made(
            solver,
            names,
            skin._layout,
            notes=(*notes(skin._problem.seeking(names), skin.components, method, solver), *remarks),
            case=skin.case(names),
            prony=prony,
            alone=SingleSolve(skin if prony is None else skin.without_creep(), names, friction),
            baseline=baseline if rest is None else rest.zero,
            tolerance=tolerance,
            budget=budget,
            rezero=rezero,
            rate=rate,
            label=skin._layout.reading_name,
        )

    def _prepared(self, method: Method, names: tuple[str, ...]) -> Any:
        """Return the method prepared for these components; it is prepared once."""

        def prepare() -> Prepared:
            free = self._boundary == "free"
            check_observable(
                self._elastic, self._planes, names, narrowed=free and method.narrows, remedied=free and "z" in names
            )
            return method.prepare(self._problem.seeking(names))

        return self._methods.get((method, names), prepare)
