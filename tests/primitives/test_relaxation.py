"""How fast vehicles settle, learned from vehicles whose rate is known."""

import numpy as np
import pytest

from dirprim_filter import learn_primitives
from dirprim_filter.config import LearningConfig
from dirprim_filter.primitives.relaxation import FALLBACK, RATES
from dirprim_filter.tracks import Tracks
from situations import rows_of
from tessellation import GridTessellation

N_VEHICLES, N_ROWS, DT_S = 200, 60, 0.5
SHAPE, MEAN_SPEED = 20.0, 9.0


def settling_traffic(rng, *, direction_rate, speed_rate):
    """Stationary deviations: Ornstein-Uhlenbeck in direction, Cox-Ingersoll-Ross in speed; places tell nothing."""
    spread = 0.2
    kept, speed_kept = np.exp(-direction_rate * DT_S), np.exp(-speed_rate * DT_S)
    turn = np.empty((N_ROWS, N_VEHICLES))
    speed = np.empty((N_ROWS, N_VEHICLES))
    turn[0] = rng.normal(0, spread, N_VEHICLES)
    speed[0] = rng.gamma(SHAPE, MEAN_SPEED / SHAPE, N_VEHICLES)
    scale = MEAN_SPEED / SHAPE * (1 - speed_kept)
    for i in range(1, N_ROWS):
        turn[i] = kept * turn[i - 1] + rng.normal(0, spread * np.sqrt(1 - kept**2), N_VEHICLES)
        speed[i] = rng.gamma(SHAPE + rng.poisson(speed[i - 1] * speed_kept / scale), scale)
    return Tracks(
        track_id=np.tile(np.arange(N_VEHICLES), N_ROWS),
        time_ns=np.repeat(np.arange(N_ROWS) * int(DT_S * 1e9), N_VEHICLES),
        position=rng.uniform(1, 99, (N_ROWS * N_VEHICLES, 2)),
        direction=3.0 + turn.ravel(),  # across the wrap
        speed=speed.ravel(),
    )


def standard_error(rate):
    """Of -log(correlation) / dt: the correlation of n pairs is off by sqrt((1 - correlation^2) / n)."""
    correlation = np.exp(-rate * DT_S)
    n = N_VEHICLES * (N_ROWS - 1)
    return np.sqrt((1 - correlation**2) / n) / correlation / DT_S


@pytest.mark.parametrize(("direction_rate", "speed_rate"), [(0.2, 0.6), (0.5, 0.1), (1.0, 0.3)])
def test_the_rates_of_known_traffic_are_learned_to_five_standard_errors(direction_rate, speed_rate):
    rng = np.random.default_rng(int(100 * direction_rate))
    tracks = settling_traffic(rng, direction_rate=direction_rate, speed_rate=speed_rate)
    cell = GridTessellation.covering(tracks.position, cell_size=100.0)
    assert cell.n_cells == 1
    config = LearningConfig(prior_strengths=(0.02,))
    learned = learn_primitives(tracks, tessellation=cell, primitive="flat", config=config, rng=rng).relaxation
    assert learned.direction_rate == pytest.approx(direction_rate, abs=5 * standard_error(direction_rate))
    assert learned.speed_rate == pytest.approx(speed_rate, abs=5 * standard_error(speed_rate))
    for wrong in (0.6 * direction_rate, 1.5 * direction_rate):
        assert learned.direction_rate != pytest.approx(wrong, abs=5 * standard_error(wrong))


def test_vehicles_that_keep_to_their_lane_exactly_have_the_least_rate_and_drift(ring):
    learned = learn_primitives(ring, tessellation="grid", cell_size=6.0, rng=np.random.default_rng(0)).relaxation
    assert learned.drift == 0.02
    assert learned.place_free_speed_rate == RATES[0]  # every vehicle drives at a speed of its own for ever
    # turning at 8 m/s on 20 m is 0.4 rad/s: over steps of 0.2 s a diffusion of 0.4^2 0.2 rad^2/s
    assert learned.place_free_turning == pytest.approx(0.4**2 * 0.2, rel=0.2)


@pytest.mark.parametrize("n", [1, 2, 10])
def test_too_few_pairs_of_rows_fall_back(n):
    first = rows_of(np.zeros(n), np.full(n, 8.0))
    assert learn_primitives(first, rng=np.random.default_rng(0)).relaxation == FALLBACK
    pairs = [first[: n // 2 + 1], rows_of(np.zeros(n // 2 + 1), np.full(n // 2 + 1, 8.0), time_ns=500_000_000)]
    assert learn_primitives(pairs, rng=np.random.default_rng(0)).relaxation == FALLBACK


def test_rows_far_apart_in_time_are_no_pairs(ring):
    sparse = ring[ring.time_ns % 3_000_000_000 == 0]
    assert learn_primitives(sparse, rng=np.random.default_rng(0)).relaxation == FALLBACK
