"""Results drawn over the picture that they were found in."""

from __future__ import annotations

import numpy as np
import pytest

import palpate as pp
from palpate.camera import View, overlay

GRID = pp.AreaGrid(shape=(12, 16), spacing=1e-3)
VIEW = View.scaled(0.1e-3, size=(160, 120))
PICTURE = np.full((120, 160, 3), 90, dtype=np.uint8)


def touch(components: tuple[str, ...] = ("x", "y", "z")) -> pp.Touch:
    values = np.zeros((3, 12, 16))
    values[:, 8, 12] = [2e3, 1e3, 9e3]  # up and to the right of the middle
    return pp.Touch(values, GRID, components, "automatic")


def test_every_field_lies_where_it_was_found() -> None:
    found = touch()
    figure = overlay(PICTURE, found, VIEW, show="all")
    panels = [a for a in figure.axes if a.images]
    assert [p.get_title().partition(":")[0] for p in panels] == ["pressure", "shear"]  # there are no error bars
    for axes in panels:
        assert axes.get_ylim() == (119.5, -0.5)  # rows go down
        opaque = np.asarray(axes.images[1].get_array())[..., 3]
        assert opaque.shape == PICTURE.shape[:2]  # as fine as the picture
        row, column = np.unravel_index(opaque.argmax(), opaque.shape)
        middle = np.array([column, row])
        assert np.abs(middle - VIEW.pixels([GRID.x[12], GRID.axes[0][8]])).max() < 1.0
        (arrows,) = axes.collections
        assert np.allclose(arrows.get_offsets()[0], middle, atol=3.0)  # the strongest lies where it is strongest
        assert arrows.U[0] > 1.9 * arrows.V[0] * -1.0 > 0  # along x, and up
        assert middle[0] > 79.5
        assert middle[1] < 59.5
        words = {t.get_text(): t.get_position() for t in axes.texts if t.get_text()}
        assert words["x"][0] > words["y"][0]  # x to the right, y up
        assert words["y"][1] < words["x"][1]
        assert any(w.endswith("mm") for w in words)
    assert "z points into the pad" in figure.get_suptitle()
    assert len(found.plot(picture=(PICTURE, VIEW)).axes) == len(figure.axes)


def test_a_picture_on_its_side_turns_arrows_and_field() -> None:
    side = View.from_points(
        [[20, 20], [20, 100], [140, 100], [140, 20]],
        [[-6e-3, -4e-3], [6e-3, -4e-3], [6e-3, 4e-3], [-6e-3, 4e-3]],
    )
    axes = overlay(PICTURE, touch(), side).axes[0]
    words = {t.get_text(): t.get_position() for t in axes.texts if t.get_text()}
    assert words["x"][1] > words["y"][1]  # x goes down the picture, y to its right
    assert words["y"][0] > words["x"][0]


def test_what_cannot_be_drawn_is_said() -> None:
    with pytest.raises(pp.InvalidInput, match="show must be pressure, shear, std or all; got 'force'"):
        overlay(PICTURE, touch(), VIEW, show="force")
    with pytest.raises(pp.InvalidInput, match="std cannot be drawn: its error bars were not asked for"):
        overlay(PICTURE, touch(), VIEW, show="std")
    with pytest.raises(pp.InvalidInput, match="shear cannot be drawn: it was not sought"):
        overlay(PICTURE, touch(("z",)), VIEW, show="shear")
    with pytest.raises(pp.InvalidInput, match="Of several, give the one of this frame"):
        overlay(PICTURE[None], touch(), VIEW)
    for empty in (PICTURE[:0], PICTURE.astype(complex)):
        with pytest.raises(pp.InvalidInput, match="got the shape"):
            overlay(empty, touch(), VIEW)
    for narrow in (PICTURE[:1], PICTURE[:, :1]):
        assert len(overlay(narrow, touch(), VIEW).axes) == 2
    with pytest.raises(pp.InvalidInput, match=r"picture must be \(image, view\)"):
        touch().plot(picture=PICTURE)
    with pytest.raises(pp.InvalidInput, match="neither truth, ax, seen_from nor taxels"):
        touch().plot(picture=(PICTURE, VIEW), seen_from="outside")


def test_a_field_over_a_picture_has_no_cells_and_no_more_than_was_found() -> None:
    """The more of it the stronger it is; nothing where nothing presses, nothing below 0 or above the largest beside a sharp edge."""
    from palpate._plot.over import _smooth

    values = np.zeros((3, 12, 16))
    values[2, 4:8, 6:10] = 1e4
    found = pp.Touch(values, GRID, ("z",), "automatic")
    smooth, _ = _smooth(found, values[2], PICTURE.shape, VIEW)
    assert smooth.min() == 0.0
    assert smooth.max() == 1e4
    assert len(np.unique(smooth)) > 1000  # of 192 cells
    shown = np.asarray(overlay(PICTURE, found, VIEW).axes[0].images[1].get_array())[..., 3]
    assert shown[0, 0] == 0.0
    order = np.argsort(smooth.ravel())
    assert (np.diff(shown.ravel()[order]) >= -1e-9).all()


@pytest.mark.parametrize("kind", [np.uint16, np.float32, np.float64])
def test_a_deep_picture_is_shown_by_its_own_brightness(kind: type) -> None:
    picture = (np.indices((120, 160)).sum(axis=0) * 100).astype(kind)
    shown = np.asarray(overlay(picture, touch(), VIEW).axes[0].images[0].get_array())
    assert shown.dtype == np.uint8
    assert (shown.min(), shown.max()) == (0, 255)


def test_a_coloured_gel_is_drawn_grey() -> None:
    """A lit gel is pink, green and blue, which would pass for pressure: only what was found has colour."""
    gel = np.zeros((48, 64, 3), dtype=np.uint8)
    gel[..., 0] = 200
    grid = pp.AreaGrid(shape=(6, 8), spacing=1e-3)
    touch = pp.Touch(np.zeros((3, 6, 8)), grid, ("x", "y", "z"), "automatic")
    figure = overlay(gel, touch, View.scaled(0.125e-3, size=(64, 48)))
    (axes, bar) = figure.axes
    drawn = axes.images[0].get_array()
    assert drawn.shape == (48, 64)
    assert int(drawn[0, 0]) == 59  # 0.299 of 200
    assert "nPa" not in bar.get_xlabel()
