"""The compiled core (`core/`), where it was built: Newton's method of `cone`, and factors for few readings, with the same
results up to rounding.

`newton` returns None if there is no core, if PALPATE_PURE is set in the environment, or if the core cannot solve the
problem; then its caller continues in Python. Nothing else knows about the core.
"""

from __future__ import annotations

import ctypes
import functools
import os
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import numpy.typing as npt

from palpate._threads import give_way
from palpate.elastic.pad import Floats
from palpate.inverse.constrained.faces import Face, straight
from palpate.inverse.constrained.factors import Beside, Chain, Dense, Factor, FewReadings, Part
from palpate.inverse.constrained.quadratic import Formed, Quadratic, Unformed
from palpate.inverse.constrained.rows import Rows

__all__ = ["LIBRARIES", "Core", "Limits", "Minimum", "core", "load", "newton"]

Index = npt.NDArray[np.intp]

#: The core for every processor, and that for AVX2 and FMA. (Python takes files with the usual endings for modules.)
LIBRARIES = ("core.compiled", "core_avx2.compiled")
#: The functions of SciPy that the core calls (`Blas` in `core/algebra.h`).
FUNCTIONS = ("dgemv", "dsymv", "dsyrk", "dtrsv", "dtrsm", "dpotrf")
#: Largest number of components.
COMPONENTS = 3


class Core(NamedTuple):
    """The library, and the table of SciPy's functions that it calls."""

    library: Any
    blas: Any


class Minimum(NamedTuple):
    """The best point (component, cell) in scaled variables, its residual, the steps taken, and face and factor there."""

    x: Floats
    residual: float
    steps: int
    face: Face | None
    factor: Factor | None


class Limits(ctypes.Structure):
    """Limits of Newton's method: the constants of `cone`, and `faces.FREE`."""

    _fields_ = (
        *((name, ctypes.c_double) for name in ("tolerance", "smaller", "nearly", "turned", "free")),
        *((name, ctypes.c_ssize_t) for name in ("steps", "patience")),
    )


class _Part(ctypes.Structure):
    _fields_ = (
        *((name, ctypes.c_ssize_t) for name in ("start", "size")),
        ("scale", ctypes.c_double),
        *((name, ctypes.c_void_p) for name in ("first", "at", "entries", "inverse")),
    )


@functools.cache
def load(name: str) -> Core | None:
    """Load one of the `LIBRARIES`; None if it, or a function of SciPy that it needs, is missing."""
    from scipy.linalg import cython_blas, cython_lapack

    p, n, flag = ctypes.c_void_p, ctypes.c_ssize_t, ctypes.c_int
    signatures: dict[str, tuple[Any, ...]] = {  # result, arguments
        "second_library_runs": (flag,),
        "newton_new": (p, p, n, n, flag, flag, p, p, p, p, n, p, n, p, p, p, p),
        "newton_step": (flag, p),
        "newton_best": (n, p, p, p),
        "newton_finish": (flag, p, p),
        "newton_factor": (None, p, p, p, p, p, p, p, p, p, p),
        "newton_free": (None, p),
        "band_solve": (flag, n, p, p, p, p, flag, n, p),
        "row_variances": (flag, n, p, p, p, n, p, n, p, p),
    }
    api = ctypes.pythonapi
    api.PyCapsule_GetName.restype, api.PyCapsule_GetName.argtypes = ctypes.c_char_p, (ctypes.py_object,)
    api.PyCapsule_GetPointer.restype, api.PyCapsule_GetPointer.argtypes = p, (ctypes.py_object, ctypes.c_char_p)
    found = []
    try:
        library = ctypes.CDLL(str(Path(__file__).with_name(name)))
        for function in FUNCTIONS:
            capsule = (cython_lapack if function == "dpotrf" else cython_blas).__pyx_capi__[function]
            signature = api.PyCapsule_GetName(capsule)
            if b"int *" not in signature:  # its integers have another size
                return None
            found.append(api.PyCapsule_GetPointer(capsule, signature))
        for function, (result, *arguments) in signatures.items():
            made = getattr(library, function)
            made.restype, made.argtypes = result, arguments
    except (OSError, AttributeError, KeyError):
        return None
    return Core(library, (p * len(found))(*found))


def core() -> Core | None:
    """The core for this processor, if there is one and PALPATE_PURE is not set."""
    return None if os.environ.get("PALPATE_PURE") else _best()


@functools.cache
def _best() -> Core | None:
    plain = load(LIBRARIES[0])
    return (load(LIBRARIES[1]) or plain) if plain and plain.library.second_library_runs() else plain


def _at(array: Any) -> int | None:
    """Address of a contiguous array."""
    return None if array is None else array.__array_interface__["data"][0]


def newton(
    hessian: Quadratic,
    linear: Floats,
    start: Floats,
    *,
    free: bool,
    coupled: bool,
    limits: Limits,
    keep_face: bool,
) -> Minimum | None:
    """Newton's method of `cone.minimise` in scaled variables, for a cone that is everything (``free``), or couples shear
    to pressure. None also if the method cycles, and if a matrix is not positive definite.
    """
    made, (c, n) = core(), linear.shape
    if made is None or not 0 < c <= COMPONENTS or not n:
        return None
    matrix = columns = row = col = values = rank = None
    if isinstance(hessian, Formed):
        matrix = np.ascontiguousarray(hessian.matrix, dtype=np.float64)
    elif isinstance(hessian, Unformed) and hessian.columns.size:
        penalty = hessian.penalty
        columns, values = np.ascontiguousarray(hessian.columns, dtype=np.float64), np.ascontiguousarray(penalty.values)
        row, col, rank = (np.ascontiguousarray(a, dtype=np.intp) for a in (penalty.row, penalty.col, penalty.rank))
    else:
        return None
    linear, start = np.ascontiguousarray(linear, dtype=np.float64), np.ascontiguousarray(start, dtype=np.float64)
    readings, entries = (0, 0) if columns is None or row is None else (columns.shape[1], len(row))
    library = made.library
    state = library.newton_new(
        made.blas, c, n, free, coupled, ctypes.byref(limits), _at(linear), _at(start), _at(matrix), readings,
        _at(columns), entries, _at(row), _at(col), _at(values), _at(rank),
    )  # fmt: skip
    if not state:
        return None
    try:
        outcome = 0
        while not outcome:
            give_way()
            outcome = library.newton_step(state)
        x, residual, face, factor = np.empty((c, n)), ctypes.c_double(), None, None
        sizes = np.zeros(2 + 4 * c, dtype=np.intp)
        if outcome != 1 or (keep_face and not library.newton_finish(state, _at(sizes))):
            return None
        steps = library.newton_best(state, _at(x), ctypes.byref(residual))
        if keep_face:
            basis, kept = np.empty((n, c, c)) if coupled else straight(n, c), np.empty((c, n))
            take = functools.partial(library.newton_factor, state, _at(basis) if coupled else None, _at(kept))
            factor = _dense(take, sizes, c, n) if readings == 0 else _few(made, take, sizes.tolist(), readings)
            face = Face(basis, kept, coupled)
        return Minimum(x, residual.value, steps, face, factor)
    finally:
        library.newton_free(state)


def _dense(take: Any, sizes: Index, c: int, n: int) -> Dense:
    """Take the factor of a matrix."""
    beside, size = bool(sizes[0]), int(sizes[1])
    lower, shear = np.empty((size, size), order="F"), (c - 1) * n if beside else 0
    first, tied = np.empty((shear, shear), order="F"), np.empty((shear, n), order="F")
    some = np.empty(size, dtype=np.intp)
    take(_at(lower), _at(first), _at(tied), _at(some), None, None, None)
    return Beside(first, tied, some, lower) if beside else Dense(lower)


def _few(made: Core, take: Any, sizes: list[int], readings: int) -> BandedReadings:
    """Take the factor of few readings."""
    (count, directions), each = sizes[:2], [sizes[k : k + 4] for k in range(2, 2 + 4 * sizes[0], 4)]
    lower, b = np.empty((readings, readings), order="F"), np.empty((directions, readings))
    order, scales = np.empty(directions, dtype=np.intp), np.empty(count)
    bands = {k: Banded(made, size, entries) for k, (_, same, size, entries) in enumerate(each) if same == k}
    panels, entries = (ctypes.c_void_p * count)(), (ctypes.c_void_p * count)()
    for k, band in bands.items():
        panels[k], entries[k] = _at(band.panels), _at(band.entries_of)
    take(_at(lower), _at(b), None, _at(order), _at(scales), panels, entries)
    parts = [Part(start, bands[same], scale) for (start, same, *_), scale in zip(each, scales.tolist())]
    return BandedReadings(made, parts, order, [b[p.place].T for p in parts], lower)


class Banded(Chain):
    """A chain in the panels of the core (`core/band.h`): the first column of each panel and the place of its first entry;
    the entries and the inverses of the diagonal.
    """

    def __init__(self, made: Core, size: int, entries: int) -> None:
        self.core, self.size, self.count = made, size, -(-size // 4)
        self.panels = np.empty(2 * self.count + 1, dtype=np.intp)
        self.entries_of = np.empty(entries + 4 * self.count)

    @property
    def arrays(self) -> tuple[int | None, ...]:
        """Addresses of the four arrays."""
        apart = self.count, len(self.entries_of) - 4 * self.count
        return tuple(_at(a) for a, k in zip((self.panels, self.entries_of), apart) for a in (a, a[k:]))

    def forward(self, right: Floats) -> Floats:
        return self._solved(right, back=False)

    def backward(self, right: Floats) -> Floats:
        return self._solved(right, back=True)

    def _solved(self, right: Floats, *, back: bool) -> Floats:
        whole = np.asfortranarray(right, dtype=np.float64)
        if not self.core.library.band_solve(self.size, *self.arrays, back, len(whole), _at(whole)):
            raise MemoryError
        if whole is not right:
            right[...] = whole
        return right


class BandedReadings(FewReadings):
    """`FewReadings` whose chains are `Banded`."""

    def __init__(self, made: Core, parts: list[Part], order: Index, blocks: list[Floats], lower: Floats) -> None:
        super().__init__(parts, order, blocks, lower)
        self.core = made

    def variances(self, rows: Rows) -> Floats:
        rank = np.empty(len(self.order), dtype=np.intp)
        rank[self.order] = np.arange(len(self.order))
        row, col, value = (
            np.ascontiguousarray(rows.row, dtype=np.intp),
            rank[rows.col],
            np.ascontiguousarray(rows.value),
        )
        bands = [p.chain for p in self.parts if isinstance(p.chain, Banded)]
        each = (_Part * len(bands))(*(_Part(p.start, b.size, p.scale, *b.arrays) for p, b in zip(self.parts, bands)))
        out = np.zeros(rows.count)
        done = self.core.library.row_variances(
            len(row), _at(row), _at(col), _at(value), len(bands), each, len(self.lower), _at(self._seen), _at(out)
        )
        if not done:
            raise MemoryError
        return out
