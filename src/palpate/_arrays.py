"""The only module that deals with array namespaces and Fourier transforms.

Arrays keep the caller's type, dtype and device. Everything that is prepared is computed once in NumPy, in double
precision, and converted with `from_numpy`. NumPy arrays are transformed by scipy.fft or ducc0 (`palpate._transforms`),
which keep float32.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
import numpy.typing as npt

from palpate._transforms import irfft2, rfft2
from palpate.errors import InvalidInput

__all__ = [
    "as_double",
    "as_real",
    "device_of",
    "fftn",
    "from_numpy",
    "irfftn",
    "is_numpy",
    "namespace",
    "rfftn",
    "to_numpy",
]


def namespace(*x: Any) -> Any:
    """Return the array namespace of the arrays ``x`` (for NumPy arrays NumPy in its array-API form)."""
    import array_api_compat

    return array_api_compat.array_namespace(*x)


def device_of(x: Any) -> Any:
    """Return the device of ``x``, in the notation of its namespace."""
    import array_api_compat

    return array_api_compat.device(x)


def is_numpy(x: Any) -> bool:
    """Return whether ``x`` is a NumPy array."""
    return isinstance(x, np.ndarray)


def as_real(x: Any, what: str) -> Any:
    """Return ``x`` as a floating-point array of its own type, in this machine's byte order: float32 and float64 are
    kept, integers become float64. Masked entries become NaN. Anything whose meaning the conversion could change raises
    an error.
    """
    if isinstance(x, list | tuple):
        x = _from_sequence(x, what)
    elif isinstance(x, int | float | np.generic):
        x = np.asarray(x)
    _refuse_foreign(x, what)
    if isinstance(x, np.ndarray):
        return _real_numpy(x, what)
    try:
        xp = namespace(x)
    except TypeError as error:
        raise InvalidInput(
            f"{what} must be an array (NumPy, PyTorch or any array-API kind); got {type(x).__name__}."
        ) from error
    if xp.isdtype(x.dtype, "real floating"):
        if x.dtype in (xp.float32, xp.float64):
            return x
        return xp.astype(x, xp.float32)
    if xp.isdtype(x.dtype, "integral"):
        return xp.astype(x, xp.float64)
    raise InvalidInput(f"{what} must be real numbers; got dtype {x.dtype}.")


def _from_sequence(x: Sequence[Any], what: str) -> npt.NDArray[Any]:
    """Convert a nested list of numbers, or a list of arrays of the same shape."""
    labelled = next((type(v).__name__ for v in x if hasattr(v, "dims")), None)
    if labelled is not None:
        raise InvalidInput(
            f"{what} came as a list of labelled arrays ({labelled}), whose labels a list would drop: join them first, "
            'xarray.concat(list, dim="time").'
        )
    for v in x:
        if hasattr(v, "dtype"):
            _refuse_foreign(v, what)
    try:
        if _any_masked(x):
            found: npt.NDArray[Any] = _masked(x)
            return found
        found = np.asarray([to_numpy(v) if hasattr(v, "detach") else v for v in x])
    except (TypeError, ValueError) as error:
        raise InvalidInput(f"{what} must be numbers in a rectangular array; got {type(x).__name__}.") from error
    if found.dtype == object:  # None among numbers is a missing value; any other object is an error
        try:
            found = np.asarray(x, dtype=np.float64)
        except (TypeError, ValueError) as error:
            raise InvalidInput(f"{what} must be numbers in a rectangular array; got {type(x).__name__}.") from error
    return found


def _any_masked(x: Any) -> bool:
    """Return whether a nested list contains a masked array or `numpy.ma.masked`, at any depth."""
    return any(isinstance(v, np.ma.MaskedArray) or (isinstance(v, list | tuple) and _any_masked(v)) for v in x)


def _masked(x: Any) -> Any:
    """Convert a nested list to a masked array."""
    return np.ma.stack([_masked(v) for v in x]) if isinstance(x, list | tuple) else np.ma.asarray(to_numpy(x))


def as_double(x: Any) -> npt.NDArray[np.float64]:
    """Return a copy of numbers in double precision; masked entries, also in lists, become NaN. Raise `ValueError` or
    `TypeError` for anything else.
    """
    if isinstance(x, list | tuple) and _any_masked(x):
        x = _masked(x)
    found = np.array(x, dtype=np.float64)
    if isinstance(x, np.ma.MaskedArray):
        found[np.ma.getmaskarray(x)] = np.nan
    return found


def _refuse_foreign(x: Any, what: str) -> None:
    """Raise an error for arrays whose unit, labels or laziness the conversion would lose."""
    kind = f"{type(x).__module__.split('.')[0]}.{type(x).__name__}"
    if hasattr(x, "magnitude") and hasattr(x, "units"):  # pint
        raise InvalidInput(f"{what} carry a unit as {kind}: pass their SI magnitude, e.g. x.to('Pa').magnitude.")
    if hasattr(x, "unit") and hasattr(x, "to_value"):  # astropy
        raise InvalidInput(f"{what} carry a unit as {kind}: pass their SI values, e.g. x.to_value('Pa').")
    if hasattr(x, "iloc") or hasattr(x, "collect_schema"):  # pandas, polars
        raise InvalidInput(f"{what} came as a table ({kind}): pass x.to_numpy(), reshaped to the expected shape.")
    if hasattr(
        x, "data_vars"
    ):  # check this before laziness: such an object can also be computed, but that would not help
        names = ", ".join(map(str, x.data_vars))
        raise InvalidInput(f"{what} came as an xarray.Dataset: pass one of its variables ({names}).")
    if hasattr(x, "dask") or (hasattr(x, "compute") and hasattr(x, "chunks")):
        raise InvalidInput(f"{what} came as a lazy array ({kind}): pass x.compute().")


def _real_numpy(x: npt.NDArray[Any], what: str) -> npt.NDArray[Any]:
    masked = x if isinstance(x, np.ma.MaskedArray) else None
    x = np.asarray(x)
    kind = x.dtype.kind
    if kind in "iu":
        x = x.astype(np.float64)
    elif kind != "f":
        remedy = {
            "b": "True and False are no numbers",
            "c": "take x.real if the imaginary part is nothing but rounding",
            "O": "take x.astype(float) if its entries are numbers",
            "V": "take one field, x['name']",
            "U": "take x.astype(float) if the text contains numbers",
            "S": "take x.astype(float) if the text contains numbers",
        }.get(kind, "pass numbers in SI units")
        raise InvalidInput(f"{what} must be real numbers; got dtype {x.dtype}: {remedy}.")
    elif x.dtype.itemsize not in (4, 8):  # half and extended precision
        x = x.astype(np.float32 if x.dtype.itemsize < 4 else np.float64)
    elif not x.dtype.isnative:
        x = x.astype(x.dtype.newbyteorder("="))
    if masked is not None and np.ma.is_masked(masked):
        x = np.where(np.ma.getmaskarray(masked), np.asarray(np.nan, dtype=x.dtype), x)
    return x


def to_numpy(x: Any) -> npt.NDArray[Any]:
    """Return ``x`` as a NumPy array in this machine's main memory."""
    if isinstance(x, np.ndarray):
        return x
    if hasattr(x, "detach"):
        return np.asarray(x.detach().cpu().numpy())
    if hasattr(x, "get"):  # CuPy
        return np.asarray(x.get())
    return np.asarray(x)


def from_numpy(a: npt.NDArray[Any], like: Any) -> Any:
    """Return ``a`` as an array with the type, precision and device of ``like`` (complex stays complex)."""
    import array_api_compat

    xp = namespace(like)
    single = like.dtype == xp.float32
    if np.iscomplexobj(a):
        dtype = xp.complex64 if single else xp.complex128
        a = np.asarray(a, dtype=np.complex64 if single else np.complex128)
    elif a.dtype == np.bool_:
        dtype = xp.bool
    else:
        dtype = xp.float32 if single else xp.float64
        a = np.asarray(a, dtype=np.float32 if single else np.float64)
    if is_numpy(like):
        return a
    if not a.flags.writeable or any(s < 0 for s in a.strides):
        a = a.copy()
    return xp.asarray(a, dtype=dtype, device=array_api_compat.device(like))


def rfftn(x: Any, shape: Sequence[int]) -> Any:
    """Real FFT over the last ``len(shape)`` axes, zero-padded to ``shape``. Rows of zeros are not transformed."""
    axes = tuple(range(-len(shape), 0))
    if is_numpy(x):
        if len(shape) == 2:
            return rfft2(x, shape)
        import scipy.fft

        return scipy.fft.rfftn(x, s=tuple(shape), axes=axes)
    return namespace(x).fft.rfftn(x, s=tuple(shape), axes=axes)


def irfftn(x: Any, shape: Sequence[int], keep: Sequence[slice] | None = None, *, overwrite: bool = False) -> Any:
    """Return the inverse of `rfftn`. ``keep`` selects a part of the result by one slice for each axis; with
    ``overwrite``, ``x`` may be destroyed.
    """
    axes = tuple(range(-len(shape), 0))
    if is_numpy(x) and len(shape) == 2:
        return irfft2(x, shape, keep, overwrite=overwrite)
    if is_numpy(x):
        import scipy.fft

        full = scipy.fft.irfftn(x, s=tuple(shape), axes=axes)
    else:
        full = namespace(x).fft.irfftn(x, s=tuple(shape), axes=axes)
    return full if keep is None else full[(..., *keep)]


def fftn(x: npt.NDArray[Any], axes: int) -> npt.NDArray[np.complex128]:
    """Return the complex FFT of a NumPy array over its last ``axes`` axes."""
    import scipy.fft

    return np.asarray(scipy.fft.fftn(x, axes=tuple(range(-axes, 0))))
