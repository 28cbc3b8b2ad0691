"""The input of a method, with caches that methods share: decompositions, operators on finer grids."""

from __future__ import annotations

import math
from collections import OrderedDict
from collections.abc import Callable, Hashable, Sequence
from dataclasses import replace
from typing import Any, TypeVar, cast

import numpy as np

from palpate._recall import Recall, digest
from palpate._threads import Lock
from palpate.elastic.channels import find_channel
from palpate.elastic.pad import Floats, Pad
from palpate.errors import Unsupported
from palpate.inverse.linear.matrix_free.system import System
from palpate.inverse.linear.priors import Prior
from palpate.inverse.linear.regularised import Decomposition, decompose
from palpate.inverse.linear.spectrum import DataSpectrum
from palpate.inverse.observability import blind_to_force, is_observable
from palpate.sensing.arrays import Array, ScatteredArray
from palpate.sensing.grids import Grid, divided
from palpate.sensing.operator import Boundary, Operator, check_surface
from palpate.sensing.surface import WIDE, check_above, check_depth, check_thickness, surface_of
from palpate.sensing.uncertainty import Uncertainty, scale_free, step_of, stretched

__all__ = ["Kept", "Problem"]

Value = TypeVar("Value")

#: Largest size of the cache of prepared methods, in entries and bytes: two decompositions of 64 x 64 x 3 readings are 0.6 GB.
MOST_ENTRIES, MOST_BYTES = 64, 2_000_000_000


class Kept:
    """A cache of prepared objects by key; the least recently used are dropped first."""

    def __init__(self, entries: int = MOST_ENTRIES, nbytes: int = MOST_BYTES) -> None:
        self.entries, self.nbytes = entries, nbytes
        self._things: OrderedDict[Hashable, Any] = OrderedDict()
        self._lock = Lock()

    def get(self, key: Hashable, make: Callable[[], Value]) -> Value:
        """Return the value cached under ``key``; make it if it is missing."""
        with self._lock:
            if key in self._things:
                self._things.move_to_end(key)
                return cast(Value, self._things[key])
        value = make()
        with self._lock:
            self._things[key] = value
            while len(self._things) > 1 and (len(self._things) > self.entries or self._size() > self.nbytes):
                self._things.popitem(last=False)
        return value

    def things(self) -> list[Any]:
        """All cached values."""
        with self._lock:
            return list(self._things.values())

    def clear(self) -> None:
        """Clear the cache."""
        with self._lock:
            self._things.clear()

    def _size(self) -> int:
        return sum(int(getattr(v, "nbytes", 0)) for v in self._things.values())

    def __len__(self) -> int:
        return len(self._things)

    def __getstate__(self) -> dict[str, Any]:
        return {"entries": self.entries, "nbytes": self.nbytes}  # prepared values can be prepared again

    def __setstate__(self, state: dict[str, Any]) -> None:
        self.__init__(**state)  # type: ignore[misc]


class Problem:
    """Pad, arrays, surface and components sought: everything that a method may depend on besides its own options.

    Attributes
    ----------
    pad : Pad
        The elastic body (without creep).
    planes : tuple of arrays
    surface : LineGrid or AreaGrid
        Grid of the traction.
    boundary : "free" or "periodic"
    components : tuple of str
        Components of the traction to estimate.
    fixed : bool
        Whether the user gave the surface, so that contact is estimated only there.
    nuisance : tuple of str or None
        Nuisances of the readings (`palpate.sensing.nuisance`); None: the readings decide.
    uncertainty : Uncertainty
        Uncertainty of pad and sensors.
    zeroed : bool
        Whether a zero was taken from the readings: stress and strain then have no offsets.
    """

    def __init__(
        self,
        pad: Pad,
        planes: Sequence[Array],
        surface: Grid,
        boundary: Boundary,
        components: Sequence[str],
        *,
        fixed: bool = False,
        nuisance: tuple[str, ...] | None = None,
        uncertainty: Uncertainty | None = None,
        kept: Kept | None = None,
        recall: Recall | None = None,
        zeroed: bool = False,
    ) -> None:
        check_surface(planes, surface)
        check_thickness(planes, pad.thickness)
        self.pad, self.planes, self.surface, self.boundary = pad, tuple(planes), surface, boundary
        self.components, self.fixed, self.nuisance = tuple(components), fixed, nuisance
        self.uncertainty = (uncertainty or Uncertainty()).of(pad)
        #: Uncertainty for constrained methods; for linear methods only a stated uncertainty of depth and thickness.
        self.doubts = self.uncertainty.beside(pad, self.planes)
        self.stated = self.uncertainty.beside(pad, self.planes, assumed=False)
        self.common_std = self.uncertainty.common(self.planes)
        self.kept = Kept() if kept is None else kept
        self.recall = recall
        self.zeroed = zeroed
        #: The zero that was taken (one array (channel, *array) per plane), because saturation shows in the raw
        #: readings.
        self.zero: Sequence[Floats] | None = None

    def seeking(self, components: Sequence[str]) -> Problem:
        """The same problem with other components sought; it shares everything that does not depend on them.

        `InvalidInput` if the surface is too large for the arrays, or lies beside them.
        """
        check_above(self.planes, self.surface)
        if not self.fixed:
            check_depth(self.planes, self.surface)
        found = Problem(
            self.pad,
            self.planes,
            self.surface,
            self.boundary,
            components,
            fixed=self.fixed,
            nuisance=self.nuisance,
            uncertainty=self.uncertainty,
            kept=self.kept,
            recall=self.recall,
            zeroed=self.zeroed,
        )
        found.zero = self.zero
        return found

    def coarser(self, most: int) -> Problem:
        """The same problem on cells as wide as those of the default surface, if the surface has more than ``most``
        unknowns, and at least twice as many cells as with these; itself otherwise.

        Readings do not resolve finer cells (`default_surface`).
        """
        cells = math.prod(self.surface.shape)
        if not self.fixed or cells * len(self.components) <= most:
            return self
        usual = surface_of(self.pad, self.planes).spacings
        counts = [
            min(n, max(2, math.ceil(n * dx / width - 1e-9)))
            for n, dx, width in zip(self.surface.shape, self.surface.spacings, usual)
        ]
        if 2 * math.prod(counts) > cells:
            return self
        kept = self.kept.get(("coarser", tuple(counts)), Kept)
        return self._on(divided(self.surface, counts), self.planes, kept)

    def _on(self, surface: Grid, planes: Sequence[Array], kept: Kept | None = None) -> Problem:
        """The same problem with another surface or other arrays, and a cache for them."""
        found = Problem(
            self.pad,
            planes,
            surface,
            self.boundary,
            self.components,
            fixed=self.fixed,
            nuisance=self.nuisance,
            uncertainty=self.uncertainty,
            kept=kept,
            recall=self.recall,
            zeroed=self.zeroed,
        )
        found.zero = self.zero
        return found

    def with_even_noise(self) -> Problem:
        """The same problem with one noise level for all channels of a kind: the root mean square of the given levels,
        or 1 in the unit of the channel.

        This represents the model error of a pad, spread evenly (`palpate.inverse.contact.discrepancy`).
        """
        squares: dict[str, list[float]] = {}
        for array in self.planes:
            for channel, std in zip(array.channels, array.noise_std or (1.0,) * len(array.channels)):
                squares.setdefault(find_channel(channel).kind.unit, []).append(std**2)
        level = {unit: math.sqrt(sum(values) / len(values)) for unit, values in squares.items()}
        if all(
            a.noise_std is not None
            and all(math.isclose(s, level[find_channel(c).kind.unit]) for c, s in zip(a.channels, a.noise_std))
            for a in self.planes
        ):
            return self  # the noise is even already: share the decompositions
        planes = [replace(a, noise=[level[find_channel(c).kind.unit] for c in a.channels]) for a in self.planes]
        return self._on(self.surface, planes)

    @property
    def columns(self) -> tuple[int, ...]:
        """Indices of the components sought among those of the surface."""
        return tuple(self.surface.components.index(c) for c in self.components)

    @property
    def ambiguous(self) -> bool:
        """Whether the channels alone cannot separate the components."""
        return self.kept.get(
            ("ambiguous", self.columns), lambda: not is_observable(self.pad, self.planes, self.components)
        )

    @property
    def blind(self) -> tuple[str, ...]:
        """The components whose net force no channel responds to (`blind_to_force`)."""
        return self.kept.get(("blind", self.columns), lambda: blind_to_force(self.pad, self.planes, self.components))

    @property
    def operator(self) -> Operator:
        """The map from traction on the surface to readings."""
        return self.kept.get("operator", lambda: self._operator(self.surface))

    @property
    def wide_surface(self) -> Grid:
        """The surface of `wide`."""
        return self.surface if self.fixed else surface_of(self.pad, self.planes, depths=WIDE)

    @property
    def wide(self) -> Operator:
        """The map from a wider surface, for loads beyond the edge of the array."""
        if self.fixed:
            return self.operator
        return self.kept.get(
            "wide operator",
            lambda: self._operator(self.wide_surface),
        )

    def _operator(self, surface: Grid) -> Operator:
        return Operator(self.pad, self.planes, surface, self.boundary, recall=self.recall)

    def about(self) -> dict[str, str]:
        """The identity of this problem: digests by name.

        Raises
        ------
        Unsupported
            A pad of the user's own class: it has no digest.
        """
        parts = {
            "pad": self.pad,
            "arrays": self.planes,
            "surface": (self.surface, self.fixed),
            "boundary": self.boundary,
        }
        found = {name: digest(part) for name, part in parts.items()}
        for name, value in found.items():
            if value is None:
                raise Unsupported(
                    f"what is prepared for {type(parts[name]).__name__} cannot be told from what is prepared for another of its kind, so "
                    "that it is not saved: only pads that come with palpate are."
                )
        return {name: value for name, value in found.items() if value is not None}

    def worked_out(self) -> dict[str, tuple[Floats, ...]]:
        """Cached values that take long to compute, for `Recall`."""
        out: dict[str, tuple[Floats, ...]] = {}
        for thing in self.kept.things():
            if isinstance(thing, Operator | System):
                out |= thing.worked_out()
            elif isinstance(thing, Decomposition) and isinstance(thing.spectrum, DataSpectrum):
                out |= thing.spectrum.worked_out()
        return out

    def doubtful(self, u: Uncertainty, traction: Floats, *, wide: bool = False) -> tuple[Floats, Floats]:
        """Effect of the uncertainty ``u`` of modulus, thickness and depth (`doubts` or `stated`) on the readings of
        ``traction`` (component, *surface).

        Returns columns (reading, unknown), in the unit of the channels for a change of 1 (100 %), and the standard
        deviations of the unknowns.
        """
        operator = self.wide if wide else self.operator

        def readings(of: Operator) -> Floats:
            parts = [
                r.reshape(len(a.channels), -1)[:, a.valid.ravel()].ravel()
                for a, r in zip(self.planes, of.forward(traction))
            ]
            return np.concatenate(parts)

        plain = readings(operator)
        columns, size = [], []
        if u.youngs_modulus:
            columns.append(-plain * scale_free(self.planes))
            size.append(u.youngs_modulus)
        for name in ("depth", "thickness"):
            value = getattr(u, name)
            if value:
                step = step_of(self.pad, self.planes, name)
                columns.append((readings(self.moved(name, wide=wide)) - plain) / step)
                size.append(value)
        if not columns:
            return np.zeros((len(plain), 0)), np.zeros(0)
        return np.stack(columns, axis=1), np.array(size)

    def moved(self, name: str, *, wide: bool = False) -> Operator:
        """The operator of a pad whose "depth" or "thickness" is larger by the fraction
        `palpate.sensing.uncertainty.step_of`.
        """

        def made() -> Operator:
            step = step_of(self.pad, self.planes, name)
            pad, planes = stretched(self.pad, self.planes, **{name: 1.0 + step})
            surface = self.wide_surface if wide else self.surface
            return Operator(pad, planes, surface, self.boundary, recall=self.recall)

        return self.kept.get(("moved", name, wide and not self.fixed), made)

    def prepare_doubts(self, *, wide: bool = False) -> None:
        """Prepare `doubtful` for `doubts`. For scattered sensors, whose operators are large, this happens at first
        use.
        """
        if not any(isinstance(a, ScatteredArray) for a in self.planes):
            for name in ("depth", "thickness"):
                if getattr(self.doubts, name):
                    _ = self.moved(name, wide=wide).planes

    def decomposition(self, priors: Sequence[Prior], *, wide: bool = False) -> Decomposition:
        """The spectral decomposition under these priors (one per component sought), cached for all methods, parameters
        and rules.

        Priors that differ only in strength, for example for another friction, share the products of readings.
        """
        place = wide and not self.fixed, self.columns
        operator = self.wide if wide else self.operator

        def shared(key: Hashable, make: Callable[[], Value]) -> Value:
            return self.kept.get(("products", *place, key), make)

        return self.kept.get(
            ("decomposition", *place, tuple(p.key for p in priors)),
            lambda: decompose(operator, priors, self.columns, shared),
        )
