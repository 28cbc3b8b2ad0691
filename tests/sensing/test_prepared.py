"""What is prepared for a skin serves another run, and no other skin."""

from __future__ import annotations

import json
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import palpate as pp
from command_line import CliRunner
from palpate import _recall
from palpate.cli import app
from palpate.inverse.linear import spectrum
from palpate.inverse.linear.matrix_free import freedom, path
from palpate.recordings import Recording, write_recording
from palpate.sensing import operator

LAYERS = pp.BondedLayers(
    [
        pp.Layer(thickness=2e-3, youngs_modulus=1e5, poissons_ratio=0.48),
        pp.Layer(thickness=3e-3, youngs_modulus=5e5, poissons_ratio=0.48),
    ]
)


def skin_of(pad: Any = LAYERS, **options: Any) -> pp.Skin:
    array = {"count": 11, "pitch": 1e-3, "depth": 1e-3, "channels": ["stress_xz", "stress_zz"], **options}
    return pp.Skin(pad, pp.LineArray(**array))


def readings_of(skin: pp.Skin) -> Any:
    return skin.sense(pp.solutions.hertz_line(half_width=2e-3, force=10.0))


def not_again(*_: Any, **__: Any) -> Any:
    raise AssertionError("worked out again")


@pytest.fixture
def saved(tmp_path: Path) -> Path:
    """A file of what a frame prepared."""
    skin = skin_of()
    skin.reconstruct(readings_of(skin))
    skin.save_prepared(tmp_path / "a.prepared")
    assert [p.name for p in tmp_path.iterdir()] == ["a.prepared"]
    return tmp_path / "a.prepared"


@pytest.mark.long
def test_nothing_is_worked_out_again(saved: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    skin = skin_of()
    readings = readings_of(skin)
    before = skin.reconstruct(readings)
    again = skin_of()
    again.load_prepared(saved)
    with monkeypatch.context() as m:
        m.setattr(operator, "influence", not_again)
        m.setattr(spectrum, "_eigh", not_again)
        m.setattr(spectrum, "_svd", not_again)
        found = again.reconstruct(readings)
    np.testing.assert_array_equal(found.traction, before.traction)
    np.testing.assert_array_equal(found.std(), before.std())


def test_areas_masks_and_the_linear_method(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def skin(dead: tuple[int, int] = (2, 3)) -> pp.Skin:
        mask = np.ones((7, 6), dtype=bool)
        mask[dead] = False
        array = pp.AreaArray(shape=(7, 6), pitch=1e-3, depth=1e-3, channels=["stress_zz"], mask=mask, noise=[2.0])
        return pp.Skin(pp.HalfSpace(youngs_modulus=1e5, poissons_ratio=0.5), array)

    readings = skin().sense(pp.solutions.hertz_point(contact_radius=2e-3, force=0.05))
    first = skin()
    before = first.reconstruct(readings, method="tikhonov")
    first.save_prepared(tmp_path / "a")
    again = skin()
    again.load_prepared(tmp_path / "a")
    monkeypatch.setattr(spectrum, "_svd", not_again)
    monkeypatch.setattr(operator, "influence", not_again)
    np.testing.assert_array_equal(again.reconstruct(readings, method="tikhonov").traction, before.traction)
    with pytest.raises(pp.errors.InvalidInput, match="another skin: arrays differ"):
        skin((0, 0)).load_prepared(tmp_path / "a")


def test_degrees_of_freedom_at_size(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(path, "LARGEST_DENSE_BLOCK", 10)
    array = pp.AreaArray(shape=(10, 10), pitch=1e-3, depth=1e-3, channels=["stress_zz"])
    skin, again = (pp.Skin(pp.HalfSpace(youngs_modulus=1e5, poissons_ratio=0.5), array) for _ in range(2))
    readings = skin.sense(pp.solutions.hertz_point(contact_radius=2e-3, force=0.05))
    readings += 0.02 * np.abs(readings).max() * np.random.default_rng(0).standard_normal(readings.shape)
    before = skin.reconstruct(readings, method="tikhonov")
    skin.save_prepared(tmp_path / "a")
    again.load_prepared(tmp_path / "a")
    monkeypatch.setattr(freedom.Freedom, "_probes", not_again)
    found = again.reconstruct(readings, method="tikhonov")
    np.testing.assert_allclose(found.traction, before.traction, atol=1e-3 * float(np.abs(before.traction).max()))


@pytest.mark.parametrize(
    ("other", "word"),
    [
        (lambda: skin_of(depth=1.5e-3), "another skin: arrays"),
        (lambda: skin_of(noise=5.0), "arrays differ"),
        (lambda: skin_of(pp.HalfSpace(youngs_modulus=1e5, poissons_ratio=0.5)), "pad differs"),
        (lambda: pp.Skin(LAYERS, skin_of().planes[0], surface=pp.LineGrid(count=20, spacing=1e-3)), "surface differs"),
    ],
)
@pytest.mark.long
def test_another_skin_is_refused(saved: Path, other: Any, word: str) -> None:
    skin = other()
    with pytest.raises(pp.errors.InvalidInput, match=word):
        skin.load_prepared(saved)
    skin.prepare()  # and goes on without


def test_another_version_is_refused(saved: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    with monkeypatch.context() as m:
        m.setattr(_recall, "FORMAT", 2)
        with pytest.raises(pp.errors.InvalidInput, match="its form is 1, and this version reads 2"):
            skin_of().load_prepared(saved)
    monkeypatch.setattr(pp, "__version__", "9.9")
    with pytest.raises(pp.errors.InvalidInput, match=r"and this is 9\.9"):
        skin_of().load_prepared(saved)


def test_a_damaged_file_is_refused(saved: Path, tmp_path: Path) -> None:
    whole = saved.read_bytes()
    bad = tmp_path / "bad"
    middle = len(whole) // 2
    flipped = bytes([*whole[:middle], whole[middle] ^ 255, *whole[middle + 1 :]])
    for damaged in (b"", b"no zip", whole[:middle], flipped):
        bad.write_bytes(damaged)
        with pytest.raises(pp.errors.InvalidInput, match="damaged, or is not a file of a prepared skin"):
            skin_of().load_prepared(bad)
    for header in ([], {"format": 1}, {"format": 1, "about": {}, "entries": {"x": 1}}):
        with bad.open("wb") as file:
            np.savez(file, header=np.frombuffer(json.dumps(header).encode(), dtype=np.uint8))
        with pytest.raises(pp.errors.InvalidInput):
            skin_of().load_prepared(bad)
    with pytest.raises(pp.errors.InvalidInput, match="no such file"):
        skin_of().load_prepared(tmp_path / "none")


def test_what_does_not_fit_is_worked_out() -> None:
    arrays = np.zeros((3, 3)), np.zeros(3)
    known = _recall.Recall({"a": arrays, "b": (np.zeros(3, dtype=np.float32),)})
    assert known.find("a", [(3, 3), (3,)]) == arrays
    assert known.find("a", [(3, 3)]) is None
    assert known.find("a", [(3, 3), (4,)]) is None
    assert known.find("b", [(3,)]) is None
    assert known.find(None, []) is None


def test_nothing_prepared_and_pads_of_ones_own(tmp_path: Path) -> None:
    with pytest.raises(pp.errors.InvalidInput, match="nothing is prepared yet"):
        skin_of().save_prepared(tmp_path / "a")

    @dataclass(frozen=True)
    class Mine(pp.HalfSpace):
        pass

    skin = skin_of(Mine(youngs_modulus=1e5, poissons_ratio=0.5))
    skin.prepare()
    with pytest.raises(pp.errors.Unsupported, match="only pads that come with palpate"):
        skin.save_prepared(tmp_path / "a")
    assert not list(tmp_path.iterdir())


def test_digests_tell_things_apart() -> None:
    things: list[Any] = [
        1,
        1.0,
        True,
        "1",
        None,
        [1],
        [[1]],
        {"a": 1},
        np.ones(1),
        np.ones((1, 1)),
        np.ones(1, dtype=int),
    ]
    things += [LAYERS, skin_of().planes[0], skin_of(depth=1.0000000001e-3).planes[0]]
    found = [_recall.digest(t) for t in things]
    assert None not in found
    assert len(set(found)) == len(things)
    assert _recall.digest(object()) is None
    assert _recall.digest(np.array([object()])) is None


@pytest.mark.long
def test_from_the_shell(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    (tmp_path / "skin.toml").write_text(
        '[pad]\nkind = "half_space"\nyoungs_modulus = "100 kPa"\npoissons_ratio = 0.5\n\n[[plane]]\nkind = "line"\ncount = 11\n'
        'pitch = "1 mm"\ndepth = "1 mm"\nchannels = ["stress_xz", "stress_zz"]\n'
    )
    skin = pp.Skin.from_file(tmp_path / "skin.toml")
    write_recording(
        Recording(readings=np.stack([readings_of(skin)] * 2), channels=["stress_xz", "stress_zz"]), tmp_path / "r.npz"
    )
    arguments = ["reconstruct", str(tmp_path / "r.npz"), "--skin", str(tmp_path / "skin.toml"), "--force"]
    arguments += ["--out", str(tmp_path / "t.npz"), "--prepared", str(tmp_path / "p")]
    first = CliRunner().invoke(app, arguments)
    assert first.exit_code == 0, first.output
    monkeypatch.setattr(spectrum, "_eigh", not_again)
    second = CliRunner().invoke(app, arguments)
    assert second.exit_code == 0, second.output
    (tmp_path / "p").write_bytes(b"")
    assert CliRunner().invoke(app, arguments).exit_code != 0
