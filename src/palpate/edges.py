"""Error of an infinite layer near the side of a gel, from a table computed by finite elements
(``benchmarks/edge_table.py``).
"""

from __future__ import annotations

import json
import math
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cache
from importlib import resources
from typing import TYPE_CHECKING, Any

import numpy as np

from palpate.elastic.channels import find_channel
from palpate.elastic.layers import BondedLayers
from palpate.elastic.pad import Floats, Pad
from palpate.elastic.viscoelastic import Viscoelastic
from palpate.errors import InvalidInput
from palpate.sensing.arrays import Array
from palpate.sensing.uncertainty import MODULUS

if TYPE_CHECKING:
    from matplotlib.axes import Axes

__all__ = ["EdgeError", "edge_error", "plot_edges", "solid_lines"]


@dataclass(frozen=True)
class EdgeError:
    """Error of the infinite layer when a ball of half a thickness touches near a free side.

    Attributes
    ----------
    thickness : float
        Thickness of the layer [m].
    distance : array (n,)
        Distances of the middle of the ball from the side [m].
    press, drag : array (n,)
        Relative error of the layer's readings when the ball presses, and when it drags across the side.
    force : array (n,) or None
        Net normal force computed with the infinite layer, over the true one; for stress sensors only.
    kind : str
        "stress": sensors at the base; "displacement": markers on the surface. Others are somewhere between.

    Examples
    --------
    >>> import palpate as pp
    >>> from palpate.edges import edge_error
    >>> gel = pp.BondedLayers([pp.Layer(thickness=4e-3, youngs_modulus=2e5, poissons_ratio=0.48)])
    >>> found = edge_error(gel, [pp.AreaArray(shape=(4, 4), pitch=4e-3, depth="base", channels=["stress_zz"])])
    >>> round(1e3 * found.reach), 0.0 < found.inner((40e-3, 40e-3)) < 1.0  # [mm]
    (3, True)
    """

    thickness: float
    distance: Floats
    press: Floats
    drag: Floats
    force: Floats | None
    kind: str

    @property
    def reach(self) -> float:
        """Distance from the side [m] below which the error of a press exceeds the assumed error of the modulus (15 %); infinite if the table ends
        before.
        """
        felt = np.flatnonzero(self.press > MODULUS)
        if not len(felt):
            return 0.0
        last = int(felt[-1])
        if last == len(self.press) - 1:
            return math.inf
        return float(np.interp(-MODULUS, -self.press[last : last + 2], self.distance[last : last + 2]))

    def inner(self, size: tuple[float, float]) -> float:
        """Return the fraction of a surface of this size (x, y) [m] that is farther than `reach` from all sides."""
        inside = [max(0.0, s - 2.0 * self.reach) / s for s in size]
        return float(inside[0] * inside[1])


@cache
def _table() -> dict[str, Any]:
    found: dict[str, Any] = json.loads(
        resources.files("palpate.solid").joinpath("edges.json").read_text(encoding="utf-8")
    )
    return found


def edge_error(pad: Pad, planes: Sequence[Array]) -> EdgeError | None:
    """Return the error of an infinite layer near a free side; None unless the pad is a single layer on a rigid base in
    area contact.

    The table is interpolated in Poisson's ratio; below 0.3 the values for 0.3 are used.

    Examples
    --------
    >>> import palpate as pp
    >>> from palpate.edges import edge_error
    >>> gel = pp.BondedLayers([pp.Layer(thickness=4e-3, youngs_modulus=2e5, poissons_ratio=0.48)])
    >>> found = edge_error(gel, [pp.AreaArray(shape=(4, 4), pitch=4e-3, depth="base", channels=["stress_zz"])])
    >>> bool(found.press[0] > 0.2), bool(found.press[-1] < 0.05)  # half a thickness from the side, and three
    (True, True)
    """
    elastic = pad.elastic if isinstance(pad, Viscoelastic) else pad
    if not isinstance(elastic, BondedLayers) or elastic.base is not None or len(elastic.layers) != 1:
        return None
    if planes[0].dimensions != 2:
        return None
    layer = elastic.layers[0]
    far = all(find_channel(c).kind.absolute for p in planes for c in p.channels)
    kind = "displacement" if far else "stress"
    rows = [r for r in _table()["rows"] if r["kind"] == kind]
    ratios = sorted({r["ratio"] for r in rows})
    distance = np.array(sorted({r["distance"] for r in rows}))

    def column(name: str) -> Floats:
        values = np.array(
            [[next(r[name] for r in rows if (r["ratio"], r["distance"]) == (n, d)) for d in distance] for n in ratios]
        )
        return np.array([np.interp(layer.poissons_ratio, ratios, v) for v in values.T])

    return EdgeError(
        layer.thickness,
        distance * layer.thickness,
        column("press"),
        column("drag"),
        column("force") if kind == "stress" else None,
        kind,
    )


def solid_lines(pad: Pad, size: tuple[float, float] | None) -> str:
    """The section [pad] of a skin.toml for the same gel with its sides; ``size`` (x, y) [m], "unknown" if it is not given.

    Raises
    ------
    InvalidInput
        A pad that is not a single layer.

    Examples
    --------
    >>> import palpate as pp
    >>> from palpate.edges import solid_lines
    >>> gel = pp.BondedLayers([pp.Layer(thickness=4e-3, youngs_modulus=2e5, poissons_ratio=0.48)])
    >>> print(solid_lines(gel, (25.25e-3, 20.75e-3)))
    [pad]
    kind = "solid_box"
    length = "25.25 mm"
    width = "20.75 mm"
    thickness = "4 mm"
    youngs_modulus = "200 kPa"
    poissons_ratio = 0.48
    """
    elastic = pad.elastic if isinstance(pad, Viscoelastic) else pad
    if not isinstance(elastic, BondedLayers) or len(elastic.layers) != 1:
        raise InvalidInput(
            f"a box is made of one layer on a rigid base; got a {type(elastic).__name__}. Use SolidPad.from_mesh."
        )
    layer = elastic.layers[0]
    across = ["unknown", "unknown"] if size is None else [f"{1e3 * s:.6g} mm" for s in size]
    lines = [
        "[pad]",
        'kind = "solid_box"',
        f'length = "{across[0]}"',
        f'width = "{across[1]}"',
        f'thickness = "{1e3 * layer.thickness:.6g} mm"',
        f'youngs_modulus = "{1e-3 * layer.youngs_modulus:.6g} kPa"',
        f"poissons_ratio = {min(layer.poissons_ratio, 0.499):g}",
    ]
    return "\n".join(lines)


def plot_edges(found: EdgeError, axes: Axes) -> None:
    """Draw the error of the infinite layer against the distance from the side."""
    from palpate._plot import INK

    x = 1e3 * found.distance
    axes.plot(x, 100 * found.press, "o-", ms=3, color=INK["pressure"], label="a ball presses")
    axes.plot(x, 100 * found.drag, "o-", ms=3, color=INK["shear"], label="a ball drags")
    axes.axhline(100 * MODULUS, color="0.7", lw=0.8)
    axes.set_xlim(0.0, float(x[-1]))
    axes.set_ylim(0.0, None)
    axes.set_xlabel("from the side of the gel [mm]")
    axes.set_ylabel("readings off [%]")
    axes.set_title("assumed infinite, near a side", fontsize=10)
    axes.legend(frameon=False, fontsize=8)
