"""The flow layer: an arrow where vehicles went on from one cell to the next, as many as did."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from rrd_files import rows_of

from dirprim_filter.primitives.journeys import Journeys
from dirprim_filter.primitives.primitive_map import PrimitiveMap
from dirprim_filter.viewer import marks
from dirprim_filter.viewer.stream import open_stream


def with_journeys(scene_map: PrimitiveMap) -> PrimitiveMap:
    """Nine vehicles from the first cell to the second, two straight to the third, one that comes back."""
    ways = [[(5, 5), (15, 15)]] * 9 + [[(5, 5), (11, 11), (25, 25)]] * 2 + [[(15, 15), (5, 5)]]
    position = np.concatenate([np.asarray(way, float) for way in ways])
    duration = np.concatenate([[0.5] * (len(way) - 1) + [0.0] for way in ways])
    journeys = Journeys(
        position=position, direction=np.zeros(len(position)), speed=np.ones(len(position)), duration=duration
    )
    return replace(scene_map, journeys=journeys)


def test_arrows_point_from_cell_to_cell(tmp_path: Path, scene_map: PrimitiveMap) -> None:
    with open_stream(save=tmp_path / "map.rrd") as sink:
        sink.log_map(with_journeys(scene_map))
    ((_, origins),) = rows_of(tmp_path / "map.rrd", "/map/flow", "Arrows3D:origins")
    ((_, vectors),) = rows_of(tmp_path / "map.rrd", "/map/flow", "Arrows3D:vectors")
    ((_, radii),) = rows_of(tmp_path / "map.rrd", "/map/flow", "Arrows3D:radii")
    rest = 0.5 * (1.0 - marks.FLOW_LENGTH)
    assert origins[:, :2] == pytest.approx(np.array([[5.0, 5.0], [15.0, 15.0]]) + 10.0 * rest)
    assert vectors[:, :2] == pytest.approx(10.0 * marks.FLOW_LENGTH)  # the one that came back is not drawn
    assert abs(radii[0]) > abs(radii[1])


def test_a_map_that_remembers_nothing_has_no_arrows(tmp_path: Path, scene_map: PrimitiveMap) -> None:
    with open_stream(save=tmp_path / "map.rrd") as sink:
        sink.log_map(scene_map)
    assert all(values.size == 0 for _, values in rows_of(tmp_path / "map.rrd", "/map/flow", "Arrows3D:origins"))
