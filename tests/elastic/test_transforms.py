"""Transforms by ducc0 and by SciPy are the same: real transforms that are padded before and cut after, in either precision."""

from __future__ import annotations

import sys
from typing import Any

import numpy as np
import pytest
import scipy.fft

import palpate as pp
from palpate import _transforms
from palpate._arrays import irfftn, rfftn


@pytest.fixture(params=["ducc0", "scipy"])
def library(request: pytest.FixtureRequest, monkeypatch: pytest.MonkeyPatch) -> str:
    if request.param == "scipy":
        monkeypatch.setattr(_transforms, "library", lambda: None)
    else:
        assert _transforms.library() is not None, "the tests install ducc0"
    return str(request.param)


@pytest.mark.usefixtures("library")
@pytest.mark.parametrize("kind", [np.float32, np.float64])
@pytest.mark.parametrize(
    ("lead", "cells", "size"),
    [((), (5, 7), (12, 15)), ((3,), (8, 8), (8, 8)), ((2, 3), (9, 4), (20, 9)), ((1, 1), (1, 1), (3, 4))],
)
def test_padded_and_cut(kind: Any, lead: tuple[int, ...], cells: tuple[int, int], size: tuple[int, int]) -> None:
    x = np.random.default_rng(0).standard_normal((*lead, *cells)).astype(kind)
    before = x.copy()
    waves = rfftn(x, size)
    expected = scipy.fft.rfftn(x.astype(np.float64), s=size, axes=(-2, -1))
    near = 1e-5 if kind is np.float32 else 1e-12
    assert waves.dtype == (np.complex64 if kind is np.float32 else np.complex128)
    np.testing.assert_allclose(waves, expected, atol=near * np.abs(expected).max())
    kept = irfftn(waves, size, [slice(0, cells[0]), slice(1, cells[1])])
    assert kept.dtype == kind
    np.testing.assert_allclose(kept, x[..., 1:], atol=near * np.abs(x).max())
    np.testing.assert_array_equal(waves, rfftn(x, size), "what is not to be used up is kept")
    whole = irfftn(waves, size, overwrite=True)
    assert whole.shape == (*lead, *size)
    np.testing.assert_allclose(whole[..., : cells[0], : cells[1]], x, atol=near * np.abs(x).max())
    np.testing.assert_array_equal(x, before)


@pytest.mark.usefixtures("library")
def test_parts_of_arrays_and_what_cannot_be_written() -> None:
    rng = np.random.default_rng(1)
    x = rng.standard_normal((6, 10, 14))[::2, 1::2, ::-3]
    waves = rfftn(x, (8, 9))
    np.testing.assert_allclose(waves, scipy.fft.rfftn(x, s=(8, 9), axes=(-2, -1)), atol=1e-12)
    waves.setflags(write=False)
    found = irfftn(waves, (8, 9), [slice(0, 5), slice(0, 5)], overwrite=True)
    np.testing.assert_allclose(found, x, atol=1e-12)


@pytest.mark.usefixtures("library")
def test_cut_before() -> None:
    """A size smaller than the array cuts it."""
    x = np.random.default_rng(2).standard_normal((2, 9, 11))
    np.testing.assert_allclose(rfftn(x, (6, 8)), scipy.fft.rfftn(x[:, :6, :8], axes=(1, 2)), atol=1e-12)


@pytest.mark.long
def test_a_frame_is_the_same_with_either(monkeypatch: pytest.MonkeyPatch) -> None:
    pad = pp.HalfSpace(youngs_modulus=2e5, poissons_ratio=0.48)
    array = pp.AreaArray(shape=(24, 24), pitch=1e-3, depth=2e-3, channels=["stress_xz", "stress_yz", "stress_zz"])
    ball = pp.solutions.hertz_point(contact_radius=8e-3, force=5.0).sliding(0.3)
    clean = np.asarray(pp.Skin(pad, array).sense(ball))
    readings = clean + 0.01 * np.abs(clean).max() * np.random.default_rng(3).standard_normal(clean.shape)
    found = []
    for fast in (True, False):
        if not fast:
            monkeypatch.setattr(_transforms, "library", lambda: None)
        found.append(np.asarray(pp.Skin(pad, array).reconstruct(readings).force))
    np.testing.assert_allclose(found[0], found[1], rtol=1e-5)


def test_without_ducc0(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "ducc0", None)
    _transforms.library.cache_clear()
    try:
        assert _transforms.library() is None
    finally:
        monkeypatch.undo()
        _transforms.library.cache_clear()
    assert _transforms.library() is not None
