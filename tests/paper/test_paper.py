"""The founding paper: every figure's curves against closed forms or stated values, its errors, its formulas."""

from __future__ import annotations

import csv
import importlib
import io
import math
import re
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import palpate as pp
from conftest import relative
from palpate import paper
from palpate.paper import algorithm, cases, formulas, studies, tables
from palpate.paper.pictures import PaperFigure

ROOT = Path(__file__).resolve().parents[2]
Z = 1.5
A, P = paper.HALF_WIDTH + paper.EPS, paper.LOAD


@pytest.fixture(scope="module")
def figures() -> dict[Any, PaperFigure]:
    return {f.number: f for f in paper.figures()}


@pytest.fixture(scope="module")
def found() -> tables.Results:
    return tables.results()


def k1(what: str, z: float, y: Any) -> Any:
    r4 = (y**2 + z**2) ** 2
    return 2 * z**3 / (np.pi * r4) if what == "stress" else 3 * z * (z**2 - y**2) / (2 * np.pi * r4)


def k2(what: str, z: float, y: Any) -> Any:
    r4 = (y**2 + z**2) ** 2
    return 2 * z**2 * y / (np.pi * r4) if what == "stress" else 3 * y * (z**2 - y**2) / (2 * np.pi * r4)


def hertz(y: Any) -> Any:
    return np.where(np.abs(y) <= 3.5, 2 * P / (np.pi * A**2) * np.sqrt(np.maximum(A**2 - y**2, 0)), 0.0)


def rectangle(y: Any) -> Any:
    return np.where(np.abs(y) <= 3.5, P / (np.pi * np.sqrt(np.maximum(A**2 - y**2, 1e-9))), 0.0)


def superposed(kernel: Any, what: str, y: Any, load: Any) -> Any:
    """The discrete form of the paper's equations 4 and 8, sample by sample."""
    return np.array([0.5 * np.sum(kernel(what, Z, a - y) * load) for a in y])


# -- the figures -------------------------------------------------------------------------------------------------------


def test_the_list_of_figures(figures: dict[Any, PaperFigure]) -> None:
    """1 to 22; 1 and 8 are sketches; everything else has its data and keeps inside the paper's axes."""
    assert sorted(figures) == list(range(1, 23))
    assert {n for n, f in figures.items() if f.sketch is not None} == {1, 8}
    for number, figure in figures.items():
        assert (not figure.panels) == (number in (1, 8))
        for panel in figure.panels:
            for name, values in panel.curves.items():
                assert values.shape == panel.x.shape
                inside = (values >= panel.y_range[0]) & (values <= panel.y_range[1])
                assert inside.all(), (number, name, values.min(), values.max())


@pytest.mark.parametrize(
    ("numbers", "x", "y"),
    [
        ((4, 6), None, (0.0, 1.0)),
        ((5, 7), None, (0.0, 0.6)),
        ((4, 5), (-5.0, 5.0), None),
        ((6, 7), (-60.0, 60.0), None),
        ((9,), (-30.0, 30.0), (0.0, 0.15)),
        ((10, 12), (-30.0, 30.0), (-0.01, 0.14)),
        ((11,), (-30.0, 30.0), (-0.02, 0.13)),
        ((13,), (-30.0, 30.0), (0.0, 0.4)),
        ((14, 15, 16, 17, 18, 19, 20), (-30.0, 30.0), (-0.1, 0.4)),
        ((21, 22), (-10.0, 10.0), (-0.01, 0.14)),
    ],
)
def test_axes(figures: dict[Any, PaperFigure], numbers: tuple[int, ...], x: Any, y: Any) -> None:
    for number in numbers:
        (panel,) = figures[number].panels
        assert x is None or panel.x_range == x
        assert y is None or panel.y_range == y


@pytest.mark.parametrize(("number", "what"), [(2, "stress"), (3, "strain")])
def test_kernels(figures: dict[Any, PaperFigure], number: int, what: str) -> None:
    for panel, kernel in zip(figures[number].panels, (k1, k2)):
        assert panel.x_range == (-8.0, 8.0)
        assert panel.x[[0, -1]].tolist() == [-8.0, 8.0]
        for z in (1.0, 2.0):
            np.testing.assert_allclose(panel.curves[f"z = {z:g}"], kernel(what, z, panel.x), rtol=1e-11, atol=1e-15)


def test_transforms(figures: dict[Any, PaperFigure]) -> None:
    """4 and 5: 1 and 0 at 0. 6 and 7: sums of cosines; at k = 0 the strain's is what lies beyond the array, with its sign turned."""
    w = figures[4].panels[0].x
    stress, strain = (next(iter(figures[n].panels[0].curves.values())) for n in (4, 5))
    np.testing.assert_allclose(stress, (1 + np.abs(w) * Z) * np.exp(-np.abs(w) * Z), rtol=1e-12)
    np.testing.assert_allclose(strain, 1.5 * np.abs(w) * Z * np.exp(-np.abs(w) * Z), rtol=1e-12, atol=1e-15)
    assert stress[w == 0] == 1.0
    assert strain[w == 0] == 0.0
    n = np.arange(-60, 61)
    for number, what in ((6, "stress"), (7, "strain")):
        panel = figures[number].panels[0]
        np.testing.assert_array_equal(panel.x, n)
        expected = [0.5 * np.sum(k1(what, Z, 0.5 * n) * np.cos(2 * np.pi * k * n / 121)) for k in n]
        np.testing.assert_allclose(next(iter(panel.curves.values())), np.abs(expected), atol=1e-14)
    tail = 3 * Z / np.pi * 30.25 / (30.25**2 + Z**2)  # -2 times the integral of K1 beyond the last cell's edge
    assert next(iter(figures[7].panels[0].curves.values()))[60] == pytest.approx(tail, rel=1e-3)


@pytest.mark.parametrize(
    ("numbers", "load", "errors"),
    [((9, 10, 11, 12), hertz, (1e-7, 4.04e-5)), ((13, 14, 15, 16), rectangle, (1e-7, 1.06e-4))],
)
def test_without_friction(
    figures: dict[Any, PaperFigure], numbers: Any, load: Any, errors: tuple[float, float]
) -> None:
    """Designed profiles, readings, and what is reconstructed: from strain within 1 % of the printed error, from stress 1e-7."""
    y = 0.5 * np.arange(-60, 61)
    for i, what in enumerate(("stress", "strain")):
        read, found = (figures[n].panels[0] for n in numbers[2 * i : 2 * i + 2])
        np.testing.assert_array_equal(read.x, y)
        for panel in (read, found):
            np.testing.assert_allclose(panel.curves["designed"], load(y), rtol=1e-13, atol=1e-16)
        np.testing.assert_allclose(read.curves[f"{what} at z = 1.5"], superposed(k1, what, y, load(y)), atol=1e-14)
        error = np.abs(found.curves["reconstructed"] - load(y)).mean()
        if what == "strain":
            assert error == pytest.approx(errors[1], rel=0.005)
        else:
            assert 1e-8 < error < errors[0]


def test_with_friction(figures: dict[Any, PaperFigure]) -> None:
    """Designed shear mu sum(F)/(2M) on 15 samples, mixed readings, and the reconstruction with M = 7 as found."""
    y = 0.5 * np.arange(-60, 61)
    normal = rectangle(y)
    shear = np.where(np.abs(y) <= 3.5, paper.FRICTION * normal.sum() / 14, 0.0)
    assert shear.sum() * 14 == pytest.approx(15 * paper.FRICTION * normal.sum())
    for number, what, limits in ((17, "stress", (2e-7, 3e-8)), (19, "strain", (7e-4, 6e-5))):
        read, found = figures[number].panels[0].curves, figures[number + 1].panels[0].curves
        for curves in (read, found):
            np.testing.assert_allclose(curves["designed vertical"], normal, rtol=1e-13)
            np.testing.assert_allclose(curves["designed tangential"], shear, rtol=1e-13)
        mixed = superposed(k1, what, y, normal) + superposed(k2, what, y, shear)
        np.testing.assert_allclose(read[f"{what} at z = 1.5"], mixed, atol=1e-14)
        assert 1e-9 < np.abs(found["reconstructed vertical"] - normal).mean() < limits[0]
        assert 1e-9 < np.abs(found["reconstructed tangential"] - shear).mean() < limits[1]
        np.testing.assert_array_equal(found["reconstructed tangential"] > 0, shear > 0)


def test_truncated(figures: dict[Any, PaperFigure]) -> None:
    """41 sensors under the cylinder: the readings are the middle of figure 9's and 11's; strain pays 10 times as much."""
    errors = []
    for number, full in ((21, 9), (22, 11)):
        panel = figures[number].panels[0]
        np.testing.assert_array_equal(panel.x, 0.5 * np.arange(-20, 21))
        np.testing.assert_allclose(panel.curves["designed"], hertz(panel.x), rtol=1e-13, atol=1e-16)
        readings = list(figures[full].panels[0].curves.values())[1][40:81]
        channel = {21: "stress_zz", 22: "strain_zz"}[number]
        np.testing.assert_allclose(panel.curves["reconstructed"], algorithm.divide(readings, channel), atol=1e-14)
        errors.append(np.abs(panel.curves["reconstructed"] - hertz(panel.x)).mean())
    assert errors[0] < 1e-4
    assert errors[1] > 10 * errors[0]


def test_data_of_every_figure_reads_back(figures: dict[Any, PaperFigure]) -> None:
    for figure in figures.values():
        if figure.panels:
            rows = list(csv.reader(io.StringIO(figure.table())))
            names = [name for panel in figure.panels for name in panel.curves]
            assert len(rows[0]) == len(names) + 1
            assert len(rows) == len(figure.panels[0].x) + 1
            last = list(figure.panels[-1].curves.values())[-1]
            np.testing.assert_array_equal([float(r[-1]) for r in rows[1:]], last)


@pytest.mark.parametrize("number", [1, 18])
def test_figures_are_drawn(figures: dict[Any, PaperFigure], number: int) -> None:
    picture = io.BytesIO()
    figures[number].draw().savefig(picture, dpi=50)
    assert picture.getvalue().startswith(b"\x89PNG")


# -- the errors --------------------------------------------------------------------------------------------------------


@pytest.mark.long
def test_printed_errors(found: tables.Results) -> None:
    """Strain as printed to three digits; stress within a factor of two with seven decimals; nothing left by the linear system."""
    for row in found.errors:
        printed = float(row["printed"])
        if row["channel"] == "strain_zz":
            assert f"{row['division']:.2e}" == f"{printed:.2e}"
        else:
            assert 1e-8 < row["division"] < 1e-7
            assert 0.5 < row["7 decimals"] / printed < 2
            assert 0.2 < row["slow transform, single"] / printed < 1
        assert row["linear system"] < 1e-13


@pytest.mark.long
def test_errors_with_friction(found: tables.Results) -> None:
    rows = {(r["component"], r["channel"]): r for r in found.friction}
    wide = {c: rows[c, "strain_zz"]["M one too wide"] for c in ("vertical", "tangential")}
    assert wide["tangential"] == pytest.approx(1.45e-3, rel=0.005)
    assert wide["vertical"] == pytest.approx(1.15e-3, rel=0.1)
    assert 3e-6 < rows["vertical", "stress_zz"]["M found, 7 decimals"] < 1e-5
    for row in rows.values():
        assert row["linear system"] < 1e-13
    for component in ("vertical", "tangential"):
        assert rows[component, "strain_zz"]["constant_friction"] < rows[component, "strain_zz"]["M found"]


def test_only_one_reading_keeps_to_the_axes(found: tables.Results) -> None:
    (kept,) = [r for r in found.profile_readings if r["keeps to the axes"] == "yes"]
    assert kept["half-width"] == paper.HALF_WIDTH
    assert kept["eps in"] == "both profiles"
    assert kept["eps"] == pytest.approx(paper.EPS, abs=5e-4)
    assert kept["load"] == pytest.approx(paper.LOAD, abs=5e-4)


def test_no_friction_explains_both_errors_with_m_right(found: tables.Results) -> None:
    rows = {(r["contact counted as"], r["M too wide by"]): r for r in found.friction_readings}
    assert rows["2M", 0]["friction"] > 10
    assert rows["2M", 0]["strain, vertical"] > 10 * 1.15e-3
    assert rows["2M", 1]["friction"] == pytest.approx(paper.FRICTION, abs=5e-4)


# -- the formulas ------------------------------------------------------------------------------------------------------


def test_every_equation_has_a_function() -> None:
    """Equations 1 to 26 without a gap, and every name leads to something that can be called."""
    covered: list[int] = []
    for equation in paper.EQUATIONS:
        first, _, last = equation.number.partition("–")
        covered += range(int(first), int(last or first) + 1)
        assert equation.functions
        for name in equation.functions:
            assert callable(_named(name)), name
    assert covered == list(range(1, 27))


def _named(name: str) -> Any:
    parts = name.split(".")
    for cut in range(len(parts) - 1, 0, -1):
        try:
            found: Any = importlib.import_module(".".join(parts[:cut]))
        except ModuleNotFoundError:
            continue
        for part in parts[cut:]:
            found = getattr(found, part)
        return found
    raise AssertionError(name)


def test_line_force_inclined() -> None:
    """Equations 1 to 3: the radial stress 2F cos(theta - alpha)/(pi r), turned to y and z."""
    force, alpha, y, z = 1.3, 0.4, np.array([-1.0, 0.2, 2.0]), 0.7
    theta, r = np.arctan2(y, z), np.hypot(y, z)
    radial = 2 * force * np.cos(theta - alpha) / (np.pi * r)
    found = formulas.line_force(y, z, vertical=force * np.cos(alpha), tangential=force * np.sin(alpha))
    expected = [radial * np.cos(theta) ** 2, radial * np.sin(theta) ** 2, radial * np.sin(theta) * np.cos(theta)]
    np.testing.assert_allclose(found, expected, rtol=1e-12)


def test_hooke_and_back() -> None:
    """Equations 5 to 7; at nu = 0.5 the two strains are opposite, three quarters of the difference of the stresses."""
    rng = np.random.default_rng(0)
    zz, xx = rng.standard_normal((2, 5))
    e_zz, e_xx = formulas.plane_strain(zz, xx, youngs_modulus=3.0, poissons_ratio=0.3)
    np.testing.assert_allclose(e_zz, (0.91 * zz - 0.39 * xx) / 3.0, rtol=1e-12)
    along = formulas.hooke([zz, xx, 0.3 * (zz + xx)], youngs_modulus=3.0, poissons_ratio=0.3)[2]
    np.testing.assert_allclose(along, 0.0, atol=1e-15)
    back = pp.elastic.stress_from_strains(e_xx, e_zz, youngs_modulus=3.0, poissons_ratio=0.3)
    np.testing.assert_allclose(back, [xx, zz], rtol=1e-12)
    e_zz, e_xx = formulas.plane_strain(zz, xx, youngs_modulus=1.0, poissons_ratio=0.5)
    np.testing.assert_allclose(e_zz, 0.75 * (zz - xx), rtol=1e-12)
    np.testing.assert_allclose(e_xx, -e_zz, rtol=1e-12)
    with pytest.raises(pp.InvalidInput, match="three normal stresses"):
        formulas.hooke([1.0, 2.0], youngs_modulus=1.0, poissons_ratio=0.3)


@pytest.mark.parametrize("channel", ["stress_zz", "strain_zz"])
def test_transform_divided_in_the_continuum(channel: str) -> None:
    """Equations 11 and 12 with Hertz's pressure, whose transform is 2 P J1(w a)/(w a)."""
    from scipy.special import j1

    w = (np.arange(-10_000, 10_000) + 0.5) * 0.02
    pressure = 2 * j1(w * 2.0) / (w * 2.0)
    reading = pressure * formulas.kernel_transforms(channel, 0.05, w)[0]
    y = np.array([0.0, 0.5, 1.5, 3.0])
    found = formulas.inverse_transform(reading, channel, 0.05, w, y)
    expected = 2 / (math.pi * 2.0) * np.sqrt(np.maximum(1 - (y / 2.0) ** 2, 0))
    np.testing.assert_allclose(found, expected, atol=2e-4)


@pytest.mark.parametrize("channel", ["stress_zz", "strain_zz"])
def test_the_papers_steps_are_the_librarys(channel: str) -> None:
    """Division and the linear system as the library has them; the kernel as it samples it."""
    true, readings = paper.data("punch", channel, 41)
    skin = pp.Skin(paper.PAD, paper.array([channel], 41))
    for solve, touch in (
        (algorithm.divide, skin.reconstruct(readings, method="dft", components=["z"])),
        (algorithm.solve_linear, skin.reconstruct(readings, method="linear", components=["z"])),
    ):
        np.testing.assert_allclose(solve(readings[0], channel), touch.values[1], atol=1e-12)
    assert algorithm.net_pressure(readings[0], channel) == pytest.approx(algorithm.divide(readings[0], channel).sum())
    assert relative(algorithm.solve_linear(readings[0], channel), true[1]) < 1e-12


def test_half_width_and_its_limits() -> None:
    pressure = np.zeros(21)
    pressure[7:14] = 1.0
    assert algorithm.half_width(pressure) == 3
    with pytest.raises(pp.InvalidInput, match="no sample of the pressure is positive"):
        algorithm.half_width(np.zeros(21))
    with pytest.raises(pp.InvalidInput, match="odd length"):
        algorithm.divide(np.zeros(20), "stress_zz")


def test_shear_turned_round() -> None:
    """Readings in a mirror: the same pressure mirrored, shear of the other sign."""
    _, readings = paper.data("punch with friction", "stress_zz")
    here = algorithm.sliding(readings[0], "stress_zz", paper.FRICTION).traction
    there = algorithm.sliding(readings[0, ::-1], "stress_zz", -paper.FRICTION).traction
    np.testing.assert_allclose(there, here[:, ::-1] * [[-1.0], [1.0]], atol=1e-11)


# -- what the paper says, and the page of the documentation ----------------------------------------------------------------


def test_the_documentation_holds_what_is_found(figures: dict[Any, PaperFigure], found: tables.Results) -> None:
    """The tables of docs/paper.md are those that are computed; where the machine or rounding has a part, to 10 %."""
    text = (ROOT / "docs" / "paper.md").read_text()
    timed = {c.says for c in found.claims if c.timed}
    for name in ("errors", "friction", "profile_readings", "friction_readings", "formulas", "claims"):
        match = re.search(rf"<!-- table {name} -->\n(.*?)<!-- end -->", text, flags=re.DOTALL)
        assert match is not None, name
        fresh = tables.to_markdown(found.text(name)).splitlines()
        written = match[1].strip().splitlines()
        assert len(written) == len(fresh), f"{name}: run python benchmarks/paper_tables.py"
        for a, b in zip(written, fresh):
            if not any(says in b for says in timed):
                _alike(a, b)
    match = re.search(r"<!-- table figures -->\n(.*?)<!-- end -->", text, flags=re.DOTALL)
    assert match is not None
    assert match[1].strip() == tables.to_markdown(tables.figure_rows(list(figures.values()))).strip()


def _alike(written: str, fresh: str) -> None:
    number = r"-?\d+(?:\.\d+)?(?:e[+-]?\d+)?"
    assert re.sub(number, "#", written) == re.sub(number, "#", fresh)
    for a, b in zip(re.findall(number, written), re.findall(number, fresh)):
        # errors of 1e-6 and less are rounding, and differ from machine to machine
        assert float(a) == pytest.approx(float(b), rel=0.1 if abs(float(b)) > 1e-5 else 0.7, abs=1e-13)


def test_claims_have_numbers(found: tables.Results) -> None:
    """Every claim is answered by a number, each section that claims something is there, and one row is told by the clock."""
    assert all(re.search(r"\d", c.finds) for c in found.claims)
    assert {"1", "2", "3", "3.1", "3.2", "4", "6"} <= {part for c in found.claims for part in c.where.split(", ")}
    assert sum(c.timed for c in found.claims) == 1
    assert {c.holds for c in found.claims} == {"yes", "in part", "open then"}


def test_what_is_claimed(found: tables.Results) -> None:
    """The order of things that the paper claims, from the tables: strain errs more than stress; division hates noise."""
    errors = {(r["case"], r["channel"]): r["division"] for r in found.errors}
    for case in ("cylinder", "punch"):
        assert errors[case, "strain_zz"] > 100 * errors[case, "stress_zz"]
    friction = {(r["component"], r["channel"]): r["M found"] for r in found.friction}
    for component in ("vertical", "tangential"):
        assert friction[component, "strain_zz"] > 100 * friction[component, "stress_zz"]
    noise = {(r["case"], r["channel"], r["noise"]): r for r in found.noise}
    for case, channel in studies.FRICTIONLESS:
        loud = noise[case, channel, 1e-2]
        assert loud["division"] > 3 * loud["Hilgers"]
    assert noise["punch", "stress_zz", 0.0]["division"] < 1e-3 * noise["punch", "stress_zz", 0.0]["Hilgers"]
    truncation = {(r["case"], r["channel"], r["sensors"]): r for r in found.truncation}
    for case in ("cylinder", "punch"):
        assert truncation[case, "strain_zz", 41]["division"] > 10 * truncation[case, "stress_zz", 41]["division"]
        assert truncation[case, "strain_zz", 21]["linear system"] < 1e-13


def test_wide_and_cut_data_agree() -> None:
    """More sensors than 121 are served by a wider surface, fewer by cutting."""
    wide = cases.data("cylinder", "stress_zz", 161)
    full = cases.data("cylinder", "stress_zz")
    np.testing.assert_allclose(wide[1][:, 20:-20], full[1], atol=1e-15)
    np.testing.assert_array_equal(wide[0][:, 20:-20], full[0])
