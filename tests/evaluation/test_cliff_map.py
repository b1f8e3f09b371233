"""CLiFF-map against slow oracles: densities by quadrature and by loops, EM by its likelihood, modes by climbing."""

import numpy as np
import pytest
from scipy import stats

from dirprim_filter.evaluation.baselines.cliff_map import CliffMap, Modes, expectation_maximisation, mean_shift_modes

CIRCLE = np.linspace(-np.pi, np.pi, 241)[:-1]
SPEED = np.linspace(-30.0, 60.0, 601)
HERE, SPARSE, AWAY = [5.0, 5.0], [25.0, 5.0], [1e4, 0.0]
SETTINGS = {"cell_size": 10.0, "speed_unit": 10.0, "bandwidth": 0.3, "least_deviation": 0.01, "pseudo_count": 1.0}


def street(rng, n=600):
    """Two modes in one square, of which one lies across the wrap and is correlated, and a few rows in another."""
    first = rng.random(n) < 0.7
    turn, extra = rng.normal(size=(2, n))
    direction = np.where(first, np.pi + 0.2 * turn, 0.5 + 0.1 * turn)
    speed = np.where(first, 12.0 + 0.8 * turn + 0.6 * extra, 5.0 + 1.0 * extra)
    position = np.tile(HERE, (n, 1))
    position[:4] = SPARSE
    return position, direction, speed


@pytest.fixture(scope="module")
def model():
    return CliffMap.fit(*street(np.random.default_rng(0)), **SETTINGS)


@pytest.mark.parametrize("place", [HERE, SPARSE, AWAY])
def test_the_density_integrates_to_one_and_its_marginals_are_those_of_the_quadrature(model, place):
    theta, speed = np.meshgrid(CIRCLE, SPEED, indexing="ij")

    def at(n):
        return np.tile(place, (n, 1))

    joint = np.exp(model.log_density(at(theta.size), theta.ravel(), speed.ravel())).reshape(theta.shape)
    of_theta, of_speed = CIRCLE[1] - CIRCLE[0], SPEED[1] - SPEED[0]
    assert joint.sum() * of_theta * of_speed == pytest.approx(1.0, abs=1e-4)
    direction = np.exp(model.direction_log_density(at(CIRCLE.size), CIRCLE))
    np.testing.assert_allclose(joint.sum(axis=1) * of_speed, direction, rtol=1e-4, atol=1e-9)
    np.testing.assert_allclose(
        joint.sum(axis=0) * of_theta, np.exp(model.speed_log_density(at(SPEED.size), SPEED)), rtol=1e-4, atol=1e-9
    )


def test_the_density_is_scipys_of_each_mode_and_wrap(model):
    rng = np.random.default_rng(1)
    theta, speed = rng.uniform(-np.pi, np.pi, 40), rng.uniform(0.0, 20.0, 40)
    cell = int(model.cells.cell_of(np.array(HERE)))
    share, (mean, deviation) = model.background_share[cell], model.background_speed
    expected = share / (2 * np.pi) * stats.norm.pdf(speed, mean, deviation)
    unit = np.diag([1.0, model.speed_unit])
    for m in range(model.modes.first[cell], model.modes.first[cell + 1]):
        normal = stats.multivariate_normal(unit @ model.modes.mean[m], unit @ model.modes.covariance[m] @ unit)
        for turn in (-2, -1, 0, 1, 2):
            turned = np.column_stack([theta + 2 * np.pi * turn, speed])
            expected = expected + (1 - share) * model.modes.weight[m] * normal.pdf(turned)
    found = model.log_density(np.tile(HERE, (40, 1)), theta, speed)
    np.testing.assert_allclose(np.exp(found), expected, rtol=1e-6)


def test_a_known_mixture_is_recovered_across_the_wrap():
    model = CliffMap.fit(*street(np.random.default_rng(2), n=20_000), **SETTINGS)
    cell = int(model.cells.cell_of(np.array(HERE)))
    own = slice(model.modes.first[cell], model.modes.first[cell + 1])
    order = np.argsort(model.modes.weight[own])
    assert order.size == 2
    np.testing.assert_allclose(model.modes.weight[own][order], [0.3, 0.7], atol=0.015)  # 4.6 deviations
    mean, covariance = model.modes.mean[own][order], model.modes.covariance[own][order]
    np.testing.assert_allclose(np.cos(mean[:, 0] - [0.5, np.pi]), 1.0, atol=1e-4)
    np.testing.assert_allclose(10.0 * mean[:, 1], [5.0, 12.0], atol=0.06)
    expected = np.array([[[0.01, 0.0], [0.0, 0.01]], [[0.04, 0.016], [0.016, 0.01]]])
    np.testing.assert_allclose(covariance, expected, rtol=0.1, atol=0.0005)


def test_each_iteration_of_em_raises_the_likelihood_whatever_the_least_covariance():
    rng = np.random.default_rng(3)
    _, direction, speed = street(rng)
    row, cell = np.column_stack([direction, speed / 10.0]), np.repeat([0, 1], 300)
    vague = Modes(
        first=np.array([0, 3, 6, 6]), weight=np.full(6, 1 / 3), mean=rng.uniform(-1.0, 1.0, (6, 2)),
        covariance=np.tile(np.eye(2), (6, 1, 1)),
    )  # fmt: skip
    for least in (0.01, 0.15, 0.4):
        fitted, found = expectation_maximisation(row, cell, vague, least)
        assert len(found) > 4
        assert np.diff(found).min() > -1e-12
        assert np.sqrt(np.linalg.eigvalsh(fitted.covariance).min()) >= least * (1 - 1e-9)
    one = np.bincount([0, 0, 0, 1, 1, 1], fitted.weight)
    np.testing.assert_allclose(one, 1.0, atol=1e-12)


def test_mean_shift_finds_the_tops_that_climbing_from_every_row_finds():
    rng = np.random.default_rng(4)
    row = np.vstack([rng.normal([3.1, 1.0], 0.05, (40, 2)), rng.normal([-1.0, 0.5], 0.05, (25, 2)),
                     rng.normal([-1.0, 1.5], 0.05, (12, 2))])  # fmt: skip
    row[:, 0] = np.angle(np.exp(1j * row[:, 0]))  # the first lies across the wrap
    tops = []
    for start in row:
        top = start.copy()
        for _ in range(100):
            away = row - top
            away[:, 0] = np.angle(np.exp(1j * away[:, 0]))
            pull = np.exp(-0.5 * (away**2).sum(axis=1) / 0.2**2)
            top = top + pull @ away / pull.sum()
        tops.append([*np.round([np.cos(top[0]), np.sin(top[0])], 3), round(top[1], 3)])
    expected = np.unique(tops, axis=0)
    found = mean_shift_modes(row, np.zeros(77, int), 1, 0.2)
    own = np.column_stack([np.cos(found.mean[:, 0]), np.sin(found.mean[:, 0]), found.mean[:, 1]])
    nearest = np.linalg.norm(own[:, None] - expected[None], axis=-1).argmin(axis=1)
    assert len(own) == 3
    np.testing.assert_allclose(own, expected[nearest], atol=0.01)
    np.testing.assert_allclose(np.sort(found.weight), np.array([12, 25, 40]) / 77)
    assert mean_shift_modes(row, np.zeros(77, int), 1, 3.0).weight.size == 1


def test_everywhere_and_for_any_speed_the_density_is_finite():
    repeated = CliffMap.fit(np.zeros((50, 2)), np.full(50, -np.pi), np.full(50, 3.0), **SETTINGS)
    for place in ([0.0, 0.0], AWAY):
        at = np.tile(place, (3, 1))
        found = repeated.log_density(at, np.array([np.pi, 0.0, 1.0]), np.array([3.0, 1e3, 0.0]))
        assert np.isfinite(found).all()
    assert np.sqrt(repeated.modes.covariance[0, 0, 0]) == pytest.approx(0.01)
