"""The zero and the noise from frames at rest: masked taxels, labels, and readings of several planes."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import palpate as pp
from palpate import solutions
from palpate.archives import reconstruct_recording
from palpate.recordings import Recording, open_recording, write_recording

PAD = pp.HalfSpace(youngs_modulus=1e5, poissons_ratio=0.5)
LINE = pp.LineArray(count=15, pitch=1e-3, depth=1e-3, channels=["stress_xz", "stress_zz"])
STRIP = solutions.hertz_line(half_width=2e-3, force=5.0).sliding(0.3)
DEAD = 4


@pytest.fixture(scope="module")
def skin() -> pp.Skin:
    return pp.Skin(PAD, LINE)


@pytest.fixture(scope="module")
def stated(skin: pp.Skin) -> pp.Skin:
    return pp.Skin(PAD, replace(LINE, noise=5.0), surface=skin.surface)


def masked() -> pp.Skin:
    return pp.Skin(PAD, replace(LINE, mask=np.arange(15) != DEAD))


def rest_with_dead_taxel(count: int = 20) -> np.ndarray:
    rng = np.random.default_rng(0)
    frames = 500.0 + 10.0 * rng.standard_normal((count, 2, 15))
    frames[:, :, DEAD] = 1e5 * rng.standard_normal((count, 2))
    return frames


def test_numbers_of_a_masked_taxel_do_not_enter_the_noise() -> None:
    frames = rest_with_dead_taxel()
    before = frames.copy()
    np.testing.assert_allclose(masked().at_rest(frames).planes[0].noise, [10.0, 10.0], rtol=0.2)
    np.testing.assert_array_equal(frames, before)


def test_a_touch_at_rest_is_found_beside_a_masked_taxel() -> None:
    frames = rest_with_dead_taxel()
    frames[5, 1, :4] += 2000.0
    zero = masked().at_rest(frames)._problem.zero[0]
    np.testing.assert_allclose(zero[1, :4], 500.0, atol=10.0)


@pytest.mark.long
def test_numbers_of_a_masked_taxel_do_not_enter_the_baseline(skin: pp.Skin, tmp_path: Path) -> None:
    frames = rest_with_dead_taxel(22)
    frames[20:] += np.nan_to_num(np.asarray(skin.sense(STRIP)))
    write_recording(Recording(readings=frames, channels=LINE.channels, time=np.arange(22) / 100.0), tmp_path / "r.npz")
    with open_recording(tmp_path / "r.npz") as source:
        done = reconstruct_recording(masked(), source, tmp_path / "t.nc", baseline=20, frame=21, workers=1)
    assert done.touch is not None
    assert done.touch.noise_std is not None
    assert (done.touch.noise_std < 20.0).all()


def test_masked_skins_keep_the_components_of_the_whole_skin(monkeypatch: pytest.MonkeyPatch) -> None:
    """At rest, with a stated noise and without creep."""
    import palpate._skin_properties as properties

    seen: list[int] = []
    real = properties.observable_components

    def count_taxels(pad: Any, planes: Any) -> Any:
        seen.append(int(planes[0].valid.sum()))
        return real(pad, planes)

    monkeypatch.setattr(properties, "observable_components", count_taxels)
    gel = pp.Viscoelastic(PAD, prony=[(0.3, 1.0)])
    skin = pp.Skin(gel, LINE).masked(np.arange(15) != DEAD)
    for derived in (skin.at_rest(np.zeros((1, 2, 15))), skin._noisy(2.0), skin.without_creep()):
        _ = derived.components
    assert seen == [15, 15, 15]


def labelled(values: np.ndarray, channels: list[str], **attrs: str) -> Any:
    xarray = pytest.importorskip("xarray")
    return xarray.DataArray(values, dims=("channel", "x"), coords={"channel": channels}, attrs=attrs)


def test_the_labels_of_a_zero_are_read(stated: pp.Skin) -> None:
    names = list(LINE.channels)
    zero = np.stack([np.full(15, 300.0), np.full(15, -1000.0)])
    for given in (
        labelled(zero[::-1], names[::-1]),
        labelled(zero / 1e3, names, units="kPa"),
        labelled(zero, names).transpose("x", "channel"),
    ):
        np.testing.assert_allclose(stated.at_rest(given)._problem.zero[0], zero)


def test_labelled_readings_take_a_zero(stated: pp.Skin) -> None:
    readings = np.asarray(stated.sense(STRIP))
    zero = np.stack([np.full(15, 300.0), np.full(15, -1000.0)])
    frames = labelled(readings + zero, list(LINE.channels)).isel(channel=[1, 0]).expand_dims(time=[3.5])
    touch = stated.reconstruct(frames, zero=zero, method="tikhonov")
    plain = stated.reconstruct(readings[None], zero=0.0 * zero, method="tikhonov")
    np.testing.assert_allclose(touch.force, plain.force, rtol=1e-9)
    np.testing.assert_allclose(touch.time, [3.5])


def test_masks_of_a_list_of_frames_outlast_the_zero(stated: pp.Skin) -> None:
    readings = np.asarray(stated.sense(STRIP))
    mask = np.zeros(readings.shape, dtype=bool)
    mask[:, DEAD] = True
    frames = [np.ma.array(readings, mask=mask)] * 2
    with pytest.raises(pp.InvalidInput, match="at 1 of 15 taxels"):
        stated.reconstruct(frames, zero=np.zeros((2, 15)))


def test_planes_as_nested_lists_take_a_zero() -> None:
    planes = [pp.LineArray(count=15, pitch=1e-3, depth=d, channels=["stress_zz"], noise=5.0) for d in (1e-3, 2e-3)]
    two = pp.Skin(PAD, planes)
    readings = np.asarray(two.sense(STRIP)) + 200.0
    zero = np.full((2, 15), 200.0)
    nested = [readings[:1].tolist(), readings[1:].tolist()]
    touch = two.reconstruct(nested, zero=zero, method="tikhonov")
    np.testing.assert_allclose(touch.force, two.reconstruct(readings, zero=zero, method="tikhonov").force)
