"""k-means in the plane: each generator the mean of its positions, as good as scikit-learn's."""

import numpy as np
import pytest

from tessellation import VoronoiTessellation
from tessellation.voronoi import seeds


def cells_around(position, *, n_cells, seed=0):
    return VoronoiTessellation.lloyd(position, n_cells=n_cells, rng=np.random.default_rng(seed), reach=5.0)


def cost(cells, position):
    return ((position - cells.generators[cells.cell_of(position)]) ** 2).sum()


@pytest.mark.parametrize("offset", [0.0, 1e7])
def test_it_is_as_good_as_that_of_scikit_learn(offset):
    from sklearn.cluster import KMeans

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
    ("position", "n"),
    [
        (np.zeros((100, 2)), 1),
        (np.repeat(np.array([[0.0, 0.0], [1.0, 0.0], [5.0, 5.0]]), 10, axis=0), 3),
        (np.full((4, 2), 1e7), 1),
        (np.column_stack([np.arange(30.0), np.arange(30.0)]), 10),
    ],
)
def test_there_are_no_more_cells_than_distinct_positions(position, n):
    cells = cells_around(position, n_cells=10)
    assert cells.n_cells == n
    assert (cells.cell_of(position) >= 0).all()


def test_cells_that_cannot_be_learned_are_refused():
    with pytest.raises(ValueError, match="n_cells: expected at least 1"):
        cells_around(np.zeros((4, 2)), n_cells=0)
    with pytest.raises(ValueError, match="at least one position"):
        cells_around(np.empty((0, 2)), n_cells=2)
