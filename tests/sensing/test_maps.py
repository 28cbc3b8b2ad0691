"""The door for maps: pads that make them themselves."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import pytest

import palpate as pp
from palpate.sensing import Body, LinearMap, MatrixMap, Operator, default_surface
from palpate.sensing.arrays import Array
from palpate.sensing.grids import Grid

LAYER = pp.BondedLayers([pp.Layer(thickness=4e-3, youngs_modulus=2e5, poissons_ratio=0.48)])
ARRAY = pp.AreaArray(shape=(5, 6), pitch=2e-3, depth=2e-3, channels=["stress_xz", "stress_yz", "stress_zz"], noise=20.0)


class Measured:
    """A user's own pad: the members of `Pad`, and maps that are matrices."""

    thickness = LAYER.thickness
    states, compliance, mean_compliance = LAYER.states, LAYER.compliance, LAYER.mean_compliance

    def patch(self, planes: Sequence[Array]) -> Grid:
        return default_surface(planes)

    def response(self, array: Array, surface: Grid) -> LinearMap:
        dense = Operator(LAYER, [array], surface).planes[0].dense()
        return MatrixMap(dense.reshape(len(array.channels), -1, len(surface.components), *surface.shape), array.shape)


@pytest.mark.long
def test_a_pad_of_ones_own_serves_as_the_one_that_it_copies() -> None:
    exact = pp.Uncertainty(thickness=0.0, depth=0.0)
    own = pp.Skin(Measured(), ARRAY, uncertainty=pp.Uncertainty(depth=0.0))
    usual = pp.Skin(LAYER, ARRAY, surface=default_surface([ARRAY]), uncertainty=exact)
    assert isinstance(Measured(), Body)
    readings = usual.sense(pp.solutions.hertz_point(contact_radius=2e-3, force=1.5), rng=np.random.default_rng(1))
    for method in (None, "tikhonov"):
        a, b = own.reconstruct(readings, method=method), usual.reconstruct(readings, method=method)
        np.testing.assert_allclose(a.force, b.force, rtol=0, atol=1e-6)
        np.testing.assert_allclose(a.interval(0.95, "force"), b.interval(0.95, "force"), rtol=0, atol=1e-6)


@pytest.mark.long
def test_a_tracker_of_such_a_pad() -> None:
    usual = pp.Skin(LAYER, ARRAY, surface=default_surface([ARRAY]))
    readings = usual.sense(
        pp.solutions.hertz_point(contact_radius=4e-3, force=1.5).shifted(0.3e-3, 0.2e-3)
    )  # no readings are equal
    forces = [skin.track().step(readings).force for skin in (pp.Skin(Measured(), ARRAY), usual)]
    np.testing.assert_allclose(forces[0], forces[1], rtol=0, atol=1e-6)


def test_a_pad_that_ends_is_not_repeated() -> None:
    skin = pp.Skin(Measured(), ARRAY, boundary="periodic", surface=ARRAY.grid)
    with pytest.raises(pp.Unsupported, match='boundary="free"'):
        skin.sense(np.zeros((3, 5, 6)))


@pytest.mark.parametrize("method", ["dft", "linear"])
def test_methods_of_one_influence_refuse_it(method: str) -> None:
    skin = pp.Skin(Measured(), ARRAY)
    with pytest.raises(pp.Unsupported, match='method="tikhonov"'):
        skin.reconstruct(np.zeros((3, 5, 6)), method=method)


def test_a_matrix_of_another_shape_is_refused() -> None:
    with pytest.raises(pp.InvalidInput, match="3 taxels"):
        MatrixMap(np.zeros((1, 2, 3, 2, 2)), (3,))
    with pytest.raises(pp.InvalidInput, match="must be finite"):
        MatrixMap(np.full((1, 2, 3, 2, 2), np.nan), (2,))
