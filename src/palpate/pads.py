"""How a pad blurs a touch before it reaches the sensors, and the error of assuming a half-space."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

from palpate._extras import require
from palpate._numbers import plain_number
from palpate.edges import EdgeError, plot_edges
from palpate.elastic.channels import channel_unit
from palpate.elastic.half_space import HalfSpace
from palpate.elastic.layers import BondedLayers
from palpate.elastic.pad import Floats, Pad, isotropic_constants
from palpate.elastic.quantities import COMPONENTS, transfer
from palpate.elastic.viscoelastic import Viscoelastic
from palpate.measured import Measured
from palpate.sensing.arrays import Array
from palpate.sensing.grids import AreaGrid
from palpate.sensing.maps import check_modelled
from palpate.sensing.uncertainty import Uncertainty
from palpate.skin import Skin
from palpate.solutions import hertz_line, hertz_point

if TYPE_CHECKING:
    from matplotlib.figure import Figure

__all__ = [
    "ExpectedForce",
    "HalfSpaceError",
    "caption",
    "expected_force",
    "half_space_error",
    "plot_response",
    "plot_table",
    "surface_half_space",
    "table_lines",
]


def caption(skin: Skin) -> str:
    """Return a short description of the sensor for the title of a figure: number, depth and pad of the taxels.

    Examples
    --------
    >>> import palpate as pp
    >>> from palpate.pads import caption
    >>> pad = pp.BondedLayers([pp.Layer(thickness=4e-3, youngs_modulus=2e5, poissons_ratio=0.48)])
    >>> caption(pp.Skin(pad, pp.AreaArray(shape=(4, 4), pitch=4e-3, depth=2e-3, channels=["stress_zz"])))
    '16 taxels 2 mm deep in a pad 4 mm thick'
    """
    depths = sorted({float(p.depth) for p in skin.planes})
    deep = " and ".join(f"{1e3 * d:.3g}" if d >= 1e-4 or d == 0 else f"{1e3 * d:.2g}" for d in depths)
    count = sum(len(p.points) for p in skin.planes)
    thickness = skin.pad.thickness
    pad = "a half-space" if thickness is None else f"a pad {1e3 * thickness:.3g} mm thick"
    return f"{count} taxels {deep} mm deep in {pad}"


def surface_half_space(pad: Pad) -> HalfSpace:
    """A half-space of the pad's uppermost material."""
    if isinstance(pad, Viscoelastic):
        pad = pad.elastic
    if isinstance(pad, BondedLayers):
        return pad.surface
    modulus, nu = isotropic_constants(pad, 0.0)
    return HalfSpace(youngs_modulus=modulus, poissons_ratio=nu)


@dataclass(frozen=True)
class HalfSpaceError:
    """Error of a half-space of the uppermost material, for a ball (or cylinder) pressed in the middle.

    Attributes
    ----------
    radius : float
        Contact radius or half-width [m] of the press: a fifth of the array's width.
    relative : float
        Error of the recovered traction, L2, relative to the true one.
    peak, force : float
        Recovered peak pressure and net force over the true ones (1 is right; NaN where pressure is not sought).
    layered : float
        Error of the right pad's own reconstruction, for comparison.
    """

    radius: float
    relative: float
    peak: float
    force: float
    layered: float


@dataclass(frozen=True)
class ExpectedForce:
    """Expected accuracy of the net force of a typical press: half of its 95 % interval, relative to the force.

    Attributes
    ----------
    radius : float
        Contact radius [m] of the press: a fifth of the array's width.
    normal, shear : float
        Relative half-width for the normal force, and for the tangential force at friction 0.3.
    exact : (float, float)
        Both numbers if pad and modulus were known exactly: the error due to the sensors alone.
    """

    radius: float
    normal: float
    shear: float
    exact: tuple[float, float]

    def __str__(self) -> str:
        said = f"normal force +-{100 * self.normal:.0f} %, across +-{100 * self.shear:.0f} % (95 %)"
        if self.shear - self.exact[1] < 0.05:
            return said
        return f"{said}; if pad and modulus were exact, +-{100 * self.exact[0]:.0f} % and +-{100 * self.exact[1]:.0f} %"


def expected_force(skin: Skin) -> ExpectedForce | None:
    """Simulate a ball that slides on the middle of the array, and return the widths of the intervals of its force; None unless the skin estimates all components.

    Noise is 1 % of each channel's largest reading. The stated uncertainty counts.

    Examples
    --------
    >>> import palpate as pp
    >>> from palpate.camera import dot_grid
    >>> from palpate.pads import expected_force
    >>> gel = pp.BondedLayers([pp.Layer(thickness=4e-3, youngs_modulus=4e5, poissons_ratio=0.48)])
    >>> names = ["displacement_x", "displacement_y"]
    >>> on_top, deep = (
    ...     expected_force(pp.Skin(gel, pp.ScatteredArray(positions=dot_grid((7, 10), 2e-3), depth=depth, channels=names)))
    ...     for depth in (0.0, 0.5e-3)
    ... )
    >>> on_top.normal > 0.8, deep.normal < 0.5  # dots on the surface tell what presses ill
    (True, True)
    """
    if skin.surface.dimensions != 2 or set(skin.components) != {"x", "y", "z"}:
        return None
    radius = float(np.ptp(skin.planes[0].points, axis=0).min()) / 5
    middle = [float(a.mean()) for a in reversed(skin.surface.axes)]
    contact = hertz_point(contact_radius=radius, force=1.0).shifted(*middle).sliding(0.3)
    readings = _noisy(skin.operator.forward(skin.sample(contact)))
    both = []
    sure = Uncertainty(youngs_modulus=0.0, thickness=0.0, depth=0.0, gain=0.0, scale=0.0)
    exact = Skin(skin.pad, skin.planes, surface=skin.surface, boundary=skin.operator.boundary, uncertainty=sure)
    for one in (skin, exact):
        touch = one.reconstruct(readings)
        low, high = touch.interval(0.95, "force")
        half = 0.5 * (np.asarray(high) - np.asarray(low))
        both.append((float(half[2]), float(half[0]) / 0.3))
    return ExpectedForce(radius, *both[0], both[1])


def _noisy(parts: Sequence[Floats]) -> Any:
    """Readings of each plane with noise of 1 % of each channel's largest one."""
    rng = np.random.default_rng(0)
    noisy = [
        r + 0.01 * np.abs(r).max(axis=tuple(range(1, r.ndim)), keepdims=True) * rng.standard_normal(r.shape)
        for r in parts
    ]
    return noisy[0] if len(noisy) == 1 else noisy


def half_space_error(skin: Skin) -> HalfSpaceError:
    """Sense a typical contact with the skin's pad and reconstruct it as if the pad were a half-space.

    Noise is 1 % of each channel's largest reading.
    """
    extents = np.ptp(skin.planes[0].points, axis=0)
    radius = float(extents[extents > 0].min()) / 5  # along a single row, its length
    line = skin.surface.dimensions == 1
    contact = hertz_line(half_width=radius, force=1.0) if line else hertz_point(contact_radius=radius, force=1.0)
    contact = contact.shifted(*[float(a.mean()) for a in reversed(skin.surface.axes)])
    if set(skin.components) >= {"x"}:
        contact = contact.sliding(0.3)
    truth = skin.sample(contact)
    keep = [c in skin.components for c in skin.surface.components]
    truth[~np.array(keep)] = 0.0
    readings = _noisy(skin.operator.forward(truth))
    elastic = skin.pad.elastic if isinstance(skin.pad, Viscoelastic) else skin.pad
    right = Skin(elastic, skin.planes, surface=skin.surface, boundary=skin.operator.boundary)
    wrong = Skin(surface_half_space(skin.pad), skin.planes, surface=skin.surface, boundary=skin.operator.boundary)
    results = [s.reconstruct(readings, components=skin.components).values for s in (right, wrong)]
    error = [float(np.linalg.norm(r - truth) / np.linalg.norm(truth)) for r in results]
    pressure = "z" in skin.components
    return HalfSpaceError(
        radius,
        error[1],
        float(results[1][-1].max() / truth[-1].max()) if pressure else float("nan"),
        float(results[1][-1].sum() / truth[-1].sum()) if pressure else float("nan"),
        error[0],
    )


def plot_response(pad: Pad, planes: Sequence[Array], *, edges: EdgeError | None = None) -> Figure:
    """Plot the response of each channel per unit traction against wavelength: the pad (solid) and a half-space
    (dashed). If ``edges`` are given, plot their effect beside it.

    Raises
    ------
    Unsupported
        A pad without an elastic model; `plot_table` draws one that was measured.
    """
    check_modelled(pad, "the response by wavelength")
    require("figures", "matplotlib")
    from matplotlib.figure import Figure

    from palpate._plot import INK, scaled

    channels = [(p, c) for p in planes for c in p.channels]
    panels = len(channels) + (edges is not None)
    columns = min(3, panels)
    rows = -(-panels // columns)
    figure = Figure(figsize=(4.4 * columns, 3.2 * rows), layout="constrained")
    grid = figure.subplots(rows, columns, squeeze=False).ravel()
    extent = max(float(np.ptp(p.points, axis=0).max()) for p in planes)
    pitch = extent / 40
    wavelength = np.geomspace(pitch, 4 * extent, 200)
    k = 2 * np.pi / wavelength
    half = surface_half_space(pad)
    factor, unit = scaled(float(wavelength[-1]), "m")
    colours = [INK["shear"], INK["other"], INK["pressure"]]
    line = planes[0].dimensions == 1
    # off the axes the channels respond to every component of an area contact
    angle = 0.0 if line else 0.6
    for axes, (plane, channel) in zip(grid, channels):
        largest = 0.0
        for body, style in ((pad, "-"), (half, "--")):
            matrix = np.abs(transfer(body, k * np.cos(angle), k * np.sin(angle), plane.depth, [channel], line=line))[
                :, 0
            ]
            for component, colour in zip("xyz", colours):
                if component not in COMPONENTS[1 if line else 2]:
                    continue
                value: Floats = matrix[:, "xyz".index(component)]
                if value.max() > 0:
                    label = {"x": "shear x", "y": "shear y", "z": "pressure"}[component] if body is pad else None
                    axes.loglog(wavelength * factor, value, style, color=colour, label=label)
                    largest = max(largest, float(value.max()))
        depth_factor, depth_unit = scaled(max(plane.depth, 1e-6), "m")
        axes.set_title(f"{channel} at {plane.depth * depth_factor:.3g} {depth_unit}", fontsize=10)
        axes.set_xlabel(f"wavelength [{unit}]")
        axes.set_ylabel(f"{channel_unit(channel)} per Pa of traction")
        if (
            largest > 0
        ):  # cut the axis at a damping of a million: no sensor measures less, and most of the axis would show it
            axes.set_ylim(1e-6 * largest, 2.0 * largest)
        axes.legend(frameon=False, fontsize=8)
    if edges is not None:
        plot_edges(edges, grid[len(channels)])
    for axes in grid[panels:]:
        axes.set_visible(False)
    figure.suptitle("solid: this pad; dashed: a half-space of its uppermost material", fontsize=10)
    return figure


def table_lines(pad: Measured) -> list[str]:
    """Return the contents of a table of presses as lines of text.

    Examples
    --------
    >>> import numpy as np
    >>> import palpate as pp
    >>> from palpate.pads import table_lines
    >>> array = pp.AreaArray(shape=(3, 3), pitch=3e-3, depth=2e-3, channels=["stress_zz"])
    >>> real = pp.Skin(pp.HalfSpace(youngs_modulus=2e5, poissons_ratio=0.5), array)
    >>> places = [(x, y) for y in np.linspace(-4e-3, 4e-3, 5) for x in np.linspace(-4e-3, 4e-3, 5)]
    >>> ball = pp.solutions.hertz_point(contact_radius=1e-3, force=1.0)
    >>> pad = pp.Measured.of(array, places=places, force=np.ones(25), readings=[real.sense(ball.shifted(*p)) for p in places], radius=1e-3)
    >>> print(table_lines(pad)[0])
    table                      25 presses 2 mm apart, forces along z, a hertz contact of radius 1 mm
    """
    t, fit = pad.table, pad.fit
    radius = f"{1e3 * float(t.radius.min()):.3g}" + (
        "" if np.ptp(t.radius) == 0 else f" to {1e3 * float(t.radius.max()):.3g}"
    )
    out = [
        f"table                      {len(t.places)} presses {1e3 * t.spacing:.3g} mm apart, forces along {', '.join(pad.components)}, a {t.indenter} contact of "
        f"radius {radius} mm",
        f"response                   as wide as that of sensors about {1e3 * fit.length:.2g} mm deep",
    ]
    dead = int((~t.working).sum())
    if dead:
        out.append(f"dead                       {dead} of {len(t.working)} taxels")
    for name, noise, error, held in zip(t.channels, fit.noise, fit.error, fit.held_out):
        out.append(
            f"{name:26s} noise {plain_number(float(noise), 2)} {channel_unit(name)}; off by {100 * error:.2g} % of the readings between the places; presses left out are predicted {100 * held:.2g} % off, including noise"
        )
    return out


def plot_table(pad: Measured) -> Figure:
    """Plot the response of the middle taxel and of one at a corner, per newton at each place; dots show the pressed
    places.

    Raises
    ------
    Unsupported
        matplotlib is not installed.
    """
    require("figures", "matplotlib")
    from matplotlib.figure import Figure

    t = pad.table
    coarse = pad.patch([pad.array])
    counts, widths = coarse.shape, coarse.spacings
    surface = AreaGrid(
        shape=(3 * counts[0], 3 * counts[1]), spacing=(widths[0] / 3, widths[1] / 3), center=coarse.center
    )
    places = t.positions[t.working]
    middle = np.hypot(*(places - 0.5 * (places.min(axis=0) + places.max(axis=0))).T)
    shown = [("taxel in the middle", int(np.argmin(middle))), ("taxel farthest out", int(np.argmax(middle)))]
    figure = Figure(figsize=(4.2 * len(shown), 3.6 * len(t.channels)), layout="constrained")
    grid = figure.subplots(len(t.channels), len(shown), squeeze=False)
    (ys, xs) = surface.axes
    for i, name in enumerate(t.channels):
        fields = pad.fit.cells(surface, i, [one for _, one in shown])[:, -1] / surface.cell
        largest = float(np.abs(fields).max())
        for axes, (title, one), field in zip(grid[i], shown, fields):
            image = axes.pcolormesh(
                1e3 * xs, 1e3 * ys, field, cmap="RdBu_r", vmin=-largest, vmax=largest, rasterized=True
            )
            axes.plot(*(1e3 * t.places.T), ".", ms=2, color="0.3")
            axes.plot(*(1e3 * places[one]), "+", ms=9, color="black")
            axes.set_aspect("equal")
            axes.set_title(f"{name}, {title}", fontsize=10)
            axes.set_xlabel("x [mm]")
            axes.set_ylabel("y [mm]")
        figure.colorbar(image, ax=list(grid[i]), label=f"{channel_unit(name)} per N pressing there")
    return figure
