"""The flow layer: an arrow where vehicles went on from one cell to the next, as many as did."""

from pathlib import Path

import numpy as np
import pytest
from rrd_files import rows_of

from dirprim_filter.drawing import shapes
from dirprim_filter.primitives.primitive_map import PrimitiveMap
from dirprim_filter.viewer.sink import open_stream
from situations import with_ways

WAYS = [(0, 1, 11.0), (1, 2, 2.0), (1, 0, 1.0)]
"""Eleven vehicles from the first cell to the second, two of them on to the third, one that comes back."""


def test_arrows_point_from_cell_to_cell(tmp_path: Path, scene_map: PrimitiveMap) -> None:
    with open_stream(save=tmp_path / "map.rrd") as sink:
        sink.log_map(with_ways(scene_map, cell=[0, 1, 2], ways=WAYS))
    ((_, origins),) = rows_of(tmp_path / "map.rrd", "/map/flow", "Arrows3D:origins")
    ((_, vectors),) = rows_of(tmp_path / "map.rrd", "/map/flow", "Arrows3D:vectors")
    ((_, radii),) = rows_of(tmp_path / "map.rrd", "/map/flow", "Arrows3D:radii")
    rest = 0.5 * (1.0 - shapes.FLOW_LENGTH)
    assert origins[:, :2] == pytest.approx(np.array([[5.0, 5.0], [15.0, 15.0]]) + 10.0 * rest)
    assert vectors[:, :2] == pytest.approx(10.0 * shapes.FLOW_LENGTH)  # the one that came back is not drawn
    assert abs(radii[0]) > abs(radii[1])


def test_a_way_of_few_among_many_is_not_drawn(scene_map: PrimitiveMap) -> None:
    ways = shapes.Flow.of(
        with_ways(scene_map, cell=[0, 1, 2], ways=[(0, 1, 96.0), (0, 2, 4.0), (1, 2, 94.0), (1, 0, 6.0)])
    )
    np.testing.assert_allclose(ways.share, [0.96, 0.06, 0.94])


def test_an_outline_runs_from_tail_to_tip_and_is_as_wide_as_reported(scene_map: PrimitiveMap) -> None:
    ways = shapes.Flow.of(with_ways(scene_map, cell=[0, 1, 2], ways=WAYS))
    outlines = ways.outlines(np.array([1.0, 0.25]))
    np.testing.assert_allclose(outlines[:, 3], ways.origin + ways.vector)
    np.testing.assert_allclose(0.5 * (outlines[:, 0] + outlines[:, 6]), ways.origin)
    np.testing.assert_allclose(np.hypot(*(outlines[:, 0] - outlines[:, 6]).T), [1.0, 0.25])


def test_a_map_without_transitions_has_no_arrows(tmp_path: Path, scene_map: PrimitiveMap) -> None:
    with open_stream(save=tmp_path / "map.rrd") as sink:
        sink.log_map(scene_map)
    assert all(values.size == 0 for _, values in rows_of(tmp_path / "map.rrd", "/map/flow", "Arrows3D:origins"))
