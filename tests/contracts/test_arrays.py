"""The same numbers whatever the array kind, with dtype and device kept."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

import palpate as pp
from long_runs import long_runs
from palpate import solutions
from palpate._arrays import as_double, as_real, to_numpy

PAD = pp.HalfSpace(youngs_modulus=1e5, poissons_ratio=0.45)
NAMES = ["stress_xz", "stress_yz", "stress_zz"]
SKINS = {
    "line": pp.Skin(
        PAD, pp.LineArray(count=30, pitch=1e-3, depth=2e-3, channels=["stress_xz", "stress_zz"], noise=10.0)
    ),
    "area": pp.Skin(PAD, pp.AreaArray(shape=(8, 9), pitch=1e-3, depth=2e-3, channels=NAMES, noise=300.0)),
    "fine": pp.Skin(PAD, pp.AreaArray(shape=(5, 6), pitch=3e-3, depth=1.5e-3, channels=NAMES, noise=300.0)),
    "masked": pp.Skin(
        PAD, pp.AreaArray(shape=(6, 6), pitch=1e-3, depth=2e-3, channels=NAMES, noise=300.0, mask=np.eye(6) < 0.5)
    ),
    "periodic": pp.Skin(
        PAD, pp.AreaArray(shape=(8, 9), pitch=1e-3, depth=2e-3, channels=NAMES, noise=300.0), boundary="periodic"
    ),
    "scattered": pp.Skin(
        PAD,
        pp.ScatteredArray(
            positions=np.random.default_rng(1).uniform(-4e-3, 4e-3, (40, 2)), depth=1e-3, channels=NAMES, noise=1000.0
        ),
    ),
}


def namespaces() -> list[Any]:
    found = []
    try:
        import array_api_strict

        found.append(pytest.param(array_api_strict, id="array-api-strict"))
    except ImportError:
        found.append(
            pytest.param(
                None, id="array-api-strict", marks=pytest.mark.skip(reason="array-api-strict is not installed")
            )
        )
    try:
        import torch

        found.append(pytest.param(torch, id="torch"))
    except ImportError:
        found.append(
            pytest.param(None, id="torch", marks=pytest.mark.skip(reason="PyTorch (optional) is not installed"))
        )
    return found


def contact(skin: pp.Skin) -> Any:
    if skin.surface.dimensions == 1:
        return solutions.hertz_line(half_width=5e-3, force=50.0).sliding(0.3)
    return solutions.hertz_point(contact_radius=3e-3, force=0.3).sliding(0.3, direction=1.0)


@pytest.mark.parametrize("dtype", ["float64", "float32"])
@pytest.mark.parametrize("name", list(SKINS))
@pytest.mark.parametrize("xp", namespaces())
def test_array_kinds(xp: Any, name: str, dtype: str) -> None:
    skin = SKINS[name]
    truth = np.asarray(skin.sample(contact(skin)))
    traction = xp.asarray(truth.tolist(), dtype=getattr(xp, dtype))
    readings = skin.sense(traction)
    assert type(readings) is type(traction)
    assert readings.dtype == getattr(xp, dtype)
    tolerance = 1e-10 if dtype == "float64" else 2e-4
    expected = skin.sense(truth)
    size = np.nanmax(np.abs(expected))
    np.testing.assert_allclose(to_numpy(readings), expected, atol=tolerance * size)

    noisy = np.nan_to_num(expected) + 0.01 * size * np.random.default_rng(0).standard_normal((2, *expected.shape))
    methods = ["tikhonov", "hilgers"] + (["linear", "dft"] if name in ("line", "area") else [])
    for method in methods:
        reference = skin.reconstruct(noisy, method=method)  # type: ignore[arg-type]
        touch = skin.reconstruct(xp.asarray(noisy.tolist(), dtype=getattr(xp, dtype)), method=method)  # type: ignore[arg-type]
        assert type(touch.values) is type(traction)
        assert touch.values.dtype == getattr(xp, dtype)
        largest = np.abs(reference.values).max()
        loose = tolerance if method in ("tikhonov", "hilgers") else 50 * tolerance
        np.testing.assert_allclose(to_numpy(touch.values), reference.values, atol=20 * loose * largest)
        for number in (
            touch.force,
            touch.moment,
            touch.peak_pressure,
            touch.contact_area(),
            touch.center_of_pressure,
            touch.slip_margin(0.6),
        ):
            assert number.dtype == getattr(xp, dtype)
        close = 1e-9 if dtype == "float64" else 1e-3 if loose == tolerance else 0.1
        np.testing.assert_allclose(to_numpy(touch.force), reference.force, atol=close * np.abs(reference.force).max())
        assert touch.traction.dtype == np.dtype(dtype)


@pytest.mark.parametrize("name", [n for n in SKINS if n != "area"] + long_runs("area"))
def test_single_precision_stays_single_in_numpy(name: str) -> None:
    skin = SKINS[name]
    readings = np.nan_to_num(skin.sense(skin.sample(contact(skin)).astype(np.float32)))
    assert readings.dtype == np.float32
    assert skin.reconstruct(readings).values.dtype == np.float32


def test_read_only_lists_and_integers() -> None:
    skin = SKINS["area"]
    readings = np.nan_to_num(skin.sense(contact(skin)))
    readings.setflags(write=False)
    expected = skin.reconstruct(readings).values
    np.testing.assert_array_equal(skin.reconstruct(readings.tolist()).values, expected)
    assert skin.reconstruct(np.zeros((3, 8, 9), dtype=np.int16)).values.dtype == np.float64


MASKED = np.ma.array([[1.0, 2.0], [3.0, 4.0]], mask=[[False, True], [False, False]])
GAPS = np.array([[1.0, np.nan], [3.0, 4.0]])


@pytest.mark.parametrize(
    ("given", "expected"),
    [
        ([MASKED, MASKED], [GAPS, GAPS]),
        ([[MASKED, MASKED]], [[GAPS, GAPS]]),
        (([[MASKED], [MASKED]],), [[[GAPS], [GAPS]]]),
        ([[MASKED, np.ones((2, 2))]], [[GAPS, np.ones((2, 2))]]),
        ([1.0, np.ma.masked, 3.0], [1.0, np.nan, 3.0]),
        ([[1, 2], [np.ma.masked, 4]], [[1.0, 2.0], [np.nan, 4.0]]),
    ],
    ids=["list", "nested", "deeper", "beside plain", "constant", "constant within"],
)
def test_masks_survive_lists_at_any_depth(given: Any, expected: Any) -> None:
    np.testing.assert_array_equal(as_real(given, "readings"), expected)
    np.testing.assert_array_equal(as_double(given), expected)


def test_masks_of_recordings_fields_and_depth_maps_are_gaps() -> None:
    """Numbers behind a mask are never taken: a gap where gaps may be, a refusal where they may not."""
    import palpate as pp
    from palpate.camera import DepthMap
    from palpate.microscopy import Field
    from palpate.sensing.zero import zero_of

    frames = pp.Recording(readings=[[MASKED], [MASKED]], channels=["stress_zz"])
    np.testing.assert_array_equal(frames.readings, [[GAPS], [GAPS]])
    u = np.ma.array(np.full((2, 6, 6), 1e-7), mask=np.zeros((2, 6, 6), dtype=bool))
    u[0, 2, 3] = np.ma.masked
    assert np.isnan(Field(displacement=u, start=(0.0, 0.0), step=8.0, pixel=1e-7).displacement[:, 2, 3]).all()
    places = np.stack(np.meshgrid([0.0, 1.0, 2.0], [0.0, 1.0, 2.0]), axis=-1).reshape(-1, 2)
    depth = np.ma.array(np.ones((1, 9)), mask=np.arange(9)[None] == 4)
    assert np.isnan(DepthMap(positions=places, depth=depth, std=1e-6).of(0)).tolist() == (np.arange(9) == 4).tolist()
    np.testing.assert_array_equal(zero_of(np.ma.stack([MASKED[None], MASKED[None]])), GAPS[None])
    hidden = np.ma.array(places, mask=np.arange(18).reshape(9, 2) == 5)
    with pytest.raises(pp.InvalidInput, match="not finite"):
        pp.ScatteredArray(positions=hidden, depth=0.0, channels=["displacement_x"])
    with pytest.raises(pp.InvalidInput, match="finite seconds"):
        pp.Recording(
            readings=np.ones((2, 1, 3)), channels=["stress_zz"], time=np.ma.array([0.0, 1.0], mask=[False, True])
        )
