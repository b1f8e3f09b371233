import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from tessellation import OUTSIDE, GridTessellation


def scattered(seed=0, n=300):
    return np.random.default_rng(seed).normal(0, 20, (n, 2))


@pytest.mark.parametrize("cell_size", [0.7, 3.0, 50.0])
def test_every_datum_lies_in_the_polygon_of_its_cell(cell_size):
    position = scattered()
    grid = GridTessellation.covering(position, cell_size=cell_size)
    cell = grid.cell_of(position)
    assert (cell != OUTSIDE).all()
    corners = np.array(grid.polygons())[cell]
    assert (corners.min(axis=1) <= position + 1e-9).all()
    assert (position <= corners.max(axis=1) + 1e-9).all()
    assert set(cell) == set(range(grid.n_cells))  # and no cell is empty


def test_polygons_are_counter_clockwise_and_of_the_stated_area():
    grid = GridTessellation.covering(scattered(), cell_size=5.0)
    for polygon, area in zip(grid.polygons(), grid.area, strict=True):
        x, y = polygon.T
        assert 0.5 * np.sum(x * np.roll(y, -1) - np.roll(x, -1) * y) == pytest.approx(area)


def test_centers_lie_in_their_own_cell():
    grid = GridTessellation.covering(scattered(), cell_size=5.0)
    np.testing.assert_array_equal(grid.cell_of(grid.centers), np.arange(grid.n_cells))


def test_neighbors_share_a_side_and_are_mutual():
    grid = GridTessellation.covering(scattered(), cell_size=5.0)
    distance = np.linalg.norm(grid.centers[:, None] - grid.centers[None], axis=-1)
    for cell in range(grid.n_cells):
        expected = np.flatnonzero(np.isclose(distance[cell], 5.0))
        np.testing.assert_array_equal(grid.neighbors(cell), expected)


def test_outside_is_said_and_never_clipped():
    grid = GridTessellation.covering(np.array([[0.5, 0.5], [10.5, 0.5]]), cell_size=1.0)
    away = np.array([[5.5, 0.5], [-0.5, 0.5], [0.5, 1.5], [1e12, -1e12]])
    assert (grid.cell_of(away) == OUTSIDE).all()


@given(st.floats(-1e6, 1e6), st.floats(-1e6, 1e6), st.floats(0.01, 1e3))
def test_one_datum_makes_one_cell_that_holds_it(x, y, cell_size):
    grid = GridTessellation.covering(np.array([[x, y]]), cell_size=cell_size)
    assert grid.n_cells == 1
    assert grid.cell_of(np.array([x, y])) == 0


def test_leading_axes_are_kept():
    grid = GridTessellation.covering(scattered(), cell_size=5.0)
    assert grid.cell_of(np.zeros((3, 4, 2))).shape == (3, 4)
    assert grid.cell_of(np.zeros(2)).shape == ()


def test_the_empty_grid_covers_nothing():
    grid = GridTessellation.empty()
    assert grid.n_cells == 0
    assert grid.polygons() == []
    assert (grid.cell_of(scattered()) == OUTSIDE).all()


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        ({"cell_size": 0.0}, "cell_size"),
        ({"cell_size": float("nan")}, "cell_size"),
        ({"n_x": 0}, "at least one column"),
        ({"square": np.array([2, 1])}, "ascending"),
        ({"square": np.array([99])}, "expected numbers from 0 to 3"),
        ({"n_x": 10**6, "n_y": 10**6}, "larger cells"),
    ],
)
def test_a_grid_that_cannot_be_is_refused(arguments, message):
    good = {"origin": np.zeros(2), "cell_size": 1.0, "n_x": 2, "n_y": 2, "square": np.array([0, 3])}
    with pytest.raises(ValueError, match=message):
        GridTessellation(**(good | arguments))


def test_far_outliers_do_not_allocate_the_plane_between():
    with pytest.raises(ValueError, match="outliers"):
        GridTessellation.covering(np.array([[0.0, 0.0], [1e9, 1e9]]), cell_size=1.0)
    with pytest.raises(ValueError, match="finite"):
        GridTessellation.covering(np.array([[0.0, np.nan]]), cell_size=1.0)
