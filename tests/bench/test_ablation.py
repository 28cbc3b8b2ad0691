"""Parts of the automatic method can be left out, and the table says what that costs."""

from __future__ import annotations

import runpy
from dataclasses import fields
from pathlib import Path

import numpy as np
import pytest

import palpate as pp
from command_line import CliRunner
from palpate import bench
from palpate.bench.ablation import Ablated, Outcome, acts, variants
from palpate.bench.unseen import CONTACT_KINDS, Sample, unseen
from palpate.cli import app
from palpate.inverse.contact.policy import Detection, Parts, Policy, changed, numbers

RULES = runpy.run_path(str(Path(__file__).parents[2] / "benchmarks" / "rules.py"), run_name="rules")


@pytest.mark.parametrize("rule", RULES["RULES"])
def test_each_rule_of_the_table_is_one_of_the_policy(rule: str) -> None:
    assert RULES["policy_without"](rule) != Policy()


def a_line() -> Sample:
    """A strip on a short line, one taxel of which lies far out."""
    array = pp.LineArray(count=40, pitch=1.0, depth=1.0, channels=["stress_zz"], noise=0.01)
    layout = bench.Layout("line", pp.HalfSpace(youngs_modulus=1.0, poissons_ratio=0.45), array, {})
    readings, truth = layout.make(bench.line_contact(("strip", 1.3, 3.0, 1.0)))
    readings = readings + 0.01 * np.random.default_rng(4).standard_normal(readings.shape)
    readings[0, 33] = 1.3
    return Sample("line", layout, readings, truth, None, False)


def error(sample: Sample, policy: Policy | None = None) -> float:
    method = Ablated(policy=policy or Policy())
    touch = sample.layout.skin.reconstruct(sample.readings, method=method, components=["z"])
    return float(np.linalg.norm(np.asarray(touch.values) - sample.truth) / np.linalg.norm(sample.truth))


@pytest.mark.long
def test_with_every_part_it_is_the_automatic_method() -> None:
    sample = a_line()
    skin = sample.layout.skin
    whole = skin.reconstruct(sample.readings, method=Ablated(), components=["z"])
    plain = skin.reconstruct(sample.readings, components=["z"])
    assert np.array_equal(whole.values, plain.values)
    assert np.array_equal(whole.std(), plain.std())


@pytest.mark.long
def test_parts_that_are_left_out_are_missed() -> None:
    sample = a_line()
    whole = error(sample)
    assert whole < 0.15
    assert error(sample, Policy(parts=Parts(outliers=False, screening=False))) > 1.5 * whole
    assert error(sample, Policy(parts=Parts(wide_weights=False, narrow_weights=False))) > 1.1 * whole
    assert np.isnan(
        error(sample, Policy(detection=Detection(evidence=1e9, in_few_cells=1e9)))
    )  # undecided: nobody gave the noise
    pulls = sample.layout.skin.reconstruct(
        sample.readings, method=Ablated(policy=Policy(parts=Parts(constraint=False))), components=["z"]
    )
    assert float(np.asarray(pulls.values).min()) < 0.0


def test_every_part_has_a_row_and_every_tried_number_two() -> None:
    rows, listed = variants(), list(numbers())
    changed_by = [[n.name for n, m in zip(numbers(p), listed) if n.value != m.value] for p in rows.values()]
    for one in listed:
        assert one.why, one.name
        changes = [names for names in changed_by if names == [one.name]]
        assert len(changes) == (1 if one.part else 2 if one.tried else 0), one.name
    assert {one.name for one in listed if one.part} == {f"parts.{f.name}" for f in fields(Parts)}
    assert all(policy != Policy() for policy in rows.values())


def test_a_number_that_does_not_exist_is_not_changed() -> None:
    with pytest.raises(TypeError, match="faintest"):
        changed(Policy(), "extent.faintest", 1.0)


@pytest.mark.long
def test_what_does_not_act_on_a_frame_changes_nothing() -> None:
    sample = a_line()
    skipped = [v for v in variants().values() if not acts(sample, v)]
    assert len(skipped) > 8
    whole = error(sample)
    for policy in skipped[::3]:
        assert error(sample, policy) == whole


@pytest.mark.parametrize("kind", list(CONTACT_KINDS))
def test_the_population_is_what_it_says(kind: str) -> None:
    for seed in range(1):
        sample, again = (unseen(np.random.default_rng((seed, 5)), kind) for _ in range(2))
        assert sample.kind == kind
        assert np.array_equal(sample.readings, again.readings)
        assert np.isfinite(sample.readings).all()
        assert sample.empty or np.abs(sample.truth).max() > 0.1
        if sample.friction is not None:
            shear = np.sqrt((sample.truth[:-1] ** 2).sum(axis=0))
            assert (shear <= sample.friction * sample.truth[-1] + 1e-9).all()


def test_the_table_counts_what_it_says() -> None:
    def frame(whole: float, other: float) -> dict[str, Outcome]:
        return {
            "whole": Outcome(whole, True, True, True, 1.0),
            "without: x": Outcome(other, whole > 0.2, None, True, 3.0),
        }

    found = [("line", False, frame(0.1, 0.2)), ("area", False, frame(0.4, 0.2)), ("line", True, frame(np.nan, np.nan))]
    whole, row = bench.summary(found)
    assert (whole.mean, whole.low, whole.high, whole.changed, whole.coverage) == (1.0, 1.0, 1.0, 0.0, 1.0)
    assert row.mean == pytest.approx(1.0)
    assert {kind: mean for kind, (mean, _, _) in row.kinds.items()} == pytest.approx({"line": 2.0, "area": 0.5})
    assert [count for _, _, count in row.kinds.values()] == [1, 1]
    assert (row.low, row.high) == pytest.approx((0.5, 2.0))
    assert (row.worst, row.largest, row.frames, row.alarms) == pytest.approx((2.0, 0.2, 2, 1))
    assert (row.coverage, row.time) == pytest.approx((0.5, 3.0))
    undecided = Outcome(np.nan, None, None, None, 1.0)
    for empty in (False, True):
        found.append(("area", empty, {"whole": undecided, "without: x": undecided}))
    found.append(("line", False, {"whole": frame(0.1, 0.1)["whole"], "without: x": undecided}))
    again, other = bench.summary(found)
    assert (again.mean, again.unanswered, other.unanswered) == (1.0, 2, 3)
    assert (other.mean, other.frames, other.missed, other.alarms) == pytest.approx((1.0, 4, 0, 1))
    assert other.changed == pytest.approx(0.75)  # an answer that is lost is a change
    text = bench.as_markdown([whole, row], command="palpate bench ablation", empty=1)
    lines = [line for line in text.splitlines() if line.startswith("|")]
    assert len({line.count("|") for line in lines}) == 1


@pytest.mark.long
def test_the_command_writes_its_table(tmp_path: Path) -> None:
    file = tmp_path / "ablation.md"
    done = CliRunner().invoke(
        app,
        ["bench", "ablation", "--frames", "2", "--numbers", "0", "--kinds", "line", "--seed", "7", "--out", str(file)],
    )
    assert done.exit_code == 0, done.output
    text = file.read_text(encoding="utf-8")
    assert text.startswith("Made by `palpate bench ablation --frames 2 --numbers 0 --kinds 'line' --seed 7`")
    assert all(name in text for name in variants(thresholds=False))
    refused = CliRunner().invoke(app, ["bench", "ablation", "--frames", "2", "--numbers", "3"])
    assert refused.exit_code != 0
