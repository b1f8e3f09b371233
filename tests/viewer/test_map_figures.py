"""Figures of the whole map: sectors say how probable a way is, colours go around, any cells are drawn."""

from dataclasses import dataclass

import numpy as np
import pytest
from matplotlib.collections import LineCollection, PathCollection, PolyCollection

from dirprim_filter.arrays import FloatArray, IntArray
from dirprim_filter.distributions import VonMisesMixture
from dirprim_filter.drawing import shapes
from dirprim_filter.drawing.colors import direction_color, probability_color
from dirprim_filter.primitives.primitive_map import PrimitiveMap
from dirprim_filter.tracks import Tracks
from dirprim_filter.viewer.figures import cell_figure, rose_figure, transition_figure
from situations import with_ways
from tessellation import GridTessellation


@dataclass(frozen=True)
class TwoTriangles:
    """A tessellation that is no grid: a square of 20 m cut along its diagonal."""

    n_cells: int = 2

    @property
    def centers(self) -> FloatArray:
        return np.array([[13.0, 7.0], [7.0, 13.0]])

    @property
    def area(self) -> FloatArray:
        return np.array([200.0, 200.0])

    def cell_of(self, position: FloatArray) -> IntArray:
        return (position[..., 1] > position[..., 0]).astype(np.int64)

    def polygons(self) -> list[FloatArray]:
        return [np.array([[0.0, 0.0], [20.0, 0.0], [20.0, 20.0]]), np.array([[0.0, 0.0], [20.0, 20.0], [0.0, 20.0]])]


def area_of(polygon: FloatArray) -> float:
    x, y = polygon.T
    return 0.5 * abs(float(np.dot(x, np.roll(y, -1)) - np.dot(y, np.roll(x, -1))))


def test_sectors_hold_all_probability_and_a_sharp_mode_is_one() -> None:
    mixture = VonMisesMixture(
        weight=[[0.7, 0.3], [1.0, 0.0]],
        mean_direction=[[0.0, np.pi], [1.0, 0.0]],
        concentration=[[1e4, 1e4], [0.0, 1.0]],
    )
    share = shapes.sector_probabilities(mixture, n_sectors=4)
    np.testing.assert_allclose(share, [[0.7, 0.0, 0.3, 0.0], [0.25, 0.25, 0.25, 0.25]], atol=1e-6)


def test_a_sectors_area_is_its_probability_and_it_points_that_way(scene_map: PrimitiveMap) -> None:
    roses = shapes.rose_sectors(scene_map)
    assert set(roses.cell) == {0, 1}  # the third holds no data
    area = np.array([area_of(polygon) for polygon in roses.polygon])
    np.testing.assert_allclose(area / roses.probability, area[0] / roses.probability[0], rtol=1e-9)
    most = np.argmax(np.where(roses.cell == 0, roses.probability, 0.0))
    tip = roses.polygon[most, 1:].mean(axis=0) - roses.polygon[most, 0]
    assert np.arctan2(tip[1], tip[0]) == pytest.approx(np.pi / 2, abs=1e-6)


def test_roses_go_from_blue_to_red_lighter_all_the_way() -> None:
    color = probability_color(np.linspace(0.0, 1.0, 100))[:, :3].astype(float)
    assert color[0, 2] > 3 * color[0, 0]
    assert color[-1, 0] > 2 * color[-1, 2]
    assert (np.diff(color @ [0.2126, 0.7152, 0.0722]) > -0.5).all()  # whole numbers


def test_the_rose_figure_draws_every_sector_and_says_what_colour_is(scene_map: PrimitiveMap) -> None:
    figure = rose_figure(scene_map)
    axes, bar = figure.axes[0], figure.axes[-1]
    (sectors,) = [c for c in axes.collections if isinstance(c, PolyCollection)]
    roses = shapes.rose_sectors(scene_map)
    assert len(sectors.get_paths()) == len(roses.probability)
    np.testing.assert_allclose(sectors.get_facecolor(), probability_color(roses.probability) / 255.0)
    assert bar.get_ylabel() == "probability of a 15° sector"


def test_the_transition_figure_draws_arrows_as_wide_as_their_share(scene_map: PrimitiveMap) -> None:
    learned = with_ways(scene_map, cell=[0, 1, 2], ways=[(0, 1, 9.0), (1, 2, 6.0), (1, 0, 2.0)])
    figure = transition_figure(learned)
    axes, key = figure.axes[0], figure.axes[-1]
    (arrows,) = [c for c in axes.collections if isinstance(c, PolyCollection)]
    shafts = np.array([np.hypot(*(path.vertices[0] - path.vertices[6])) for path in arrows.get_paths()])
    np.testing.assert_allclose(shafts / shafts[0], [1.0, 0.75, 0.25])  # the widest lies lowest
    to_north_east, back = (direction_color(np.array(angle)) / 255.0 for angle in (np.pi / 4, -3 * np.pi / 4))
    np.testing.assert_allclose(arrows.get_facecolor(), [to_north_east, to_north_east, back])
    (borders,) = [c for c in axes.collections if isinstance(c, LineCollection)]
    assert len(borders.get_paths()) == 3
    assert any(text.get_text().startswith("width: share") for text in key.texts)


def test_a_map_that_learned_no_transitions_has_cells_alone(scene_map: PrimitiveMap) -> None:
    axes = transition_figure(scene_map).axes[0]
    assert all(len(c.get_paths()) == 0 for c in axes.collections if isinstance(c, PolyCollection))


def test_cells_of_any_shape_are_drawn_over_rows_in_their_colours() -> None:
    tracks = Tracks(
        track_id=np.arange(4), time_ns=np.zeros(4, np.int64), position=np.array([[5.0, 2], [6, 2], [2, 5], [2, 6]]),
        direction=np.array([np.pi, -np.pi + 1e-9, np.pi / 2, 0.0]), speed=np.array([5.0, 5.0, 5.0, 0.0]),
    )  # fmt: skip
    axes, key = cell_figure(TwoTriangles(), tracks).axes
    (borders,) = [c for c in axes.collections if isinstance(c, LineCollection)]
    assert [len(path.vertices) for path in borders.get_paths()] == [4, 4]  # closed
    (rows,) = [c for c in axes.collections if type(c) is PathCollection]
    color = np.asarray(rows.get_facecolor())
    np.testing.assert_allclose(color[0], color[1], atol=0.02)  # west is west from either side
    np.testing.assert_allclose(color[2], direction_color(np.array(np.pi / 2)) / 255.0)
    assert np.ptp(color[3, :3]) == 0.0  # a standing vehicle is grey
    assert borders.get_zorder() > rows.get_zorder()
    assert (axes.get_xlabel(), axes.get_ylabel(), axes.get_aspect()) == ("east [m]", "north [m]", 1.0)
    assert "2 cells\n4 rows\n4 vehicles" in [text.get_text() for text in key.texts]


def test_a_long_road_gets_a_close_up_of_its_busy_part() -> None:
    road = np.column_stack([np.arange(0.0, 300.0, 5.0), np.zeros(60)])
    cells = GridTessellation.covering(road, cell_size=5.0)
    here = np.random.default_rng(0).normal([150.0, 1.0], 3.0, (200, 2)) * [1.0, 0.0] + [0.0, 1.0]
    tracks = Tracks(
        track_id=np.arange(260), time_ns=np.zeros(260, np.int64), position=np.concatenate([road, here]),
        direction=np.zeros(260), speed=np.ones(260),
    )  # fmt: skip
    whole, close_up, _ = cell_figure(cells, tracks).axes
    west, east = close_up.get_xlim()
    assert 100 < west < 150 < east < 200
    assert np.ptp(whole.get_xlim()) > 300
    (frame,) = whole.patches
    assert (frame.get_x(), frame.get_width()) == (west, east - west)
