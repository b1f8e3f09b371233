"""The motion model: left alone it settles on the primitive, however finely time is cut."""

import numpy as np
import pytest
from numba import njit
from scipy import stats
from scipy.special import i0e

from dirprim_filter.config import FilterConfig
from dirprim_filter.detections import Detections
from dirprim_filter.distributions import _kernels as density
from dirprim_filter.distributions import _random as random
from dirprim_filter.distributions.angles import wrap
from dirprim_filter.filtering import _kernels, _relaxing
from dirprim_filter.filtering.motion import motion_table, reaching, speeds_of_all_places
from dirprim_filter.filtering.particle_filter import ParticleFilter
from situations import one_cell_map
from tessellation import GridTessellation
from tessellation._kernels import locate

FALSE_ALARM = 1e-4  # of each statistical test below; seeds are fixed
N = 20_000
RATE = 0.5  # 1/s
BARE = FilterConfig(direction_spread=1e-6, speed_spread=1e-6)  # the modes of the map as they are


@njit
def accelerated(n, n_steps, speed, shape, rate, kept, state):  # noqa: PLR0917 numba
    out = np.full(n, speed)
    for i in range(n):
        for _ in range(n_steps):
            out[i] = _relaxing.accelerate(out[i], shape, rate, kept, state)
    return out


@njit
def turned(n, n_steps, direction, mean, concentration, kept, state):  # noqa: PLR0917 numba
    out = np.full(n, direction)
    for i in range(n):
        for _ in range(n_steps):
            out[i] = density.wrap(_relaxing.turn(out[i], mean, concentration, kept, state))
    return out


def seeded(key):
    state = np.zeros(4, np.uint64)
    random.seed_state(np.uint64(key), state)
    return state


def speeds(n_steps, *, over_s, shape=6.0, rate=0.6, key=1, start=25.0):
    return accelerated(N, n_steps, start, shape, rate, np.exp(-RATE * over_s / n_steps), seeded(key))


def directions(n_steps, *, over_s, concentration, key=1, start=0.4, mean=0.0):
    return turned(N, n_steps, start, mean, concentration, np.exp(-RATE * over_s / n_steps), seeded(key))


@pytest.mark.parametrize(("shape", "rate"), [(0.3, 20.0), (1.0, 20.0), (6.0, 0.6), (400.0, 40.0)])
@pytest.mark.parametrize("n_steps", [5, 40])
def test_speed_settles_on_the_gamma_of_the_mode(shape, rate, n_steps):
    sample = speeds(n_steps, over_s=40.0, shape=shape, rate=rate)
    assert stats.kstest(sample, stats.gamma(shape, scale=1 / rate).cdf).pvalue > FALSE_ALARM
    assert stats.kstest(sample, stats.gamma(shape * 1.1, scale=1 / rate).cdf).pvalue < FALSE_ALARM


def test_speed_after_four_seconds_is_the_same_in_8_steps_as_in_80():
    fine = speeds(80, over_s=4.0, key=2)
    assert stats.ks_2samp(speeds(8, over_s=4.0, key=3), fine).pvalue > FALSE_ALARM
    assert stats.ks_2samp(speeds(1, over_s=4.0, key=4), fine).pvalue > FALSE_ALARM
    assert stats.ks_2samp(speeds(8, over_s=4.4, key=3), fine).pvalue < FALSE_ALARM
    assert stats.kstest(fine, stats.gamma(6.0, scale=1 / 0.6).cdf).pvalue < FALSE_ALARM  # not yet settled


GRID = wrap((np.arange(1440) + 0.5) * (2 * np.pi / 1440) - np.pi)


def direction_law(n_steps, *, over_s, concentration, start):
    """The probability of each angle of GRID, by a histogram filter: a step's von Mises as a matrix, n times."""
    kept = np.exp(-RATE * over_s / n_steps)
    own, usual = concentration * kept / (1 - kept**2), concentration / (1 + kept)

    def step_from(angle):
        p = np.exp(own * (np.cos(GRID - angle) - 1) + usual * (np.cos(GRID) - 1))
        return p / p.sum(axis=-1, keepdims=True)

    law = step_from(start)
    matrix = step_from(GRID[:, None])
    for _ in range(n_steps - 1):
        law = law @ matrix
    return law


def below(law):
    """Its cumulative distribution at the upper edge of each angle of GRID, as a function."""
    edges = np.linspace(-np.pi, np.pi, GRID.size + 1)
    return lambda angle: np.interp(angle, edges, np.concatenate([[0.0], np.cumsum(law)]))


def settled_law(concentration, kept):
    """What `turn` settles on: reversible with respect to I0(|own e^{id} + usual|) e^{usual cos d}."""
    own, usual = concentration * kept / (1 - kept**2), concentration / (1 + kept)
    resultant = np.hypot(own + usual * np.cos(GRID), usual * np.sin(GRID))
    p = i0e(resultant) * np.exp(resultant - own - usual + usual * (np.cos(GRID) - 1))
    return p / p.sum()


SMALL_ANGLES = 0.01
"""Times 1 / concentration, the mean square of d: how far cos d = 1 - d^2 / 2 takes the cumulative laws off.

The settled law is known in closed form; over steps of any length it is at most 0.0074 / concentration off.
"""


@pytest.mark.parametrize("concentration", [20.0, 100.0, 1000.0])
@pytest.mark.parametrize("n_steps", [5, 80])
def test_direction_settles_on_the_von_mises_of_the_mode_but_for_the_angles_beyond_the_small(concentration, n_steps):
    sample = directions(n_steps, over_s=40.0, concentration=concentration)
    law = settled_law(concentration, np.exp(-RATE * 40.0 / n_steps))
    assert stats.kstest(sample, below(law)).pvalue > FALSE_ALARM
    von_mises = stats.vonmises.pdf(GRID, concentration)
    assert np.abs(np.cumsum(law - von_mises / von_mises.sum())).max() < SMALL_ANGLES / concentration
    for wrong in (0.8, 1.25):
        assert stats.kstest(sample, stats.vonmises(wrong * concentration).cdf).pvalue < FALSE_ALARM


def test_a_broad_mode_is_not_met_exactly_so_the_bound_above_means_something():
    law, von_mises = settled_law(2.0, 0.4), stats.vonmises.pdf(GRID, 2.0)
    assert np.abs(np.cumsum(law - von_mises / von_mises.sum())).max() > SMALL_ANGLES / 20.0


def test_direction_after_four_seconds_is_the_same_in_8_steps_as_in_80():
    knobs = {"concentration": 20.0, "start": 0.6}
    coarse, fine = (directions(n, over_s=4.0, key=n, **knobs) for n in (8, 80))
    of_coarse, of_fine = (direction_law(n, over_s=4.0, **knobs) for n in (8, 80))
    assert stats.kstest(coarse, below(of_coarse)).pvalue > FALSE_ALARM
    assert stats.kstest(fine, below(of_fine)).pvalue > FALSE_ALARM
    tolerance = 0.01  # the pull of sin d is at first 0.6^2 / 6 = 6 % weaker than that of d, and both steps see it
    assert np.abs(np.cumsum(of_coarse - of_fine)).max() < tolerance
    assert stats.ks_2samp(coarse, fine).statistic < tolerance + stats.kstwobign.isf(FALSE_ALARM) * np.sqrt(2 / N)
    longer = directions(8, over_s=5.5, key=9, **knobs)
    assert stats.ks_2samp(longer, fine).statistic > tolerance + stats.kstwobign.isf(FALSE_ALARM) * np.sqrt(2 / N)


def test_a_vehicle_against_the_traffic_turns_sooner_in_fine_steps():
    """The closed form is exact for small angles alone: what this costs, so that nobody takes it for exact."""
    coarse, fine = (direction_law(n, over_s=4.0, concentration=20.0, start=2.0) for n in (8, 80))
    assert 0.05 < np.abs(np.cumsum(coarse - fine)).max() < 0.15


def test_direction_is_drawn_the_short_way_across_the_wrap():
    sample = directions(4, over_s=2.0, concentration=500.0, start=np.pi - 0.2, mean=-np.pi + 0.2)
    assert (np.abs(sample) > 2.3).all()


def moved(primitive_map, dt_s, *, n=N, key=5, direction=0.0, speed=10.0, config=None):
    """Particles from the origin after dt_s: one call of `predict`."""
    table = motion_table(primitive_map, config or FilterConfig())
    cloud = _kernels.Cloud(
        position=np.zeros((1, n, 2)), direction=np.full((1, n), direction), speed=np.full((1, n), speed),
        cell=np.full((1, n), -1), mode=np.zeros((1, n), np.int64), row=np.full((1, n), -1),
        since=np.zeros((1, n)), weight=np.full((1, n), 1.0 / n),
        state=seeded(key)[None].copy(),
    )  # fmt: skip
    vehicle = np.zeros(1, np.int64)
    _kernels.settle(table, cloud, vehicle)
    _kernels.predict(table, cloud, vehicle, np.array([dt_s]))
    return cloud


def test_position_follows_direction_and_speed_and_drifts_at_the_learned_rate():
    cloud = moved(one_cell_map(drift=0.08), 3.0, config=BARE)
    x, y = cloud.position[0].T
    error = np.sqrt(0.08 * 3.0)
    assert stats.kstest(x, stats.norm(30.0, error).cdf).pvalue > FALSE_ALARM
    # one mode of spread 1e-3 rad, held from step to step: sideways at most 30 m of it
    assert stats.kstest(y, stats.norm(0.0, np.hypot(error, 0.02)).cdf).pvalue > FALSE_ALARM
    assert stats.kstest(x, stats.norm(30.0, 1.1 * error).cdf).pvalue < FALSE_ALARM


def test_one_long_prediction_is_as_many_short_ones():
    broad = {"concentration": 30.0, "shape": 20.0, "mean": 0.3}
    long, short = (
        moved(one_cell_map(**broad), 4.0, n=5000),
        moved(one_cell_map(**broad), 4.0, n=5000, config=FilterConfig(step_s=0.02)),
    )
    for name in ("speed", "direction"):
        assert stats.ks_2samp(getattr(long, name)[0], getattr(short, name)[0]).pvalue > FALSE_ALARM
    for axis in (0, 1):
        assert stats.ks_2samp(long.position[0, :, axis], short.position[0, :, axis]).pvalue > FALSE_ALARM
    other = moved(one_cell_map(**broad | {"mean": 0.35}), 4.0)
    assert stats.ks_2samp(long.position[0, :, 1], other.position[0, :, 1]).pvalue < FALSE_ALARM


def test_where_no_cell_tells_the_direction_diffuses():
    free = one_cell_map(place_free_turning=0.02, speed_rate=1.0).without_places()
    cloud = moved(free, 2.0)
    assert (cloud.cell == -1).all()
    assert stats.kstest(cloud.direction[0], stats.norm(0, np.sqrt(0.02 * 2.0)).cdf).pvalue > FALSE_ALARM
    assert stats.kstest(cloud.direction[0], stats.norm(0, 1.1 * np.sqrt(0.02 * 2.0)).cdf).pvalue < FALSE_ALARM


def test_place_free_modes_and_those_without_direction_draw_no_vehicle(ring_map):
    table = motion_table(ring_map, FilterConfig())
    m = ring_map.direction.weight.shape[1]
    assert not table.draws[-1].any()
    assert not table.draws[:, m - ring_map.n_place_free_modes :].any()
    assert not table.draws[ring_map.direction.concentration == 0].any()
    assert table.draws.any()


def test_speeds_of_all_places_have_the_moments_of_the_place_free_speeds_in_motion(ring_map):
    shape, rate = speeds_of_all_places(ring_map)
    _, speed = ring_map.without_places().sample(np.zeros((200_000, 2)), rng=np.random.default_rng(0))
    mode_means = ring_map.speed.mean[-1]
    assert sorted(mode_means[ring_map.direction.weight[-1] > 0])[0] < 0.3  # the standing mode, which is left out
    moving = speed[speed > 0.5]
    assert shape / rate == pytest.approx(moving.mean(), rel=0.03)
    assert shape / rate**2 == pytest.approx(moving.var(), rel=0.1)


def test_cells_reach_beside_themselves_to_the_nearest():
    cells = GridTessellation.covering(np.array([[0.5, 0.5], [10.5, 0.5]]), cell_size=1.0)
    near = reaching(cells.locator, 3.5)
    found = {
        (x, y): locate(near, x, y)
        for x, y in ((0.5, 0.5), (10.5, 0.5), (3.5, 0.5), (7.5, 0.5), (0.5, -2.5), (5.5, 0.5), (0.5, 5.5))
    }
    assert found == {
        (0.5, 0.5): 0, (10.5, 0.5): 1, (3.5, 0.5): 0, (7.5, 0.5): 1, (0.5, -2.5): 0, (5.5, 0.5): -1, (0.5, 5.5): -1,
    }  # fmt: skip
    nothing = GridTessellation.empty().locator
    assert locate(reaching(nothing, 3.5), 0.5, 0.5) == -1


def test_who_follows_a_journey_of_another_place_turns_by_so_much_more_than_it(ring_map):
    """The variance of turns has a part that grows as the square of the agility: to 5 %, six standard errors."""

    def variance_of_turns(agility):
        particles = ParticleFilter(ring_map, FilterConfig(n_particles=N, place_free_agility=agility))
        particles.reserve(1)
        far_off = Detections(track_id=["a"], time_ns=[0], position=[[500.0, 500.0]], direction=[0.0], speed=[8.0])
        slot = np.array([0])
        particles.begin(slot, np.array([7], np.uint64), far_off)
        particles.predict(slot, np.array([0.1]))  # now they follow journeys
        before = particles.belief.cloud.direction[0].copy()
        particles.predict(slot, np.array([1.0]))
        return np.var(wrap(particles.belief.cloud.direction[0] - before))

    still, once, twice = (variance_of_turns(agility) for agility in (1e-6, 1.0, 2.0))
    assert once > 2.0 * still
    assert twice - still == pytest.approx(4.0 * (once - still), rel=0.05)
