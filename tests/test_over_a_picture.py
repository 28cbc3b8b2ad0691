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
        field = axes.collections[0].get_array()
        row, column = np.unravel_index(np.ma.filled(field, 0.0).reshape(12, 16).argmax(), (12, 16))
        corners = axes.collections[0].get_coordinates()
        middle = corners[row : row + 2, column : column + 2].reshape(-1, 2).mean(axis=0)
        assert np.allclose(middle, VIEW.pixels([GRID.x[12], GRID.axes[0][8]]), atol=0.01)
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
    with pytest.raises(pp.InvalidInput, match=r"picture must be \(image, view\)"):
        touch().plot(picture=PICTURE)
    with pytest.raises(pp.InvalidInput, match="neither truth, ax nor seen_from"):
        touch().plot(picture=(PICTURE, VIEW), seen_from="outside")
