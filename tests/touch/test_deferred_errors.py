"""Errors of a large contact are worked out when they are asked for, and are then what they would have been."""

from __future__ import annotations

import copy
import pickle
from typing import Any

import numpy as np
import pytest

import palpate as pp
from palpate.inverse.constrained import products
from palpate.inverse.contact import summary
from palpate.inverse.contact.deferred_errors import ContactErrors
from palpate.touch import joined


@pytest.fixture
def skin(monkeypatch: pytest.MonkeyPatch) -> pp.Skin:
    """A skin whose contacts are solved by products whatever their size."""
    monkeypatch.setattr(products, "MIN_ITERATIVE_UNKNOWNS", 10)
    monkeypatch.setattr(products, "PRODUCTS", 0.0)
    monkeypatch.setattr(products, "FEW_READINGS", 0)
    array = pp.AreaArray(shape=(10, 10), pitch=1e-3, depth=2e-3, channels=["stress_zz"])
    return pp.Skin(pp.HalfSpace(youngs_modulus=1e5, poissons_ratio=0.48), array)


def frame(skin: pp.Skin) -> Any:
    readings = np.asarray(skin.sense(pp.solutions.hertz_point(contact_radius=2.5e-3, force=0.5)))
    return readings + 0.02 * np.abs(readings).max() * np.random.default_rng(0).standard_normal(readings.shape)


@pytest.mark.long
def test_one_frame_works_them_out_when_asked(skin: pp.Skin, monkeypatch: pytest.MonkeyPatch) -> None:
    readings = frame(skin)
    with monkeypatch.context() as m:

        def not_yet(*_: Any) -> Any:
            raise AssertionError("nobody asked")

        for name in ("traction", "force", "moment", "center", "peak", "variance_reduction"):
            m.setattr(summary.Summary, name, not_yet)
        touch = skin.reconstruct(readings)
        alone = skin.reconstruct(readings[None])
        assert float(touch.force[2]) == pytest.approx(0.5, rel=0.1)
    assert isinstance(touch._errors.posterior, ContactErrors)
    assert touch._errors.posterior.deferred
    both = skin.reconstruct(np.stack([readings, readings]))
    assert not isinstance(both._errors.posterior, ContactErrors)  # many frames do not keep their models
    picked = alone.frame(0)
    np.testing.assert_array_equal(picked.std(), touch.std())
    for name in ("force", "variance_reduction"):
        np.testing.assert_array_equal(getattr(picked, name), getattr(touch, name))
    for of in ("traction", "force", "moment", "center_of_pressure", "peak_pressure"):
        for one, other, first in zip(touch.interval(of=of), picked.interval(of=of), both.interval(of=of)):
            np.testing.assert_array_equal(one, other)
            np.testing.assert_array_equal(one, first[0])
    low, high = touch.interval(of="force")
    assert low[2] < 0.5 < high[2]
    assert not touch._errors.posterior.force.flags.writeable


@pytest.mark.long
def test_copies_and_joined_results_have_them(skin: pp.Skin) -> None:
    touch = skin.reconstruct(frame(skin))
    known = skin.reconstruct(frame(skin))
    expected = [np.asarray(x) for x in known.interval(of="traction")]
    for other in (copy.deepcopy(touch), pickle.loads(pickle.dumps(touch))):
        np.testing.assert_array_equal(other.interval(of="traction"), expected)
    both = joined([touch, known])
    np.testing.assert_array_equal(both.frame(0).interval(of="traction"), expected)
    np.testing.assert_array_equal(both.frame(1).interval(of="traction"), expected)


def test_the_models_are_let_go_of(skin: pp.Skin) -> None:
    touch = skin.reconstruct(frame(skin))
    errors = touch._errors.posterior
    assert isinstance(errors, ContactErrors)
    for name in errors.__dataclass_fields__:
        getattr(errors, name)
    assert not errors.deferred
    with pytest.raises(AttributeError, match="no attribute 'nothing'"):
        _ = errors.nothing  # type: ignore[attr-defined]
