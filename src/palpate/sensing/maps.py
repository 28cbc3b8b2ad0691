"""Maps from traction on a surface to readings: the interface `LinearMap`, and a matrix as an implementation.

For a pad that is the same everywhere, `palpate.sensing.Operator` builds the map as a convolution. A pad with a
position-dependent response (it ends, it bends, it was measured) computes its own maps: it has the members of `Body`
besides those of `palpate.elastic.Pad`. Methods, trackers, plots and files only use maps, so that a new kind of pad
needs only a new class.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any, Protocol, runtime_checkable

import numpy as np
import numpy.typing as npt

from palpate._arrays import from_numpy, is_numpy, namespace
from palpate.elastic.pad import Floats
from palpate.errors import InvalidInput, Unsupported
from palpate.sensing.arrays import Array
from palpate.sensing.grids import Grid

__all__ = ["Among", "Body", "LinearMap", "MatrixMap", "body_of", "check_modelled", "kernel_of"]

#: Indices of the components of a traction; None: all of them.
Among = Sequence[int] | None


@runtime_checkable
class LinearMap(Protocol):
    """A map from traction (..., component, *surface) to the readings (..., channel, *array) of one array, and its
    transpose.

    A convolution also has ``kernel`` (channel, component, *lag), the influence of one cell; large problems without a
    matrix need it.

    Examples
    --------
    >>> import palpate as pp
    >>> from palpate.sensing import LinearMap
    >>> pad = pp.HalfSpace(youngs_modulus=1e5, poissons_ratio=0.5)
    >>> skin = pp.Skin(pad, pp.LineArray(count=5, pitch=1e-3, depth=1e-3, channels=["stress_zz"]))
    >>> all(isinstance(part, LinearMap) for part in skin.operator.planes)
    True

    >>> import numpy as np
    >>> (part,) = skin.operator.planes
    >>> part.forward(np.ones((2, 9))).shape, part.adjoint(np.ones((1, 5))).shape
    ((1, 5), (2, 9))

    >>> part.dense().shape, part.columns(1, np.array([3, 4])).shape
    ((1, 5, 2, 9), (1, 5, 2))
    """

    def forward(self, traction: Any, among: Among = None) -> Any:
        """Readings of a traction; ``among`` are the components that ``traction`` contains, by default all."""
        ...

    def adjoint(self, readings: Any, among: Among = None) -> Any:
        """The transpose of `forward`."""
        ...

    def dense(self) -> Floats:
        """The matrix (channel, *array, component, *surface)."""
        ...

    def columns(self, component: int, cells: npt.NDArray[np.intp]) -> Floats:
        """Some columns of the matrix (channel, taxel, cell): readings of unit traction in cells (flat indices)."""
        ...


@runtime_checkable
class Body(Protocol):
    """A pad that computes its own influence maps, because its response depends on position.

    It also has the members of `palpate.elastic.Pad`, those of the most similar endless pad. They decide which
    components can be separated, the largest possible reading, and the strain of the surface; no reading is computed
    from them.

    Examples
    --------
    >>> import palpate as pp
    >>> from palpate.sensing import Body
    >>> gel = pp.SolidPad.box(8e-3, 8e-3, 2e-3, youngs_modulus=2e5, poissons_ratio=0.48, element=1e-3)
    >>> isinstance(gel, Body), isinstance(gel.endless, Body)
    (True, False)
    >>> array = pp.AreaArray(shape=(3, 3), pitch=2e-3, depth=2e-3, channels=["stress_zz"])
    >>> surface = gel.patch([array])
    >>> gel.response(array, surface).dense().shape == (1, 3, 3, 3, *surface.shape)
    True
    """

    def response(self, array: Array, surface: Grid) -> LinearMap:
        """The map of an array, from traction on the cells of a surface."""
        ...

    def patch(self, planes: Sequence[Array]) -> Grid:
        """The surface that can be touched, in cells that suit these arrays."""
        ...


def body_of(pad: object) -> Body | None:
    """The pad itself, if it computes its own influence maps; otherwise None."""
    return pad if isinstance(pad, Body) else None


def check_modelled(pad: object, use: str) -> None:
    """Raise `Unsupported` for a pad without an elastic model, such as a measured one (``modelled`` is False)."""
    if not getattr(pad, "modelled", True):
        raise Unsupported(
            f"{use} needs an elastic model of the pad, and a {type(pad).__name__} has none: only its table is known. Take HalfSpace, BondedLayers or SolidPad "
            "with what you know of the pad."
        )


def kernel_of(part: LinearMap, use: str) -> npt.NDArray[np.float64]:
    """The influence of one cell (channel, component, *lag) on an array.

    Raises
    ------
    Unsupported
        The map is no convolution.
    """
    found = getattr(part, "kernel", None)
    if found is None:
        raise Unsupported(
            f"{use} needs a pad that is the same everywhere, and the map of this one is a {type(part).__name__}. Use fewer readings or a coarser surface, "
            'or method="tikhonov".'
        )
    return np.asarray(found)


class Cached:
    """Prepared NumPy arrays, handed over once per array kind, precision and device."""

    def __init__(self, value: npt.NDArray[Any]) -> None:
        self.value = value
        self._copies: dict[tuple[Any, ...], Any] = {}

    def like(self, x: Any) -> Any:
        """The array in the kind, precision and device of ``x``."""
        key: tuple[Any, ...] = (x.dtype,)
        if not is_numpy(x):
            key = (namespace(x).__name__, str(x.dtype), str(getattr(x, "device", "")))
        if key not in self._copies:
            self._copies[key] = from_numpy(self.value, x)
        return self._copies[key]


class MatrixMap:
    """A map given by a matrix (channel, taxel, component, *surface), for an array with the shape ``taxels``.

    Raises
    ------
    InvalidInput
        A matrix of another shape, or with entries that are not finite.

    Examples
    --------
    >>> import numpy as np
    >>> from palpate.sensing import MatrixMap
    >>> part = MatrixMap(np.arange(24.0).reshape(1, 2, 3, 2, 2), (2,))  # one channel, two taxels, 2 x 2 cells
    >>> part.forward(np.ones((3, 2, 2))).tolist()
    [[66.0, 210.0]]

    >>> part.adjoint(np.ones((1, 2))).shape, part.dense().shape, part.columns(2, np.array([0])).ravel().tolist()
    ((3, 2, 2), (1, 2, 3, 2, 2), [8.0, 20.0])
    """

    def __init__(self, matrix: Floats, taxels: tuple[int, ...]) -> None:
        if matrix.ndim < 4 or matrix.shape[1] != math.prod(taxels):
            raise InvalidInput(
                f"a matrix (channel, taxel, component, *surface) of {math.prod(taxels)} taxels is needed; got one of shape {matrix.shape}."
            )
        if not np.isfinite(matrix).all():
            raise InvalidInput(
                f"the matrix of a map must be finite; {int((~np.isfinite(matrix)).sum())} of its {matrix.size} numbers are not. Compute them again."
            )
        self.taxels, self.cells = tuple(taxels), matrix.shape[3:]
        self.rows, self.count = matrix.shape[0], matrix.shape[2]
        self._matrix = matrix
        self.matrix = Cached(matrix.reshape(self.rows * matrix.shape[1], -1))

    def forward(self, traction: Any, among: Among = None) -> Any:
        """Readings (..., channel, *array) of a traction."""
        xp, d = namespace(traction), len(self.cells)
        batch, n = traction.shape[: -1 - d], math.prod(self.cells)
        flat, matrix = xp.reshape(traction, (*batch, -1, n)), self.matrix.like(traction)
        out: Any = 0.0
        for place, column in enumerate(range(self.count) if among is None else among):
            one, first, last = flat[..., place, :], 0, n
            if not batch and is_numpy(traction):  # most contacts are small: read only their part of the matrix
                loaded = np.flatnonzero(one)
                first, last = (int(loaded[0]), int(loaded[-1]) + 1) if len(loaded) else (0, 0)
            part = matrix[:, column * n + first : column * n + last]
            out = out + xp.matmul(one[..., first:last], xp.permute_dims(part, (1, 0)))
        return xp.reshape(out, (*batch, self.rows, *self.taxels))

    def adjoint(self, readings: Any, among: Among = None) -> Any:
        """The transpose of `forward`."""
        xp = namespace(readings)
        batch, n = readings.shape[: -1 - len(self.taxels)], math.prod(self.cells)
        flat, matrix = xp.reshape(readings, (*batch, -1)), self.matrix.like(readings)
        if among is None:
            return xp.reshape(xp.matmul(flat, matrix), (*batch, self.count, *self.cells))
        each = [xp.matmul(flat, matrix[:, i * n : (i + 1) * n]) for i in among]
        return xp.reshape(xp.stack(each, axis=-2), (*batch, len(each), *self.cells))

    def dense(self) -> Floats:
        """The matrix (channel, *array, component, *surface)."""
        return self._matrix.reshape(self.rows, *self.taxels, self.count, *self.cells)

    def columns(self, component: int, cells: npt.NDArray[np.intp]) -> Floats:
        """(channel, taxel, cell): readings of unit traction in some ``cells`` (flat indices)."""
        rows = self._matrix.reshape(self.rows, -1, self.count, math.prod(self.cells))
        return np.asarray(rows[:, :, component, cells])
