"""The smoother of velocities is Rauch's, Tung's and Striebel's; its numbers are those that the rows were made with."""

import math

import numpy as np
import pytest

from dirprim_filter.smoothed_motion import LEAST_ROWS, SmoothedMotion
from oracles import filterpy_constant_velocity


def wandering(*, density, noise, interval_s, n_vehicles=60, n=60, seed=0):
    """Vehicles of white acceleration at irregular times: time, true velocity, measured place, who follows."""
    rng = np.random.default_rng(seed)
    dt = interval_s * rng.uniform(0.5, 1.5, (n_vehicles, n))
    velocity = rng.normal(0.0, 10.0, (n_vehicles, 1, 2)) + np.zeros((n_vehicles, n, 2))
    place = rng.normal(0.0, 500.0, (n_vehicles, 1, 2)) + np.zeros((n_vehicles, n, 2))
    for i in range(1, n):
        h = dt[:, i]
        covariance = density * np.array([[h**3 / 3, h**2 / 2], [h**2 / 2, h]]).transpose(2, 0, 1)
        added = np.linalg.cholesky(covariance) @ rng.standard_normal((n_vehicles, 2, 2))
        place[:, i] = place[:, i - 1] + h[:, None] * velocity[:, i - 1] + added[:, 0]
        velocity[:, i] = velocity[:, i - 1] + added[:, 1]
    measured = place + rng.normal(0.0, noise, place.shape)
    follows = np.tile(np.arange(n) < n - 1, n_vehicles)[:-1]
    return dt.cumsum(axis=1).ravel(), velocity.reshape(-1, 2), measured.reshape(-1, 2), follows


def found_of(time_s, measured, follows):
    return SmoothedMotion.of(time_s, measured, follows, np.ones(time_s.size, np.bool_))


@pytest.mark.parametrize(
    ("density", "noise", "interval_s"), [(1.0, 5.0, 2.0), (0.02, 5.0, 9.0), (4.0, 2.0, 0.1), (1.0, 0.5, 1.0)]
)
def test_noise_and_spread_of_velocities_come_back(density, noise, interval_s):
    off, spreads = [], []
    for seed in range(5):
        time_s, velocity, measured, follows = wandering(
            density=density, noise=noise, interval_s=interval_s, seed=seed
        )  # fmt: skip
        found = found_of(time_s, measured, follows)
        assert found.noise == pytest.approx(noise, rel=0.08)  # 7,200 coordinates, some fit the motion: 5 deviations
        inner = np.tile(np.minimum(np.arange(60), np.arange(60)[::-1]) > 15, 60)
        off.append(np.std((found.velocity - velocity)[inner]))
        spreads.append(found.spread)
    assert np.mean(spreads) == pytest.approx(np.mean(off), rel=0.15)  # of steps of one length, without end
    shuffled = np.random.default_rng(0).permutation(time_s.size)  # the negative control: places of other times
    assert found_of(time_s, measured[shuffled], follows).noise > 2.0 * noise


def test_it_is_the_smoother_of_another_package_under_its_own_noise_and_the_density_it_was_made_with():
    density, noise = 1.0, 3.0
    time_s, _, measured, follows = wandering(density=density, noise=noise, interval_s=1.0, n_vehicles=40)
    found = found_of(time_s, measured, follows)
    given = {"density": density, "noise_m": noise, "first_speed_std": 1e3}
    _, (smoothed, _) = filterpy_constant_velocity(measured[:60], time_s[:60], **given)
    off = np.abs(found.velocity[:60] - smoothed[:, 2:])
    assert off.max() < 0.5 * found.spread  # the chosen ratio is not quite that of the making
    assert np.median(off) < 0.1 * found.spread


def test_turned_shifted_and_slower_worlds_have_turned_and_slower_velocities():
    time_s, _, measured, follows = wandering(density=1.0, noise=3.0, interval_s=1.0)
    found = found_of(time_s, measured, follows)
    turn = np.array([[math.cos(1.0), -math.sin(1.0)], [math.sin(1.0), math.cos(1.0)]])
    turned = found_of(time_s, 10.0 * measured @ turn.T + [5e5, -4e6], follows)
    np.testing.assert_allclose(turned.velocity, 10.0 * found.velocity @ turn.T, atol=1e-3)
    slow = found_of(100.0 * time_s, measured, follows)
    np.testing.assert_allclose(100.0 * slow.velocity, found.velocity, atol=1e-6)
    assert (turned.noise, slow.noise) == pytest.approx((10.0 * found.noise, found.noise), rel=1e-6)


def test_exact_positions_have_a_spline_s_velocities_and_of_few_rows_nothing_is_said():
    time_s = np.arange(200.0)
    place = np.column_stack([100.0 * np.sin(0.1 * time_s), 100.0 * np.cos(0.1 * time_s)])
    found = found_of(time_s, place, np.ones(199, np.bool_))
    assert found.noise < 0.05
    np.testing.assert_allclose(np.hypot(*found.velocity[5:-5].T), 10.0, rtol=1e-3)
    few = slice(0, LEAST_ROWS)
    assert found_of(time_s[few], place[few], np.ones(LEAST_ROWS - 1, np.bool_)) is None


def test_rows_of_one_instant_or_nearly_and_rows_alone_are_borne():
    time_s, velocity, measured, follows = wandering(density=1.0, noise=1.0, interval_s=1.0)
    time_s[1::2] = time_s[::2] + 1e-9  # two rows in a nanosecond, over and over
    alone = np.zeros_like(follows)
    alone[: follows.size // 2] = follows[: follows.size // 2]
    found = found_of(time_s, measured, alone)
    assert np.isfinite(found.velocity).all()
    assert np.std((found.velocity - velocity)[: follows.size // 2 - 60]) < 5.0  # of 10: half of the times are wrong
