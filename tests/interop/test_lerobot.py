"""Tactile columns in LeRobot's datasets: exact both ways, and opened by its own loader where that is installed."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest

import palpate as pp

pytest.importorskip("pyarrow")

from palpate.lerobot import Episode, add_columns, read_dataset, tactile_columns, write_dataset

CHANNELS = ["stress_xz", "stress_yz", "stress_zz"]


@pytest.fixture(scope="module")
def episodes() -> list[Episode]:
    """Two episodes of a finger that presses, each reconstructed, with joints beside it."""
    rng = np.random.default_rng(0)
    array = pp.AreaArray(shape=(5, 6), pitch=1.5e-3, depth=1.5e-3, channels=CHANNELS, noise=50.0)
    skin = pp.Skin(pp.HalfSpace(youngs_modulus=2e5, poissons_ratio=0.48), array)
    out = []
    for number, count in enumerate((7, 4)):
        balls = [pp.solutions.hertz_point(contact_radius=2e-3, force=0.2 + 0.1 * i) for i in range(count)]
        readings = np.stack([skin.sense(ball, rng=rng) for ball in balls])
        touch = skin.reconstruct(readings, method="tikhonov", time=0.1 + np.arange(count) / 30)
        columns = tactile_columns(touch, name="thumb", readings=readings, friction=0.6)
        columns["observation.state"] = rng.standard_normal((count, 7)).astype(np.float32)
        columns["next.done"] = np.arange(count) == count - 1
        out.append(Episode(columns, task=f"press {number}"))
    return out


def same(a: Episode, b: Episode) -> None:
    assert list(a.columns) == list(b.columns)
    assert a.task == b.task
    for name, value in a.columns.items():
        other = b.columns[name]
        assert other.dtype == value.dtype
        assert np.array_equal(other.reshape(value.shape), value, equal_nan=value.dtype.kind == "f")


def test_a_round_trip_loses_nothing(episodes: list[Episode], tmp_path: Path) -> None:
    path = write_dataset(tmp_path / "set", episodes, fps=30, robot_type="hand")
    found = read_dataset(path)
    assert (found.fps, found.robot_type, len(found.episodes)) == (30, "hand", 2)
    for a, b in zip(episodes, found.episodes):
        same(a, b)
    again = read_dataset(write_dataset(tmp_path / "again", found.episodes, fps=30))
    for a, b in zip(episodes, again.episodes):
        same(a, b)
    recording = found.episodes[0].recording("thumb", CHANNELS)
    np.testing.assert_array_equal(recording.readings, episodes[0].columns["observation.tactile.thumb.readings"])
    assert recording.time[0] == 0.1


def test_columns_are_added_and_the_rest_is_copied(episodes: list[Episode], tmp_path: Path) -> None:
    bare = [Episode({"observation.state": e.columns["observation.state"]}, task=e.task) for e in episodes]
    source = write_dataset(tmp_path / "bare", bare, fps=30)
    video = source / "videos/observation.images.wrist/chunk-000/file-000.mp4"
    video.parent.mkdir(parents=True)
    video.write_bytes(b"not a film")
    more = [{k: v for k, v in e.columns.items() if k != "observation.state"} for e in episodes]
    target = add_columns(source, tmp_path / "more", more)
    assert (target / video.relative_to(source)).read_bytes() == b"not a film"
    for a, b in zip(episodes, read_dataset(target).episodes):
        assert set(a.columns) == set(b.columns)
        for name, value in a.columns.items():
            assert np.array_equal(b.columns[name].reshape(value.shape), value)
    assert set(read_dataset(source).episodes[0].columns) == {"observation.state"}  # as it was
    with pytest.raises(pp.InvalidInput, match="episode 1 has 4 frames; its columns have 3"):
        add_columns(source, tmp_path / "wrong", [more[0], {k: v[:3] for k, v in more[1].items()}])
    assert not (tmp_path / "wrong").exists()


def test_missing_numbers_and_single_numbers(tmp_path: Path) -> None:
    values = np.array([[1.0], [np.nan], [3.0]])
    plain = np.array([1.5, 2.5, np.nan], dtype=np.float32)
    path = write_dataset(tmp_path / "set", [Episode({"a": values, "b": plain})], fps=10)
    found = read_dataset(path).episodes[0].columns
    assert np.array_equal(found["a"], values, equal_nan=True)
    assert np.array_equal(found["b"].ravel(), plain, equal_nan=True)
    stats = json.loads((path / "meta/stats.json").read_text())
    assert stats["a"] == {"min": [1.0], "max": [3.0], "mean": [2.0], "std": [1.0], "count": [3]}


def test_what_is_refused(episodes: list[Episode], tmp_path: Path) -> None:
    with pytest.raises(pp.InvalidInput, match="all columns must have one entry"):
        Episode({"a": np.zeros(3), "b": np.zeros(4)})
    with pytest.raises(pp.InvalidInput, match="complex128"):
        Episode({"a": np.zeros(3, dtype=complex)})
    with pytest.raises(pp.InvalidInput, match="is the format's own"):
        Episode({"timestamp": np.zeros(3)})
    with pytest.raises(pp.InvalidInput, match="fps must be"):
        write_dataset(tmp_path / "a", episodes, fps=0)
    with pytest.raises(pp.InvalidInput, match="episode 1 has other columns"):
        write_dataset(tmp_path / "a", [episodes[0], Episode({"a": np.zeros(3)})], fps=30)
    with pytest.raises(pp.InvalidInput, match=r"no meta/info\.json"):
        read_dataset(tmp_path)
    path = write_dataset(tmp_path / "a", episodes, fps=30)
    with pytest.raises(pp.InvalidInput, match="there already"):
        write_dataset(path, episodes, fps=30)
    with pytest.raises(pp.InvalidInput, match="its sensors are thumb"):
        episodes[0].recording("palm", CHANNELS)
    info = json.loads((path / "meta/info.json").read_text())
    (path / "meta/info.json").write_text(json.dumps({**info, "codebase_version": "v2.1"}))
    with pytest.raises(pp.Unsupported, match=r"version v2\.1"):
        read_dataset(path)


def test_lerobots_own_loader_opens_it(episodes: list[Episode], tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    pytest.importorskip("datasets", reason="lerobot is not installed: its own loader was not tried")
    lerobot = pytest.importorskip(
        "lerobot.datasets.lerobot_dataset", reason="lerobot is not installed: its own loader was not tried"
    )
    monkeypatch.setenv("HF_HUB_OFFLINE", "1")
    path = write_dataset(tmp_path / "set", episodes, fps=30)
    opened = lerobot.LeRobotDataset("palpate/presses", root=path)
    assert (opened.num_episodes, opened.num_frames) == (2, 11)
    row = 0
    for episode in episodes:
        for i in range(len(episode)):
            item = opened[row]
            for name, value in episode.columns.items():
                assert np.array_equal(
                    np.asarray(item[name]).reshape(value[i].shape), value[i].astype(np.asarray(item[name]).dtype)
                )
            assert item["task"] == episode.task
            row += 1
