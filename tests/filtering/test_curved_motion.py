"""Vehicles on primitives that bend turn with the bend."""

from dataclasses import replace

import numpy as np
import pytest
from scipy import stats

from dirprim_filter import forecast
from dirprim_filter.config import FilterConfig
from dirprim_filter.detections import Detections
from dirprim_filter.filtering.particle_filter import ParticleFilter
from moving import only_places
from situations import one_cell_map

FALSE_ALARM = 1e-4  # of each statistical test below; seeds are fixed
RADIUS = 20.0


def circling(**settings):
    """A cell whose mode turns to the left by 1 / RADIUS along its way east, at first."""
    straight = one_cell_map(side=60.0, **settings)
    bend = np.zeros((2, 1, 2))
    bend[0, 0, 0] = 1 / RADIUS
    return only_places(replace(straight, modes=straight.modes._replace(bend=bend), motion=None))


def test_a_vehicle_turns_with_the_bend_as_the_line_of_the_field_does():
    """The line of course x / R through the origin: y = -R log cos(x / R)."""
    path = forecast(
        circling(), position=(0.0, 0.0), direction=0.0, speed=10.0, horizon_s=2.0, dt_s=0.1,
        rng=np.random.default_rng(0),
    ).mean(axis=0)  # fmt: skip
    np.testing.assert_allclose(path[:, 1], -RADIUS * np.log(np.cos(path[:, 0] / RADIUS)), atol=0.1)
    assert path[-1, 1] > 5.0


def test_speed_settles_on_the_gain_of_the_place():
    """At the pace v(north) that reversion holds in balance: what is gained there is what is lost of the surplus."""
    flat = one_cell_map(shape=400.0, concentration=1e4)
    gain = np.zeros((2, 1, 2))
    gain[0, 0, 1] = 0.02  # north, across the course
    climbing = only_places(replace(flat, modes=flat.modes._replace(gain=gain), motion=None))
    for north in (-10.0, 10.0):
        paths = forecast(
            climbing, position=(0.0, north), direction=0.0, speed=10.0, horizon_s=20.0, dt_s=1.0, n_samples=400,
            rng=np.random.default_rng(0),
        )  # fmt: skip
        speed, place = np.diff(paths[:, 14:, 0], axis=1).mean(), paths[:, 14:, 1].mean()
        assert speed == pytest.approx(10.0 * (1 + 0.02 * place), rel=0.02)
        assert abs(speed - 10.0) > 1.0


@pytest.mark.parametrize("place", [(10.0, 0.0), (-25.0, 5.0), (28.0, -28.0)])
def test_a_belief_is_born_of_the_density_of_its_place(place):
    """Far from the centre of a cell that bends and gains: direction and speed are those of `log_density` there."""
    slope = np.zeros((2, 1, 2))
    slope[0, 0] = 0.01, -0.004
    bent = circling(concentration=40.0, shape=12.0)
    bent = replace(bent, modes=bent.modes._replace(gain=slope), motion=None)
    filter_ = ParticleFilter(bent, FilterConfig(n_particles=20_000, noise_m=1e-6))
    slot, place = np.zeros(1, np.int64), np.array(place)
    filter_.begin(slot, np.array([7], np.uint64), Detections(track_id=["a"], time_ns=[0], position=[place]))
    cloud = filter_.cloud
    theta, v = np.linspace(-np.pi, np.pi, 20_001), np.linspace(1e-3, 80.0, 20_001)

    def below(grid, log_density, drawn):
        total = np.concatenate([[0.0], np.cumsum(np.diff(grid) * np.exp(log_density[:-1] + np.diff(log_density) / 2))])
        assert total[-1] == pytest.approx(1.0, abs=1e-4)
        return np.interp(drawn, grid, total)

    of_direction, of_speed = bent.direction_log_density(place, theta), bent.speed_log_density(place, v)
    assert stats.kstest(below(theta, of_direction, cloud.direction[0]), "uniform").pvalue > FALSE_ALARM
    assert stats.kstest(below(v, of_speed, cloud.speed[0]), "uniform").pvalue > FALSE_ALARM
    of_center, at_center = bent.direction_log_density(np.zeros(2), theta), bent.speed_log_density(np.zeros(2), v)
    assert stats.kstest(below(theta, of_center, cloud.direction[0]), "uniform").pvalue < FALSE_ALARM
    assert stats.kstest(below(v, at_center, cloud.speed[0]), "uniform").pvalue < FALSE_ALARM
