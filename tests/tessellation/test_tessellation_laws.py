"""What every division of the plane into cells keeps, whatever its shape; it takes memory by what is covered."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from hexagons import Hexagons
from tessellation import OUTSIDE, GridTessellation, Tessellation, VoronoiTessellation
from tessellation.locate import Pixels, cells_of, in_blocks, locator_of


def data(seed=0, n=400):
    return np.random.default_rng(seed).normal(0, 20, (n, 2))


def grid(position):
    return GridTessellation.covering(position, cell_size=4.0)


def voronoi(position):
    return VoronoiTessellation.covering(position, generators=position[::7], reach=4.0)


def lloyd(position):
    return VoronoiTessellation.lloyd(position, n_cells=40, rng=np.random.default_rng(1), reach=4.0)


def hexagons(position):
    return Hexagons.covering(position, width=4.0)


TWINS = [grid, voronoi, lloyd, hexagons]


def scattered(n=3000):
    return np.random.default_rng(9).uniform(-80, 80, (n, 2))


def signed_area(polygon):
    x, y = (polygon - polygon[:1]).T
    return 0.5 * np.sum(x * np.roll(y, -1) - np.roll(x, -1) * y)


def inside(polygon, position, tolerance):
    """Which positions lie in a convex polygon, or so many metres beside it: (k, 2), (n, 2) -> (n,)."""
    if len(polygon) == 0:
        return np.zeros(len(position), bool)
    side = np.roll(polygon, -1, axis=0) - polygon
    away = position[:, None] - polygon
    return (side[:, 0] * away[..., 1] - side[:, 1] * away[..., 0] >= -tolerance * np.hypot(*side.T)).all(axis=1)


@pytest.mark.parametrize("twin", TWINS)
def test_every_twin_is_a_tessellation_whose_cells_cover_the_data_and_nothing_far(twin):
    position = data()
    cells: Tessellation = twin(position)
    assert cells.centers.shape == (cells.n_cells, 2)
    assert cells.area.shape == (cells.n_cells,)
    assert len(cells.polygons()) == cells.n_cells
    assert cells.cell_of(np.zeros((3, 4, 2))).shape == (3, 4)
    assert cells.cell_of(np.zeros(2)).shape == ()
    assert cells.cell_of(np.empty((0, 2))).shape == (0,)
    with pytest.raises(ValueError, match="position: expected finite"):
        cells.cell_of(np.array([np.nan, 0.0]))
    found = cells.cell_of(cells.centers)
    covered = found != OUTSIDE
    assert covered.mean() > 0.9
    np.testing.assert_array_equal(found[covered], np.flatnonzero(covered))
    assert (cells.cell_of(position) != OUTSIDE).all()
    far = position + np.array([300.0, 0.0])
    assert (cells.cell_of(far) == OUTSIDE).all()
    assert (cells.cell_of(np.array([[1e300, 0.0], [0.0, -1e300]])) == OUTSIDE).all()


@pytest.mark.parametrize("offset", [np.zeros(2), np.array([1e7, -1e7])])
@pytest.mark.parametrize("twin", TWINS)
def test_a_position_lies_in_the_polygon_of_its_cell_and_in_no_other(twin, offset):
    """Polygons are counter-clockwise, convex and of the stated area."""
    cells = twin(data() + offset)
    position = scattered(600) + offset
    cell = cells.cell_of(position)
    assert (cell != OUTSIDE).sum() > 80
    for c, (polygon, area) in enumerate(zip(cells.polygons(), cells.area, strict=True)):
        assert inside(polygon, position[cell == c], 1e-6).all()
        within = cell[inside(polygon, position, -1e-6)]
        assert ((within == c) | (within == OUTSIDE)).all()
        assert signed_area(polygon) == pytest.approx(area)
        assert inside(polygon, polygon, 1e-6).all()


@pytest.mark.parametrize("twin", TWINS)
def test_moving_the_data_moves_the_cells(twin):
    move = np.array([1e6, -1e6])  # whole squares; exact in binary, with data rounded so
    position = (data() * 1024).round() / 1024
    here, there = twin(position), twin(position + move)
    at = (scattered() * 1024).round() / 1024
    np.testing.assert_array_equal(here.cell_of(at), there.cell_of(at + move))
    np.testing.assert_allclose(here.centers + move, there.centers, rtol=0, atol=1e-8)
    np.testing.assert_allclose(here.area, there.area, rtol=1e-6)


@pytest.mark.parametrize("twin", TWINS)
def test_compiled_code_finds_the_cell_of_a_point(twin):
    """Exactly, of cells with a locator of their own; of others but for points at a border."""
    cells = twin(data())
    position = scattered(20_000)
    cell, found = cells.cell_of(position), cells_of(locator_of(cells), position)
    if hasattr(cells, "locator"):
        np.testing.assert_array_equal(found, cell)
    else:
        pixel = 4.0 / 40
        corners = pixel * np.array([[1, 1], [1, -1], [-1, 1], [-1, -1]])
        inner = np.all([cells.cell_of(position + corner) == cell for corner in corners], axis=0)
        assert inner.mean() > 0.8
        np.testing.assert_array_equal(found[inner], cell[inner])


@pytest.mark.parametrize("twin", [grid, lloyd, hexagons])
def test_the_order_of_the_data_does_not_matter(twin):
    position = data()
    one, other = twin(position), twin(np.random.default_rng(5).permutation(position))
    np.testing.assert_array_equal(one.centers, other.centers)
    np.testing.assert_array_equal(one.cell_of(scattered()), other.cell_of(scattered()))


# Squares of a grid, and rasters of cells


def test_far_outliers_do_not_allocate_the_plane_between():
    for wrong, line in (([1e9, 1e9], "outliers"), ([0.0, np.nan], "finite")):
        with pytest.raises(ValueError, match=line):
            GridTessellation.covering(np.array([[0.0, 0.0], wrong]), cell_size=1.0)


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
    ],
)
def test_a_grid_that_cannot_be_is_refused(arguments, message):
    good = {"origin": np.zeros(2), "cell_size": 1.0, "n_x": 2, "n_y": 2, "square": np.array([0, 3])}
    with pytest.raises(ValueError, match=message):
        GridTessellation(**(good | arguments))


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
    assert (cells.cell_of(rng.uniform(3e4, 7e4, (500, 2))) == OUTSIDE).all()


@pytest.mark.parametrize("apart_m", [1e-6, 1e-3, 1.0])
def test_rasters_are_as_large_however_near_generators_are(apart_m):
    rng = np.random.default_rng(5)
    way, side = rng.uniform(-90.0, 110.0, (150, 2)), rng.normal(0.0, 1.5, (150, 2))  # two streets, pixels are crowded
    place = np.vstack([np.column_stack([way[:, 0], side[:, 0]]), np.column_stack([side[:, 1] + 30.0, way[:, 1]])])
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
        with pytest.raises(ValueError, match=r"squares, more than 8589934592 in blocks .* larger cells"):
            GridTessellation(origin=np.zeros(2), cell_size=1.0, n_x=n_x, n_y=n_y, square=np.empty(0, np.int64))
