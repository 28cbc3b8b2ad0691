"""Large strain: what a linear answer makes of a neo-Hookean layer, on a finite-element solution that is kept (benchmarks/hyperelastic.py)."""

from __future__ import annotations

import importlib.util
import math
from pathlib import Path
from typing import Any

import numpy as np
import pytest

ROOT = Path(__file__).parents[2]


@pytest.fixture(scope="module")
def benchmark() -> Any:
    spec = importlib.util.spec_from_file_location("hyperelastic", ROOT / "benchmarks" / "hyperelastic.py")
    assert spec is not None
    assert spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


def test_the_kept_solution_is_hertz_where_strain_is_small(benchmark: Any) -> None:
    """At 2 % of a layer, a contact of a fifth of its thickness: force and peak somewhat above the half-space's, the base sees the whole force."""
    for (radius, level), some in benchmark.cases(benchmark.table()).items():
        modulus = 1.0 / (1.0 - benchmark.POISSON**2)
        half = math.sqrt(radius * level)
        force = 4.0 / 3.0 * modulus * math.sqrt(radius) * level**1.5
        if (radius, level) == (1.5, 0.02):
            assert some[0]["force"] == pytest.approx(1.2 * force, rel=0.05)
            assert some[0]["peak"] == pytest.approx(2.0 * modulus * half / (math.pi * radius), rel=0.08)
        places = np.array([row["place"] for row in some])
        stress = np.array([row["s_zz"] for row in some])
        whole = 2.0 * math.pi * np.trapezoid(places * stress, places)
        assert whole == pytest.approx(some[0]["force"], rel=0.1), (radius, level)


@pytest.mark.long
def test_the_force_of_a_strained_gel_is_a_tenth_off_at_most_and_the_misfit_says_so(benchmark: Any) -> None:
    """Markers in a layer pressed by 5 and 16 % of its thickness: 1 and 9 % of the force."""
    where = benchmark.skin("markers")
    for level, wrong, poor in ((0.05, 0.04, False), (0.16, 0.14, True)):
        some = benchmark.cases(benchmark.table())[1.5, level]
        clean = benchmark.readings(some, "markers", where)
        noise = benchmark.NOISE * np.abs(clean).max() * np.random.default_rng(0).standard_normal(clean.shape)
        touch = where.reconstruct(clean + noise, method="constrained")
        force = some[0]["force"] * benchmark.MODULUS * benchmark.THICKNESS**2
        assert float(touch.force[2]) == pytest.approx(force, rel=wrong)
        assert bool(touch.fit < 1e-3) is poor
