"""Watch the safety of a grasp: contact made and lost, slip before it happens, too much pressure or force.

How close a contact is to sliding is measured by Q/(mu P): tangential force over normal force times friction. If the
friction is known, the net forces suffice. Otherwise the *distribution* of shear shows it: where a contact is sheared,
its rim slips first, and by the theorem of Ciavarella and Jaeger (M. Ciavarella, J. Appl. Mech. 65, 1998, 998-1003; J.
Jaeger, Arch. Appl. Mech. 68, 1998, 438-451)

    q(x) = mu [p(x) - p*(x)],     mu = (Q/P)/(1 - P*/P),

where p* is the pressure of the same contact under a smaller load P* whose whole contact area still sticks. If the
contact grows like that of a ball, p*(x) = s p(x/s) about its centre, where s is the radius of the stick zone over that
of the contact, so that Q/(mu P) = 1 - s^3 (1 - s^2 in line contact). The likelihood of s given the estimated shear and
its error bars gives the closeness to slip and its uncertainty.

A twisted contact slips too. If all of it turns about its centre of pressure c, the shear is mu p across the arm r = |x
- c|, and its moment is M = mu int p r dA. Under force and moment together the limit is nearly an ellipse (R. D. Howe
and M. R. Cutkosky, Int. J. Robotics Res. 15, 1996, 557-572),

    (Q/(mu P))^2 + (M/(mu int p r dA))^2 = 1,

and the utilisation is the square root of the left side for a known friction.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, field, replace

import numpy as np

from palpate._arrays import to_numpy
from palpate._numbers import plain_number
from palpate.elastic.pad import Floats
from palpate.errors import InvalidInput
from palpate.inverse.drag import STICK
from palpate.inverse.fit import POOR_FIT
from palpate.status import Status
from palpate.touch import Touch
from palpate.units import is_number

__all__ = ["Event", "GraspMonitor", "GraspState"]

#: Prior of the friction of dry contact: mean and standard deviation of its logarithm.
LOG_MEAN, LOG_STD = math.log(0.6), 0.7
#: Relative standard deviation of friction from one slip to the next.
REPEATED = 0.1
#: Blur (standard deviation) of the estimated pressure and shear, as fractions of the resolution. The constraint that
#: pressure is positive sharpens pressure. On half-spaces and glued gels, lines and areas, at 0.3 to 3 % noise these
#: fractions were 0.20 to 0.28 and 0.40 to 0.66.
PRESSURE_BLUR, SHEAR_BLUR = 0.23, 0.5
#: Error of the shear that is predicted from the estimated pressure, as a fraction of its largest value.
TEMPLATE = 0.05
#: Error of the ratio of net forces: the difference between the drag that a tracker estimated and the true one
#: at slip, on balls of 8 to 25 mm with frictions of 0.25 to 1.1.
DRAGGED = 0.03
#: Weight of the previous frames in the running estimate.
MEMORY = 0.7
#: Weight of the previous frames in the evidence from the distribution of shear, and the number of frames as which this memory counts.
#: A memory is needed because the noise of a single frame raises false alarms.
SHAPE_MEMORY, COUNTS = 0.85, 2.5
#: The number of frames as which the memory counts if the readings themselves are compared, whose noise is independent from frame to frame (0.85 makes
#: a memory of about twelve frames, but the noise of the zero stays).
COUNTS_OF_READINGS = 5.0
#: An alarm is raised at probability RAISE and withdrawn below CLEAR.
RAISE, CLEAR = 0.9, 0.5
#: An event needs this many consecutive frames to begin or end; slip also needs SETTLED explained frames before it, so
#: that neither a single frame nor a recovering sensor raises an alarm.
EVIDENCE, SETTLED = 3, 3
#: A contact counts as sliding beyond this fraction of the friction limit.
SLIDING = 0.95
#: Number of consecutive sliding frames after which the friction is learnt.
LEARN = 5
#: Blur of rotational shear as a fraction of the resolution; and the standard deviation of its moment relative to the
#: one that independent cells, one resolution apart, would give: errors of neighbours cancel in a moment. On balls of 8
#: and 15 mm at 0.3 and 1 % noise a full twist was then estimated as 0.98 to 1.01 of the limit (at 3 % as 0.8, because
#: the penalty shrinks it), with 0.06 to 0.2 of that standard deviation.
TWIST_BLUR, TWIST_SPREAD = 0.7, 0.25
#: Cells with less than this fraction of the peak pressure do not count in a twist: at the rim pressure and shear both vanish.
RIM = 0.1


@dataclass(frozen=True)
class Event:
    """Something began or ended.

    ``kind`` is "contact", "pull" (the net force pulls the pad), "unexplained" (no load explains the readings),
    "incipient slip", "slip", "excess pressure" or "excess force". ``probability`` is that of the event when it began,
    or that it still continues when it ended. ``value`` and ``limit`` are in the unit of the watched quantity (Q/(mu
    P), Pa, N).

    Examples
    --------
    >>> from palpate.grasp import Event
    >>> print(Event("incipient slip", True, 1.25, 0.97, 0.8, 0.75))
    1.250 s  incipient slip began: 0.8 of the friction limit, probability 97 %
    """

    kind: str
    began: bool
    time: float
    probability: float
    value: float
    limit: float

    def __str__(self) -> str:
        text = f"{self.time:.3f} s  {self.kind} {'began' if self.began else 'ended'}"
        if self.kind in ("contact", "unexplained") or not self.began:
            return text
        unit = {"excess pressure": " Pa", "excess force": " N", "pull": " N"}.get(self.kind, " of the friction limit")
        return f"{text}: {plain_number(self.value, 3)}{unit}, probability {100 * self.probability:.0f} %"


@dataclass(frozen=True)
class GraspState:
    """The state of the grasp in one frame.

    ``utilisation`` is Q/(mu P), 0 without shear and 1 when all slides, with its standard deviation; NaN without contact. With a given or learnt
    friction, a twist counts too. ``friction`` and its standard deviation are given, learned or inferred from the shape of the shear.
    ``twist`` is M/int p r dA, the moment about the normal over that of pressure across its arm: it equals the friction when all of the contact turns;
    NaN on a line. ``utilisation_map`` (y, x) is |q|/(mu p) of every cell of the contact, 1 where it slips, NaN elsewhere; None without contact.
    """

    time: float
    touching: bool
    force: Floats
    utilisation: float
    utilisation_std: float
    friction: float
    friction_std: float
    probabilities: dict[str, float] = field(default_factory=dict)
    twist: float = math.nan
    utilisation_map: Floats | None = None


class GraspMonitor:
    """Processes the touches of a stream one by one, and reports events: contact, slip, excess pressure or force.

    Parameters
    ----------
    friction : float, optional
        Coefficient mu. Without it, it is inferred from the shape of the shear and learned from slips.
    incipient : float
        Fraction of the friction limit from which incipient slip is reported (0.75: a Hertz contact then sticks over 0.63 of its radius).
    max_pressure, max_force : float, optional
        Limits of peak pressure [Pa] and normal force [N].
    callback : callable, optional
        Called with each `Event`.

    Attributes
    ----------
    events : list of Event
        The last 10,000 events.

    Raises
    ------
    InvalidInput
        A limit or friction that is not positive, or ``incipient`` outside 0 to 0.95.

    Examples
    --------
    >>> import numpy as np
    >>> import palpate as pp
    >>> grid = pp.LineGrid(count=5, spacing=1e-3)
    >>> pressure = np.array([0.0, 500.0, 1000.0, 500.0, 0.0])
    >>> monitor = pp.GraspMonitor(friction=0.5)
    >>> for time in range(12):
    ...     pull = 0.1 if time == 0 else 0.49  # shear over pressure
    ...     values = np.stack([pull * pressure, pressure])
    ...     found = monitor.update(pp.Touch(values, grid, ("x", "z"), "tikhonov", time=np.array(float(time))))
    >>> [(event.kind, event.time) for event in monitor.events]
    [('contact', 2.0), ('incipient slip', 8.0)]
    """

    def __init__(
        self,
        *,
        friction: float | None = None,
        incipient: float = 0.75,
        max_pressure: float | None = None,
        max_force: float | None = None,
        callback: Callable[[Event], None] | None = None,
    ) -> None:
        for name, value in (("friction", friction), ("max_pressure", max_pressure), ("max_force", max_force)):
            if value is not None and not (is_number(value) and value > 0):
                raise InvalidInput(f"{name} must be a positive number; got {value!r}.")
        if not 0 < incipient < SLIDING:
            raise InvalidInput(f"incipient must lie between 0 and {SLIDING}; got {incipient!r}.")
        self.incipient, self.max_pressure, self.max_force, self.callback = incipient, max_pressure, max_force, callback
        self.given = friction
        self.events: list[Event] = []
        self.reset()

    def reset(self) -> None:
        """Forget the learnt friction and all current events.

        Examples
        --------
        >>> import numpy as np
        >>> import palpate as pp
        >>> touch = pp.Touch(np.ones((2, 3)), pp.LineGrid(count=3, spacing=1e-3), ("x", "z"), "tikhonov")
        >>> monitor = pp.GraspMonitor(friction=2.0)
        >>> found = monitor.update(touch)
        >>> monitor.reset()
        >>> monitor.going_on()
        ()
        """
        self.learned: float | None = None
        self._on: dict[str, bool] = {}
        self._since: dict[str, int] = {}  # number of consecutive frames that suggest a change
        self._settled = 0  # number of consecutive explained frames of a contact
        self._past: Floats = np.zeros(len(STICK))
        self._smooth: float | None = None
        self._slid: list[float] = []
        self._frames = 0
        self.state: GraspState | None = None

    def update(self, touch: Touch) -> list[Event]:
        """Process one touch (without batch axes) and return the events that began or ended: each needs three consecutive explained frames. An unexplained frame (status "unexplained", or a fit below 0.01) can begin or end only the event "unexplained".

        Raises
        ------
        InvalidInput
            A batch, or a touch without pressure.

        Examples
        --------
        >>> import numpy as np
        >>> import palpate as pp
        >>> grid = pp.LineGrid(count=3, spacing=1e-3)
        >>> touch = pp.Touch(np.array([[0.0, 100.0, 0.0], [0.0, 1000.0, 0.0]]), grid, ("x", "z"), "tikhonov")
        >>> monitor = pp.GraspMonitor(friction=0.5, max_pressure=800.0)
        >>> events = [str(event) for _ in range(3) for event in monitor.update(touch)]  # one frame alone is no event
        >>> events
        ['2.000 s  contact began', '2.000 s  excess pressure began: 1000 Pa, probability 100 %']

        >>> round(monitor.state.utilisation, 3)  # Q / (mu P)
        0.2
        """
        if to_numpy(touch.values).ndim != 1 + touch.surface.dimensions:
            raise InvalidInput("a GraspMonitor takes one touch at a time: Touch.frame(i) of a batch.")
        if "z" not in touch.components:
            raise InvalidInput("a GraspMonitor needs the pressure: seek component z.")
        time = float(self._frames if touch.time is None else touch.time)
        self._frames += 1
        status = None if touch.status is None else Status.coded(int(touch.status))
        if status is not None and (not status.known or status is Status.FROZEN):
            # a frame without numbers does not end current events
            lost = np.full(len(touch.surface.components), math.nan)
            self._forget()
            self.state = GraspState(time, False, lost, math.nan, math.nan, *self._friction())
            return []
        values = to_numpy(touch.values).astype(np.float64)
        force = to_numpy(touch.force).astype(np.float64)
        touching = bool(values[-1].any()) if touch.touching is None else bool(touch.touching)
        # a pull or an unexplained frame does not count as contact
        pushing = touch.pushing is None or bool(touch.pushing)
        poor = touch.fit is not None and float(touch.fit) < POOR_FIT
        explained = status is not Status.UNEXPLAINED and not poor
        pulling = touching and explained and not pushing and force[-1] < 0
        unexplained = touching and (not explained or (not pushing and force[-1] > 0))
        touching = touching and force[-1] > 0
        probabilities: dict[str, float] = {}
        if unexplained:
            # such a frame is no evidence about current events
            self._forget()
            self.state = GraspState(time, touching, force, math.nan, math.nan, *self._friction())
            return self._watch({"unexplained": (1.0, float(force[-1]), 0.0)}, time)
        utilisation = std = twist = math.nan
        cells: Floats | None = None
        friction, friction_std = self._friction()
        overload = status is Status.OVERLOAD
        if not touching:
            self._forget()
        elif overload:
            self._settled = 0  # shear over pressure is unknown
        elif set(touch.components) == set(touch.surface.components):
            net, error = _likely(touch, force)
            ratio = float(np.linalg.norm(net[:-1])) / float(net[-1])
            if touch.drag is not None:  # the drag estimate is not shrunk by the penalty
                ratio = float(np.linalg.norm(touch.drag))
                error = math.hypot(float(touch.drag_std or 0.0), DRAGGED * ratio)
            twist, twist_std = _twist(touch, values)
            if self.given is None and self.learned is None:
                utilisation, std, friction, friction_std = self._from_shape(
                    touch, values, net, ratio, error, probabilities
                )
            else:
                if twist > twist_std:
                    both = math.hypot(ratio, math.sqrt(twist**2 - twist_std**2))
                    error = math.hypot(ratio * error, twist * twist_std) / both
                    ratio = both
                utilisation, std = self._from_forces(ratio, error, friction, friction_std, probabilities)
            self._learn(probabilities["slip"], ratio)
            size, p = to_numpy(touch._shear_size()), values[-1]
            cells = np.where(touch.contact(), size / np.where(p > 0, friction * p, 1.0), math.nan)
            self._settled += 1
        for kind, limit, of, value in (
            ("excess pressure", self.max_pressure, "peak_pressure", float(values[-1].max())),
            ("excess force", self.max_force, "force", float(force[-1])),
        ):
            if touching and limit is not None:
                sure = overload or not touch.has_intervals  # an overload is at least as large as its value
                probabilities[kind] = float(value > limit if sure else touch.exceeds(limit, of))
        self.state = GraspState(
            time, touching, force, utilisation, std, friction, friction_std, probabilities, twist, cells
        )
        watched = {
            "contact": (self._contact(touch, force) if touching else 0.0, float(force[-1]), 0.0),
            "pull": (_chance_of_pull(touch) if pulling else 0.0, float(force[-1]), 0.0),
            "unexplained": (0.0, float(force[-1]), 0.0),
            "excess pressure": (
                probabilities.get("excess pressure", 0.0),
                float(values[-1].max()),
                self.max_pressure or math.nan,
            ),
            "excess force": (probabilities.get("excess force", 0.0), float(force[-1]), self.max_force or math.nan),
        }
        if not touching or self._settled > SETTLED:
            for kind, limit in (("incipient slip", self.incipient), ("slip", SLIDING)):
                watched[kind] = (probabilities.get(kind, 0.0), utilisation, limit)
        return self._watch(watched, time)

    def _forget(self) -> None:
        """Discard the evidence on slip."""
        self._past, self._smooth, self._settled = np.zeros(len(STICK)), None, 0

    def _contact(self, touch: Touch, force: Floats) -> float:
        """Return the probability that a touch with positive force is a contact; 1 if a contact continues."""
        return 1.0 if self._on.get("contact", False) else _chance_of_contact(touch, force)

    def _watch(self, watched: dict[str, tuple[float, float, float]], time: float) -> list[Event]:
        """Begin or end events from probability, value and limit of each kind; reset the evidence of events that do not apply."""
        found = []
        since, self._since = self._since, {}
        for kind, (probability, value, limit) in watched.items():
            was = self._on.get(kind, False)
            if math.isnan(probability) or (probability >= (CLEAR if was else RAISE)) is was:
                continue
            self._since[kind] = since.get(kind, 0) + 1
            if self._since[kind] >= EVIDENCE:
                self._on[kind] = not was
                found.append(Event(kind, not was, time, probability, value, limit))
        for event in found:
            self.events.append(event)
            if self.callback is not None:
                self.callback(event)
        del self.events[:-10_000]
        return found

    def going_on(self) -> tuple[str, ...]:
        """Kinds of events that have begun and not ended.

        Examples
        --------
        >>> import numpy as np
        >>> import palpate as pp
        >>> touch = pp.Touch(np.ones((2, 3)), pp.LineGrid(count=3, spacing=1e-3), ("x", "z"), "tikhonov")
        >>> monitor = pp.GraspMonitor(friction=2.0)
        >>> found = [monitor.update(touch) for _ in range(3)]
        >>> monitor.going_on()
        ('contact',)
        """
        return tuple(kind for kind, on in self._on.items() if on)

    # -- how near slip is ----------------------------------------------------------------------------------------------

    def _friction(self) -> tuple[float, float]:
        """Return the friction known before this frame, and its standard deviation."""
        if self.given is not None:
            return self.given, 0.0
        if self.learned is not None:
            return self.learned, REPEATED * self.learned
        return math.exp(LOG_MEAN), LOG_STD * math.exp(LOG_MEAN)

    def _from_forces(
        self, ratio: float, error: float, friction: float, friction_std: float, chances: dict[str, float]
    ) -> tuple[float, float]:
        """Return Q/(mu P) and its standard deviation from the net forces, with known friction."""
        now = min(ratio / friction, 1.2)
        std = math.hypot(error, now * friction_std) / friction
        self._smooth = now if self._smooth is None else MEMORY * self._smooth + (1.0 - MEMORY) * now
        for kind, limit in (("incipient slip", self.incipient), ("slip", SLIDING)):
            chances[kind] = 0.5 * math.erfc((limit - self._smooth) / (math.sqrt(2.0) * max(std, 1e-6)))
        return min(self._smooth, 1.0), std

    def _from_shape(
        self, touch: Touch, values: Floats, force: Floats, ratio: float, error: float, chances: dict[str, float]
    ) -> tuple[float, float, float, float]:
        """Return Q/(mu P) and mu, each with its standard deviation, from the distribution of shear over the contact."""
        power = 1.0 + touch.surface.dimensions
        used = 1.0 - STICK**power
        mus = ratio / used
        wide = math.hypot(LOG_STD, error / max(ratio, 1e-9))
        log = -0.5 * ((np.log(np.maximum(mus, 1e-9)) - LOG_MEAN) / wide) ** 2
        if ratio > 3.0 * error:
            log = log + (self._shape(touch, values, force, power) if touch.sticking is None else touch.sticking)
        self._past = SHAPE_MEMORY * self._past + (1.0 - SHAPE_MEMORY) * (log - log.max())
        counts = COUNTS if touch.sticking is None else COUNTS_OF_READINGS
        weights = np.exp(counts * (self._past - self._past.max()))
        # candidates are not evenly spaced in Q/(mu P)
        weights = weights * np.abs(np.gradient(used))
        weights = weights / weights.sum()
        chances["incipient slip"] = float(weights @ (used >= self.incipient))
        chances["slip"] = float(weights @ (used >= SLIDING))

        def summed_up(x: Floats) -> tuple[float, float]:
            mean = float(weights @ x)
            return mean, math.sqrt(max(float(weights @ (x - mean) ** 2), 0.0))

        return (*summed_up(used), *summed_up(mus))

    def _shape(self, touch: Touch, values: Floats, force: Floats, power: float) -> Floats:
        """Return the log likelihood of each candidate from the distribution of shear over the contact."""
        import scipy.ndimage

        grid = touch.surface
        p = values[-1]
        direction = force[:-1] / np.linalg.norm(force[:-1])
        q = np.tensordot(direction, values[:-1], 1)
        # neighbouring cells are not independent: count as many data as there are resolved patches
        resolution = 2.0 if touch.resolution is None else float(touch.resolution) / min(grid.spacings)
        cells = max(1.0, resolution) ** grid.dimensions
        # blur the pressure as much as the shear
        sharp, wide = PRESSURE_BLUR * resolution, SHEAR_BLUR * resolution
        outer = scipy.ndimage.gaussian_filter(p, math.sqrt(wide**2 - sharp**2))
        region = outer > 0.02 * outer.max()
        if touch._errors is None:
            variance = np.full(p.shape, (0.1 * float(np.abs(q).max())) ** 2)
        else:
            std = np.asarray(touch._errors.posterior.traction, dtype=np.float64)
            variance = np.tensordot(direction**2, std[:-1] ** 2, 1)
            # the template is computed from the estimated pressure
            slope = float(np.linalg.norm(force[:-1])) / float(force[-1])
            variance = variance + (slope * std[-1]) ** 2
        variance = variance + (TEMPLATE * float(np.abs(q).max())) ** 2
        total = float(p.sum())
        centers = [
            float((np.arange(n) * p.sum(axis=tuple(a for a in range(p.ndim) if a != axis))).sum()) / total
            for axis, n in enumerate(p.shape)
        ]
        places = np.indices(p.shape).astype(np.float64)
        weight = region / variance
        out = np.empty(len(STICK))
        for i, s in enumerate(STICK):
            template = outer
            if s > 0:
                scaled = [c + (x - c) / s for c, x in zip(centers, places)]
                inner = scipy.ndimage.map_coordinates(p, scaled, order=1, mode="constant")
                template = outer - s * scipy.ndimage.gaussian_filter(inner, math.sqrt(wide**2 - (s * sharp) ** 2))
            norm = float((weight * template**2).sum())
            mu = float((weight * template * q).sum()) / norm if norm > 0 else 0.0
            out[i] = -0.5 * float((weight * (q - mu * template) ** 2).sum()) / cells
        return out

    def _learn(self, sliding: float, ratio: float) -> None:
        """Learn the friction while the contact slides."""
        if self.given is not None:
            return
        if sliding < RAISE:
            self._slid = []
            return
        self._slid.append(ratio)
        if len(self._slid) >= LEARN:
            now = float(np.median(self._slid[-LEARN:]))
            self.learned = now if self.learned is None else 0.8 * self.learned + 0.2 * now


def _twist(touch: Touch, values: Floats) -> tuple[float, float]:
    """Return M/int p r dA about the centre of pressure and its standard deviation; NaN and 0 in line contact, or if
    nothing presses.
    """
    import scipy.ndimage

    grid = touch.surface
    if grid.dimensions == 1:
        return math.nan, 0.0
    p = np.where(values[-1] > RIM * float(values[-1].max()), values[-1], 0.0)
    if not float(p.sum()) > 0.0:  # a calibration gave the force alone, without a map of pressure
        return math.nan, 0.0
    y, x = (np.arange(n) * d for n, d in zip(grid.shape, grid.spacings))
    dx, dy = x[None, :] - float((p @ x).sum()) / float(p.sum()), y[:, None] - float((p.T @ y).sum()) / float(p.sum())
    arm = np.maximum(np.hypot(dx, dy), 1e-300)
    resolution = 2.0 if touch.resolution is None else float(touch.resolution) / min(grid.spacings)
    # the shape of the shear under a turning contact, blurred like the estimate
    blur = resolution * math.sqrt(TWIST_BLUR**2 - PRESSURE_BLUR**2)
    across = [scipy.ndimage.gaussian_filter(v, blur) for v in (-p * dy / arm, p * dx / arm)]
    near = scipy.ndimage.gaussian_filter(p, blur) > 0.02 * float(p.max())
    whole = float((near * (dx * across[1] - dy * across[0])).sum())
    if not whole > 0:
        return 0.0, 0.0
    moment = float((near * (dx * values[1] - dy * values[0])).sum())
    if touch._errors is None:
        return abs(moment) / whole, 0.05
    std = np.asarray(touch._errors.posterior.traction, dtype=np.float64)
    cells = max(1.0, resolution) ** 2
    variance = cells * float((near * ((dx * std[1]) ** 2 + (dy * std[0]) ** 2)).sum())
    return abs(moment) / whole, TWIST_SPREAD * math.sqrt(max(variance, 0.0)) / whole


def _chance_of_pull(touch: Touch) -> float:
    """Return the probability that the true net force pulls, for a touch with an estimated net force that pulls."""
    if not touch.has_intervals:
        return 1.0
    low, high = touch.interval(0.6827, "force")
    if not (math.isfinite(low[-1]) and math.isfinite(high[-1])):  # an overload: nothing shows its sign
        return 0.5
    middle, std = 0.5 * (low[-1] + high[-1]), 0.5 * (high[-1] - low[-1])
    return 0.5 * math.erfc(float(middle) / (math.sqrt(2.0) * max(float(std), 1e-300)))


def _chance_of_contact(touch: Touch, force: Floats) -> float:
    """Return the probability that the net force presses, given its bias and error."""
    if touch._errors is None or not np.isfinite(touch._errors.posterior.force[-1]):
        return 1.0
    low, high = touch.interval(0.6827, "force")
    below = (
        float(force[-1] - low[-1]) if low[-1] > 0 else float(high[-1] - force[-1])
    )  # the lower end may be cut off at zero
    if not math.isfinite(below):
        return 1.0
    return 0.5 * math.erfc(-float(force[-1]) / (math.sqrt(2.0) * max(below, 1e-300)))


def _likely(touch: Touch, force: Floats) -> tuple[Floats, float]:
    """Return the most likely net force, with the bias subtracted, and the standard deviation of Q/P."""
    if touch._errors is None:
        return force, 0.05
    # a common error of pressure and shear does not change their ratio
    low, high = replace(touch, _errors=replace(touch._errors, scale=0.0)).interval(0.6827, "force")
    net, std = 0.5 * (low + high), 0.5 * (high - low)
    if not net[-1] > 0:
        return force, 0.05
    ratio = float(np.linalg.norm(net[:-1])) / float(net[-1])
    along = net[:-1] / max(float(np.linalg.norm(net[:-1])), 1e-300)
    across = float(np.linalg.norm(along * std[:-1])) if ratio > 0 else float(np.linalg.norm(std[:-1]))
    return net, math.hypot(across, ratio * float(std[-1])) / float(net[-1])
