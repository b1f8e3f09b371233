"""The colour bar hides as little of the map as can be."""

from dataclasses import replace

import numpy as np
import pytest

from dirprim_filter.primitives.primitive_map import PrimitiveMap
from dirprim_filter.viewer.legend import BAR_WIDTH, Legend

BOX = np.array([[0.0, 0.0], [200.0, 100.0]])


@pytest.mark.parametrize(
    ("box", "is_east"), [(BOX, True), (BOX - np.array([180.0, 0.0]), False), (BOX + np.array([50.0, 0.0]), False)]
)
def test_the_bar_lies_where_fewer_cells_are(scene_map: PrimitiveMap, box: np.ndarray, is_east: bool) -> None:
    legend = Legend.of(scene_map, extent=box, fastest=10.0)  # cells that hold data at (5, 5) and (15, 15)
    assert legend.is_east is is_east
    x = np.asarray(legend.bar().vertex_positions.as_arrow_array().flatten()).reshape(-1, 3)[:, 0]
    start = box[1, 0] - BAR_WIDTH * 200.0 if is_east else box[0, 0]
    assert (x.min(), x.max()) == pytest.approx((start, start + BAR_WIDTH * 200.0))


def test_cells_without_data_do_not_count(scene_map: PrimitiveMap) -> None:
    empty = replace(scene_map, n_rows=np.zeros_like(scene_map.n_rows))
    assert not Legend.of(empty, extent=BOX, fastest=10.0).is_east
