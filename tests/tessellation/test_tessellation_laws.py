"""What every division of the plane into cells keeps, whatever its shape."""

import numpy as np
import pytest

from hexagons import Hexagons
from tessellation import OUTSIDE, GridTessellation, Tessellation, VoronoiTessellation
from tessellation.locate import cells_of, locator_of


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
def test_every_twin_is_a_tessellation(twin):
    cells: Tessellation = twin(data())
    assert cells.centers.shape == (cells.n_cells, 2)
    assert cells.area.shape == (cells.n_cells,)
    assert len(cells.polygons()) == cells.n_cells
    assert cells.cell_of(np.zeros((3, 4, 2))).shape == (3, 4)
    assert cells.cell_of(np.zeros(2)).shape == ()
    assert cells.cell_of(np.empty((0, 2))).shape == (0,)
    with pytest.raises(ValueError, match="position: expected finite"):
        cells.cell_of(np.array([np.nan, 0.0]))


@pytest.mark.parametrize("twin", TWINS)
def test_centers_belong_to_their_cells_data_are_covered_and_what_is_far_is_outside(twin):
    position = data()
    cells = twin(position)
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
    cells = twin(data() + offset)
    position = scattered(600) + offset
    cell = cells.cell_of(position)
    assert (cell != OUTSIDE).sum() > 80
    for c, polygon in enumerate(cells.polygons()):
        assert inside(polygon, position[cell == c], 1e-6).all()
        within = cell[inside(polygon, position, -1e-6)]
        assert ((within == c) | (within == OUTSIDE)).all()


@pytest.mark.parametrize("twin", TWINS)
def test_polygons_are_counter_clockwise_convex_and_of_the_stated_area(twin):
    cells = twin(data())
    for polygon, area in zip(cells.polygons(), cells.area, strict=True):
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


def test_the_numbers_of_generators_are_those_of_their_cells():
    position = data()
    generators = position[::7]
    order = np.random.default_rng(6).permutation(len(generators))
    one = VoronoiTessellation.covering(position, generators=generators, reach=4.0)
    other = VoronoiTessellation.covering(position, generators=generators[order], reach=4.0)
    np.testing.assert_array_equal(one.cell_of(position), order[other.cell_of(position)])
    np.testing.assert_allclose(one.area[order], other.area)
