"""Placement of a given number of taxels."""

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

#: Sites per extent of the pad, and the stride between the sites of presses.
SITES, EVERY = 25, 3
#: Rounds of moving each taxel to a better site.
ROUNDS = 2


@dataclass(frozen=True)
class Placement:
    """Taxels placed for presses all over a rectangle.

    Attributes
    ----------
    array : ScatteredArray
    places : array (n, 2) [m]
        Where presses were tried, (y, x).
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
        """The taxels over the standard deviation of the force (a matplotlib Figure).

        Examples
        --------
        >>> import palpate as pp
        >>> from palpate.design import place
        >>> pad = pp.HalfSpace(youngs_modulus=2e5, poissons_ratio=0.5)
        >>> array = pp.AreaArray(shape=(4, 4), pitch=4e-3, depth=3e-3, channels=["stress_zz"], noise=100.0)
        >>> figure = place(pp.Skin(pad, array), count=9, extent=(16e-3, 16e-3)).plot()
        """
        from palpate.design.figures import plot_places

        return plot_places(self)


def place(skin: Any, *, count: int, extent: tuple[float, float], press: Press | None = None) -> Placement:
    """Sites of ``count`` taxels, of the kind that the skin has, that know presses all over a rectangle best.

    First, each taxel in turn takes the site that lowers the mean variance most; then each moves to a better site while there is one. The criterion is
    the variance of the normal force (over the force) plus that of the place (over depth plus radius), its mean over the presses: an A-optimal design
    (A. C. Atkinson, A. N. Donev, R. D. Tobias, Optimum Experimental Designs, with SAS, 2007, chapters 10 and 12), by exchange. The result is good,
    not always the best.

    Parameters
    ----------
    skin : Skin
        Gives pad, depth, channels, aperture and noise of its first plane; its positions do not matter.
    count : int
        Taxels to place.
    extent : (float, float)
        Width (x) and height (y) of the rectangle that is pressed and that taxels lie in [m].
    press : Press, optional
        What is pressed; 1 N over a radius of 2 mm where nothing is given.

    Raises
    ------
    InvalidInput
        Fewer taxels than tell a press, more than there are sites, or an extent that is not two positive lengths.
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
        raise Unsupported("placement is for area contact. On a line taxels at even distances serve best.")
    if (
        not isinstance(extent, tuple | list)
        or len(extent) != 2
        or not all(isinstance(e, float | int) and 0 < e < math.inf for e in extent)
    ):
        raise InvalidInput(f"extent must be (width, height) of the pressed rectangle in metres; got {extent!r}.")
    pressed = press or Press(force=1.0, contact_radius=2e-3)
    step = max(extent) / (SITES - 1)
    shape = tuple(max(2, round(e / step) + 1) for e in reversed(extent))  # (rows, columns)
    sites = math.prod(shape)
    unknowns = math.ceil((len(skin.components) + 3 + len(first.channels)) / len(first.channels))
    if isinstance(count, bool) or not isinstance(count, int) or not unknowns <= count <= sites // 2:
        raise InvalidInput(
            f"count must be a whole number from {unknowns} (a press and the offsets are {len(skin.components) + 3 + len(first.channels)} unknowns) to {sites // 2}; got {count!r}."
        )
    information, places, scale = _informations(skin, first, pressed, shape, step)
    chosen = _exchanged(information, scale, count)
    # (row, column) of a site, and its place around the middle
    rows, columns = np.unravel_index(np.sort(chosen), shape)
    x, y = (columns - 0.5 * (shape[1] - 1)) * step, (rows - 0.5 * (shape[0] - 1)) * step
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
    )
    return Placement(array, places, force, center)


def _informations(
    skin: Any, first: Any, press: Press, shape: tuple[int, ...], step: float
) -> tuple[Floats, Floats, dict[str, Any]]:
    """Information (place, site, parameter, parameter) in natural units, the places (y, x), and those units."""
    elastic = skin.pad.elastic if isinstance(skin.pad, Viscoelastic) else skin.pad
    check_modelled(elastic, "placing taxels")
    # what a taxel feels depends on its distance from the press alone: one press in the middle of all distances
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
    sizes = np.abs(felt[..., n - 1]).max(axis=(1, 2))  # of an offset: as large as the largest reading
    whole[:, :, np.arange(channels), n + 3 + np.arange(channels)] = sizes
    rows, columns = np.arange(0, shape[0], EVERY), np.arange(0, shape[1], EVERY)
    at_y, at_x = (a.ravel() for a in np.meshgrid(rows, columns, indexing="ij"))
    site_y, site_x = (a.ravel() for a in np.meshgrid(np.arange(shape[0]), np.arange(shape[1]), indexing="ij"))
    one = np.einsum("yxci,yxcj->yxij", whole, whole)
    information = one[site_y[None] - at_y[:, None] + shape[0] - 1, site_x[None] - at_x[:, None] + shape[1] - 1]
    places = np.stack([(at_y - 0.5 * (shape[0] - 1)) * step, (at_x - 0.5 * (shape[1] - 1)) * step], axis=1)
    return information, places, {"force": press.force, "length": length, "forces": n, "size": n + 3 + channels}


def _prior(scale: dict[str, Any]) -> Floats:
    """One natural unit of each parameter: known to the size of the press itself, so that few taxels have a finite variance."""
    return np.asarray(np.eye(scale["size"]))


def _exchanged(information: Floats, scale: dict[str, Any], count: int) -> Any:
    """Sites by greedy choice, then by exchange."""
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
