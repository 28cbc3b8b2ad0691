"""Images and Grids state their shape and the order of their bytes; both are honoured or refused."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

import palpate as pp
from palpate.recordings import TopicMapping

VALUES = np.arange(24.0).reshape(1, 6, 4)


def image(values: np.ndarray, kind: str = "<f4") -> Any:
    count, rows, columns = values.shape
    data = np.ascontiguousarray(np.moveaxis(values, 0, -1), dtype=kind).tobytes()
    return SimpleNamespace(
        encoding=f"32FC{count}",
        height=rows,
        width=columns,
        step=4 * count * columns,
        is_bigendian=kind == ">f4",
        data=data,
    )


def grid(values: np.ndarray) -> Any:
    columns = values.shape[2]
    field = SimpleNamespace(name="p", type=7, offset=0)
    data = values[0].astype("<f4").tobytes()
    return SimpleNamespace(column_count=columns, cell_stride=4, row_stride=4 * columns, fields=[field], data=data)


def mapping(shape: tuple[int, int] | None) -> TopicMapping:
    return TopicMapping(topic="/finger", channels=["stress_zz"], shape=shape)


@pytest.mark.parametrize("message", [image, grid])
def test_another_shape_with_as_many_values_is_refused(message: Any) -> None:
    with pytest.raises(pp.InvalidInput, match="6 rows of 4 taxels, but shape says 4 x 6"):
        mapping((4, 6)).readings(message(VALUES))
    for shape in ((6, 4), None):
        np.testing.assert_array_equal(mapping(shape).readings(message(VALUES)), VALUES)
    # one row states no shape: it is laid out as the mapping says
    np.testing.assert_array_equal(mapping((6, 4)).readings(message(VALUES.reshape(1, 1, 24))), VALUES)


def test_big_endian_images_are_honoured() -> None:
    np.testing.assert_array_equal(mapping((6, 4)).readings(image(VALUES, ">f4")), VALUES)
