"""The only door to array namespaces and Fourier transforms.

Arrays go through in the caller's kind, dtype and device. Everything that is prepared is made once in NumPy, in double
precision, and handed over with `from_numpy`. NumPy arrays are transformed by scipy.fft, which keeps float32.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
import numpy.typing as npt

from palpate.errors import InvalidInput

__all__ = ["as_real", "device_of", "fftn", "from_numpy", "irfftn", "is_numpy", "namespace", "rfftn", "to_numpy"]


def namespace(x: Any) -> Any:
    """The array namespace of ``x`` (NumPy for NumPy arrays, in its array-API form)."""
    import array_api_compat

    return array_api_compat.array_namespace(x)


def device_of(x: Any) -> Any:
    """The device of ``x``, as its namespace names it."""
    import array_api_compat

    return array_api_compat.device(x)


def is_numpy(x: Any) -> bool:
    """Whether ``x`` is a NumPy array."""
    return isinstance(x, np.ndarray)


def as_real(x: Any, what: str) -> Any:
    """``x`` as a floating array of its own kind: float32 and float64 are kept, integers become float64."""
    if isinstance(x, list | tuple | int | float) or np.isscalar(x):
        try:
            x = np.asarray(x, dtype=np.float64)
        except (TypeError, ValueError) as error:
            raise InvalidInput(f"{what} must be numbers in a rectangular array; got {type(x).__name__}.") from error
    if hasattr(x, "values") and hasattr(x, "dims"):  # xarray
        x = np.asarray(x.values)
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


def to_numpy(x: Any) -> npt.NDArray[Any]:
    """``x`` as a NumPy array on this machine's memory."""
    if isinstance(x, np.ndarray):
        return x
    if hasattr(x, "detach"):
        return np.asarray(x.detach().cpu().numpy())
    if hasattr(x, "get"):  # CuPy
        return np.asarray(x.get())
    return np.asarray(x)


def from_numpy(a: npt.NDArray[Any], like: Any) -> Any:
    """``a`` as an array of the kind, precision and device of ``like`` (complex stays complex)."""
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
    """Real FFT over the last ``len(shape)`` axes, zero-padded to ``shape``."""
    axes = tuple(range(-len(shape), 0))
    if is_numpy(x):
        import scipy.fft

        return scipy.fft.rfftn(x, s=tuple(shape), axes=axes)
    return namespace(x).fft.rfftn(x, s=tuple(shape), axes=axes)


def irfftn(x: Any, shape: Sequence[int]) -> Any:
    """Inverse of `rfftn`."""
    axes = tuple(range(-len(shape), 0))
    if is_numpy(x):
        import scipy.fft

        return scipy.fft.irfftn(x, s=tuple(shape), axes=axes)
    return namespace(x).fft.irfftn(x, s=tuple(shape), axes=axes)


def fftn(x: npt.NDArray[Any], axes: int) -> npt.NDArray[np.complex128]:
    """Complex FFT of a NumPy array over its last ``axes`` axes."""
    import scipy.fft

    return np.asarray(scipy.fft.fftn(x, axes=tuple(range(-axes, 0))))
