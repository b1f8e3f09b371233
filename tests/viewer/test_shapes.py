"""Laws of the shapes: areas are probabilities, north is up, ellipses hold what they say."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.stats import chi2

from dirprim_filter.drawing import shapes
from dirprim_filter.primitives._modes import Modes
from dirprim_filter.primitives.primitive_map import PrimitiveMap
from tessellation import GridTessellation

COVARIANCE = np.array([[4.0, 1.5], [1.5, 1.0]])


def area_of(polygon):
    """The shoelace formula."""
    x, y = polygon.T
    return 0.5 * abs(float(x @ np.roll(y, 1) - y @ np.roll(x, 1)))


def test_petals_point_where_a_cells_own_modes_go_the_heaviest_first(scene_map):
    petals = shapes.rose_petals(scene_map)
    north = petals.polygon[petals.cell == 0][0] - scene_map.tessellation.centers[0]
    tip = north[np.argmax(np.hypot(*north.T))]
    assert tip[1] > 0
    assert abs(tip[0]) < 0.05 * tip[1]
    assert (np.hypot(*north.T) <= shapes.REACH * 5.0 + 1e-9).all()
    assert petals.cell.tolist() == [0, 1, 1]  # cell 2 holds no data; the last mode is the background's
    assert petals.weight == pytest.approx([1.0, 2 / 3, 1 / 3])
    assert petals.mean_speed.tolist() == [8.0, 8.0, 4.0]
    assert shapes.fastest_speed(petals) == 8.0


def test_a_petals_area_is_its_weight_times_the_root_of_the_traffic_whatever_its_concentration(scene_map):
    petals = shapes.rose_petals(scene_map)
    of_cell = petals.weight * np.sqrt(scene_map.n_rows[petals.cell])
    area = np.array([area_of(p) for p in petals.polygon])
    # 24 vertices and the cut at the rim cost at most 3 %; lengths, the wrong quantity, differ by far more.
    assert area / of_cell == pytest.approx((area / of_cell)[0], rel=0.03)
    length = np.hypot(*(petals.polygon - petals.polygon[:, :1]).transpose(2, 0, 1)).max(axis=1)
    assert np.ptp(length / of_cell) > 0.3 * (length / of_cell).max()


def test_a_rose_grows_with_traffic_more_than_with_its_cell(scene_map):
    def reach(n_rows):
        petals = shapes.rose_petals(replace(scene_map, n_rows=np.array([*n_rows, 0, sum(n_rows)])))
        return dict(zip(petals.cell.tolist(), petals.reach.tolist(), strict=True))

    assert reach([100, 100])[1] == pytest.approx(reach([100, 100])[0])
    assert reach([160, 31])[1] == pytest.approx((31 / 160) ** 0.25 * reach([160, 31])[0])
    assert reach([10**6, 1])[1] == pytest.approx(shapes.TRAFFIC[0] ** 0.25 * reach([10**6, 1])[0])


def test_in_a_city_the_cells_of_a_square_have_one_rose_of_the_modes_that_differ():
    """Roads of 40 by 40 cells of 10 m: all go east or, one in four, west, by up to 20 degrees aside."""
    cells = GridTessellation.covering(np.argwhere(np.ones((40, 40))) * 10.0 + 5.0, cell_size=10.0)
    n, aside = cells.n_cells + 1, np.radians(np.tile([-20.0, 20.0], cells.n_cells // 2 + 1)[: cells.n_cells + 1])
    of = PrimitiveMap(
        tessellation=cells, modes=Modes.flat(
            np.tile([0.75, 0.25], (n, 1)), np.column_stack([aside, np.pi - aside]), np.full((n, 2), 200.0),
            np.ones((n, 2)), np.tile([0.1, 0.2], (n, 1)),
        ), n_rows=np.full(n, 10), n_background_modes=0,
    )  # fmt: skip
    petals = shapes.rose_petals(of, spacing=100.0)
    assert np.bincount(petals.cell).tolist() == [2] * 16
    heaviest, lighter = petals.weight > 0.5, petals.weight < 0.5
    assert petals.weight[heaviest] == pytest.approx(0.75)
    assert petals.mean_speed[heaviest] == pytest.approx(10.0)
    assert petals.mean_speed[lighter] == pytest.approx(5.0)
    heads = shapes.petal_heads(petals)
    ahead = heads[:, 1] - petals.polygon[:, 0]
    assert np.abs(ahead[:, 1]).max() < 0.05 * np.abs(ahead[:, 0]).min()  # what is aside on both sides is straight on
    assert np.array_equal(ahead[:, 0] > 0, heaviest)
    assert np.abs(ahead[heaviest]).max() > 50.0  # where one cell's would be 7 m
    assert len(shapes.rose_petals(of).polygon) == 2 * cells.n_cells


def test_vehicles_that_stand_are_a_disc_and_leave_the_petals_of_the_others_as_large(scene_map):
    modes = scene_map.modes._replace(rate=np.where(np.arange(3) == 0, 100.0, scene_map.speed.rate))  # mode 1 stands
    petals = shapes.rose_petals(replace(scene_map, modes=modes))
    assert petals.is_disc.tolist() == [True, True, False]  # beneath what moves
    assert petals.weight.tolist() == [0.9, 0.6, 1.0]
    (alone,) = shapes.rose_petals(scene_map).polygon[2:]
    assert area_of(petals.polygon[2]) == pytest.approx(3.0 * area_of(alone))
    rim = shapes.petal_colors(petals, fastest=8.0)
    assert (rim[petals.is_disc, 0] == rim[petals.is_disc, 1]).all()
    assert (rim[2, 0] != rim[2, 1]).any()


def test_most_of_the_traffic_leaves_out_who_is_far_away_and_without_traffic_all_is_shown(scene_map):
    """A thousandth of the rows lies a kilometre off; control: a tenth is shown."""

    def width(n_far):
        places = np.array([[5.0, 5.0], [15.0, 5.0], [1005.0, 5.0]])
        cells = GridTessellation.covering(places, cell_size=10.0)
        n_rows = np.zeros(cells.n_cells + 1, np.int64)
        n_rows[cells.cell_of(places)] = 500, 500, n_far
        one = np.ones((cells.n_cells + 1, 1))
        of = PrimitiveMap(
            tessellation=cells, modes=Modes.flat(one, 0.0 * one, one, one, one), n_rows=n_rows, n_background_modes=0,
        )  # fmt: skip
        return float(np.ptp(shapes.map_extent(of, share=0.99), axis=0)[0])

    assert width(1) < 50.0
    assert width(100) > 1000.0
    for quiet in (scene_map.without_places(), replace(scene_map, n_rows=np.zeros(4, np.int64))):
        assert (shapes.map_extent(quiet, share=0.5) == shapes.map_extent(quiet)).all()


@pytest.mark.parametrize("probability", [0.5, 0.9])
def test_the_ellipse_holds_its_probability(probability):
    """Its rim lies at the quantile of the squared Mahalanobis distance, which of a Gaussian is chi-squared."""
    half, angle = shapes.covariance_axes(COVARIANCE, probability=probability)
    t, turn = np.linspace(0.0, 2.0 * np.pi, 9), np.array([np.cos(angle), np.sin(angle)])
    rim = half[0] * np.cos(t)[:, None] * turn + half[1] * np.sin(t)[:, None] * turn[::-1] * [-1, 1]
    distance = np.einsum("ni,ij,nj->n", rim, np.linalg.inv(COVARIANCE), rim)
    np.testing.assert_allclose(distance, chi2.ppf(probability, 2), rtol=1e-9)


def test_arrows_and_outlines_point_along_the_direction():
    direction = np.array([0.0, np.pi / 2, -3 * np.pi / 4])
    arrow = shapes.motion_arrow(direction, np.array([1.0, 1.5, 2.0]))
    assert arrow == pytest.approx(np.array([[1, 0], [0, 1.5], [-np.sqrt(2), -np.sqrt(2)]]), abs=1e-12)
    outline = shapes.vehicle_outline(np.zeros((3, 2)), direction, np.array([[4.0, 2.0, 1.5]] * 3))
    bow = outline[:, 2]
    assert np.arctan2(bow[:, 1], bow[:, 0]) == pytest.approx(direction)
    assert np.hypot(*bow.T) == pytest.approx(2.0)
    assert (outline[:, 0] == outline[:, -1]).all()


def test_a_petal_bends_as_its_mode_does_and_keeps_its_area(scene_map):
    bend = np.zeros((4, 3, 2))
    bend[0, 0] = [0.3, 0.06]  # the mode of the first cell heads north: 0.06 rad in each metre along its way
    maps = scene_map, replace(scene_map, modes=scene_map.modes._replace(bend=bend))
    straight, bent = (shapes.rose_petals(of).polygon[0] - scene_map.tessellation.centers[0] for of in maps)
    assert bent[0] == pytest.approx(0.0)
    length = np.hypot(*straight.T)
    tip = int(length.argmax())
    half_turn = 0.5 * 0.06 * length[tip]  # the chord of an arc points half its turn aside, to the left
    assert np.arctan2(*bent[tip][::-1]) - np.arctan2(*straight[tip][::-1]) == pytest.approx(half_turn)
    assert np.hypot(*bent[tip]) == pytest.approx(length[tip] * np.sin(half_turn) / half_turn)
    assert area_of(bent) == pytest.approx(area_of(straight), rel=0.05)
