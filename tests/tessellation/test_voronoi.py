"""Voronoi cells against brute force where they locate and draw, and against scikit-learn where they are learned."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.spatial import Voronoi, cKDTree
from sklearn.cluster import KMeans
from test_tessellation_laws import inside

from tessellation import OUTSIDE, GridTessellation, VoronoiTessellation
from tessellation.voronoi import seeds


def nearest(generators, position):
    """The oracle: every squared distance, the first of the smallest."""
    return ((position[:, None] - generators) ** 2).sum(axis=-1).argmin(axis=1)


def one_square(low, high):
    low, side = np.asarray(low, float), float(high - low)
    return GridTessellation(origin=np.full(2, low), cell_size=side, n_x=1, n_y=1, square=np.array([0]))


def lattice(along):
    return np.stack(np.meshgrid(along, along), -1).reshape(-1, 2)


GENERATORS = {
    "one": lambda rng: np.array([[3.0, 4.0]]),
    "two": lambda rng: np.array([[3.0, 4.0], [-3.0, 4.0]]),
    "collinear": lambda rng: np.column_stack([np.arange(-50.0, 50.0, 2.5), np.arange(-50.0, 50.0, 2.5)]),
    "lattice": lambda rng: lattice(np.arange(-30.0, 31.0, 5.0)),
    "circle": lambda rng: 40 * np.column_stack([f(np.arange(100) * np.pi / 50) for f in (np.cos, np.sin)]),
    "uniform": lambda rng: rng.uniform(-100, 100, (1000, 2)),
    "roads": lambda rng: rng.permuted(np.outer(rng.uniform(-100, 100, 1000), [1.0, 0.0]), axis=1),  # a line each
    "clustered": lambda rng: np.concatenate(
        [rng.uniform(-100, 100, (50, 2)), rng.normal((20.0, -7.0), 1e-3, (2000, 2)), rng.normal(0, 1.0, (500, 2))]
    ),
    "far away": lambda rng: 1e4 + rng.normal(0, 1.0, (300, 2)),
}


@pytest.mark.parametrize("offset", [0.0, 1e7])
@pytest.mark.parametrize("name", GENERATORS)
def test_the_nearest_generator_has_the_position(name, offset):
    rng = np.random.default_rng(0)
    generators = GENERATORS[name](rng) + offset
    some, anywhere = generators[rng.integers(len(generators), size=400)], rng.uniform(-100, 100, (400, 2)) + offset
    position = np.concatenate([anywhere, some + rng.normal(0, 2e-3, some.shape), some, some.round(1)])
    position = position[(np.abs(position - offset) < 128).all(axis=1)]
    cells = VoronoiTessellation(generators=generators, region=one_square(offset - 128, offset + 128))
    np.testing.assert_array_equal(cells.cell_of(position), nearest(generators, position))


@given(
    st.lists(st.tuples(st.integers(-4, 4), st.integers(-4, 4)), min_size=1, max_size=40, unique=True),
    st.sampled_from([1.0, 1e-3, 1e5]),
    st.sampled_from([0.0, 1e7, -3e6 / 7]),
)
@settings(deadline=None, max_examples=50)
def test_ties_go_to_the_first(corners, scale, offset):
    generators = np.array(corners) * scale + offset
    position = lattice(np.arange(-8, 9)) * (0.5 * scale) + offset
    cells = VoronoiTessellation(generators=generators, region=one_square(offset - 5 * scale, offset + 5 * scale))
    np.testing.assert_array_equal(cells.cell_of(position), nearest(generators, position))


def test_the_region_is_what_lies_near_the_data_and_no_more():
    rng = np.random.default_rng(2)
    data = rng.normal(0, 100, (60, 2))
    cells = VoronoiTessellation.covering(data, generators=data[::3], reach=7.0)
    position = rng.uniform(-400, 400, (20_000, 2))
    distance, _ = cKDTree(data).query(position)
    covered = cells.cell_of(position) != OUTSIDE
    assert covered[distance <= 7.0].all()
    assert not covered[distance > 2 * np.sqrt(2) * 7.0].any()
    np.testing.assert_array_equal(covered, cells.region.cell_of(position) != OUTSIDE)


@pytest.mark.parametrize("name", ["one", "two", "collinear", "lattice", "circle", "clustered", "far away"])
def test_polygons_are_the_nearest_positions_within_their_boxes(name):
    rng = np.random.default_rng(3)
    generators = GENERATORS[name](rng)
    data = rng.uniform(-60, 60, (40, 2))
    cells = VoronoiTessellation.covering(data, generators=generators, reach=9.0)
    position = rng.uniform(-90, 90, (1500, 2))
    cell, polygons = cells.cell_of(position), cells.polygons()
    owner = nearest(generators, position)
    for c in np.unique(cell[cell >= 0]):
        mine = position[cell == c]
        boxed = ((position >= mine.min(axis=0)) & (position <= mine.max(axis=0))).all(axis=1)
        held = inside(polygons[c], position, 1e-6)
        assert held[boxed & (owner == c)].all()
        assert not held[owner != c].any()


def test_polygons_of_a_filled_region_are_those_of_qhull():
    generators = np.random.default_rng(4).uniform(0, 10, (200, 2))
    cells = VoronoiTessellation(generators=generators, region=one_square(0, 10))
    diagram, n_inner = Voronoi(generators), 0
    for mine, region in zip(cells.polygons(), diagram.point_region, strict=True):
        corners = diagram.vertices[diagram.regions[region]]
        if -1 not in diagram.regions[region] and (np.abs(corners - 5) < 5).all():
            np.testing.assert_allclose(mine[np.lexsort(mine.T)], corners[np.lexsort(corners.T)], atol=1e-8)
            n_inner += 1
    assert n_inner > 100
    assert cells.area.sum() == pytest.approx(100.0)


def test_no_generator_makes_no_cell_and_one_far_from_the_data_owns_nothing():
    data = np.zeros((1, 2))
    cells = VoronoiTessellation.covering(data, generators=np.array([[0.0, 0.0], [1000.0, 0.0]]), reach=5.0)
    assert (cells.n_cells, cells.area[1], cells.polygons()[1].shape) == (2, 0.0, (0, 2))
    cells = VoronoiTessellation.covering(data, generators=np.empty((0, 2)), reach=5.0)
    assert (cells.n_cells, cells.polygons(), cells.area.shape) == (0, [], (0,))
    assert cells.cell_of(np.zeros(2)) == OUTSIDE


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        ({"generators": np.array([[1.0, 2.0], [0.0, 0.0], [1.0, 2.0]])}, r"got \(1.0, 2.0\) as number 0 and 2"),
        ({"generators": np.array([[1.0, np.nan]])}, "generators: expected finite"),
        ({"generators": np.zeros((3, 3))}, r"generators: expected shape \(n, 2\)"),
        ({"reach": 0.0}, "reach: expected a positive"),
        ({"reach": float("nan")}, "reach: expected a positive"),
        ({"position": np.empty((0, 2))}, "expected at least one position"),
        ({"position": np.array([[0.0, 0.0], [1e9, 1e9]])}, "outliers"),
    ],
)
def test_cells_that_cannot_be_are_refused(arguments, message):
    good = {"position": np.zeros((1, 2)), "generators": np.zeros((1, 2)), "reach": 1.0}
    given = good | arguments
    with pytest.raises(ValueError, match=message) as caught:
        VoronoiTessellation.covering(given.pop("position"), **given)
    assert "\n" not in str(caught.value)


def cells_around(position, *, n_cells, seed=0):
    return VoronoiTessellation.lloyd(position, n_cells=n_cells, rng=np.random.default_rng(seed), reach=5.0)


def cost(cells, position):
    return ((position - cells.generators[cells.cell_of(position)]) ** 2).sum()


@pytest.mark.parametrize("offset", [0.0, 1e7])
def test_it_is_as_good_as_that_of_scikit_learn(offset):
    position = np.random.default_rng(0).normal(0, 30, (3000, 2))
    ours = cost(cells_around(position + offset, n_cells=50), position + offset)
    theirs = KMeans(50, n_init=5, random_state=0).fit(position).inertia_
    assert ours < 1.1 * theirs


def test_seeds_are_drawn_as_by_the_plain_algorithm():
    rng = np.random.default_rng(4)
    position, weight, uniform = rng.integers(0, 64, (500, 2)).astype(float), rng.integers(1, 5, 500), rng.random(60)
    squared = np.ones(500)
    expected = []
    for u in uniform:  # integers: all sums are exact, in whatever order
        expected.append(np.searchsorted(np.cumsum(weight * squared), u * (weight * squared).sum(), side="right"))
        away = ((position - position[expected[-1]]) ** 2).sum(axis=1)
        squared = np.minimum(squared, away) if len(expected) > 1 else away
    np.testing.assert_array_equal(seeds(position, weight.astype(float), uniform), expected)


@pytest.mark.parametrize(
    ("position", "asked", "n"),
    [
        (np.zeros((100, 2)), 10, 1),
        (np.repeat(np.array([[0.0, 0.0], [1.0, 0.0], [5.0, 5.0]]), 10, axis=0), 10, 3),
        (np.full((4, 2), 1e7), 10, 1),
        (np.column_stack([np.arange(30.0), np.arange(30.0)]), 10, 10),
        (np.column_stack([np.arange(600.0), np.zeros(600)]), 3_000_000, 600),
    ],
)
def test_there_are_as_many_cells_as_asked_for_but_no_more_than_distinct_positions(position, asked, n):
    cells = cells_around(position, n_cells=asked)
    assert cells.n_cells == n
    assert (cells.cell_of(position) >= 0).all()


def test_cells_that_cannot_be_learned_are_refused():
    with pytest.raises(ValueError, match="n_cells: expected at least 1"):
        cells_around(np.zeros((4, 2)), n_cells=0)
    with pytest.raises(ValueError, match="at least one position"):
        cells_around(np.empty((0, 2)), n_cells=2)
