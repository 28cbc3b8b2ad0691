from __future__ import annotations

from typing import Any

import numpy as np
import pytest

import palpate as pp
from conftest import relative
from long_runs import long_runs
from palpate import solutions
from palpate.inverse import DifferencePrior, Regularised, SpectralPrior, choose_parameter, decompose, hilgers_prior
from palpate.inverse.linear.parameter import tikhonov, truncate
from palpate.sensing.operator import Operator
from palpate.sensing.uncertainty import EXACT

PAD = pp.HalfSpace(youngs_modulus=1.0, poissons_ratio=0.4)


# -- constant friction -----------------------------------------------------------------------------------------------


@pytest.mark.long
def test_constant_friction_off_centre_and_noisy(rng: np.random.Generator) -> None:
    array = pp.LineArray(count=121, pitch=0.5, depth=1.5, channels=["stress_zz"])
    contact = solutions.flat_punch_line(half_width=4.0, force=1.0).shifted(3.3)
    shear = solutions.strip(half_width=4.0, traction=-0.4 / 8.0, component="x").shifted(3.3)
    clean = sum(c.fields(PAD, ["stress_zz"], array.grid.x, 1.5) for c in (contact, shear))
    noisy = clean + 1e-3 * np.abs(clean).max() * rng.standard_normal((2, *clean.shape))
    touch = pp.Skin(PAD, array).reconstruct(noisy, method="constant_friction", friction=-0.4)
    np.testing.assert_allclose(touch.force[:, 0], -0.4, rtol=0.03)
    np.testing.assert_allclose(touch.force[:, 1], 1.0, rtol=0.02)
    width = touch.surface.cell * np.abs(touch.values[:, 0]).sum(axis=1) / np.abs(touch.values[:, 0]).max(axis=1) / 2
    np.testing.assert_allclose(width, 4.0, rtol=0.15)


# -- direct methods ----------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    "array",
    [
        pp.LineArray(count=40, pitch=0.5, depth=1.0, channels=["stress_xz", "stress_zz"]),
        pp.LineArray(count=41, pitch=0.5, depth=1.0, channels=["stress_xz", "stress_zz", "strain_xz"]),
        pp.AreaArray(shape=(9, 8), pitch=0.5, depth=0.8, channels=["stress_xz", "stress_yz", "stress_zz"]),
    ],
)
def test_linear_inverts_its_own_model(array: Any, rng: np.random.Generator) -> None:
    """General shear and pressure from two (or three) components; square and overdetermined."""
    from palpate.sensing.operator import sampled_kernel

    true = rng.standard_normal((2, len(array.grid.components), *array.shape))
    readings = sampled_kernel(PAD, array).forward(true)[0]
    touch = pp.Skin(PAD, array).reconstruct(readings, method="linear")
    assert relative(touch.values, true) < 1e-8
    assert touch.surface.shape == array.shape


@pytest.mark.parametrize("count", [40, 41])
def test_dft_divides_exactly(count: int, rng: np.random.Generator) -> None:
    """Circularly convolved data come back to rounding, on even and odd arrays."""
    from palpate.inverse.paper.division import _wrapped_spectrum
    from palpate.sensing.operator import sampled_kernel

    array = pp.LineArray(count=count, pitch=0.5, depth=0.6, channels=["stress_xz", "stress_zz"])
    kernel = sampled_kernel(PAD, array).planes[0].kernel  # type: ignore[attr-defined]
    true = rng.standard_normal((2, count))
    spectrum = np.einsum("cpk,pk->ck", _wrapped_spectrum(kernel, (count,)), np.fft.rfft(true))
    touch = pp.Skin(PAD, array).reconstruct(np.fft.irfft(spectrum, count), method="dft")
    assert relative(touch.values, true) < 1e-9


def test_two_planes_tell_pressure_from_shear() -> None:
    """The paper's open problem: general tangential traction from one channel at two depths."""
    planes = [pp.LineArray(count=121, pitch=0.5, depth=d, channels=["stress_zz"]) for d in (1.0, 2.0)]
    skin = pp.Skin(PAD, planes)
    assert skin.components == ("x", "z")
    contact = solutions.hertz_line(half_width=4.0, force=1.0).partial_slip(0.5, 0.3)
    touch = skin.reconstruct(skin.sense(contact), components=["x", "z"])
    assert relative(touch.values, skin.sample(contact)) < 0.05
    np.testing.assert_allclose(touch.force, [0.3, 1.0], atol=0.01)


# -- the regularised family against textbook formulas with dense matrices ----------------------------------------------


def small() -> tuple[Operator, np.ndarray, np.ndarray]:
    array = pp.LineArray(count=14, pitch=0.5, depth=0.6, channels=["stress_zz", "stress_xz"], noise=[0.02, 0.03])
    op = Operator(PAD, [array], pp.LineGrid(count=17, spacing=0.5), "free")
    weights = 1 / np.repeat([0.02, 0.03], 14)
    return op, op.dense(), weights


@pytest.mark.parametrize("order", [0, 1, 2])
def test_tikhonov_is_the_minimiser(order: int, rng: np.random.Generator) -> None:
    """min |(A t - y)/sigma|^2 + lambda dx sum |D^m t|^2 with D the difference with zero beyond the edge."""
    op, dense, weights = small()
    n, dx = 17, 0.5
    gradient = (np.eye(n + 1, n) - np.eye(n + 1, n, k=-1)) / dx
    penalty = {0: np.eye(n), 1: gradient.T @ gradient, 2: (gradient.T @ gradient) @ (gradient.T @ gradient)}[order]
    y = rng.standard_normal(28)
    a = dense * weights[:, None]
    expected = np.linalg.solve(a.T @ a + 0.7 * dx * np.kron(np.eye(2), penalty), a.T @ (weights * y))
    solver = Regularised(decompose(op, [DifferencePrior(op.surface, order)] * 2, [0, 1]), tikhonov, 0.7)
    found = solver.solve([y.reshape(2, 14)]).traction
    np.testing.assert_allclose(found.ravel(), expected, rtol=1e-9, atol=1e-12)


def test_truncation_is_the_truncated_svd(rng: np.random.Generator) -> None:
    op, dense, weights = small()
    y = rng.standard_normal(28)
    u, s, vt = np.linalg.svd(dense * weights[:, None], full_matrices=False)
    cell_scale = 1 / 0.5  # the order-0 prior covariance, 1/dx
    cut = 0.5 * (s[9] ** 2 + s[10] ** 2) * cell_scale
    expected = vt[:10].T @ ((u.T @ (weights * y))[:10] / s[:10])
    solver = Regularised(decompose(op, [DifferencePrior(op.surface, 0)] * 2, [0, 1]), truncate, cut)
    np.testing.assert_allclose(solver.solve([y.reshape(2, 14)]).traction.ravel(), expected, rtol=1e-8, atol=1e-11)


def test_wiener_is_the_conditional_mean(rng: np.random.Generator) -> None:
    """E[t | y] = W A' (A W A' + N)^-1 y, W with the given spectrum's correlation function."""
    op, dense, weights = small()
    spectra = [lambda k: 0.3 * np.exp(-((k * 0.8) ** 2)), lambda k: 1.0 / (1 + (k * 1.5) ** 4)]
    priors = [SpectralPrior(op.surface, s) for s in spectra]
    covariance = np.zeros((34, 34))
    for i, spectrum in enumerate(spectra):
        # correlation on a domain twice as wide, as documented: (1/L) sum S(k) cos(k x)
        n = 34
        k = 2 * np.pi * np.fft.fftfreq(n, 0.5)
        lag = np.arange(17)[:, None] - np.arange(17)[None, :]
        covariance[17 * i : 17 * i + 17, 17 * i : 17 * i + 17] = (
            spectrum(np.abs(k)) * np.cos(k * lag[..., None] * 0.5)
        ).sum(-1) / (n * 0.5)
    y = rng.standard_normal(28)
    inner = dense @ covariance @ dense.T + np.diag(weights**-2.0)
    expected = covariance @ dense.T @ np.linalg.solve(inner, y)
    found = Regularised(decompose(op, priors, [0, 1]), tikhonov, 1.0).solve([y.reshape(2, 14)]).traction
    np.testing.assert_allclose(found.ravel(), expected, rtol=1e-8, atol=1e-10)


def test_hilgers_prior_is_the_sobolev_kernel() -> None:
    """Far from the ends of its periodic domain the kernel is exp(-|x|/l)/2 per unit length."""
    grid = pp.LineGrid(count=400, spacing=0.05)
    point = np.zeros(400)
    point[200] = 1.0
    found = hilgers_prior(grid, 1.0).covariance(point)
    expected = 0.5 * np.exp(-np.abs(grid.x - grid.x[200]))
    np.testing.assert_allclose(found[150:250], expected[150:250], atol=0.01)


@pytest.mark.parametrize("boundary", ["free", "periodic"])
@pytest.mark.parametrize("filter_factors", [tikhonov, truncate])
@pytest.mark.parametrize("rule", ["gcv", "discrepancy", "evidence", "lcurve"])
@pytest.mark.long
def test_rules_find_the_extremum_of_their_definition(
    rule: str, filter_factors: Any, boundary: Any, rng: np.random.Generator
) -> None:
    """Score the definition with dense matrices over a scan of the parameter; the closed form must be as good."""
    if rule == "evidence" and filter_factors is truncate:
        with pytest.raises(pp.Unsupported, match="gcv"):
            choose_parameter(rule, truncate, np.ones(3), np.ones(3), np.ones((1, 3)), noise_known=True)
        return
    array = pp.LineArray(count=24, pitch=0.5, depth=0.6, channels=["stress_zz"], noise=0.01)
    surface = array.grid if boundary == "periodic" else pp.LineGrid(count=30, spacing=0.5)
    op = Operator(PAD, [array], surface, boundary)
    true = np.stack([np.zeros(surface.count), np.exp(-(surface.x**2))])
    y = op.forward(true)[0] + 0.01 * rng.standard_normal((1, 24))
    prior = DifferencePrior(surface, 0)
    solver = Regularised(decompose(op, [prior], [1]), filter_factors, rule)
    chosen = float(np.ravel(solver.solve([y]).parameter)[0])

    a = op.dense()[:, surface.count :] / 0.01
    data = y[0] / 0.01
    u, s, _ = np.linalg.svd(a)
    c, s2 = u.T @ data, np.concatenate([s**2, np.zeros(24 - len(s))]) / surface.cell

    def parts(value: float) -> tuple[float, float, np.ndarray]:
        phi = filter_factors(s2, np.array(value))
        safe = np.where(s2 > 0, s2, 1.0)
        return float(((1 - phi) ** 2 * c**2).sum()), float((phi**2 * c**2 / safe).sum()), phi

    def score(value: float) -> float:
        residual, _, phi = parts(value)
        if rule == "gcv":
            return 24 * residual / (1 - phi).sum() ** 2
        if rule == "discrepancy":
            return abs(np.log(residual / 24))
        if rule == "lcurve":
            h = 0.05

            def point(t: float) -> np.ndarray:
                r, p, _ = parts(float(np.exp(t)))
                return np.array([np.log(r), np.log(p)])

            t = np.log(value)
            first, second = (point(t + h) - point(t - h)) / (2 * h), (point(t + h) - 2 * point(t) + point(t - h)) / h**2
            speed = np.hypot(*first) ** 3
            return float(-(first[0] * second[1] - first[1] * second[0]) / max(speed, 1e-30))
        return float((c**2 * (1 - phi)).sum() - np.log(np.maximum(1 - phi, 1e-300)).sum())

    if filter_factors is truncate:
        kept = int((s2 > chosen).sum())
        assert 1 <= kept <= 24
        if rule == "lcurve":
            return  # a discrete curve has no curvature to compare with
        levels = np.unique(s2)[:-1] * (1 + 1e-9)
        assert score(chosen) <= min(score(v) for v in levels if (1 - filter_factors(s2, v)).sum() > 0) * (1 + 1e-9)
        return
    scan = np.geomspace(s2[s2 > 1e-14 * s2.max()].min() * 2, s2.max() / 2, 2000)
    best = min(score(v) for v in scan)
    spread = max(score(v) for v in scan) - best
    assert score(chosen) - best < 0.02 * spread


@pytest.mark.parametrize("layout", ["even", "odd", "rectangular"])
def test_symmetry_blocks_change_nothing(layout: str, rng: np.random.Generator, monkeypatch: pytest.MonkeyPatch) -> None:
    shape = {"even": (6, 8), "odd": (5, 7), "rectangular": (6, 5)}[layout]
    array = pp.AreaArray(
        shape=shape,
        pitch=(0.5, 0.4),
        depth=0.5,
        channels=["stress_xz", "stress_yz", "stress_zz", "strain_xy"],
        noise=0.01,
    )
    y = rng.standard_normal((2, 4, *shape)) * 0.1
    whole = pp.Skin(PAD, array, uncertainty=EXACT).reconstruct(y, order=1, parameter="evidence")
    monkeypatch.setattr("palpate.inverse.linear.spectrum.LARGEST_SVD", 10)
    split = pp.Skin(PAD, array, uncertainty=EXACT)
    found = split.reconstruct(y, order=1, parameter="evidence")
    solver = pp.Tikhonov().prepare(split.problem())
    assert len(solver.spectrum.blocks) == 4
    np.testing.assert_allclose(found.parameter, whole.parameter, rtol=1e-6)
    np.testing.assert_allclose(found.values, whole.values, atol=1e-7 * np.abs(whole.values).max())


@pytest.mark.long
@pytest.mark.parametrize("boundary", ["free", "periodic"])
def test_noise_is_estimated(boundary: Any, rng: np.random.Generator) -> None:
    array = pp.LineArray(count=120, pitch=0.5, depth=1.0, channels=["stress_zz"])
    skin = pp.Skin(PAD, array, boundary=boundary)
    contact = solutions.hertz_line(half_width=5.0, force=1.0)
    clean = contact.fields(PAD, ["stress_zz"], array.grid.x, 1.0)
    touch = skin.reconstruct(clean + 1e-3 * rng.standard_normal((15, *clean.shape)))
    assert np.median(touch.noise_std) == pytest.approx(1e-3, rel=0.1)


# -- every method on every layout it can serve, and a refusal with a remedy elsewhere ----------------------------------

ARRAYS: dict[str, Any] = {
    "line": pp.LineArray(count=30, pitch=0.5, depth=0.8, channels=["stress_zz"], noise=1e-3),
    "area": pp.AreaArray(shape=(12, 13), pitch=0.5, depth=0.8, channels=["stress_zz"], noise=1e-3),
    "scattered": pp.ScatteredArray(
        positions=np.random.default_rng(2).uniform(-3, 3, (120, 2)), depth=0.8, channels=["stress_zz"], noise=1e-3
    ),
    "masked": pp.AreaArray(
        shape=(12, 13),
        pitch=0.5,
        depth=0.8,
        channels=["stress_zz"],
        noise=1e-3,
        mask=np.random.default_rng(3).uniform(size=(12, 13)) > 0.1,
    ),
}
METHODS: dict[str, dict[str, Any]] = {
    "tikhonov": {},
    "hilgers": {},
    "truncated": {},
    "wiener": {"spectrum": lambda k: 0.01 / (1 + k**4)},
    "dft": {},
    "linear": {},
    "constant_friction": {"friction": 0.3},
}
REFUSED = {("dft", "scattered"), ("dft", "masked"), ("linear", "scattered"), ("linear", "masked")} | {
    ("constant_friction", n) for n in ("area", "scattered", "masked")
}


@pytest.mark.parametrize("layout", list(ARRAYS))
@pytest.mark.parametrize("method", list(METHODS))
@pytest.mark.long
def test_every_method_on_every_layout(method: Any, layout: str, rng: np.random.Generator) -> None:
    skin = pp.Skin(PAD, ARRAYS[layout])
    contact = (
        solutions.hertz_line(half_width=3, force=1)
        if layout == "line"
        else solutions.hertz_point(contact_radius=2, force=1)
    )
    readings = skin.sense(contact, rng=rng)
    if (method, layout) in REFUSED:
        with pytest.raises(pp.Unsupported, match="method=") as error:
            skin.reconstruct(readings, method=method, **METHODS[method])
        assert "use" in str(error.value).lower() or "seek" in str(error.value)
        return
    touch = skin.reconstruct(readings, method=method, **METHODS[method])
    assert np.isfinite(touch.values).all()
    if method not in ("dft", "linear"):  # these two amplify the noise; their force is still right
        assert relative(touch.values, skin.sample(contact)) < (0.5 if method == "constant_friction" else 0.35)
    assert touch.force[-1] == pytest.approx(1.0, rel=0.1)


@pytest.mark.parametrize("method", ["tikhonov", *long_runs("wiener", "hilgers", "truncated")])
@pytest.mark.long
def test_periodic_and_free_agree_far_from_the_edge(method: Any, rng: np.random.Generator) -> None:
    array = pp.AreaArray(
        shape=(20, 21), pitch=0.5, depth=0.6, channels=["stress_xz", "stress_yz", "stress_zz"], noise=1e-3
    )
    contact = solutions.hertz_point(contact_radius=2.0, force=1.0).sliding(0.4, direction=0.3)
    skins = [pp.Skin(PAD, array, surface=array.grid), pp.Skin(PAD, array, boundary="periodic")]
    readings = skins[0].sense(contact, rng=rng)
    options = METHODS[method] if method == "wiener" else {}
    found = [s.reconstruct(readings, method=method, **options) for s in skins]
    truth = skins[0].sample(contact)
    assert relative(found[0].values, truth) < 0.35
    middle = (..., slice(6, -6), slice(6, -6))
    assert relative(found[1].values[middle], found[0].values[middle]) < 0.15
    # cut off at the array's edge, the periodic surface loses part of the shear; the free one does not
    np.testing.assert_allclose(found[0].force, contact.force, atol=0.02)


def test_options_are_never_ignored() -> None:
    skin = pp.Skin(PAD, ARRAYS["line"])
    readings = np.zeros((1, 30))
    for options in (
        {"method": "dft", "parameter": 1.0},
        {"method": "linear", "order": 1},
        {"method": "tikhonov", "friction": 0.5},
        {"method": "hilgers", "order": 1},
        {"method": "truncated", "spectrum": np.abs},
        {"method": "wiener", "parameter": "gcv", "spectrum": np.abs},
    ):
        with pytest.raises(pp.Unsupported, match="does not take"):
            skin.reconstruct(readings, **options)  # type: ignore[arg-type]
    with pytest.raises(pp.InvalidInput, match="method must be one of"):
        skin.reconstruct(readings, method="magic")  # type: ignore[arg-type]
    with pytest.raises(pp.InvalidInput, match="evidence, gcv"):
        skin.reconstruct(readings, parameter="best")
    with pytest.raises(pp.InvalidInput, match="parameter"):
        skin.reconstruct(readings, parameter=-1.0)
    with pytest.raises(pp.InvalidInput, match="order"):
        skin.reconstruct(readings, order=3)
    with pytest.raises(pp.InvalidInput, match="spectrum"):
        skin.reconstruct(readings, method="wiener")
    with pytest.raises(pp.InvalidInput, match="finite densities"):
        skin.reconstruct(readings, method="wiener", spectrum=lambda k: -k)
    with pytest.raises(pp.InvalidInput, match="friction"):
        skin.reconstruct(readings, method="constant_friction")
    quiet = pp.Skin(PAD, pp.LineArray(count=30, pitch=0.5, depth=0.8, channels=["stress_zz"]))
    with pytest.raises(pp.Unsupported, match="needs the noise"):
        quiet.reconstruct(readings, method="wiener", spectrum=lambda k: 1 / (1 + k**2))
    with pytest.raises(pp.Unsupported, match="needs the noise"):
        quiet.reconstruct(readings, parameter="discrepancy")


# -- what can be seen --------------------------------------------------------------------------------------------------


def components(nu: float, *planes: Any) -> tuple[str, ...]:
    return pp.Skin(pp.HalfSpace(youngs_modulus=1.0, poissons_ratio=nu), list(planes)).components


def test_default_components() -> None:
    line = lambda d, *c: pp.LineArray(count=9, pitch=1.0, depth=d, channels=c)  # noqa: E731
    area = lambda d, *c: pp.AreaArray(shape=(5, 5), pitch=1.0, depth=d, channels=c)  # noqa: E731
    assert components(0.3, line(1.0, "stress_zz")) == ("z",)
    assert components(0.3, line(1.0, "stress_zz", "stress_xz")) == ("x", "z")
    assert components(0.3, line(1.0, "stress_zz"), line(2.0, "stress_zz")) == ("x", "z")
    assert components(0.5, line(1.0, "strain_xx", "strain_zz")) == ("z",)  # e_xx = -e_zz: one equation
    assert components(0.3, line(1.0, "strain_xx", "strain_zz")) == ("x", "z")
    assert components(0.3, area(1.0, "stress_zz")) == ("z",)
    assert components(0.3, area(1.0, "stress_zz"), area(2.0, "stress_zz")) == ("z",)  # shear across k leaves no trace
    assert components(0.3, area(1.0, "stress_xz", "stress_yz", "stress_zz")) == ("x", "y", "z")
    assert components(0.5, area(0.0, "displacement_x", "displacement_y")) == ("x", "y")
    assert components(0.5, area(0.0, "displacement_z")) == ("z",)
    assert components(0.3, line(1.0, "stress_xz")) == ("x",)
    assert components(0.3, area(1.0, "stress_yz")) == ("y",)
    assert components(0.5, line(0.0, "displacement_x")) == ("x",)


def test_what_cannot_be_seen_is_refused() -> None:
    skin = pp.Skin(PAD, pp.LineArray(count=20, pitch=0.5, depth=0.8, channels=["stress_zz"]))
    with pytest.raises(pp.NotObservable, match="second plane"):
        skin.reconstruct(np.zeros((1, 20)), components=["x", "z"], method="tikhonov")
    area = pp.Skin(PAD, [pp.AreaArray(shape=(6, 6), pitch=0.5, depth=d, channels=["stress_zz"]) for d in (0.5, 1.0)])
    with pytest.raises(pp.NotObservable, match="three independent"):
        area.reconstruct(np.zeros((2, 6, 6)), components=["x", "y", "z"], method="tikhonov")


def test_condition_of_each_wavelength() -> None:
    """det of (q, p) -> (s_xz, s_zz) is e^{-2kz} at every k: well conditioned, better than two planes close together."""
    both = pp.Skin(PAD, pp.LineArray(count=20, pitch=0.5, depth=1.0, channels=["stress_xz", "stress_zz"], noise=1.0))
    found = both.observability([0.5, 2.0, 50.0])
    k = 2 * np.pi / np.array([0.5, 2.0, 50.0])
    np.testing.assert_allclose(found.singular_values.prod(axis=1), np.exp(-2 * k), rtol=1e-9)
    planes = [pp.LineArray(count=20, pitch=0.5, depth=d, channels=["stress_zz"], noise=1.0) for d in (1.0, 1.1)]
    assert (pp.Skin(PAD, planes).observability([2.0, 50.0]).condition > found.condition[1:]).all()
    alone = pp.Skin(PAD, planes[0]).observability([2.0], components=["x", "z"])
    assert np.isinf(alone.condition).all()


def test_notes_say_what_was_assumed() -> None:
    skin = pp.Skin(PAD, pp.LineArray(count=20, pitch=0.5, depth=0.8, channels=["stress_zz"]))
    touch = skin.reconstruct(np.zeros((1, 20)))
    assert "shear along x taken as zero" in touch.assumed[0]
    with pytest.raises(pp.NotObservable, match="not sought"):
        touch.slip_margin(0.5)
    strain = pp.Skin(
        pp.HalfSpace(youngs_modulus=1.0, poissons_ratio=0.5),
        pp.LineArray(count=20, pitch=0.5, depth=0.8, channels=["strain_zz"]),
    )
    assert any("net force" in n for n in strain.reconstruct(np.zeros((1, 20))).notes)


# -- net force ---------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("nu", [0.3, *long_runs(0.5)])
@pytest.mark.parametrize(
    "channels",
    [*long_runs(["displacement_x", "displacement_y"]), ["displacement_x", "displacement_y", "displacement_z"]],
)
@pytest.mark.long
def test_net_force_from_displacement(channels: list[str], nu: float) -> None:
    """A single off-centre sheared patch, its displacement by closed form: the net force within 1 %, not zero."""
    body = pp.HalfSpace(youngs_modulus=1e4, poissons_ratio=nu)
    array = pp.AreaArray(shape=(20, 21), pitch=1e-4, depth=0.0, channels=channels)
    block = solutions.patch(half_widths=(3.1e-4, 2.4e-4), traction=500.0, component="x").shifted(3e-4, -2e-4)
    readings = block.fields(body, channels, array.grid.x, array.grid.y[:, None], 0.0)
    # shear without pressure: cells that pull, not contact that pushes, so the linear method
    touch = pp.Skin(body, array, nuisance=[]).reconstruct(readings, method="tikhonov")
    np.testing.assert_allclose(touch.force / block.force[0], [1, 0, 0], atol=0.01)
    if len(channels) == 2:  # an image may drift, if nobody says that it does not
        low, high = pp.Skin(body, array).reconstruct(readings, method="tikhonov").interval(0.95, "force")
        assert low[0] < block.force[0] < high[0]


def test_net_force_that_cannot_be_known_is_not_a_number() -> None:
    array = pp.AreaArray(shape=(8, 8), pitch=1e-4, depth=0.0, channels=["displacement_x", "displacement_y"])
    touch = pp.Skin(PAD, array, boundary="periodic").reconstruct(np.zeros((2, 8, 8)))
    assert np.isnan(touch.force[:2]).all()
    assert any("net force" in n for n in touch.notes)
