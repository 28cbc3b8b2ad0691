"""Methods as objects: one registry for Python and the command line, nothing prepared twice, every frame decided alone."""

from __future__ import annotations

import inspect
import pickle
from collections.abc import Iterator, Sequence
from dataclasses import FrozenInstanceError, dataclass, fields, replace
from pathlib import Path
from typing import Any, ClassVar

import numpy as np
import pytest

import palpate as pp
from command_line import CliRunner
from palpate import solutions
from palpate.inverse import Estimate, Method, Problem, registry
from palpate.inverse.method import Needs, number
from palpate.inverse.problem import Kept
from palpate.recordings import Recording, read_touch, write_recording
from palpate.sensing.uncertainty import EXACT
from skin_files import skin_text

PAD = pp.HalfSpace(youngs_modulus=1.0, poissons_ratio=0.45)
LINE = pp.LineArray(count=31, pitch=0.5, depth=1.0, channels=["stress_zz"])
THREE = pp.AreaArray(shape=(9, 9), pitch=1.0, depth=1.5, channels=["stress_xz", "stress_yz", "stress_zz"])
BALL = solutions.hertz_point(contact_radius=2.5, force=1.0)


def noisy(skin: pp.Skin, contact: Any, noise: float, seed: int = 0) -> Any:
    clean = np.asarray(skin.sense(contact))
    return clean + noise * np.abs(clean).max() * np.random.default_rng(seed).standard_normal(clean.shape)


# -- a new method: all that it takes -----------------------------------------------------------------------------------


@dataclass(frozen=True, kw_only=True)
class Backprojection(Method):
    """The adjoint of the readings, times a gain."""

    name: ClassVar[str] = "backprojection"
    summary: ClassVar[str] = "the adjoint, for a test"
    needs: ClassVar[Needs] = Needs(free_boundary=True)

    gain: float = number(1.0, help="what the adjoint is multiplied by")

    def prepare(self, problem: Problem) -> _Backprojection:
        self.check(problem)
        return _Backprojection(problem, self.gain)


class _Backprojection:
    def __init__(self, problem: Problem, gain: float) -> None:
        self.problem, self.gain, self.grid = problem, gain, problem.surface

    def solve(self, readings: Sequence[Any], rng: Any = None) -> Estimate:
        return Estimate(self.gain * self.problem.operator.adjoint(readings), None, None, None)


@pytest.fixture
def registered() -> Iterator[None]:
    pp.register(Backprojection)
    yield
    registry.unregister("backprojection")


SKIN = skin_text(31, pitch="0.5 m", depth="1 m", modulus="1 Pa", ratio=0.45)


@pytest.fixture
def recording(tmp_path: Path) -> Path:
    skin = pp.Skin(PAD, LINE)
    frames = np.stack([noisy(skin, solutions.hertz_line(half_width=2.0, force=0.3), 0.01, seed=i) for i in range(2)])
    positions = LINE.points[:, 0]
    (tmp_path / "skin.toml").write_text(SKIN)
    write_recording(
        Recording(readings=frames, channels=("stress_zz",), time=np.arange(2.0), positions=positions), tmp_path / "r.nc"
    )
    return tmp_path


def palpate(*arguments: str) -> Any:
    from palpate.cli import app

    return CliRunner().invoke(app, list(arguments))


@pytest.mark.usefixtures("registered")
@pytest.mark.long
def test_a_method_of_ones_own(recording: Path) -> None:
    """One class and one call: Python, the command line and its help know it."""
    skin = pp.Skin(PAD, LINE)
    readings = noisy(skin, solutions.hertz_line(half_width=2.0, force=0.3), 0.01)
    found = skin.reconstruct(readings, method=Backprojection(gain=2.0))
    np.testing.assert_allclose(found.values, 2.0 * skin.operator.adjoint([readings]))
    np.testing.assert_array_equal(2.0 * skin.reconstruct(readings, method="backprojection").values, found.values)
    with pytest.raises(pp.Unsupported, match="does not take friction"):
        skin.reconstruct(readings, method="backprojection", friction=0.5)
    with pytest.raises(pp.Unsupported, match='boundary="free"'):
        pp.Skin(PAD, LINE, boundary="periodic").reconstruct(readings, method="backprojection")

    said = palpate("reconstruct", "--help")
    assert said.exit_code == 0
    assert "backprojection (the adjoint, for a test)" in " ".join(said.output.split())
    assert "--gain" in said.output
    out = palpate(
        "reconstruct", str(recording / "r.nc"), "--skin", str(recording / "skin.toml"), "--method", "backprojection",
        "--gain", "3", "--out", str(recording / "t.nc"),
    )  # fmt: skip
    assert out.exit_code == 0, out.output
    touch = read_touch(recording / "t.nc")
    assert touch.attrs["method"] == "backprojection"
    one = skin.reconstruct(_readings(recording)[0], method=Backprojection(gain=3.0)).values
    np.testing.assert_allclose(touch["traction"].values[0], one, atol=1e-9 * np.abs(one).max())


def _readings(folder: Path) -> Any:
    from palpate.recordings import read_recording

    return read_recording(folder / "r.nc").readings


def test_a_name_is_taken_once() -> None:
    @dataclass(frozen=True, kw_only=True)
    class Other(Backprojection):
        name: ClassVar[str] = "tikhonov"

    with pytest.raises(pp.InvalidInput, match="is that of Tikhonov"):
        pp.register(Other)
    with pytest.raises(pp.InvalidInput, match="subclass"):
        pp.register(int)  # type: ignore[type-var]
    with pytest.raises(pp.InvalidInput, match="cannot be removed"):
        registry.unregister("adaptive")


# -- options -----------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("method", "options"),
    [
        (pp.Tikhonov(order=2, rule="gcv"), {"method": "tikhonov", "order": 2, "parameter": "gcv"}),
        (pp.Tikhonov(order=0, parameter=1e-3), {"order": 0, "parameter": 1e-3}),
        (pp.Hilgers(length=2.0), {"method": "hilgers", "length": 2.0}),
        (pp.Truncated(rule="lcurve"), {"method": "truncated", "parameter": "lcurve"}),
        (pp.Constrained(parameter=1e-3), {"method": "constrained", "parameter": 1e-3}),
        (pp.Constrained(), {"method": "constrained", "parameter": "evidence"}),
        (pp.paper.Division(), {"method": "dft"}),
        (pp.paper.LinearSystem(), {"method": "linear"}),
        (
            pp.paper.ConstantFriction(friction=-0.2, parameter=1e-3),
            {"method": "constant_friction", "friction": -0.2, "parameter": 1e-3},
        ),
        (pp.comparison.NonNegative(), {"method": "nnls"}),
        (pp.comparison.ElasticNet(parameter=1e-3), {"method": "elastic_net", "parameter": 1e-3}),
        (pp.Adaptive(), {"method": "adaptive"}),
        (pp.Automatic(), {}),
    ],
    ids=str,
)
@pytest.mark.long
def test_objects_are_their_short_names(method: Method, options: dict[str, Any]) -> None:
    skin = pp.Skin(PAD, LINE)
    readings = noisy(skin, solutions.hertz_line(half_width=2.0, force=0.3).shifted(0.2), 0.01)
    components = None if method.name == "constant_friction" else ["z"]
    one, other = (skin.reconstruct(readings, components=components, **o) for o in ({"method": method}, options))
    np.testing.assert_array_equal(one.values, other.values)
    assert one.method == other.method


@pytest.mark.parametrize(
    "method", [pp.Tikhonov, pp.Adaptive, pp.Constrained, pp.Hilgers, pp.comparison.NonNegative, pp.Automatic]
)
def test_methods_are_frozen_hashable_and_pickle(method: type[Method]) -> None:
    one = method()
    assert one == method()
    assert hash(one) == hash(method())
    assert pickle.loads(pickle.dumps(one)) == one
    for f in fields(one):
        with pytest.raises(FrozenInstanceError):
            setattr(one, f.name, 1.0)
    with pytest.raises(TypeError):
        method(0.5)  # type: ignore[call-arg]


WRONG: dict[str, tuple[Any, type[Exception], str]] = {
    "negative friction": (lambda: pp.Constrained(friction=-0.4), pp.InvalidInput, "friction must be a positive"),
    "no friction": (lambda: pp.Adaptive(friction=0.0), pp.InvalidInput, "friction must be a positive"),
    "NaN": (lambda: pp.Adaptive(friction=float("nan")), pp.InvalidInput, "friction must be"),
    "friction in words": (lambda: pp.Adaptive(friction="high"), pp.InvalidInput, "got 'high'"),  # type: ignore[arg-type]
    "True is no number": (lambda: pp.Adaptive(friction=True), pp.InvalidInput, "friction must be"),
    "order": (lambda: pp.Tikhonov(order=3), pp.InvalidInput, "0, 1 or 2"),
    "rule": (lambda: pp.Tikhonov(rule="best"), pp.InvalidInput, "evidence, gcv"),
    "evidence of truncation": (lambda: pp.Truncated(rule="evidence"), pp.Unsupported, "gcv, lcurve"),
    "both": (lambda: pp.Tikhonov(rule="gcv", parameter=1.0), pp.InvalidInput, "not both"),
    "draws": (lambda: pp.Adaptive(draws=-1), pp.InvalidInput, "whole number"),
    "half a draw": (lambda: pp.Adaptive(draws=1.5), pp.InvalidInput, "whole number"),  # type: ignore[arg-type]
    "spectrum": (lambda: pp.Wiener(spectrum=3.0), pp.InvalidInput, "function of wavenumber"),  # type: ignore[arg-type]
}


@pytest.mark.parametrize("case", list(WRONG))
def test_values_that_a_method_does_not_accept(case: str) -> None:
    make, error, words = WRONG[case]
    with pytest.raises(error, match=words):
        make()


def test_options_are_given_once() -> None:
    skin, readings = pp.Skin(PAD, LINE), np.zeros((1, 31))
    with pytest.raises(pp.InvalidInput, match=r"say Tikhonov\(order=...\)"):
        skin.reconstruct(readings, method=pp.Tikhonov(), order=2)
    with pytest.raises(pp.InvalidInput, match=r"Tikhonov\(...\)"):
        skin.reconstruct(readings, method=pp.Tikhonov)  # type: ignore[arg-type]
    with pytest.raises(pp.Unsupported, match="draws no samples"):
        skin.reconstruct(readings, method="tikhonov", rng=np.random.default_rng(0))
    with pytest.raises(pp.Unsupported, match='method="tikhonov"'):
        pp.Skin(PAD, LINE, boundary="periodic").reconstruct(readings, friction=0.5)


def test_options_are_those_that_methods_declare() -> None:
    """`Skin.reconstruct` has no list of its own: what a method declares it takes, and what none declares is refused."""

    @dataclass(frozen=True, kw_only=True)
    class Halved(pp.Tikhonov):
        name: ClassVar[str] = "halved"
        part: float = number(0.5, help="part that is kept")

    skin, readings = pp.Skin(PAD, LINE), np.zeros((1, 31))
    registry.register(Halved)
    try:
        assert skin.reconstruct(readings, method="halved", part=0.25, order=2).method == "halved"
        with pytest.raises(pp.InvalidInput, match="part must be a positive number"):
            skin.reconstruct(readings, method="halved", part=-1)
    finally:
        registry.unregister("halved")
    with pytest.raises(pp.Unsupported, match='"automatic" does not take frictoin; it takes friction, draws'):
        skin.reconstruct(readings, frictoin=0.5)
    with pytest.raises(pp.Unsupported, match="frictoin is an option of no method"):
        skin.reconstruct(readings, method="tikhonov", frictoin=None)
    offered = inspect.getdoc(pp.Skin.reconstruct) or ""
    for option in registry.options():
        assert f"``{option}``" in offered, f"the docstring of Skin.reconstruct does not name {option}"


def test_every_method_says_what_it_is() -> None:
    for name, method in pp.methods().items():
        assert method.name == name
        assert method.summary
        assert method.__doc__
        for option, known in method.options().items():
            assert known.help, option
            assert known.accepts, option
        assert all(f.kw_only for f in fields(method))


COMMANDS: dict[str, tuple[list[str], str]] = {
    "friction of a method that takes none": (["--method", "tikhonov", "--friction", "0.4"], "does not take friction"),
    "negative friction": (["--method", "constrained", "--friction", "-0.4"], "friction must be a positive number"),
    "friction in words": (["--method", "constrained", "--friction", "high"], "got 'high'"),
    "friction where only pressure is sought": (["--friction", "0.4"], "only pressure is sought"),
    "order of another method": (["--method", "nnls", "--order", "1"], "does not take order"),
    "rule of another method": (["--method", "constrained", "--parameter", "gcv"], "evidence"),
    "only in Python": (["--method", "wiener"], "which only Python can say"),
    "unknown": (["--method", "magic"], "method must be one of"),
    "no order": (["--order", "two"], "0, 1 or 2"),
}


@pytest.mark.parametrize("case", list(COMMANDS))
@pytest.mark.long
def test_the_command_line_drops_no_option(case: str, recording: Path) -> None:
    options, words = COMMANDS[case]
    out = palpate("reconstruct", str(recording / "r.nc"), "--skin", str(recording / "skin.toml"), *options)
    assert isinstance(out.exception, pp.PalpateError), out.output
    assert words in str(out.exception)
    assert not (recording / "r-touch.nc").exists()


@pytest.mark.long
def test_friction_reaches_the_constrained_method(tmp_path: Path) -> None:
    """A ball that slides at 0.6, taken for one at 0.3 at most: the cone of 0.3 holds in every cell."""
    skin = pp.Skin(PAD, THREE)
    frames = noisy(skin, BALL.sliding(0.6), 0.01)[None]
    text = SKIN.replace('"line"', '"area"').replace("count = 31", "shape = [9, 9]").replace('"0.5 m"', '"1 m"')
    text = text.replace('depth = "1 m"', 'depth = "1.5 m"').replace('["stress_zz"]', str(list(THREE.channels)))
    (tmp_path / "skin.toml").write_text(text)
    write_recording(
        Recording(readings=frames, channels=THREE.channels, time=np.zeros(1), positions=None), tmp_path / "r.nc"
    )
    out = palpate(
        "reconstruct", str(tmp_path / "r.nc"), "--skin", str(tmp_path / "skin.toml"), "--method", "constrained",
        "--friction", "0.3", "--out", str(tmp_path / "t.nc"),
    )  # fmt: skip
    assert out.exit_code == 0, out.output
    values = read_touch(tmp_path / "t.nc")["traction"].values[0]
    over = np.hypot(values[0], values[1]) - 0.3 * values[2]
    assert over.max() < 1e-6 * values[2].max()


# -- nothing is prepared twice -----------------------------------------------------------------------------------------


@pytest.fixture
def prepared(monkeypatch: pytest.MonkeyPatch) -> list[str]:
    """One entry for each decomposition and each operator made."""
    made: list[str] = []

    def counted(module: str, name: str) -> None:
        import importlib

        home = importlib.import_module(module)
        whole = getattr(home, name)

        def count(*a: Any, **k: Any) -> Any:
            made.append(name)
            return whole(*a, **k)

        monkeypatch.setattr(home, name, count)

    counted("palpate.inverse.problem", "decompose")
    counted("palpate.inverse.problem", "Operator")
    return made


@pytest.mark.long
def test_what_does_not_change_is_not_prepared_again(prepared: list[str]) -> None:
    skin = pp.Skin(PAD, LINE, uncertainty=EXACT)
    readings = noisy(skin, solutions.hertz_line(half_width=2.0, force=0.3), 0.01)
    first = skin.reconstruct(readings, method=pp.Tikhonov(parameter=1e-3))
    assert prepared.count("decompose") == 1
    for rule in ("evidence", "gcv", "lcurve"):
        skin.reconstruct(readings, method=pp.Tikhonov(rule=rule))
    second = skin.reconstruct(readings, method=pp.Tikhonov(parameter=2e-3))
    assert not np.array_equal(first.values, second.values)
    for method in (pp.Constrained(), pp.Constrained(parameter=1e-3), pp.comparison.TotalVariation(parameter=1e-2)):
        skin.reconstruct(readings, method=method)  # the same penalty on the same grid
    assert prepared == ["Operator", "decompose"]
    skin.reconstruct(readings, method=pp.Tikhonov(order=0))
    skin.reconstruct(readings, method="truncated")
    assert prepared.count("decompose") == 2
    skin.reconstruct(readings)
    assert prepared.count("decompose") == 4  # both orders on a wider grid
    skin.reconstruct(readings, draws=2)
    skin.reconstruct(readings, method=pp.Adaptive())
    skin.reconstruct(-readings)  # a pull: the linear method, which is there already
    assert prepared.count("decompose") == 4
    assert prepared.count("Operator") == 2


@pytest.mark.long
def test_friction_changes_the_prior_of_shear_and_nothing_else(prepared: list[str]) -> None:
    skin = pp.Skin(PAD, THREE, uncertainty=EXACT)
    readings = noisy(skin, BALL.sliding(0.3), 0.01)
    skin.reconstruct(readings, method=pp.Constrained(friction=0.4))
    skin.reconstruct(readings, method=pp.Constrained(friction=0.5))
    assert prepared == ["Operator", "decompose", "decompose"]
    skin.reconstruct(readings, method=pp.Constrained(friction=0.4, parameter=1e-3))
    assert prepared == ["Operator", "decompose", "decompose"]


def test_what_is_kept_is_bounded() -> None:
    kept = Kept(entries=3)
    for i in range(10):
        assert kept.get(i, lambda i=i: i) == i  # type: ignore[misc]
    assert len(kept) == 3
    big = Kept(nbytes=100)
    for i in range(5):
        big.get(i, lambda: np.zeros(10))
    assert len(big) == 1
    skin = pp.Skin(PAD, LINE)
    readings = np.zeros((1, 31))
    for i in range(40):
        skin.reconstruct(readings, method=pp.Tikhonov(parameter=1.0 + i))
    assert len(skin._methods) <= 8
    again = pickle.loads(pickle.dumps(skin))
    np.testing.assert_array_equal(again.reconstruct(readings).values, skin.reconstruct(readings).values)


# -- every frame is decided alone --------------------------------------------------------------------------------------


def frames(skin: pp.Skin, contact: Any, rng: np.random.Generator, kinds: Sequence[str]) -> Any:
    clean = np.asarray(skin.sense(contact))
    size = float(np.abs(clean).max())
    out = []
    for kind in kinds:
        frame = 0.01 * size * rng.standard_normal(clean.shape)
        frame += {"push": 1.0, "light": 0.2, "pull": -1.0, "empty": 0.0, "dead": 1.0, "zero": 0.0}[kind] * clean
        if kind == "dead":
            frame[..., 3] = 3.0 * size
        out.append(np.zeros_like(frame) if kind == "zero" else frame)
    return np.stack(out)


KINDS = ("push", "light", "pull", "empty", "dead", "zero")


def same(batch: pp.Touch, index: int, alone: pp.Touch) -> None:
    """Frame ``index`` of a batch is the touch of that frame alone: to rounding of matrix products of other shapes."""
    assert batch.methods[index] == alone.method
    for name in ("values", "parameter", "noise_std", "residual", "converged", "touching", "outliers", "resolution"):
        whole, one = getattr(batch, name), getattr(alone, name)
        if one is None:  # the method that found this frame has no such thing
            filler = {"converged": True, "touching": True, "outliers": False, "resolution": np.nan, "residual": np.nan}
            assert whole is None or np.array_equal(np.unique(whole[index]), [filler[name]], equal_nan=True)
            continue
        np.testing.assert_allclose(
            np.asarray(whole)[index], one, rtol=1e-9, atol=1e-9 * max(float(np.nan_to_num(np.abs(one)).max()), 1e-300),
            err_msg=name,
        )  # fmt: skip


@pytest.mark.parametrize("seed", [0, 1, 2])
@pytest.mark.long
def test_random_batches_chunks_and_orders(seed: int) -> None:
    rng = np.random.default_rng(seed)
    skin = pp.Skin(PAD, LINE)
    kinds = rng.choice(KINDS, size=7)
    whole = frames(skin, solutions.hertz_line(half_width=2.0, force=0.3), rng, kinds)
    together = skin.reconstruct(whole)
    alone = [skin.reconstruct(f) for f in whole]
    for i, one in enumerate(alone):
        same(together, i, one)
    order = rng.permutation(len(whole))
    mixed = skin.reconstruct(whole[order])
    for place, i in enumerate(order):
        same(mixed, place, alone[i])
    size = int(rng.integers(2, 5))
    for start in range(0, len(whole), size):
        chunk = skin.reconstruct(whole[start : start + size])
        for i in range(len(chunk.values)):
            same(chunk, i, alone[start + i])


@pytest.mark.parametrize("method", ["constrained", "tikhonov", "nnls", "hilgers"])
def test_other_methods_decide_alone_too(method: str) -> None:
    rng = np.random.default_rng(4)
    skin = pp.Skin(PAD, LINE)
    whole = frames(skin, solutions.hertz_line(half_width=2.0, force=0.3), rng, KINDS)
    together = skin.reconstruct(whole, method=method)
    for i, f in enumerate(whole):
        same(together, i, skin.reconstruct(f, method=method))


@pytest.mark.long
def test_a_pull_does_not_change_the_frames_beside_it() -> None:
    """One frame that pushes among ten that pull, and the other way round: each as it is alone."""
    rng = np.random.default_rng(1)
    skin = pp.Skin(PAD, LINE)
    contact = solutions.hertz_line(half_width=2.0, force=0.3)
    for kinds in (["push"] + ["pull"] * 4, ["pull"] + ["push"] * 4):
        whole = frames(skin, contact, rng, kinds)
        touch = skin.reconstruct(whole)
        forces = np.asarray(touch.force)[:, -1]
        np.testing.assert_allclose(forces, [0.3 if k == "push" else -0.3 for k in kinds], rtol=0.1)
        for i, f in enumerate(whole):
            same(touch, i, skin.reconstruct(f))


@pytest.mark.long
def test_a_frame_that_the_linear_method_answers_does_not_change_the_others() -> None:
    """Its interval and the notes on the frames beside it are those of each frame alone."""
    rng = np.random.default_rng(6)
    pad = pp.HalfSpace(youngs_modulus=1e5, poissons_ratio=0.5)
    channels = ["stress_xz", "stress_yz", "stress_zz"]
    skin = pp.Skin(pad, pp.AreaArray(shape=(6, 6), pitch=1e-3, depth=1e-3, channels=channels, noise=20.0))

    def ball(force: float, x: float, y: float, radius: float) -> Any:
        return np.asarray(skin.sense(solutions.hertz_point(contact_radius=radius, force=force).shifted(x, y)))

    edge = ball(0.3, 2.4e-3, 0.0, 1.5e-3) + 20.0 * rng.standard_normal((3, 6, 6))
    both = sum(s * ball(0.1, *rng.uniform(-2e-3, 2e-3, 2), 1e-3) for s in (1, -1, 1, -1))
    whole = np.stack([edge, both + 20.0 * rng.standard_normal(edge.shape)])
    touch, alone = skin.reconstruct(whole), [skin.reconstruct(f) for f in whole]
    assert touch.methods.tolist() == ["adaptive", "tikhonov"]
    for i, one in enumerate(alone):
        for of in ("force", "peak_pressure"):
            np.testing.assert_allclose([b[i] for b in touch.interval(0.95, of)], one.interval(0.95, of), rtol=1e-6)
        assert {note[:9] for note in one.notes} <= {note[:9] for note in touch.notes}
    assert "in 1 of 2 frames" in next(n for n in touch.notes if n.startswith("contact across the edge"))
    assert "in 1 of 2 frames" in next(n for n in touch.notes if n.startswith("an offset of the readings"))


@pytest.mark.long
def test_channels_noise_is_the_frames_own() -> None:
    """Frames whose channels are noisy in different ways, in one batch."""
    rng = np.random.default_rng(2)
    skin = pp.Skin(PAD, THREE)
    clean = np.asarray(skin.sense(BALL.sliding(0.3)))
    size = 0.005 * float(np.abs(clean).max())
    levels = [(1.0, 1.0, 8.0), (1.0, 1.0, 1.0), (8.0, 8.0, 1.0)]
    whole = np.stack([clean + size * np.array(n)[:, None, None] * rng.standard_normal(clean.shape) for n in levels])
    touch = skin.reconstruct(whole, method="constrained", friction=0.5)
    for i, f in enumerate(whole):
        same(touch, i, skin.reconstruct(f, method="constrained", friction=0.5))
    assert touch.noise_std is not None
    assert np.ptp(touch.noise_std[0]) > 3 * size
    assert np.ptp(touch.noise_std[1]) < size


@pytest.mark.long
def test_draws_do_not_depend_on_the_batch() -> None:
    skin = pp.Skin(PAD, replace(LINE, noise=1e-3))
    rng = np.random.default_rng(3)
    whole = frames(skin, solutions.hertz_line(half_width=2.0, force=0.3), rng, ["push", "light", "push"])
    together = skin.reconstruct(whole, draws=3).draws
    for i, f in enumerate(whole):
        np.testing.assert_allclose(together[i], skin.reconstruct(f, draws=3).draws, atol=1e-9 * np.abs(together).max())
    shared, one = (np.random.default_rng(9) for _ in range(2))
    together = skin.reconstruct(whole, draws=3, rng=shared).draws
    for i, f in enumerate(whole):
        np.testing.assert_allclose(
            together[i], skin.reconstruct(f, draws=3, rng=one).draws, atol=1e-9 * np.abs(together).max()
        )


@pytest.mark.parametrize("noise", [None, 20.0])
def test_the_residual_is_in_units_of_the_noise_that_the_result_names(noise: float | None) -> None:
    """Root mean square of readings less predicted ones over `noise_std`, by every method, with contact and without."""
    rng = np.random.default_rng(0)
    pad = pp.HalfSpace(youngs_modulus=1e5, poissons_ratio=0.5)
    skin = pp.Skin(
        pad, pp.LineArray(count=21, pitch=1e-3, depth=1e-3, channels=["stress_xz", "stress_zz"], noise=noise)
    )
    press = np.asarray(skin.sense(solutions.hertz_line(half_width=3e-3, force=10.0)))
    for size, method in ((1.0, "tikhonov"), (0.0, "tikhonov"), (1.0, "tv"), (0.0, "constrained")):
        readings = size * press + 20.0 * rng.standard_normal(press.shape)
        touch = skin.reconstruct(readings, method=method, components=["x", "z"])
        left = np.asarray(readings - skin.sense(np.nan_to_num(touch.values))) / np.asarray(touch.noise_std)[:, None]
        assert float(touch.residual) == pytest.approx(np.sqrt(np.mean(left**2)), rel=1e-2), (method, size)
    touch = skin.reconstruct(press + 20.0 * rng.standard_normal(press.shape), method="local", components=["x", "z"])
    assert touch.methods.item() == "local"
    assert 0.3 < float(touch.residual) < 1.5  # its cells are finer than the map's
