"""Rivals of the map: densities of direction, and vehicles that go on as one that was seen here."""

import numpy as np
import pytest
from scipy import integrate, stats

from dirprim_filter.evaluation.baselines import gaussian_process
from dirprim_filter.evaluation.baselines.directional_grid_map import DirectionalGridMap
from dirprim_filter.evaluation.baselines.gaussian_process import (
    DirectionalGaussianProcess,
    projected_normal_log_density,
)
from dirprim_filter.evaluation.baselines.trajectory_memory import States, TrajectoryMemory
from dirprim_filter.evaluation.density import Uninformative
from dirprim_filter.evaluation.forecast_cases import Cases
from situations import ring_traffic, tracks_of

CIRCLE = np.linspace(-np.pi, np.pi, 2001)[:-1]
STEP = CIRCLE[1] - CIRCLE[0]


def integral(model, place):
    return np.exp(model.direction_log_density(np.tile(place, (CIRCLE.size, 1)), CIRCLE)).sum() * STEP


def one_cell(direction, **options):
    position = np.full((len(direction), 2), 5.0)
    given = {"cell_size": 10.0, "max_concentration": 1e4, "pseudo_count": 1e-9} | options
    return DirectionalGridMap.fit(position, direction, **given)


def test_uninformative_densities_are_those_of_the_uniform_law():
    model = Uninformative(max_speed=20.0)
    place, speed = np.zeros((3, 2)), np.array([0.0, 20.0, 20.1])
    np.testing.assert_allclose(np.exp(model.direction_log_density(place, np.zeros(3))), 0.159, atol=2e-4)
    np.testing.assert_allclose(np.exp(model.speed_log_density(place, speed)), [0.05, 0.05, 0.0], rtol=1e-12)
    assert model.log_density(place, np.zeros(3), speed)[0] == pytest.approx(-np.log(2 * np.pi * 20))


def test_a_grid_map_of_one_mode_is_scipys_maximum_likelihood_fit():
    direction = stats.vonmises.rvs(30.0, loc=3.0, size=400, random_state=1)  # across the wrap
    kappa, mean, _ = stats.vonmises.fit(direction, fscale=1)
    found = one_cell(direction).direction
    assert found.concentration[0, 0] == pytest.approx(kappa, rel=1e-4)
    assert np.cos(found.mean_direction[0, 0] - mean) == pytest.approx(1.0, abs=1e-9)


def test_a_grid_map_finds_both_ways_of_a_street_and_beats_one_mode():
    rng = np.random.default_rng(2)
    direction = np.concatenate([rng.vonmises(0.5, 60, 300), rng.vonmises(0.5 - np.pi, 25, 100)])
    model = one_cell(direction)
    used = model.direction.weight[0] > 1e-6
    np.testing.assert_allclose(np.sort(model.direction.weight[0, used]), [0.25, 0.75], atol=0.02)
    np.testing.assert_allclose(np.sort(model.direction.concentration[0, used]), [25, 60], rtol=0.3)
    place = np.full((400, 2), 5.0)
    kappa, mean, _ = stats.vonmises.fit(direction, fscale=1)
    alone = stats.vonmises.logpdf(direction, kappa, loc=mean).mean()
    assert model.direction_log_density(place, direction).mean() > alone + 1.0


def test_a_uniform_direction_counts_as_so_many_rows_of_a_square_and_repeated_angles_are_bounded():
    rng = np.random.default_rng(4)
    direction = rng.vonmises(0.0, 80, 6)
    sure, unsure = one_cell(direction), one_cell(direction, pseudo_count=2.0)
    own = np.exp(sure.direction_log_density(np.full((CIRCLE.size, 2), 5.0), CIRCLE))
    mixed = np.exp(unsure.direction_log_density(np.full((CIRCLE.size, 2), 5.0), CIRCLE))
    np.testing.assert_allclose(mixed, 0.75 * own + 0.25 / (2 * np.pi), atol=1e-8)
    assert integral(unsure, [5.0, 5.0]) == pytest.approx(1.0, abs=1e-6)
    model = one_cell(np.full(50, -np.pi))
    assert model.direction.concentration.max() == 1e4
    log_p = model.direction_log_density(np.full((2, 2), 5.0), np.array([np.pi, 0.0]))
    assert np.isfinite(log_p).all()
    assert log_p[0] == pytest.approx(0.5 * np.log(1e4 / (2 * np.pi)), abs=1e-3)


@pytest.mark.parametrize("turn", [0.0, 0.4, 2.0, -3.0])
def test_projected_normal_is_the_planes_normal_density_along_the_ray(turn):
    def along_ray(r):
        return r * stats.multivariate_normal.pdf([r * np.cos(turn), r * np.sin(turn)], mean=[2.5, 0.0])

    found = projected_normal_log_density(np.array([turn]), np.array([2.5]))
    assert np.exp(found) == pytest.approx(integrate.quad(along_ray, 0.0, np.inf)[0], rel=1e-6)


def test_projected_normal_stays_finite_however_sure_it_is():
    log_p = projected_normal_log_density(np.array([0.0, np.pi / 2, np.pi]), np.full(3, 1e6))
    assert np.isfinite(log_p).all()
    assert log_p[0] == pytest.approx(np.log(1e6) - 0.5 * np.log(2 * np.pi), abs=1e-6)


def test_a_gaussian_process_learns_a_bend_and_knows_nothing_far_away(ring, monkeypatch):
    monkeypatch.setattr(gaussian_process, "MAX_ROWS", 150)
    rows = np.random.default_rng(7).permutation(len(ring))
    train, test = ring[rows[:600]], ring[rows[600:900]]
    model = DirectionalGaussianProcess.fit(
        train.position, train.direction, length=15.0, noise=0.1, rng=np.random.default_rng(8)
    )
    assert model.process.X_train_.shape == (150, 2)
    assert model.direction_log_density(test.position, test.direction).mean() > 0.5
    assert model.direction_log_density(test.position, test.direction + np.pi).mean() < -2.0
    assert integral(model, test.position[0]) == pytest.approx(1.0, abs=1e-6)
    far = np.full((4, 2), 1e4)
    np.testing.assert_allclose(model.direction_log_density(far, np.arange(4.0)), -np.log(2 * np.pi), atol=1e-6)


RADIUS, SPEED = 20.0, 8.0


def on_ring(angle, *, radius=RADIUS, speed=SPEED):
    angle = np.atleast_1d(angle)
    place = radius * np.column_stack([np.cos(angle), np.sin(angle)])
    return States(place, angle + np.pi / 2, np.full(angle.size, speed))


def drawn(memory, start, time_s, *, n_samples=200, but=None):
    return memory.sample(start, time_s=np.array(time_s), n_samples=n_samples, but=but, rng=np.random.default_rng(0))


@pytest.fixture(scope="module")
def memory():
    return TrajectoryMemory.of(ring_traffic(np.random.default_rng(0), n_vehicles=40))


def test_on_a_ring_it_goes_along_the_ring_and_off_it_straight_on(memory):
    path = drawn(memory, on_ring([0.3, 2.0]), (1.0, 3.0))
    radius = np.linalg.norm(path, axis=-1)
    angle = np.arctan2(path[..., 1], path[..., 0]) - np.array([0.3, 2.0])[:, None, None]
    assert np.median(np.abs(radius - RADIUS)) < 1.0
    np.testing.assert_allclose(np.median(angle % (2 * np.pi), axis=1), [[0.4, 1.2]] * 2, rtol=0.1)
    beside = States(np.array([[200.0, 0.0]]), np.array([0.0]), np.array([SPEED]))  # the control: no vehicle was there
    assert drawn(memory, on_ring([]), (3.0,)).shape == (0, 200, 1, 2)
    unfamiliar = drawn(memory, beside, (3.0,))
    bend = np.linalg.norm(unfamiliar - [200.0, 0.0], axis=-1)
    assert np.median(np.abs(np.linalg.norm(unfamiliar, axis=-1) - RADIUS)) > 100.0
    assert (bend < 1.7 * 3.0 * SPEED).all()


def test_a_vehicle_never_follows_itself():
    alone = ring_traffic(np.random.default_rng(0), n_vehicles=1)
    memory = TrajectoryMemory.of(alone)
    start = States(alone.position[:1], alone.direction[:1], alone.speed[:1])
    radius = {but: np.linalg.norm(drawn(memory, start, (3.0,), but=np.array([but])), axis=-1) for but in (-1, 0)}
    own = np.linalg.norm(alone.position[0])
    assert np.median(np.abs(radius[-1] - own)) < 1.0
    assert (radius[0] > own + 5.0).all()  # straight on: there is no other


def test_of_tracks_of_one_row_there_is_nothing_to_remember_and_all_go_straight_on():
    lone = tracks_of(np.zeros((3, 1, 2)))
    memory = TrajectoryMemory.of(lone)
    memory, found = memory.chosen(Cases.of(lone, horizons_s=(2.0,)), (2.0,), rng=np.random.default_rng(0))
    assert not found
    path = drawn(memory, States(np.zeros((1, 2)), np.zeros(1), np.full(1, 10.0)), (2.0,))
    np.testing.assert_allclose(path[0, :, 0], np.tile([20.0, 0.0], (200, 1)), atol=1.0)
