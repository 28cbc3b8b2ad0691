"""The resolution of one design, as numbers and as text."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, field

from palpate.design.bounds import Bound, PressModel
from palpate.design.detection import Noticed, noticed_forces, range_of
from palpate.design.press import Press
from palpate.design.resolution import full_width, highest_wavenumbers, point_spread, separable_pair
from palpate.design.responses import Responses, array_middle, pitch_of, weights_of
from palpate.elastic.channels import channel_unit
from palpate.elastic.pad import Floats, Pad
from palpate.elastic.viscoelastic import Viscoelastic
from palpate.errors import InvalidInput
from palpate.sensing.arrays import Array
from palpate.sensing.uncertainty import Uncertainty

__all__ = ["Design", "evaluate"]

#: Largest distance of a press from the edge of the array, as a fraction of the array's extent: farther out no taxel is
#: below the press.
MAX_DISTANCE_OUTSIDE = 0.5
#: Largest distance of a pair, in units of depth plus contact radius; the cells extend as far.
FARTHEST = 3.0


@dataclass(frozen=True)
class Design:
    """The best possible resolution of a skin. Lengths in m, forces in N (N/m in line contact).

    Attributes
    ----------
    press : Press
        The press that it is for.
    components : tuple of str
        The components that the channels separate; the force has this order.
    known : Bound
        Standard deviations of force, center, radius and friction reserve due to noise and unknown offsets, for an exact pad and exact sensors.
    bound : Bound
        The same with modulus, depth, thickness, gains and scale uncertain as in the skin's `Uncertainty`.
    wavenumber : dict
        Highest recovered wavenumber [rad/m] of each component, and its limit: "noise" or "pitch". 0: none.
    distance, point_spread : array (n,) and dict of arrays (n,)
        The best linear estimate of a point load of each component.
    pair : float
        Smallest resolved distance of two tips.
    noticed : Noticed
        Smallest noticed force at each place.
    saturation, linear : float
        Normal force at which the first reading is at the end of its range, and at which linear elasticity ends.
    taxels, readings, dimensions : int
    farthest : float
        Largest tested distance of a pair.
    noise_unit : str
        Unit of the first channel.

    Examples
    --------
    >>> import palpate as pp
    >>> pad = pp.HalfSpace(youngs_modulus=2e5, poissons_ratio=0.5)
    >>> array = pp.AreaArray(shape=(8, 8), pitch=2e-3, depth=2e-3, channels=["stress_zz"], noise=100.0, limits=(0.0, 2e4))
    >>> found = pp.Skin(pad, array).design(force=1.0, contact_radius=2e-3)
    >>> found.taxels, found.components, bool(0 < found.known.force[0] < found.bound.force[0])
    (64, ('z',), True)

    >>> bool(1e-3 < found.width("z") < 6e-3), found.range < found.linear  # the readings end before the pad does
    (True, True)

    >>> print(found.lines()[0])
    64 taxels, 64 readings; a press of 1 N over a radius of 2 mm

    >>> found.notes()[0][:55]
    'The press of 1 N is beyond the range: a reading reaches'

    >>> sorted(found.numbers())[:4]
    ['blind', 'center', 'force', 'force_known']
    """

    press: Press
    components: tuple[str, ...]
    known: Bound
    bound: Bound
    wavenumber: dict[str, tuple[float, str]]
    distance: Floats = field(repr=False)
    point_spread: dict[str, Floats] = field(repr=False)
    pair: float
    noticed: Noticed = field(repr=False)
    saturation: float
    linear: float
    taxels: int
    readings: int
    dimensions: int
    farthest: float
    noise_unit: str

    def width(self, component: str = "z") -> float:
        """Return the full width at half maximum of the point-spread function of a component [m].

        Raises
        ------
        InvalidInput
            A component that is not estimated.
        """
        if component not in self.point_spread:
            raise InvalidInput(f"component must be one of {', '.join(self.components)}; got {component!r}.")
        return full_width(self.distance, self.point_spread[component])

    @property
    def range(self) -> float:
        """Largest normal force that can be measured: up to the end of a reading's range or of linear elasticity,
        whichever comes first.
        """
        return min(self.saturation, self.linear)

    def numbers(self) -> dict[str, float]:
        """Return one number for each column of a table of designs, in SI units."""
        shears = [i for i, c in enumerate(self.components) if c != "z"]

        def of(bound: Bound) -> tuple[float, float]:
            normal = float(bound.force[self.components.index("z")]) if "z" in self.components else math.nan
            return normal, max((float(bound.force[i]) for i in shears), default=math.nan)

        (force, shear), (force_known, shear_known) = of(self.bound), of(self.known)
        waves = [self.wavenumber[c][0] for c in self.components]
        return {
            "taxels": float(self.taxels),
            "readings": float(self.readings),
            "force": force,
            "force_known": force_known,
            "shear": shear,
            "shear_known": shear_known,
            "center": float(self.bound.center.max()),
            "radius": self.bound.radius,
            "friction_reserve": self.bound.friction_reserve,
            "width": self.width(self.components[-1]),
            "pair": self.pair,
            "wavelength": math.inf if min(waves) == 0 else 2.0 * math.pi / min(waves),
            "noticed": self.noticed.median,
            "blind": self.noticed.blind,
            "range": self.range,
        }

    def __str__(self) -> str:
        return "\n".join(self.lines())

    def lines(self) -> list[str]:
        """Return the numbers, one to a line, then the notes."""
        d, n = self.dimensions, "N" if self.dimensions == 2 else "N/m"
        over = "radius" if d == 2 else "half-width"
        out = [
            f"{self.taxels} taxels, {self.readings} readings; a press of {self.press.force:.3g} {n} over a {over} of {_mm(self.press.contact_radius)}"
        ]
        names = {"x": "force along x", "y": "force along y", "z": "normal force"}
        for i, c in enumerate(self.components):
            out.append(
                f"{names[c]:<22}+-{_number(self.bound.force[i])} {n}   (+-{_number(self.known.force[i])} {n} if pad and sensors were exact)"
            )
        out.append(f"{'centre':<22}+-{_mm(float(self.bound.center.max()))}")
        out.append(f"{'contact ' + over:<22}+-{_mm(self.bound.radius)}")
        if not math.isnan(self.bound.friction_reserve):
            out.append(
                f"{'friction reserve':<22}+-{_number(self.bound.friction_reserve)} {n}   (friction {self.press.friction:g})"
            )
        out.append(f"{'a point looks':<22}{_mm(self.width(self.components[-1]))} wide (half maximum)")
        out.append(f"{'pair told apart':<22}from {_mm(self.pair)}")
        for c in self.components:
            k, limit = self.wavenumber[c]
            out.append(
                f"{'finest wave, ' + c:<22}"
                + (f"{_mm(2 * math.pi / k)} long (limited by {limit})" if k else "none by itself")
            )
        out.append(
            f"{'smallest noticed force':<22} {_number(self.noticed.median)} {n} (worst place {_number(float(self.noticed.force.max()))} {n})"
        )
        out.append(
            f"{'range':<22}{_number(self.range)} {n} ("
            + ("a reading reaches its end" if self.saturation < self.linear else "linear elasticity ends")
            + ")"
        )
        return [*out, *self.notes()]

    def notes(self) -> list[str]:
        """The limits of the design, in plain words."""
        out = []
        if self.press.shear and not set(self.components) & {"x"}:
            out.append(
                "These channels cannot separate shear from pressure: the press is taken without shear. Add stress_xz and stress_yz, or two displacements."
            )
        if math.isinf(self.pair):
            out.append(f"No pair of tips up to {_mm(self.farthest)} apart can be resolved at this noise.")
        for c in self.components:
            if self.wavenumber[c][0] == 0.0:
                out.append(
                    f"No wave of {'pressure' if c == 'z' else 'shear along ' + c} is measured by these channels alone. It follows only from the assumption that contact is compact."
                )
        if self.noticed.blind > 0:
            out.append(
                f"Blind spots: at {100 * self.noticed.blind:.0f} % of the places on the array a tip needs more than three times the usual force to be noticed."
            )
        if any(math.isinf(v) for v in (*self.bound.force, *self.bound.center)):
            out.append(
                "These readings do not determine force and centre of a press of unknown size. Add taxels or channels."
            )
        if self.range < self.press.force:
            out.append(
                f"The press of {_number(self.press.force)} {'N' if self.dimensions == 2 else 'N/m'} is beyond the range: "
                + (
                    "a reading reaches its end first. Place taxels deeper, or take sensors with more range."
                    if self.saturation < self.linear
                    else "its peak exceeds 30 % of Young's modulus. Take a stiffer pad or a blunter press."
                )
            )
        return out

    def plot(self) -> object:
        """Plot the point-spread functions and the smallest detectable force over the array (a matplotlib Figure)."""
        from palpate.design.figures import plot_design

        return plot_design(self)


def _number(value: float) -> str:
    return "unknown" if math.isinf(value) or math.isnan(value) else f"{value:.2g}" if value < 100 else f"{value:.0f}"


def _mm(value: float) -> str:
    if math.isinf(value) or math.isnan(value):
        return "unknown"
    return f"{1e3 * value:.2g} mm" if value < 0.1 else f"{value:.2g} m"


def evaluate(
    pad: Pad,
    planes: Sequence[Array],
    press: Press,
    components: tuple[str, ...],
    *,
    nuisance: Sequence[str] | None = None,
    uncertainty: Uncertainty | None = None,
) -> Design:
    """The numbers of one design; `palpate.Skin.design` calls it. Noise is taken as independent from reading to reading:
    ``noise_correlation`` is not used.

    Raises
    ------
    InvalidInput
        A press far beside the array.
    Unsupported
        An array without noise, or with more than 20,000 readings.
    """
    elastic = pad.elastic if isinstance(pad, Viscoelastic) else pad
    planes = tuple(planes)
    weights = weights_of(planes)
    dimensions = planes[0].dimensions
    middle = array_middle(planes)
    if press.center is not None:
        center = middle * 0.0 + (press.center[0] if dimensions == 1 else press.center[::-1])
        points = planes[0].points
        size = max(float(np_ptp(points)), pitch_of(planes[0]))
        if (abs(center - middle) > 0.5 * size + MAX_DISTANCE_OUTSIDE * size).any():
            raise InvalidInput(
                f"center = {press.center} m lies far beside the array, whose middle is at {tuple(float(m) for m in middle[::-1])} m. Give it in metres, in the array's coordinates."
            )
        middle = center
    length = min(p.depth for p in planes) + press.contact_radius
    extent = float(np_ptp(planes[0].points))
    farthest = min(FARTHEST * length, max(extent, pitch_of(planes[0])))
    responses = Responses(elastic, planes, middle, 0.5 * farthest + press.contact_radius, 0.5 * press.contact_radius)
    model = PressModel(responses, press, components)
    saturation, linear = range_of(model)
    distance, spread = point_spread(elastic, planes, press, components)
    return Design(
        press,
        components,
        model.bound(nuisance),
        model.bound(nuisance, uncertainty or Uncertainty()),
        highest_wavenumbers(elastic, planes, press, components),
        distance,
        spread,
        separable_pair(model, nuisance, uncertainty or Uncertainty(), farthest),
        noticed_forces(elastic, planes, nuisance),
        saturation,
        linear,
        sum(int(p.valid.sum()) for p in planes),
        len(weights),
        dimensions,
        farthest,
        channel_unit(planes[0].channels[0]),
    )


def np_ptp(points: Floats) -> float:
    """Return the largest extent of points (n, axis) [m]."""
    return float((points.max(axis=0) - points.min(axis=0)).max())
