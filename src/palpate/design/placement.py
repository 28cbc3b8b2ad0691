"""Choose places for a given number of taxels."""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any

import numpy as np

from palpate.design.bounds import PressModel
from palpate.design.press import Press
from palpate.design.responses import Responses, weights_of
from palpate.elastic.pad import Floats
from palpate.elastic.viscoelastic import Viscoelastic
from palpate.errors import InvalidInput, Unsupported
from palpate.sensing.arrays import AreaArray, ScatteredArray
from palpate.sensing.maps import check_modelled

if TYPE_CHECKING:
    from matplotlib.figure import Figure


__all__ = ["Placement", "place"]

#: Number of candidate places along the extent of the pad, and the stride between the candidate places at which presses
#: are tried.
SITES, EVERY = 25, 3
#: Number of rounds in which each taxel is moved to a better place.
ROUNDS = 2


@dataclass(frozen=True)
class Placement:
    """Taxels placed for presses anywhere on a rectangle.

    Attributes
    ----------
    array : ScatteredArray
    places : array (n, 2) [m]
        Places (y, x) at which presses were tried.
    force_std, center_std : array (n,)
        Bounds of the normal force [N] and of the centre [m] there, with noise and offsets unknown.

    Examples
    --------
    >>> import palpate as pp
    >>> from palpate.design import place
    >>> pad = pp.HalfSpace(youngs_modulus=2e5, poissons_ratio=0.5)
    >>> array = pp.AreaArray(shape=(4, 4), pitch=4e-3, depth=3e-3, channels=["stress_zz"], noise=100.0)
    >>> placed = place(pp.Skin(pad, array), count=9, extent=(16e-3, 16e-3))
    >>> placed.array.shape, bool(placed.force_std.max() < 1.0)
    ((9,), True)
    """

    array: ScatteredArray
    places: Floats = field(repr=False)
    force_std: Floats = field(repr=False)
    center_std: Floats = field(repr=False)

    def plot(self) -> Figure:
        """Plot the taxels over the standard deviation of the force (a matplotlib Figure)."""
        from palpate.design.figures import plot_places

        return plot_places(self)


def place(skin: Any, *, count: int, extent: tuple[float, float], press: Press | None = None) -> Placement:
    """Choose the places of ``count`` taxels, of the kind the skin has, that measure presses anywhere on a rectangle
    best.

    First each taxel in turn takes the place that lowers the mean variance most; then taxels move to better places as
    long as there are any. The criterion is the variance of the normal force (divided by the force) plus that of the
    position (divided by depth plus radius), averaged over the presses: an A-optimal design by exchange (A. C.
    Atkinson, A. N. Donev, R. D. Tobias, Optimum Experimental Designs, with SAS, 2007, chapters 10 and 12). The result
    is good, but not always the best.

    Parameters
    ----------
    skin : Skin
        Gives pad, depth, channels, aperture, noise and limits of its first plane; its positions do not matter. Places
        are chosen for independent noise.
    count : int
        Taxels to place.
    extent : (float, float)
        Width (x) and height (y) of the rectangle that is pressed and that taxels lie in [m].
    press : Press, optional
        The press to measure; default: 1 N over a radius of 2 mm.

    Raises
    ------
    InvalidInput
        Too few taxels to determine a press, more than there are places, or an extent that is not two positive lengths.
    Unsupported
        Line contact, or an array without noise.

    Examples
    --------
    >>> import palpate as pp
    >>> from palpate.design import place
    >>> pad = pp.HalfSpace(youngs_modulus=2e5, poissons_ratio=0.5)
    >>> array = pp.AreaArray(shape=(4, 4), pitch=4e-3, depth=3e-3, channels=["stress_zz"], noise=100.0)
    >>> placed = place(pp.Skin(pad, array), count=9, extent=(16e-3, 16e-3))
    >>> skin = pp.Skin(pad, placed.array)  # ready to be used
    """
    first = skin.planes[0]
    if first.dimensions == 1:
        raise Unsupported("placement is for area contact. On a line, evenly spaced taxels are best.")
    if (
        not isinstance(extent, tuple | list)
        or len(extent) != 2
        or not all(isinstance(e, float | int) and 0 < e < math.inf for e in extent)
    ):
        raise InvalidInput(f"extent must be (width, height) of the pressed rectangle in metres; got {extent!r}.")
    pressed = press or Press(force=1.0, contact_radius=2e-3)
    usual = max(extent) / (SITES - 1)
    shape = tuple(max(2, round(e / usual) + 1) for e in reversed(extent))  # (rows, columns)
    step = (extent[1] / (shape[0] - 1), extent[0] / (shape[1] - 1))  # along y and x: the sites cover the rectangle
    sites = math.prod(shape)
    unknowns = math.ceil((len(skin.components) + 3 + len(first.channels)) / len(first.channels))
    if isinstance(count, bool) or not isinstance(count, int) or not unknowns <= count <= sites // 2:
        raise InvalidInput(
            f"count must be a whole number from {unknowns} (a press and the offsets are {len(skin.components) + 3 + len(first.channels)} unknowns) to {sites // 2}; got {count!r}."
        )
    limits = first.limits
    if limits is not None and limits.ndim > 2:
        raise Unsupported(
            "limits differ between taxels, so that they cannot be kept at other places. Give one pair for each channel, or none."
        )
    information, places, scale = _informations(skin, first, pressed, shape, step)
    chosen = _exchanged(information, scale, count)
    # (row, column) of a candidate place, and its position relative to the middle
    rows, columns = np.unravel_index(np.sort(chosen), shape)
    x, y = (columns - 0.5 * (shape[1] - 1)) * step[1], (rows - 0.5 * (shape[0] - 1)) * step[0]
    covariances = np.linalg.inv(information[:, chosen].sum(axis=1) + _prior(scale))
    n = len(skin.components)
    force = np.sqrt(covariances[:, n - 1, n - 1]) * scale["force"]
    center = np.sqrt(np.maximum(covariances[:, n, n], covariances[:, n + 1, n + 1])) * scale["length"]
    array = ScatteredArray(
        positions=np.stack([x, y], axis=1),
        depth=first.depth,
        channels=first.channels,
        aperture=first.aperture,
        noise=first.noise,
        noise_correlation=first.noise_correlation,
        limits=limits,
    )
    return Placement(array, places, force, center)


def _informations(
    skin: Any, first: Any, press: Press, shape: tuple[int, ...], step: tuple[float, float]
) -> tuple[Floats, Floats, dict[str, Any]]:
    """Return the information (place, site, parameter, parameter) in natural units, the places (y, x), and the units."""
    elastic = skin.pad.elastic if isinstance(skin.pad, Viscoelastic) else skin.pad
    check_modelled(elastic, "placing taxels")
    # a reading depends only on the position relative to the press: one press in the middle covers all of them
    ny, nx = (2 * n - 1 for n in shape)
    array = AreaArray(
        shape=(ny, nx),
        pitch=step,
        depth=first.depth,
        channels=first.channels,
        aperture=first.aperture,
        noise=first.noise,
    )
    responses = Responses(elastic, [array], np.zeros(2), press.contact_radius, press.contact_radius)
    model = PressModel(responses, press, skin.components)
    length = responses.length
    n, channels = len(skin.components), len(first.channels)
    units = np.array([press.force] * n + [length] * 3)
    felt = (model.jacobian * weights_of([array])[:, None] * units).reshape(channels, ny, nx, n + 3)
    whole = np.zeros((ny, nx, channels, n + 3 + channels))
    whole[..., : n + 3] = np.moveaxis(felt, 0, 2)
    sizes = np.abs(felt[..., n - 1]).max(axis=(1, 2))  # unit of an offset: the largest reading
    whole[:, :, np.arange(channels), n + 3 + np.arange(channels)] = sizes
    rows, columns = np.arange(0, shape[0], EVERY), np.arange(0, shape[1], EVERY)
    at_y, at_x = (a.ravel() for a in np.meshgrid(rows, columns, indexing="ij"))
    site_y, site_x = (a.ravel() for a in np.meshgrid(np.arange(shape[0]), np.arange(shape[1]), indexing="ij"))
    one = np.einsum("yxci,yxcj->yxij", whole, whole)
    information = one[site_y[None] - at_y[:, None] + shape[0] - 1, site_x[None] - at_x[:, None] + shape[1] - 1]
    places = np.stack([(at_y - 0.5 * (shape[0] - 1)) * step[0], (at_x - 0.5 * (shape[1] - 1)) * step[1]], axis=1)
    return information, places, {"force": press.force, "length": length, "forces": n, "size": n + 3 + channels}


def _prior(scale: dict[str, Any]) -> Floats:
    """Return the prior information: each parameter is known to one natural unit (the size of the press), so that few
    taxels have a finite variance.
    """
    return np.asarray(np.eye(scale["size"]))


def _exchanged(information: Floats, scale: dict[str, Any], count: int) -> Any:
    """Return places by greedy choice, then by exchange."""
    n = scale["forces"]
    asked = [n - 1, n, n + 1]
    places, sites = information.shape[:2]
    total = np.repeat(_prior(scale)[None], places, axis=0)
    chosen: list[int] = []

    def costs(base: Floats, among: Any) -> Floats:
        found = np.linalg.inv(base[:, None] + information[:, among])
        return np.asarray(found[:, :, asked, asked].sum(axis=-1).mean(axis=0))

    def add(base: Floats) -> Floats:
        among = np.setdiff1d(np.arange(sites), chosen)
        best = int(among[costs(base, among).argmin()])
        chosen.append(best)
        return np.asarray(base + information[:, best])

    for _ in range(count):
        total = add(total)
    for _ in range(ROUNDS):
        before = list(chosen)
        for site in before:
            chosen.remove(site)
            total = add(total - information[:, site])
        if set(before) == set(chosen):
            break
    return np.array(chosen)
