"""Squares of a grid, and rasters of cells: memory by what is covered, what is too large."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from tessellation import OUTSIDE, GridTessellation, VoronoiTessellation
from tessellation.locate import Pixels, in_blocks


def test_outside_is_said_and_far_outliers_do_not_allocate_the_plane_between():
    grid = GridTessellation.covering(np.array([[0.5, 0.5], [10.5, 0.5]]), cell_size=1.0)
    away = np.array([[5.5, 0.5], [-0.5, 0.5], [0.5, 1.5], [1e12, -1e12]])
    assert (grid.cell_of(away) == OUTSIDE).all()
    with pytest.raises(ValueError, match="outliers"):
        GridTessellation.covering(np.array([[0.0, 0.0], [1e9, 1e9]]), cell_size=1.0)
    with pytest.raises(ValueError, match="finite"):
        GridTessellation.covering(np.array([[0.0, np.nan]]), cell_size=1.0)


@given(st.floats(-1e6, 1e6), st.floats(-1e6, 1e6), st.floats(0.01, 1e3))
def test_one_datum_makes_one_cell_that_holds_it(x, y, cell_size):
    grid = GridTessellation.covering(np.array([[x, y]]), cell_size=cell_size)
    assert grid.n_cells == 1
    assert grid.cell_of(np.array([x, y])) == 0


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        ({"cell_size": 0.0}, "cell_size"),
        ({"cell_size": float("nan")}, "cell_size"),
        ({"n_x": 0}, "at least one column"),
        ({"square": np.array([2, 1])}, "ascending"),
        ({"square": np.array([0, 2**62, -(2**62) - 1, 3])}, "ascending"),  # differences wrap
        ({"square": np.array([99])}, "expected numbers from 0 to 3"),
        ({"n_x": 10**6, "n_y": 10**6}, "larger cells"),
    ],
)
def test_a_grid_that_cannot_be_is_refused(arguments, message):
    good = {"origin": np.zeros(2), "cell_size": 1.0, "n_x": 2, "n_y": 2, "square": np.array([0, 3])}
    with pytest.raises(ValueError, match=message):
        GridTessellation(**(good | arguments))


def streets(rng, n=300):
    """Places along some streets, in clusters, so that pixels are crowded."""
    way = rng.uniform(-90.0, 110.0, n)
    side = rng.normal(0.0, 1.5, n)
    return np.where(rng.random(n)[:, None] < 0.5, np.column_stack([way, side]), np.column_stack([side + 30.0, way]))


def test_a_city_takes_memory_by_what_is_covered():
    """100 km each way, 40 km of streets; some 30 times what a raster of all could hold."""
    rng = np.random.default_rng(4)
    way = np.linspace(0.0, 1e5, 20_000)
    position = np.vstack([np.column_stack([way[:4000], 0.5 * way[:4000]]), np.column_stack([way[-4000:], way[-4000:]])])
    cells = VoronoiTessellation.covering(position, generators=position[::8] + rng.normal(0, 1, (1000, 2)), reach=3.0)
    assert cells.region.n_x * cells.region.n_y > 30_000**2
    assert sum(np.asarray(column).nbytes for column in cells.locator) < 64e6
    covered = position[rng.integers(len(position), size=500)] + rng.uniform(-3.0, 3.0, (500, 2))
    squared = ((covered[:, None] - cells.generators) ** 2).sum(axis=2)
    assert np.array_equal(cells.cell_of(covered), squared.argmin(axis=1))
    assert (cells.cell_of(rng.uniform(3e4, 7e4, (500, 2))) == -1).all()


@pytest.mark.parametrize("apart_m", [1e-6, 1e-3, 1.0])
def test_rasters_are_as_large_however_near_generators_are(apart_m):
    rng = np.random.default_rng(5)
    place = streets(rng)
    generators = np.vstack([place[::10], place[0] + apart_m * rng.normal(size=(60, 2))])
    cells = VoronoiTessellation.covering(place, generators=generators, reach=3.0)
    assert sum(np.asarray(column).nbytes for column in cells.locator) < 3e6
    squared = ((place[:, None] - generators) ** 2).sum(axis=2)
    np.testing.assert_array_equal(cells.cell_of(place), squared.argmin(axis=1))
    assert np.isfinite(cells.area).all()


def test_squares_too_scattered_or_too_many_for_memory_are_refused():
    square = np.arange(0, 1 << 33, 8191, dtype=np.int64)[: 1 << 21]
    with pytest.raises(ValueError, match=r"blocks of 16 x 16 pixels take .* remove far outliers"):
        in_blocks(np.zeros(2), 3.0, (1 << 13, 1 << 20), Pixels(*np.divmod(square, 1 << 20), square))
    for n_x, n_y in ((1 << 31, 1), (1 << 18, 1 << 17), (1 << 62, 1 << 62)):
        with pytest.raises(ValueError, match="squares, more than 8589934592 in blocks"):
            GridTessellation(origin=np.zeros(2), cell_size=1.0, n_x=n_x, n_y=n_y, square=np.empty(0, np.int64))
