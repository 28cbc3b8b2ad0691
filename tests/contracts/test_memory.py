"""A size that cannot be served is refused before any work, with what it needs, what is free, and what serves that very input."""

from __future__ import annotations

import re
import tracemalloc
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import palpate as pp
from long_runs import long_runs
from palpate import _memory
from palpate.inverse.linear import fourier, memory
from palpate.inverse.linear.memory import spectrum_memory
from palpate.inverse.registry import requested_method
from palpate.sensing import operator as operators
from palpate.sensing import readings as readings_module
from palpate.sensing.readings import FRAME_CELLS, FRAME_READINGS, MOST

PAD = pp.HalfSpace(youngs_modulus=5e3, poissons_ratio=0.48)
STRESS = ["stress_xz", "stress_yz", "stress_zz"]
DISPLACEMENT = ["displacement_x", "displacement_y"]


def area(n: int, channels: list[str], **options: Any) -> Any:
    return pp.AreaArray(shape=(n, n), pitch=1e-3, depth=2e-3, channels=channels, **options)


def scattered(n: int) -> Any:
    positions = np.random.default_rng(0).uniform(0.0, 1e-5 * n, (n * n, 2))
    return pp.ScatteredArray(positions=positions, depth=0.0, channels=DISPLACEMENT)


def without_one(array: Any) -> Any:
    working = np.ones(array.shape, dtype=bool)
    working[3, 4] = False
    return array.masked(working)


CASES: dict[str, tuple[Any, dict[str, Any], float, str]] = {
    # array, options, bytes free, remedy
    "127 x 127 displacements": (area(127, DISPLACEMENT), {"method": "truncated"}, 23e9, "tikhonov"),
    "128 x 128 displacements": (area(128, DISPLACEMENT), {"method": "truncated"}, 23e9, "tikhonov"),
    "96 x 96 displacements, little free": (area(96, DISPLACEMENT), {}, 1e8, "every 2nd taxel"),
    "96 x 96 stresses, nnls": (area(96, STRESS), {"method": "nnls"}, 23e9, "tikhonov"),
    "64 x 64 stresses, 50 MB free": (area(64, STRESS), {}, 5e7, "every 2nd taxel"),
    "60 x 60 stresses, one dead": (without_one(area(60, STRESS)), {"method": "nnls"}, 23e9, "2nd taxel"),
    "4900 beads": (scattered(70), {"method": "truncated"}, 23e9, '"tikhonov" serves it. Or: Grid the recording'),
    "22500 beads": (scattered(150), {}, 5e8, "rid the recording"),
    "correlated noise": (area(96, STRESS, noise=5.0, noise_correlation=2e-3), {}, 23e9, "2nd taxel"),
    "2000 x 2000, periodic": (area(2000, DISPLACEMENT), {"boundary": "periodic"}, 1e9, "parts"),
    "2000 x 2000, dft": (area(2000, STRESS), {"method": "dft"}, 1e9, "parts"),
}


@pytest.mark.parametrize(
    "name", [pytest.param(n, marks=[pytest.mark.long] if n.startswith("2000") else []) for n in CASES]
)
def test_refused_before_any_work(name: str, monkeypatch: pytest.MonkeyPatch) -> None:
    array, options, free, remedy = CASES[name]

    def begun(*_: Any, **__: Any) -> Any:
        raise RuntimeError("work was begun")

    monkeypatch.setattr(operators, "influence", begun)
    monkeypatch.setattr(operators, "periodic_transfer", begun)
    monkeypatch.setattr(fourier, "periodic_transfer", begun)
    for module in (_memory, memory):
        monkeypatch.setattr(module, "available", lambda: int(free))
    options = dict(options)
    skin = pp.Skin(PAD, array, boundary=options.pop("boundary", "free"))
    readings = np.broadcast_to(0.0, (len(array.channels), *array.shape))
    tracemalloc.start()
    try:
        with pytest.raises(pp.Unsupported) as refused:
            skin._prepared(requested_method(options.get("method"), {}).resolved(skin.problem()), skin.components)
        peak = tracemalloc.get_traced_memory()[1]
    finally:
        tracemalloc.stop()
    message = str(refused.value)
    assert remedy in message
    assert re.search(r"need about [\d.]+ [GM]B of memory", message)
    assert f"{_memory.gigabytes(free)} are free" in message
    assert peak < 20e6 + 48 * readings[0].size  # where the taxels are
    assert len(message) < 500


def test_constant_friction_is_refused_before_its_inversion_is_prepared(monkeypatch: pytest.MonkeyPatch) -> None:
    def begun(*_: Any, **__: Any) -> Any:
        raise RuntimeError("work was begun")

    monkeypatch.setattr(pp.Tikhonov, "prepare", begun)
    skin = pp.Skin(PAD, area(20, STRESS))
    with pytest.raises(pp.Unsupported, match="one complete LineArray"):
        skin.prepare(method="constant_friction", friction=0.3)


@pytest.mark.parametrize("kind", [np.float64, *long_runs(np.float32, np.int16)])
def test_a_batch_that_does_not_fit_is_refused_before_any_work(kind: Any, monkeypatch: pytest.MonkeyPatch) -> None:
    """100,000 frames of 32 x 32 x 3 ended in a MemoryError after 45 s. The number of frames that is named is taken."""

    def begun(*_: Any, **__: Any) -> Any:
        raise RuntimeError("work was begun")

    monkeypatch.setattr(operators, "influence", begun)
    monkeypatch.setattr(readings_module, "available", lambda: int(6e9))
    monkeypatch.setattr(_memory, "available", lambda: int(6e9))
    many = np.broadcast_to(np.zeros((), dtype=kind), (100_000, 3, 32, 32))
    skin = pp.Skin(PAD, area(32, STRESS))
    tracemalloc.start()
    try:
        with pytest.raises(pp.Unsupported, match="100000 frames of 3072 readings need about") as refused:
            skin.reconstruct(many, method="tikhonov")
        peak = tracemalloc.get_traced_memory()[1]
    finally:
        tracemalloc.stop()
    assert peak < 5e6
    named = re.search(r"Reconstruct (\d+) frames at a time", str(refused.value))
    assert named is not None
    with pytest.raises(RuntimeError, match="work was begun"):
        skin.reconstruct(many[: int(named[1])], method="tikhonov")


def test_readings_of_several_planes_and_draws_are_counted(monkeypatch: pytest.MonkeyPatch) -> None:
    for module in (readings_module, _memory):
        monkeypatch.setattr(module, "available", lambda: int(6e9))
    planes = [area(16, STRESS[2:]), pp.AreaArray(shape=(16, 16), pitch=1e-3, depth=3e-3, channels=STRESS)]
    skin = pp.Skin(PAD, planes)
    many = [np.broadcast_to(0.0, (500_000, c, 16, 16)) for c in (1, 3)]
    with pytest.raises(pp.Unsupported, match="500000 frames of 1024 readings need"):
        skin.reconstruct(many, method="tikhonov")
    with pytest.raises(
        pp.Unsupported, match=r"1 frames of 1024 readings with 1000000 draws each need .* Give fewer draws"
    ):
        skin.reconstruct([m[0] for m in many], draws=1_000_000)


@pytest.mark.parametrize(("n", "channels"), [(8, STRESS), *long_runs((24, STRESS), (24, DISPLACEMENT))])
@pytest.mark.parametrize("method", ["tikhonov", "dft"])
def test_a_batch_takes_no_less_than_is_said(n: int, channels: list[str], method: str) -> None:
    """What is refused would not have fitted; and `MOST` times as much is enough."""
    if method == "dft" and channels is DISPLACEMENT:
        channels = [*DISPLACEMENT, "displacement_z"]
    skin = pp.Skin(PAD, area(n, channels))
    frames = 200
    readings = np.random.default_rng(0).standard_normal((frames, len(channels), n, n)) * 1e-6
    skin.reconstruct(readings[:2], method=method)
    tracemalloc.start()
    try:
        touch = skin.reconstruct(readings, method=method)
        peak = tracemalloc.get_traced_memory()[1]
    finally:
        tracemalloc.stop()
    cells = len(skin.surface.components) * skin.surface.shape[0] * skin.surface.shape[1]
    said = 8 * frames * (FRAME_READINGS * readings[0].size + FRAME_CELLS * cells)
    assert 0.7 * said < peak < MOST * said
    assert touch.values.nbytes < said


@pytest.mark.long
def test_what_is_known_of_millions_of_readings_takes_no_number_for_each() -> None:
    array = area(2048, DISPLACEMENT)
    tracemalloc.start()
    try:
        known = pp.Uncertainty(youngs_modulus=0.1)
        assert known.common((array,)) > 0.1
        assert known.beside(PAD, (array,)).youngs_modulus == 0.0
        peak = tracemalloc.get_traced_memory()[1]
    finally:
        tracemalloc.stop()
    assert peak < 1e5


def test_the_remedies_serve_that_input() -> None:
    array = area(96, STRESS[1:], noise=100.0)
    readings = np.random.default_rng(0).normal(size=(2, 96, 96)) * 100.0
    with pytest.raises(pp.Unsupported, match=r'method="tikhonov" serves it.*periodic'):
        pp.Skin(PAD, array).reconstruct(readings, method="truncated", parameter=1e-3)
    for boundary in ("free", "periodic"):
        touch = pp.Skin(PAD, array, boundary=boundary).reconstruct(readings, method="tikhonov", parameter=1e-3)
        assert np.isfinite(touch.values).all()


@pytest.mark.parametrize(
    "name", ["64 x 64 stresses, 50 MB free", "60 x 60 stresses, one dead", "4900 beads", "correlated noise"]
)
def test_the_remedy_is_accepted(name: str, monkeypatch: pytest.MonkeyPatch) -> None:
    """What the message proposes passes the same checks."""
    array, _, free, _ = CASES[name]
    monkeypatch.setattr(memory, "available", lambda: int(free))
    skin = pp.Skin(PAD, array)
    with pytest.raises(pp.Unsupported) as refused:
        memory.check_spectrum(skin.pad, skin.planes, skin.surface, len(skin.components))
    message = str(refused.value)
    if name == "4900 beads":
        pitch = re.search(r"gridded\(([^)]*)\)", message)
        assert pitch is not None
        positions = array.points[:, ::-1]
        recording = pp.Recording(readings=np.zeros((1, 2, len(positions))), channels=DISPLACEMENT, positions=positions)
        shape = recording.gridded(float(pitch[1])).readings.shape[2:]
        fewer: Any = pp.AreaArray(shape=shape, pitch=float(pitch[1]), depth=0.0, channels=DISPLACEMENT)
    else:
        step = re.search(r"::(\d+)", message)
        assert step is not None
        k = int(step[1])
        shape = np.zeros(array.shape)[::k, ::k].shape
        fewer = pp.AreaArray(shape=shape, pitch=k * 1e-3, depth=array.depth, channels=array.channels)
        if name.endswith("dead"):
            fewer = fewer.masked(array.valid[::k, ::k])
    thin = pp.Skin(PAD, fewer)
    memory.check_spectrum(thin.pad, thin.planes, thin.surface, len(thin.components))


@pytest.mark.parametrize(
    "array",
    [
        *long_runs(area(20, STRESS)),
        area(28, ["stress_zz"]),
        *long_runs(without_one(area(18, STRESS)), scattered(22)),
    ],
    ids=["blocks", "one channel", "masked", "scattered"],
)
def test_the_estimate_is_what_is_allocated(array: Any) -> None:
    from palpate.inverse import DifferencePrior, decompose

    skin = pp.Skin(PAD, array)
    columns = [skin.surface.components.index(c) for c in skin.components]
    skin.operator.planes  # noqa: B018
    tracemalloc.start()
    try:
        decompose(skin.operator, [DifferencePrior(skin.surface, 1)] * len(columns), columns)
        peak = tracemalloc.get_traced_memory()[1]
    finally:
        tracemalloc.stop()
    estimate = spectrum_memory(skin.pad, skin.planes, skin.surface, len(columns))
    assert 1 / 1.6 < estimate / peak < 1.6


# -- what is free ------------------------------------------------------------------------------------------------------


def test_the_least_of_machine_group_and_process(monkeypatch: pytest.MonkeyPatch) -> None:
    files = {
        "/proc/meminfo": "MemTotal: 9000000 kB\nMemFree: 10 kB\nMemAvailable: 8000000 kB\n",
        "/proc/self/cgroup": "0::/job/step\n",
        "/sys/fs/cgroup/job/memory.max": "3000000000\n",
        "/sys/fs/cgroup/job/memory.current": "2500000000\n",
        "/sys/fs/cgroup/job/memory.stat": "anon 5\ninactive_file 500000000\n",
        "/sys/fs/cgroup/job/step/memory.max": "max\n",
        "/sys/fs/cgroup/job/step/memory.current": "100\n",
    }

    def text(path: Path) -> str:
        return files.get(str(path), "")

    monkeypatch.setattr(_memory, "_text", text)
    assert _memory.available() == 1_000_000_000  # of a parent group, its file cache counted as free
    files["/proc/self/cgroup"] = "4:memory:/old\n1:name=systemd:/\n"
    files["/sys/fs/cgroup/memory/old/memory.limit_in_bytes"] = "700000000\n"
    files["/sys/fs/cgroup/memory/old/memory.usage_in_bytes"] = "600000000\n"
    assert _memory.available() == 100_000_000
    del files["/proc/self/cgroup"]
    assert _memory.available() == 8_192_000_000
    monkeypatch.setattr(_memory, "_address_space", lambda: -5)
    assert _memory.available() == 0


def test_small_things_are_not_refused(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(_memory, "available", lambda: 0)
    _memory.require(1e6, "these", "Nothing.")
    with pytest.raises(pp.Unsupported, match="need about 60 MB of memory, and 0 MB are free"):
        _memory.require(6e7, "These", "Nothing.")
    monkeypatch.setattr(_memory, "available", lambda: None)
    _memory.require(1e30, "These", "Nothing.")


def test_tikhonov_iterates_where_its_decomposition_does_not_fit(monkeypatch: pytest.MonkeyPatch) -> None:
    """So that no other method is sent to one that is refused too."""
    for module in (memory, _memory):
        monkeypatch.setattr(module, "available", lambda: int(2.2e8))
    skin = pp.Skin(PAD, area(36, DISPLACEMENT, noise=1e-7))
    with pytest.raises(pp.Unsupported, match=r'317 MB of memory .* method="tikhonov" serves it'):
        skin.prepare(method="truncated")
    skin.prepare(method="tikhonov")


def test_few_beads_on_many_cells_are_not_sent_to_the_method_that_is_refused(monkeypatch: pytest.MonkeyPatch) -> None:
    """Their map is a matrix for every method."""
    positions = np.random.default_rng(0).uniform(0.0, 12e-3, (300, 2))
    array = pp.ScatteredArray(positions=positions, depth=1e-3, channels=DISPLACEMENT, noise=1e-7)
    surface = pp.AreaGrid(shape=(64, 64), spacing=0.2e-3, center=(6e-3, 6e-3))
    monkeypatch.setattr(memory, "available", lambda: int(2.2e8))
    for method in ("tikhonov", "truncated"):
        with pytest.raises(pp.Unsupported, match="Grid the recording") as refused:
            pp.Skin(PAD, array, surface=surface).reconstruct(np.zeros((2, 300)), method=method)
        assert "tikhonov" not in str(refused.value)


def test_a_touch_without_error_bars_is_not_sent_to_its_own_method() -> None:
    grid = pp.LineGrid(count=4, spacing=1e-3)
    for method, words in (
        ("tikhonov", "Skin.reconstruct returns"),
        ("adaptive", "Skin.reconstruct returns"),
        ("dft", 'use method="tikhonov"'),
        ("another", 'use method="tikhonov"'),
    ):
        with pytest.raises(pp.Unsupported, match=words):
            pp.Touch(np.ones((2, 4)), grid, ("x", "z"), method).std()
