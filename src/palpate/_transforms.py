"""Two-dimensional real transforms of NumPy arrays with zero padding before and cropping after: padded rows and cropped parts cost nothing. They use ducc0 if it is installed (the extra "fast"; GPL-2.0-or-later, which is why it is not required), which takes 0.7 of the time in single precision and half in
double (docs/_generated/transforms.md), and by `scipy.fft` elsewhere. Both are the same to rounding.
"""

from __future__ import annotations

from collections.abc import Sequence
from functools import lru_cache
from types import ModuleType
from typing import Any

import numpy as np

__all__ = ["irfft2", "library", "rfft2"]


@lru_cache(maxsize=1)
def library() -> ModuleType | None:
    """Return ducc0's module of transforms, if installed."""
    try:
        from ducc0 import fft
    except ImportError:
        return None
    return fft


def rfft2(x: Any, shape: Sequence[int]) -> Any:
    """Real FFT over the last two axes, zero-padded to ``shape``."""
    fast = library()
    # scipy handles cropped arrays and those that are not float
    if fast is None or any(n > s for n, s in zip(x.shape[-2:], shape)) or x.dtype.char not in "fd":
        import scipy.fft

        rows = scipy.fft.rfft(x, n=shape[1], axis=-1)
        return scipy.fft.fft(rows, n=shape[0], axis=-2, overwrite_x=True)
    last = x.ndim - 1
    if x.shape[-1] < shape[1]:
        wide = np.zeros((*x.shape[:-1], shape[1]), dtype=x.dtype)
        wide[..., : x.shape[-1]] = x
        x = wide
    complex_type = np.complex64 if x.dtype == np.float32 else np.complex128
    out = np.zeros((*x.shape[:-2], shape[0], shape[1] // 2 + 1), dtype=complex_type)
    fast.r2c(x, axes=(last,), out=out[..., : x.shape[-2], :])
    return fast.c2c(out, axes=(last - 1,), out=out)


def irfft2(x: Any, shape: Sequence[int], keep: Sequence[slice] | None, *, overwrite: bool) -> Any:
    """Return the inverse of `rfft2`. ``keep`` selects a part of the result; with ``overwrite``, ``x`` may be destroyed."""
    fast = library()
    kept = (slice(None), slice(None)) if keep is None else tuple(keep)
    if fast is None or x.dtype.char not in "FD" or x.shape[-2:] != (shape[0], shape[1] // 2 + 1):
        import scipy.fft

        rows = scipy.fft.ifft(x, axis=-2, overwrite_x=overwrite and x.flags.writeable)
        return scipy.fft.irfft(rows[..., kept[0], :], n=shape[1], axis=-1)[..., kept[1]]
    last = x.ndim - 1
    out = x if overwrite and x.flags.writeable else None
    rows = fast.c2c(x, axes=(last - 1,), forward=False, inorm=2, out=out)
    return fast.c2r(rows[..., kept[0], :], axes=(last,), lastsize=shape[1], inorm=2, forward=False)[..., kept[1]]
