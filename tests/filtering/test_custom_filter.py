"""Motion and sensor models of one's own: own columns, the map's motion as one of them, a radar far away."""

import numpy as np
import pytest
from scipy import stats

from dirprim_filter import forecast
from dirprim_filter.config import FilterConfig
from dirprim_filter.filtering import CustomFilter, MapTransition, ParticleFilter, Radar, Tracker
from situations import TRUSTING, one_cell_map, seen_at

SLOT = np.zeros(1, np.int64)
ROAD = one_cell_map(concentration=50.0, shape=60.0)
HERE = seen_at(0.0, [(0.0, 0.0)], ids=["a"])


class Numbered:
    """Particles that stay where they are, and have numbers."""

    n_own = 2

    def begin(self, particles, rng):
        particles.own[:] = np.arange(particles.speed.size)[:, None] * [1.0, 10.0]

    def advance(self, particles, dt_s, rng):
        particles.own[:, 1] += dt_s


def begun(**models):
    made = CustomFilter(ROAD, config=FilterConfig(n_particles=200), **models)
    made.begin(SLOT, np.array([7], np.uint64), HERE)
    return made


def test_own_columns_survive_with_their_particles_and_are_copied():
    made = begun(transition=Numbered())
    made.predict(SLOT, np.array([0.5]))
    made.cloud.weight[0] = 0.0
    made.cloud.weight[0, [3, 150]] = 0.25, 0.75
    made.resample(SLOT)
    number, counts = np.unique(made.own[0, :, 0], return_counts=True)
    np.testing.assert_array_equal(number, [3.0, 150.0])
    assert abs(counts[1] - 150) <= 1
    np.testing.assert_allclose(made.own[0, :, 1], 10.0 * made.own[0, :, 0] + 0.5)
    made.reserve(50)
    made.copy(SLOT, np.array([40]))
    np.testing.assert_array_equal(made.own[40], made.own[0])


def test_the_maps_motion_by_the_protocol_is_the_filters():
    """Means of 20,000 particles, each estimated to four standard errors of its difference."""
    config, n = FilterConfig(n_particles=20_000, own_way_rate=0.0), 20_000
    pair = ParticleFilter(ROAD, config), CustomFilter(ROAD, transition=MapTransition(ROAD), config=config)
    for made in pair:
        made.begin(SLOT, np.array([7], np.uint64), HERE)
        made.predict(SLOT, np.array([2.0]))
    ours, theirs = (made.moments(SLOT)[0] for made in pair)
    error = 4.0 * np.sqrt(2.0 * ours[[2, 4]] / n)
    assert (np.abs(ours[:2] - theirs[:2]) < error).all()
    np.testing.assert_allclose(theirs[[2, 4]], ours[[2, 4]], rtol=0.1)
    assert pair[1].own[0, :, 0].min() >= -1.0


def test_a_forecast_moves_by_the_transition_given():
    paths = forecast(
        ROAD, position=(1.0, 2.0), direction=0.0, speed=8.0, n_samples=5, transition=Numbered(),
        rng=np.random.default_rng(0),
    )  # fmt: skip
    np.testing.assert_array_equal(paths, np.broadcast_to([1.0, 2.0], (5, 10, 2)))


FAR = Radar(place=(0.0, -300.0), range_m=0.5, bearing=0.05)


def test_a_radar_is_normal_in_range_and_bearing_and_densest_where_it_measured():
    axis = np.arange(-60.0, 60.0, 0.2)
    place = np.stack(np.meshgrid(axis, 0.1 * axis), axis=-1).reshape(-1, 2)
    density = np.exp(FAR.log_likelihood(place, HERE))
    there, ray = np.hypot(place[:, 0], place[:, 1] + 300.0), np.arctan2(place[:, 1] + 300.0, place[:, 0])
    exact = stats.norm(300.0, 0.5).pdf(there) * stats.norm(np.pi / 2, 0.05).pdf(ray) / 300.0
    np.testing.assert_allclose(density, exact, rtol=1e-9)
    assert density.max() == pytest.approx(np.exp(FAR.log_likelihood(HERE.position, HERE))[0])


def errors_by(seed, measurement):
    """Squared errors in units of the covariances, of a vehicle that drives east at 10 m/s 300 m from a radar."""
    rng, config, nees = np.random.default_rng(seed), FilterConfig(n_particles=500), []
    bayes = CustomFilter(ROAD, measurement=measurement, config=config)
    tracker = Tracker(bayes, config=config, tracking=TRUSTING, rng=rng)
    for i in range(40):
        true = np.array([1.0 * i - 20.0, 0.0])
        there, ray = rng.normal([np.hypot(true[0], 300.0), np.arctan2(300.0, true[0])], [0.5, 0.05])
        place = [there * np.cos(ray), there * np.sin(ray) - 300.0]
        found = tracker.step(FAR.with_covariance(seen_at(0.1 * i, [place], ids=["a"])))
        away = found.position[0] - true
        nees.append(away @ np.linalg.solve(found.covariance[0], away))
    return np.mean(nees[10:])


def test_far_away_a_radar_by_its_own_axes_knows_how_near():
    """Mean squares in units of what beliefs expect, 2: six vehicles show 1.7, and 4.4 by ellipses."""
    ellipse, arc = (np.mean([errors_by(seed, of) for seed in range(6)]) for of in (None, FAR))
    assert arc < 2.4 < ellipse
