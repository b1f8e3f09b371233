"""The colour bar hides as little of the map as can be."""

from dataclasses import replace

import numpy as np
import pytest

from dirprim_filter.primitives.primitive_map import PrimitiveMap
from dirprim_filter.viewer.texts import BAR, legend

BOX = np.array([[0.0, 0.0], [200.0, 100.0]])


@pytest.mark.parametrize(
    ("east", "with_data", "is_east"),
    [(0.0, 1, True), (0.0, 0, False), (-180.0, 1, False), (50.0, 1, False)],
)  # fmt: skip
def test_the_bar_lies_where_fewer_cells_are(
    scene_map: PrimitiveMap, east: float, with_data: int, is_east: bool
) -> None:
    box = BOX + np.array([[east, max(east, 0.0)]])
    seen = replace(scene_map, n_rows=with_data * scene_map.n_rows)  # cells that hold data at (5, 5) and (15, 15)
    bar = dict(legend(seen, extent=box, fastest=10.0))["/map/legend"][0]
    x = np.asarray(bar.vertex_positions.as_arrow_array().flatten()).reshape(-1, 3)[:, 0]
    start = box[1, 0] - BAR[0] * 200.0 if is_east else box[0, 0]
    assert (x.min(), x.max()) == pytest.approx((start, start + BAR[0] * 200.0))
