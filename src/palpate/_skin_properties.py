"""Properties of `palpate.Skin`: its parts, and what it can observe."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

import numpy.typing as npt

from palpate._threads import cached_property
from palpate.design import Design, Press, evaluate
from palpate.elastic.pad import Pad
from palpate.errors import InvalidInput
from palpate.identify import Identified, IdentifiedPress, identify
from palpate.inverse.observability import Observability, observability, observable_components
from palpate.inverse.problem import Kept, Problem
from palpate.sensing.arrays import Array
from palpate.sensing.grids import Grid
from palpate.sensing.maps import check_modelled
from palpate.sensing.operator import Boundary, Operator
from palpate.sensing.readings import Layout
from palpate.sensing.uncertainty import Uncertainty
from palpate.sensing.zero import Rest, rest_frames
from palpate.touch import Touch
from palpate.uncertainty import Case

if TYPE_CHECKING:
    from palpate.calibrate import SkinCalibration

__all__ = ["SkinProperties"]


class SkinProperties:
    """Pad, arrays and surface of a skin, and what its channels can observe."""

    _pad: Pad
    _elastic: Pad
    _planes: tuple[Array, ...]
    _surface: Grid
    _boundary: Boundary
    _problem: Problem
    #: Problems by the components that they seek.
    _problems: Kept
    _whole: tuple[Array, ...]
    _calibration: SkinCalibration | None
    if TYPE_CHECKING:

        def at_rest(self, rest: Any) -> Any:
            """See `palpate.Skin.at_rest`."""
            ...

    def __repr__(self) -> str:
        """Describe the skin in one line: the pad, its arrays with their channels, and the cells of the surface.

        Examples
        --------
        >>> import palpate as pp
        >>> pad = pp.HalfSpace(youngs_modulus=1e5, poissons_ratio=0.5)
        >>> pp.Skin(pad, pp.AreaArray(shape=(4, 5), pitch=1e-3, depth=1e-3, channels=["stress_zz"]))
        <Skin: HalfSpace, 4 x 5 AreaArray of stress_zz, surface of 8 x 9 cells>
        """
        planes = ", ".join(f"{_by(a.shape)} {type(a).__name__} of {'+'.join(a.channels)}" for a in self._planes)
        calibrated = ", calibrated" if self._calibration is not None else ""
        return f"<Skin: {type(self._pad).__name__}, {planes}, surface of {_by(self._surface.shape)} cells{calibrated}>"

    @property
    def pad(self) -> Pad:
        """The elastic body.

        Examples
        --------
        >>> import palpate as pp
        >>> pad = pp.HalfSpace(youngs_modulus=1e5, poissons_ratio=0.5)
        >>> pp.Skin(pad, pp.LineArray(count=11, pitch=1e-3, depth=1e-3, channels=["stress_zz"])).pad is pad
        True
        """
        return self._pad

    @property
    def planes(self) -> tuple[Array, ...]:
        """The arrays, one per plane.

        Examples
        --------
        >>> import palpate as pp
        >>> pad = pp.HalfSpace(youngs_modulus=1e5, poissons_ratio=0.5)
        >>> planes = [pp.LineArray(count=11, pitch=1e-3, depth=d, channels=["stress_zz"]) for d in (1e-3, 2e-3)]
        >>> [plane.depth for plane in pp.Skin(pad, planes).planes]
        [0.001, 0.002]
        """
        return self._planes

    @property
    def surface(self) -> Grid:
        """The grid of the traction.

        Examples
        --------
        >>> import palpate as pp
        >>> pad = pp.HalfSpace(youngs_modulus=1e5, poissons_ratio=0.5)
        >>> pp.Skin(pad, pp.LineArray(count=11, pitch=1e-3, depth=1e-3, channels=["stress_zz"])).surface
        LineGrid(count=15, spacing=0.001, center=0.0)
        """
        return self._surface

    @property
    def boundary(self) -> Boundary:
        """ "free" or "periodic".

        Examples
        --------
        >>> import palpate as pp
        >>> pad = pp.HalfSpace(youngs_modulus=1e5, poissons_ratio=0.5)
        >>> array = pp.LineArray(count=11, pitch=1e-3, depth=1e-3, channels=["stress_zz"])
        >>> pp.Skin(pad, array).boundary, pp.Skin(pad, array, boundary="periodic").boundary
        ('free', 'periodic')
        """
        return self._boundary

    @property
    def uncertainty(self) -> Uncertainty:
        """Uncertainty of pad and sensors.

        Examples
        --------
        >>> import palpate as pp
        >>> pad = pp.HalfSpace(youngs_modulus=1e5, poissons_ratio=0.5)
        >>> array = pp.LineArray(count=11, pitch=1e-3, depth=1e-3, channels=["stress_zz"])
        >>> pp.Skin(pad, array, uncertainty=pp.Uncertainty(depth=0.1)).uncertainty.depth
        0.1
        """
        return self._problem.uncertainty

    @property
    def operator(self) -> Operator:
        """The linear operator from traction to readings, with its adjoint.

        Examples
        --------
        >>> import palpate as pp
        >>> pad = pp.HalfSpace(youngs_modulus=1e5, poissons_ratio=0.5)
        >>> skin = pp.Skin(pad, pp.LineArray(count=11, pitch=1e-3, depth=1e-3, channels=["stress_zz"]))
        >>> skin.operator.dense().shape  # readings, and two components in 15 cells
        (11, 30)
        """
        return self._problem.operator

    @property
    def calibration(self) -> SkinCalibration | None:
        """The calibration by presses with known forces (`calibrate`), or None.

        Examples
        --------
        >>> import palpate as pp
        >>> pad = pp.HalfSpace(youngs_modulus=1e5, poissons_ratio=0.5)
        >>> pp.Skin(pad, pp.LineArray(count=11, pitch=1e-3, depth=1e-3, channels=["stress_zz"])).calibration is None
        True
        """
        return self._calibration

    @cached_property
    def components(self) -> tuple[str, ...]:
        """The traction components that `reconstruct` estimates by default: those that these channels can separate.

        Examples
        --------
        >>> import palpate as pp
        >>> pad = pp.HalfSpace(youngs_modulus=1e5, poissons_ratio=0.5)
        >>> one = pp.LineArray(count=11, pitch=1e-3, depth=1e-3, channels=["stress_zz"])
        >>> two = pp.LineArray(count=11, pitch=1e-3, depth=1e-3, channels=["stress_xz", "stress_zz"])
        >>> pp.Skin(pad, one).components, pp.Skin(pad, two).components
        (('z',), ('x', 'z'))
        """
        return observable_components(self._elastic, self._whole)

    def observability(self, wavelength: npt.ArrayLike, *, components: Sequence[str] | None = None) -> Observability:
        """Return how well each ``wavelength`` [m] of the traction can be observed: the condition number of its
        response matrix.

        Examples
        --------
        >>> import palpate as pp
        >>> pad = pp.HalfSpace(youngs_modulus=1e5, poissons_ratio=0.5)
        >>> skin = pp.Skin(pad, pp.LineArray(count=11, pitch=1e-3, depth=1e-3, channels=["stress_xz", "stress_zz"]))
        >>> seen = skin.observability([1e-3, 10e-3])
        >>> seen.condition.round(1).tolist()
        [159.9, 3.3]
        """
        check_modelled(self._elastic, "observability by wavelength")
        return observability(self._elastic, self._planes, wavelength, self._names(components))

    def design(
        self,
        *,
        force: float = 1.0,
        contact_radius: float = 2e-3,
        shear: float = 0.0,
        friction: float = 0.5,
        center: tuple[float, float] | None = None,
        components: Sequence[str] | None = None,
    ) -> Design:
        """The best possible resolution of this skin: Cramer-Rao bounds of a press, resolution, smallest noticed force, range.

        Parameters
        ----------
        force : float
            Normal force of the press [N]; [N/m] in line contact.
        contact_radius : float
            Radius of its contact, half-width in line contact [m].
        shear, friction : float
            Tangential over normal force, and the coefficient of friction of the slip margin.
        center : (float, float), optional
            Place (x, y) of the press [m]; default: the middle of the array.
        components : sequence of str, optional
            The components to estimate; default: those of the skin.

        Raises
        ------
        InvalidInput
            A number of the press that is not finite or out of range.
        Unsupported
            An array without noise.

        Examples
        --------
        >>> import palpate as pp
        >>> pad = pp.HalfSpace(youngs_modulus=2e5, poissons_ratio=0.5)
        >>> array = pp.AreaArray(shape=(8, 8), pitch=2e-3, depth=2e-3, channels=["stress_zz"], noise=100.0)
        >>> found = pp.Skin(pad, array).design(force=1.0, contact_radius=2e-3)
        >>> print(f"force +-{found.bound.force[0]:.2f} N, a pair is told apart from {1e3 * found.pair:.1f} mm")
        force +-0.03 N, a pair is told apart from 1.6 mm
        """
        check_modelled(self._elastic, "a design")
        press = Press(force=force, contact_radius=contact_radius, shear=shear, friction=friction, center=center)
        nuisance, names = self._problem.nuisance, self._names(components)
        return evaluate(
            self._elastic, self._planes, press, names, nuisance=nuisance, uncertainty=self._problem.uncertainty
        )

    def identify(
        self,
        readings: Any,
        touch: Touch,
        *,
        indentation: npt.ArrayLike | None = None,
        shape: str | None = None,
        zero: npt.ArrayLike | None = None,
    ) -> Identified | IdentifiedPress:
        """Identify what presses: contact patches, radius of a ball or a round flat, modulus, stiffness and texture, each with its interval or the
        reason why it is not determined.

        Parameters
        ----------
        readings : array (channel, *array), or (frame, channel, *array)
        touch : Touch
            The touch from these readings.
        indentation : float or array (frame,), optional
            How far the object has moved into the pad since it touched [m], e.g. from the robot's joints.
        shape : "ball" or "flat", optional
            The shape, if known; else the readings decide, if they can.
        zero : array (frame, channel, *array), optional
            Frames at rest, if the touch was found with them (``reconstruct(readings, zero=...)``).

        Returns
        -------
        Identified, or IdentifiedPress of a recording
            Each number is a `palpate.identify.Finding`.

        Raises
        ------
        InvalidInput
            Readings of other frames than the touch's, an indentation that is negative or not one for each frame, a shape that there is not.
        Unsupported
            Line contact; a pad that creeps.

        Notes
        -----
        Round contacts are fitted to the readings themselves (Hertz's pressure, or Boussinesq's under a flat, each with shear of the same shape). Of a ball of radius R
        with the force F on a contact of radius a, F = 4 E* a^3/(3 R) if the object is much stiffer than the pad, or R = a^2/indentation if that is
        known; pads on a base are corrected for, up to a = half the thickness of the uppermost material. A `palpate.Measured` pad states no modulus, so that only the
        patches and the radius of a flat are found. The errors of depth, thickness, modulus and scale are those of `uncertainty`.

        Examples
        --------
        >>> import numpy as np
        >>> import palpate as pp
        >>> pad = pp.HalfSpace(youngs_modulus=2e5, poissons_ratio=0.5)
        >>> array = pp.AreaArray(shape=(8, 8), pitch=1.5e-3, depth=1.5e-3, channels=["stress_zz"], noise=50.0)
        >>> skin = pp.Skin(pad, array)
        >>> a = pp.solutions.hertz_contact_radius(pad, radius=10e-3, force=2.0)
        >>> readings = skin.sense(pp.solutions.hertz_point(contact_radius=a, force=2.0), rng=np.random.default_rng(0))
        >>> found = skin.identify(readings, skin.reconstruct(readings), shape="ball")
        >>> found.radius.low < 10e-3 < found.radius.high
        True
        """
        if zero is not None:
            rest = Rest.of(rest_frames(zero, self._planes))
            less, _ = Layout(self._planes, self._elastic).without_zero(readings, rest.zero, None)
            return identify(self.at_rest(rest), touch, less, indentation=indentation, shape=shape)
        return identify(self, touch, readings, indentation=indentation, shape=shape)

    def case(self, components: Sequence[str] | None = None) -> Case:
        """Return the case that selects the calibration constants of the error bars.

        Examples
        --------
        >>> import palpate as pp
        >>> pad = pp.HalfSpace(youngs_modulus=1e5, poissons_ratio=0.5)
        >>> skin = pp.Skin(pad, pp.LineArray(count=11, pitch=1e-3, depth=1e-3, channels=["stress_xz", "stress_zz"]))
        >>> str(skin.case())
        'line, stress, half-space'
        """
        problem = self._seeking(self._names(components))
        return Case.of(self._elastic, self._planes, problem.components, ambiguous=problem.ambiguous)

    def problem(self, *, components: Sequence[str] | None = None) -> Problem:
        """The input of a method: operator, surface and the components sought, with caches that methods share.

        Examples
        --------
        >>> import palpate as pp
        >>> pad = pp.HalfSpace(youngs_modulus=1e5, poissons_ratio=0.5)
        >>> skin = pp.Skin(pad, pp.LineArray(count=11, pitch=1e-3, depth=1e-3, channels=["stress_xz", "stress_zz"]))
        >>> skin.problem(components=["z"]).components
        ('z',)
        """
        return self._problem.seeking(self._names(components))

    def _seeking(self, names: tuple[str, ...]) -> Problem:
        """The problem of these components, made once: frames share what it has computed."""
        return self._problems.get(names, lambda: self._problem.seeking(names))

    def _names(self, components: Sequence[str] | None) -> tuple[str, ...]:
        if components is None:
            return self.components
        accepted = self._surface.components
        if isinstance(components, str) or not components or any(c not in accepted for c in components):
            raise InvalidInput(f"components must be a list of names among {', '.join(accepted)}; got {components!r}.")
        if len(set(components)) < len(components):
            raise InvalidInput(f"components names one twice: {', '.join(components)}; name each once.")
        return tuple(c for c in accepted if c in components)


def _by(shape: Sequence[int]) -> str:
    return " x ".join(map(str, shape))
