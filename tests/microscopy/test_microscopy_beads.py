"""Pictures of beads become displacements whose standard deviations are true; what is no pair is refused."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest
import scipy.ndimage

from palpate.errors import InvalidInput
from palpate.microscopy import Field, bead_displacements, is_field, read_field, read_pair, read_picture

N, SHIFT = 224, np.array([3.3, -1.7])


def moved(x: Any, y: Any, size: float = 1.5) -> np.ndarray:
    """A pull inwards on both sides [px]."""
    out = np.zeros((2, *np.shape(x)))
    for side in (-1, 1):
        out[0] -= side * size * np.exp(-((x - N / 2 - side * N / 5) ** 2 + (y - 0.45 * N) ** 2) / (2 * 25.0**2))
    return out


def beads(
    rng: np.random.Generator, places: np.ndarray, light: np.ndarray, noise: float = 40.0, width: float = 1.2
) -> np.ndarray:
    y, x = np.mgrid[-6:7, -6:7]
    image = np.zeros((N + 40, N + 40))
    for (px, py), a in zip(places + 20, light):
        c, r = round(px), round(py)
        if 6 <= r < N + 34 and 6 <= c < N + 34:
            image[r - 6 : r + 7, c - 6 : c + 7] += a * np.exp(-((x + c - px) ** 2 + (y + r - py) ** 2) / (2 * width**2))
    return np.clip(200 + 1500 * image[20:-20, 20:-20] + rng.normal(0, noise, (N, N)), 0, 65535).astype(np.uint16)


@pytest.fixture(scope="module")
def pair() -> tuple[np.ndarray, np.ndarray]:
    rng = np.random.default_rng(3)
    places = rng.uniform(-15, N + 15, (1500, 2))
    light = rng.uniform(0.3, 1.0, 1500)
    after = places + moved(*places.T).T + SHIFT
    return beads(rng, places, light), beads(rng, after, light)


def test_means_over_windows_are_within_their_errors_as_often_as_they_say(pair: tuple[np.ndarray, np.ndarray]) -> None:
    field = bead_displacements(*pair, pixel=0.1e-6, drift=False)
    assert field.aperture == pytest.approx(32 * 0.1e-6)
    error, std = errors(field)
    assert np.sqrt(np.mean(error**2)) < 0.05
    assert 0.005 < np.median(std) < 0.04
    assert 0.88 < np.mean(np.abs(error) < 1.96 * std) <= 1.0


def errors(field: Field) -> tuple[np.ndarray, np.ndarray]:
    """Of each vector that is there, in pixels, and its standard deviation."""
    every = np.meshgrid(np.arange(N), np.arange(N))
    means = np.stack([scipy.ndimage.uniform_filter(c, 32, mode="nearest") for c in moved(*every)])[
        :, 16:-15:16, 16:-15:16
    ]
    assert field.std is not None
    there = np.isfinite(field.std)
    return (field.displacement / field.pixel - means - SHIFT[:, None, None])[there], (field.std / field.pixel)[there]


def test_where_beads_are_missing_there_is_no_vector(pair: tuple[np.ndarray, np.ndarray]) -> None:
    covered = pair[1].copy()
    covered[80:150] = 240  # a fold, a bubble, a shadow
    field = bead_displacements(pair[0], covered, pixel=0.1e-6, drift=False)
    assert any("left out" in n for n in field.notes)
    assert (~field.valid[4:8]).mean() > 0.6
    error, std = errors(field)
    assert np.mean(np.abs(error) < 1.96 * std) > 0.85
    assert np.abs(error).max() < 1.0


def test_errors_hold_in_much_noise_and_other_light(pair: tuple[np.ndarray, np.ndarray]) -> None:
    rng = np.random.default_rng(4)
    noisy = [np.clip(p + rng.normal(0, 450, p.shape), 0, 65535).astype(np.uint16) for p in pair]
    error, std = errors(bead_displacements(*noisy, pixel=0.1e-6, drift=False))
    assert np.mean(np.abs(error) < 1.96 * std) > 0.85
    light = (0.4 * pair[1] * np.linspace(1.0, 1.6, N)).astype(np.uint16)
    error, std = errors(bead_displacements(pair[0], light, pixel=0.1e-6, drift=False))
    assert np.sqrt(np.mean(error**2)) < 0.05


def test_drift_is_taken_out_and_said(pair: tuple[np.ndarray, np.ndarray]) -> None:
    field = bead_displacements(*pair, pixel=0.1e-6)
    assert field.drift is not None
    np.testing.assert_allclose(np.array(field.drift) / 0.1e-6, SHIFT, atol=0.1)
    left = field.displacement[0, :, : field.shape[1] // 2].max() / 0.1e-6
    assert 1.0 < left < 1.7  # the left side is pulled to the right


def test_what_is_no_pair_is_refused(pair: tuple[np.ndarray, np.ndarray]) -> None:
    rest, pulled = pair
    rng = np.random.default_rng(9)
    other = beads(rng, rng.uniform(0, N, (1500, 2)), rng.uniform(0.3, 1, 1500))
    cases: list[tuple[tuple[Any, Any], dict[str, Any], str]] = [
        ((rest, rest), {}, "the same"),
        ((rest, other), {}, "do not show the same beads"),
        ((rest, np.full_like(rest, 7)), {}, "even"),
        ((rest, pulled[:100]), {}, "same field of view"),
        ((rest, np.full_like(rest, 65535) - (np.arange(N) < 9).astype(np.uint16)), {}, "saturated"),
        ((rest, pulled), {"window": 4}, "window must be"),
        ((rest, pulled), {"window": 200}, "window must be"),
        ((rest, pulled), {"step": 0}, "step must be"),
        ((rest, pulled), {"pixel": -1.0}, "pixel must be"),
        ((rest, np.where(np.arange(N) < 3, np.nan, pulled.astype(float))), {}, "not finite"),
    ]
    for images, options, words in cases:
        with pytest.raises(InvalidInput, match=words):
            bead_displacements(*images, **{"pixel": 0.1e-6, **options})


def test_stacks_and_files(tmp_path: Path, pair: tuple[np.ndarray, np.ndarray]) -> None:
    tifffile = pytest.importorskip("tifffile")
    tifffile.imwrite(tmp_path / "stack.tif", np.stack(pair), photometric="minisblack")
    tifffile.imwrite(tmp_path / "one.tif", pair[0])
    tifffile.imwrite(tmp_path / "long.tif", np.stack([*pair, pair[0]]), photometric="minisblack")
    for found in (read_pair([tmp_path / "stack.tif"]), read_pair([tmp_path / "long.tif"], frames=(-1, 1))):
        assert all(np.array_equal(a, b) for a, b in zip(found, pair))
    for source, words in (
        (["one.tif"], "holds one picture"),
        (["long.tif"], "holds 3 pictures"),
        (["none.tif"], "no such file"),
    ):
        with pytest.raises(InvalidInput, match=words):
            read_pair([tmp_path / s for s in source])
    with pytest.raises(InvalidInput, match="two different numbers"):
        read_pair([tmp_path / "long.tif"], frames=(0, 3))
    with pytest.raises(InvalidInput, match="several pictures"):
        read_picture(tmp_path / "long.tif")
    raw = (tmp_path / "stack.tif").read_bytes()
    (tmp_path / "cut.tif").write_bytes(raw[: len(raw) // 3])
    with pytest.raises(InvalidInput):
        read_pair([tmp_path / "cut.tif"])


def test_compressed_stacks_are_read(tmp_path: Path, pair: tuple[np.ndarray, np.ndarray]) -> None:
    """LZW, as ImageJ and microscopes write it, which tifffile alone does not unpack."""
    cv2 = pytest.importorskip("cv2")
    for name, one in zip(("rest", "pulled"), pair):
        assert cv2.imwrite(str(tmp_path / f"{name}.tif"), one, [cv2.IMWRITE_TIFF_COMPRESSION, 5])
    paths = [tmp_path / "rest.tif", tmp_path / "pulled.tif"]
    assert not is_field(paths)
    assert all(np.array_equal(a, b) for a, b in zip(read_pair(paths), pair))


PUBLISHED = Path(__file__).parents[3] / "shared" / "data" / "pivuq"


@pytest.mark.long
@pytest.mark.skipif(not PUBLISHED.exists(), reason="published data are not here")
def test_another_program_agrees_within_both_errors() -> None:
    """Its v grows upwards where its y grows downwards, and its vector at 1 stands for pixels 0 to 3."""
    theirs = read_field(PUBLISHED / "B00010_UQ.dat", pixel=1.0)
    mine = published(16, 8)
    axes = [
        (s + mine.step * np.arange(n) - t - 0.5) / theirs.step
        for s, n, t in zip(mine.start[::-1], mine.shape, theirs.start[::-1])
    ]
    at = np.meshgrid(*axes, indexing="ij")
    assert theirs.std is not None
    assert mine.std is not None
    u, std = (
        np.stack([scipy.ndimage.map_coordinates(c, at, order=1, cval=np.nan) for c in both])
        for both in (theirs.displacement, theirs.std)
    )
    difference = mine.displacement - np.array([1.0, -1.0])[:, None, None] * u
    both = np.hypot(mine.std, std)
    good = np.isfinite(difference).all(axis=0) & np.isfinite(both).all(axis=0)
    assert good.sum() > 1000
    assert np.median(np.abs(difference[:, good])) < 0.03
    # as often as they say, and no less often than that
    assert np.mean(np.abs(difference[:, good]) < 1.96 * both[:, good]) > 0.96


@pytest.mark.long
@pytest.mark.skipif(not PUBLISHED.exists(), reason="published data are not here")
def test_windows_side_by_side_repeat_as_well_as_their_standard_deviations_say() -> None:
    """Fourth differences along the stream of real pictures: no truth is needed, and nothing is shared by windows that do not overlap."""
    mine = published(16, 16)
    assert mine.std is not None
    weights = np.array([1.0, -4.0, 6.0, -4.0, 1.0])
    count = mine.shape[1] - 4
    bend = sum(w * mine.displacement[..., k : k + count] for k, w in enumerate(weights))
    std = np.sqrt(sum((w * mine.std[..., k : k + count]) ** 2 for k, w in enumerate(weights)))
    z = np.abs(bend / std)[np.isfinite(bend)]
    assert len(z) > 900
    assert 0.6 < np.mean(z < 1.0) < 0.78
    assert 0.93 < np.mean(z < 1.96) < 0.99


def published(window: int, step: int) -> Field:
    return bead_displacements(
        read_picture(PUBLISHED / "B00010.tif"),
        read_picture(PUBLISHED / "B00011.tif"),
        pixel=1.0,
        window=window,
        step=step,
        drift=False,
    )
