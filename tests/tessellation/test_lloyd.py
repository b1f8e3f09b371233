"""k-means in the plane: each generator the mean of its positions, as good as scikit-learn's."""

import numpy as np
import pytest

from tessellation import VoronoiTessellation
from tessellation.lloyd import seeds


def cells_around(position, *, n_cells, seed=0, weight=None):
    rng = np.random.default_rng(seed)
    return VoronoiTessellation.lloyd(position, n_cells=n_cells, rng=rng, reach=5.0, weight=weight)


def cost(cells, position):
    return ((position - cells.generators[cells.cell_of(position)]) ** 2).sum()


@pytest.mark.parametrize("offset", [0.0, 1e7])
def test_it_is_as_good_as_that_of_scikit_learn(offset):
    from sklearn.cluster import KMeans

    position = np.random.default_rng(0).normal(0, 30, (3000, 2))
    ours = cost(cells_around(position + offset, n_cells=50), position + offset)
    theirs = KMeans(50, n_init=5, random_state=0).fit(position).inertia_
    assert ours < 1.1 * theirs


def test_generators_end_near_the_means_of_their_positions():
    position = np.random.default_rng(1).normal(0, 30, (3000, 2))
    cells = cells_around(position, n_cells=20)
    cell = cells.cell_of(position)
    means = np.array([position[cell == c].mean(axis=0) for c in range(cells.n_cells)])
    np.testing.assert_allclose(cells.generators, means, atol=1.0)
    random = np.random.default_rng(2).choice(position, 20, replace=False)  # a control: no seeds are so near
    assert np.abs(random - means).max() > 5.0


def test_clusters_far_apart_get_a_generator_each():
    corner = np.stack(np.meshgrid(np.arange(8), np.arange(8)), -1).reshape(-1, 1, 2) * 100.0
    position = (corner + np.random.default_rng(3).normal(0, 1, (64, 30, 2))).reshape(-1, 2)
    found = sum(cost(cells_around(position, n_cells=64, seed=s), position) < 64 * 30 * 4 for s in range(10))
    uniform = 0
    for s in range(10):  # the control: seeds drawn uniformly miss clusters
        chosen = np.random.default_rng(s).choice(64 * 30, 64, replace=False) // 30
        uniform += np.unique(chosen).size == 64
    assert uniform == 0
    assert found > 0


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


def test_a_weight_counts_as_so_many_positions():
    rng = np.random.default_rng(5)
    position, weight = rng.normal(0, 30, (300, 2)), rng.integers(0, 4, 300)
    weighted = cells_around(position, n_cells=12, weight=weight.astype(float))
    repeated = cells_around(np.repeat(position, weight, axis=0), n_cells=12)
    np.testing.assert_allclose(weighted.generators, repeated.generators, rtol=1e-12, atol=1e-9)


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


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        ({"n_cells": 0}, "n_cells: expected at least 1"),
        ({"weight": np.zeros(4)}, "at least one position of positive weight"),
        ({"weight": np.array([1.0, -1.0, 1.0, 1.0])}, "no negative number, got -1.0 at 1"),
        ({"weight": np.ones(3)}, r"expected shape \(4,\)"),
        ({"weight": np.array([1.0, np.nan, 1.0, 1.0])}, "weight: expected finite"),
        ({"position": np.empty((0, 2)), "weight": None}, "at least one position"),
    ],
)
def test_cells_that_cannot_be_learned_are_refused(arguments, message):
    given = {"position": np.arange(8.0).reshape(4, 2), "n_cells": 2, "weight": None} | arguments
    with pytest.raises(ValueError, match=message):
        cells_around(given["position"], n_cells=given["n_cells"], weight=given["weight"])
