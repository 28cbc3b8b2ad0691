"""Swapped taxels and taxels of turned sign are named, and nothing is said of a sound array. Readings are closed forms of a half-space."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

import palpate as pp
from calibrate_scenes import PAD, bench, taxels
from palpate.calibrate import calibrate
from palpate.calibrate.labels import Labelled
from palpate.calibrate.wiring import ranks, wrong_wiring

PUBLISHED = Path(__file__).parents[3] / "shared" / "data" / "tactileforce"
SKIN = pp.Skin(PAD, taxels())
FEW = pp.Skin(PAD, pp.AreaArray(shape=(2, 2), pitch=8e-3, depth=3e-3, channels=["stress_zz"]))


def labelled(readings: np.ndarray, force: np.ndarray) -> Labelled:
    flat, run = readings.reshape(len(force), -1), np.zeros(len(force), dtype=np.int64)
    return Labelled(flat, readings, {"fz": force}, 0.0 * force, None, run, np.arange(len(force)), readings[:0])


def said(readings: np.ndarray, force: np.ndarray, skin: pp.Skin = SKIN) -> list[str]:
    return wrong_wiring(skin, labelled(readings, force))


@pytest.mark.parametrize("seed", range(2000, 2006))
def test_swapped_and_turned_taxels_are_named(seed: int) -> None:
    readings, force, _ = bench(40, seed)
    assert said(readings, force) == []
    swapped = readings.copy()
    swapped[:, 0, [1, 2], [1, 2]] = swapped[:, 0, [2, 1], [2, 1]]
    (words,) = said(swapped, force)
    assert words.startswith("stress_zz of taxel 5 and stress_zz of taxel 10 look swapped")
    turned = readings.copy()
    turned[:, 0, 2, 3] *= -1.0
    (words,) = said(turned, force)
    assert words.startswith("stress_zz of taxel 11: the sign looks opposite")


def test_few_taxels_have_signs_but_no_neighbours() -> None:
    readings, force, _ = bench(40, 2000, noise=1e-4)
    corners = readings[:, :, ::3, ::3]
    assert said(corners, force, FEW) == []
    turned = corners.copy()
    turned[:, 0, 1, 0] *= -1.0
    (words,) = said(turned, force, FEW)
    assert words.startswith("stress_zz of taxel 2: ")
    assert said(corners[..., ::-1], force, FEW) == []  # two pairs swapped: four taxels do not show it


def test_masked_taxels_keep_their_numbers() -> None:
    valid = np.ones((4, 4), dtype=bool)
    valid[0, 1] = False
    skin = pp.Skin(PAD, pp.AreaArray(shape=(4, 4), pitch=4e-3, depth=3e-3, channels=["stress_zz"], mask=valid))
    readings, force, _ = bench(40, 2001)
    readings[:, 0, 2, 3] *= -1.0
    flat = readings.reshape(40, -1)[:, valid.ravel()]
    data = labelled(flat, force)
    assert wrong_wiring(skin, data)[0].startswith("stress_zz of taxel 11: ")


def test_presses_without_any_reading_or_too_few_say_nothing() -> None:
    readings, force, _ = bench(14, 2002)
    readings[:, 0, [1, 2], [1, 2]] = readings[:, 0, [2, 1], [2, 1]]
    assert said(readings, force) == []
    assert said(np.zeros((40, 1, 4, 4)), np.ones(40)) == []


def test_ranks_are_those_of_spearman() -> None:
    from scipy.stats import spearmanr

    rng = np.random.default_rng(0)
    a, b = (m + m.T for m in rng.normal(size=(2, 6, 6)))
    upper = np.triu_indices(6, 1)
    assert float((ranks(a) * ranks(b)).sum()) == pytest.approx(spearmanr(a[upper], b[upper]).statistic)


@pytest.mark.skipif(not PUBLISHED.is_dir(), reason="no published data in ../shared/data/tactileforce")
@pytest.mark.parametrize("stream", range(3))
def test_published_barometers(stream: int) -> None:
    """Four taxels under a soft cap, with a force sensor (vistormu/tactileforce): sound as published, and with one sign turned."""
    table = np.loadtxt(PUBLISHED / f"stream-{stream}.csv", delimiter=",", skiprows=1)
    table -= table[:30].mean(axis=0)
    readings, force = table[::10, [1, 4, 2, 3]].reshape(-1, 1, 2, 2), table[::10, 0]
    assert said(readings, force, FEW) == []
    for taxel in range(4):
        turned = readings.copy()
        turned.reshape(-1, 4)[:, taxel] *= -1.0
        (words,) = said(turned, force, FEW)
        assert words.startswith(f"stress_zz of taxel {taxel}: ")


@pytest.mark.long
def test_a_calibration_reports_them() -> None:
    readings, force, _ = bench(40, 2003)
    readings[:, 0, [1, 2], [1, 2]] = readings[:, 0, [2, 1], [2, 1]]
    found = calibrate(SKIN, readings, reference=force)
    assert any("taxel 5 and stress_zz of taxel 10 look swapped" in s for s in found.said)
