"""Cells learned together with a model that has nothing to do with roads."""

from typing import NamedTuple

import numpy as np
import pytest
from scipy.spatial import cKDTree

from tessellation import OUTSIDE, JointFit, VoronoiTessellation, fit_jointly
from tessellation.gates import members_of

TRUE = np.array([[0.0, 0.0], [20.0, 4.0], [6.0, 18.0], [26.0, 22.0], [-14.0, 14.0]])
LEVEL = np.array([0.0, 3.0, -3.0, 6.0, -6.0])


class Levels(NamedTuple):
    mean: np.ndarray
    spread: np.ndarray


class GaussianCells:
    """One normal distribution in each cell, leaning on (0, 3) as on one datum."""

    def fit(self, position, data, members):
        n, value = len(members.center), data[members.row]
        cell = np.repeat(np.arange(n), np.diff(members.start))
        mass = np.bincount(cell, members.weight, minlength=n) + 1.0
        mean = np.bincount(cell, members.weight * value, minlength=n) / mass
        square = (np.bincount(cell, members.weight * value**2, minlength=n) + 9.0) / mass
        return Levels(mean, np.sqrt(np.maximum(square - mean**2, 1e-4)))

    def log_density(self, cells, position, data, row, cell):
        z = (data[row] - cells.mean[cell]) / cells.spread[cell]
        return -0.5 * z**2 - np.log(cells.spread[cell]) - 0.5 * np.log(2 * np.pi)


def sample(n=2500, seed=0, generators=TRUE, level=LEVEL):
    """Positions all over a square, and numbers around the level of the true cell that they lie in."""
    rng = np.random.default_rng(seed)
    position = rng.uniform([-20, -6], [34, 30], (n, 2))
    cell = cKDTree(generators).query(position)[1]
    return position, level[cell] + rng.standard_normal(n), cell


def learned(position, value, seed=0, **options):
    given = {"softness": 0.0, "reach": 5.0} | options
    return fit_jointly(GaussianCells(), position, value, rng=np.random.default_rng(seed), **given)


def held_out(found, position, value):
    """Mean log density of data that the cells have not seen."""
    generators, (known, of_known, _) = found.tessellation.generators, sample()
    fitted = GaussianCells().fit(known, of_known, members_of(known, generators, softness=0.0)[0])
    cell = cKDTree(generators).query(position)[1]
    return GaussianCells().log_density(fitted, position, value, np.arange(len(value)), cell).mean()


@pytest.fixture(scope="module")
def found() -> JointFit:
    return learned(*sample()[:2])


def test_the_known_optimum_is_found(found):
    position, value, _ = sample(20_000, seed=9)
    best = -0.5 * np.log(2 * np.pi * np.e)  # minus the entropy of a unit normal distribution
    four_errors = 4 * np.sqrt(0.5 / 20_000)
    asked_for = learned(*sample()[:2], n_cells=5)
    assert best - 0.25 < held_out(asked_for, position, value) < best + four_errors
    assert best - 0.22 < held_out(found, position, value) < best + four_errors
    single = learned(*sample()[:2], n_cells=1)
    assert held_out(single, position, value) < best - 1.0  # what is lost without cells: the test can see it


def test_borders_lie_where_the_true_ones_are(found):
    """Cells are of one true cell each, but for slivers: few data share a learned cell with another true one's."""
    position, _, true = sample(20_000, seed=9)
    astray = []
    for cells in (found.tessellation, learned(*sample()[:2], n_cells=3).tessellation):
        assert (cells.cell_of(position) != OUTSIDE).all()
        table = np.zeros((cells.n_cells, len(TRUE)))
        np.add.at(table, (cells.cell_of(position), true), 1)
        astray.append(1.0 - table.max(axis=1).sum() / len(position))
    assert astray[0] < 0.05
    assert astray[1] > 0.2


def test_one_cell_is_found_where_all_is_alike_and_as_many_as_asked_for():
    for seed in range(5):
        position, value, _ = sample(1500, seed=seed, generators=TRUE[:1], level=LEVEL[:1])
        assert learned(position, value, seed=seed).tessellation.n_cells == 1
    position, value, _ = sample(1000)
    for n in (1, 2, 7, 20):  # but for one that may starve
        assert n - (n > 7) <= learned(position, value, n_cells=n, softness=0.25).tessellation.n_cells <= n
    position, value, _ = sample(6000)
    some = learned(position, value, max_rows=2000)
    assert held_out(some, *sample(20_000, seed=9)[:2]) > -1.42 - 0.2


def test_the_trace_never_rises_is_reported_and_is_that_of_the_seed(found):
    assert found.trace.size == found.n_cells.size > 3
    assert (np.diff(found.trace) <= 0).all()
    assert found.trace[-1] < found.trace[0] - 0.1
    assert found.n_cells[-1] >= found.tessellation.n_cells  # empty ones are dropped
    nearest = cKDTree(found.tessellation.generators).query(sample()[0])[1]
    assert np.bincount(nearest, minlength=found.tessellation.n_cells).min() > 0
    again, other = (learned(*sample()[:2], seed=seed).tessellation.generators for seed in (0, 1))
    np.testing.assert_array_equal(again, found.tessellation.generators)
    assert not np.array_equal(other, again)
    reported = []
    found = learned(*sample(600)[:2], progress=lambda n, objective: reported.append((n, objective)))
    assert [n for n, _ in reported] == found.n_cells.tolist()
    assert [objective for _, objective in reported] == found.trace.tolist()


def test_a_number_of_cells_is_found_by_moving_even_ones_and_does_better_than_these():
    """Five cells of a hill in a plain: on each of eight seeds their levels are nearer to the truth than even cells'."""
    at = np.stack(np.meshgrid(*[np.linspace(-29, 29, 60)] * 2), axis=-1).reshape(-1, 2)
    for seed in range(8):
        rng = np.random.default_rng(seed)
        position = rng.uniform(-30, 30, (400, 2))
        height = 9.0 * np.exp(-(position**2).sum(axis=1) / 200) + rng.normal(size=400)
        truth = 9.0 * np.exp(-(at**2).sum(axis=1) / 200)
        joint = learned(position, height, seed=seed, n_cells=5)
        assert (np.diff(joint.trace) <= 0).all()
        assert (joint.n_cells == 5).all()

        def error(cells, position=position, height=height, truth=truth):
            cell = cells.cell_of(position)
            level = np.bincount(cell, height, cells.n_cells) / np.bincount(cell, minlength=cells.n_cells)
            return np.sqrt(np.mean((level[cells.cell_of(at)] - truth) ** 2))

        even = VoronoiTessellation.lloyd(position, n_cells=5, reach=5.0, rng=np.random.default_rng(seed))
        assert error(joint.tessellation) < 0.8 * error(even)


def test_a_search_begins_with_the_cells_that_are_given():
    position, value, _ = sample(600)
    assert learned(position, value, start=TRUE).n_cells[0] == len(TRUE)


def turned(position):
    return np.stack([-position[:, 1], position[:, 0]], axis=1)


@pytest.mark.parametrize("moved", [turned, lambda p: p + np.array([1e6, -1e6])])
def test_data_that_are_moved_or_turned_have_the_same_cells(found, moved):
    position, value, _ = sample()
    there = learned(moved(position), value)
    assert there.tessellation.n_cells == found.tessellation.n_cells
    apart, _ = cKDTree(there.tessellation.generators).query(moved(found.tessellation.generators))
    assert apart.max() < 1e-4
    np.testing.assert_allclose(there.trace, found.trace, atol=1e-6)


def test_groups_are_held_out_whole():
    """Rows that repeat each other say nothing of others: by single rows each vehicle would have cells of its own."""
    rng = np.random.default_rng(2)
    group = np.repeat(np.arange(60), 30)
    position = rng.uniform(0, 30, (60, 2))[group] + rng.normal(0, 0.5, (1800, 2))
    value = rng.normal(0, 3, 60)[group] + rng.normal(0, 0.1, 1800)
    assert learned(position, value, group=group).tessellation.n_cells <= 8
    assert learned(position, value).tessellation.n_cells > 20


ODD = {
    "one datum": np.zeros((1, 2)),
    "two data": np.array([[0.0, 0.0], [1.0, 0.0]]),
    "all at one point": np.full((50, 2), 3.0),
    "on a line": np.stack([np.linspace(0, 100, 300), np.zeros(300)], axis=1),
    "on a slanting line": np.linspace(0, 100, 300)[:, None] * [1.0, 0.3],
    "two points": np.repeat([[0.0, 0.0], [50.0, 0.0]], 40, axis=0),
    "far away": np.random.default_rng(0).uniform(0, 30, (300, 2)) + 1e7,
}


@pytest.mark.parametrize("name", ODD)
@pytest.mark.parametrize("n_cells", [None, 10])
def test_little_or_odd_data_give_cells(name, n_cells):
    position = ODD[name]
    value = np.where(np.arange(len(position)) < len(position) // 2, 0.0, 9.0)
    found = learned(position, value, n_cells=n_cells)
    assert 1 <= found.tessellation.n_cells <= max(len(np.unique(position, axis=0)), 1)
    assert (found.tessellation.cell_of(position) != OUTSIDE).all()


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"group": np.ones(49, int)}, r"group: expected .* shape \(50,\)"),
        ({"n_cells": 0}, "n_cells: expected at least 1, got 0"),
        ({"softness": -0.1}, "softness: expected a number that is not negative"),
        ({"max_rows": 0}, "max_rows: expected at least 1, got 0"),
        ({"reach": 0.0}, "reach: expected a positive length in metres, got 0.0"),
        ({"reach": np.nan}, "reach: expected a positive length in metres, got nan"),
        ({"start": np.zeros((5, 3))}, "start"),
        ({"position": np.zeros((0, 2)), "value": np.zeros(0)}, "position"),
        ({"position": np.full((50, 2), np.nan)}, "position"),
        ({"position": np.zeros((50, 3))}, "position"),
    ],
)
def test_bad_options_are_refused_before_anything_is_fitted(options, message, monkeypatch):
    position, value, _ = sample(50)
    monkeypatch.delattr(GaussianCells, "fit")
    with pytest.raises(ValueError, match=message):
        learned(**{"position": position, "value": value} | options)
