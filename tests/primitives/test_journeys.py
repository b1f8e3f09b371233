"""Journeys: found by those that move alike, followed as they went, and never one's own."""

from dataclasses import replace

import numpy as np
import pytest
from numba import njit
from scipy import stats

from dirprim_filter.distributions import _random as random
from dirprim_filter.primitives import _candidates, _following, _likening
from dirprim_filter.primitives.journeys import INTERVAL_S, Journeys
from dirprim_filter.primitives.likeness import learn_likeness
from dirprim_filter.primitives.rows import TrackRows
from dirprim_filter.tracks import Tracks
from situations import ring_traffic

FALSE_ALARM = 1e-4  # of each statistical test below; seeds are fixed
STILL = {
    "direction_spread": 1e-9,
    "speed_spread": 1e-9,
    "drift": 1e-12,
    "forget_rate": 1e-9,
    "agility": 1e-9,
}
ALIVE = {
    "direction_spread": 0.1,
    "speed_spread": 0.2,
    "drift": 0.05,
    "forget_rate": 0.5,
    "agility": 0.3,
}


def journeys_of(tracks):
    return Journeys.of(TrackRows.thinned(tracks, interval_s=0.05))


def straight(*, speed=10.0, n_rows=101, dt_s=0.1, y=0.0, track_id=0, start_s=0.0):
    """A vehicle that drives east from the origin."""
    t = start_s + dt_s * np.arange(n_rows)
    return Tracks(
        track_id=np.full(n_rows, track_id),
        time_ns=(t * 1e9).round().astype(np.int64),
        position=np.column_stack([speed * dt_s * np.arange(n_rows), np.full(n_rows, y)]),
        direction=np.zeros(n_rows),
        speed=np.full(n_rows, speed),
    )


def futures(journeys, start, time_s, *, n=400, spreads=STILL, but=-1.0, step_s=0.1, key=1):
    path = np.empty((1, n, len(time_s), 2))
    _following.hallucinate(
        journeys.table(**spreads), np.array([start], dtype=float), np.array([but]), np.asarray(time_s, dtype=float),
        step_s, np.array([key], np.uint64), path,
    )  # fmt: skip
    return path[0]


def test_journeys_have_a_row_every_interval_and_end_where_the_vehicle_or_its_rows_do():
    gap = Tracks.concatenate([straight(n_rows=21), straight(n_rows=21, start_s=10.0), straight(track_id=1, n_rows=16)])
    journeys = journeys_of(gap)
    np.testing.assert_allclose(journeys.duration, [*[INTERVAL_S] * 4, 0, *[INTERVAL_S] * 4, 0, *[INTERVAL_S] * 3, 0])
    assert journeys.position[1, 0] == pytest.approx(10.0 * INTERVAL_S)


def test_a_lone_row_is_no_journey():
    lone = Tracks.concatenate([straight(n_rows=1), straight(track_id=1, n_rows=21), straight(track_id=2, n_rows=1)])
    assert len(journeys_of(lone)) == 5
    assert len(journeys_of(straight(n_rows=1))) == 0


def test_of_many_rows_whole_vehicles_are_left_out():
    rows = TrackRows.thinned(ring_traffic(np.random.default_rng(0), n_vehicles=12), interval_s=0.05)
    all_of_them, some = Journeys.of(rows), Journeys.of(rows, most_rows=len(rows) // 3)
    assert len(some) == pytest.approx(len(all_of_them) / 3, rel=0.01)


def test_a_standing_vehicle_turns_evenly_from_the_last_direction_to_the_next():
    t = straight(n_rows=51)
    stands = (t.time_ns >= 1_000_000_000) & (t.time_ns <= 4_000_000_000)
    noisy = replace(
        t,
        speed=np.where(stands, 0.0, t.speed),
        direction=np.where(stands, 2.0, np.where(t.time_ns > 4_000_000_000, 0.7, 0.0)),
    )
    direction = journeys_of(noisy).direction
    assert (np.diff(direction) >= 0).all()
    assert direction.max() == pytest.approx(0.7)


@pytest.mark.parametrize(
    "change", [{"speed": -np.ones(5)}, {"duration": np.ones(5)}, {"nearness": 0.0}, {"strength": -1.0}]
)
def test_journeys_that_cannot_be_are_refused(change):
    with pytest.raises(ValueError, match="expected"):
        replace(journeys_of(straight(n_rows=21)), **change)


def test_left_to_itself_a_vehicle_goes_its_journeys_way_at_its_times():
    ring = ring_traffic(np.random.default_rng(0), n_vehicles=1)
    journeys = journeys_of(ring)
    at = ring.time_ns == 1_500_000_000
    start = [*ring.position[at][0], ring.direction[at][0], ring.speed[at][0]]
    time_s = np.arange(1, 9) * 0.5
    path = futures(replace(journeys, strength=1e-12), start, time_s, n=3)
    truth = np.stack([np.interp(1.5 + time_s, ring.time_ns * 1e-9, ring.position[:, axis]) for axis in (0, 1)], axis=-1)
    np.testing.assert_allclose(path, np.broadcast_to(truth, path.shape), atol=0.05)


def test_a_faster_vehicle_gets_ahead_as_its_lead_decays():
    """ds = 2 m/s decays at k: after t it is ahead by ds (1 - e^{-k t}) / k."""
    journeys = replace(journeys_of(straight()), strength=1e-12, speed_rate=0.5, nearness=5.0)
    path = futures(journeys, [0.0, 0.0, 0.0, 12.0], [1.0, 2.0, 4.0], n=2, step_s=0.02)
    t = np.array([1.0, 2.0, 4.0])
    np.testing.assert_allclose(path[0, :, 0], 10.0 * t + 2.0 * (1 - np.exp(-0.5 * t)) / 0.5, rtol=0.01)


def test_ones_own_journey_is_passed_over():
    two = Tracks.concatenate([straight(), straight(track_id=1, y=0.5, speed=8.0)])
    journeys = replace(journeys_of(two), strength=1e-12, speed_rate=5.0, nearness=3.0)
    of_second = futures(journeys, [0.0, 0.0, 0.0, 10.0], [4.0], but=0.0)[:, 0, 0]
    both = futures(journeys, [0.0, 0.0, 0.0, 10.0], [4.0])[:, 0, 0]
    assert of_second.std() < 0.1
    assert both.std() > 1.0


def test_weights_are_those_of_a_slow_loop():
    rng = np.random.default_rng(0)
    ring = ring_traffic(rng, n_vehicles=30)
    journeys = replace(journeys_of(ring), nearness=1.3)
    table = journeys.table(**STILL)
    alike = _candidates.room_for(table)
    for _ in range(40):
        row = rng.integers(len(ring))
        x, y = ring.position[row] + rng.normal(0, 1, 2)
        direction, speed = ring.direction[row] + rng.normal(0, 0.2), ring.speed[row] + rng.normal(0, 1)
        n_blocks, total = _candidates.look_around(table, x, y, direction, speed, -1.0, alike)
        expected = {}
        for r in np.flatnonzero(journeys.duration > 0):
            offset = np.array([x, y]) - journeys.position[r]
            toward = np.array([np.cos(journeys.direction[r]), np.sin(journeys.direction[r])])
            since = offset @ toward / journeys.speed[r]
            if not 0 <= since < journeys.duration[r]:
                continue
            _, _, turn, gain = table.row[r, :4]
            across = toward[0] * offset[1] - toward[1] * offset[0] - 0.5 * turn * since**2 * journeys.speed[r]
            chord = 2 * np.sin(0.5 * (direction - journeys.direction[r] - turn * since))
            squared = (across / 1.5) ** 2 + (chord * min(speed, 1) / 0.12) ** 2
            squared += ((speed - journeys.speed[r] - gain * since) / (0.5 + 0.15 * speed)) ** 2
            if squared / 1.3**2 <= 18.0:
                expected[r] = np.exp(-0.5 * squared / 1.3**2)
        n = n_blocks * _candidates.BLOCK
        like = alike.at[_candidates.WEIGHT, :n] > 0
        assert set(alike.row[:n][like]) == set(expected)
        assert total == pytest.approx(sum(expected.values()), rel=1e-4)  # single precision


@pytest.fixture
def crowded_table():
    journeys = replace(journeys_of(ring_traffic(np.random.default_rng(0), n_vehicles=12)), nearness=1.0, strength=0.5)
    return journeys.table(**STILL)


def assert_found_by_weight(table, motion, drawn):
    """Rows drawn for a motion, -2 and less for journeys of other places, are as many as their weights say."""
    alike = _candidates.room_for(table)
    n_blocks, total = _candidates.look_around(table, *motion, _likening.NOBODY, alike)
    n = n_blocks * _candidates.BLOCK
    row, weight = alike.row[:n], alike.at[_candidates.WEIGHT, :n].astype(float)
    wanted = dict(zip(row[weight > 0].tolist(), weight[weight > 0], strict=True)) | {-1: table.strength}
    drawn = np.maximum(drawn, -1).tolist()
    count = np.array([drawn.count(row) for row in wanted])
    assert count.sum() == len(drawn)
    expected = len(drawn) * np.array(list(wanted.values())) / (total + table.strength)
    rare = expected < 5
    count, expected = (np.append(c[~rare], c[rare].sum() + 1e-9) for c in (count, expected))
    expected *= count.sum() / expected.sum()
    assert stats.chisquare(count, expected).pvalue > FALSE_ALARM
    assert stats.chisquare(np.roll(count, 1), expected).pvalue < FALSE_ALARM


def test_a_journey_is_found_as_often_as_its_weight_whether_or_not_most_are_unlike(crowded_table):
    state = np.empty(4, np.uint64)
    alike = _candidates.room_for(crowded_table)
    random.seed_state(np.uint64(5), state)
    for direction in (np.pi / 2, np.pi / 2 + 0.3):  # like some, like next to none
        motion = (20.0, 0.5, direction, 8.0)
        drawn = np.array([found(crowded_table, motion, alike, state) for _ in range(20_000)])
        assert_found_by_weight(crowded_table, motion, drawn)


@njit
def found(table, motion, alike, state):
    x, y, direction, speed = motion
    row, _ = _candidates.find(table, x, y, direction, speed, -1.0, 0.0, alike, state)
    return row


def test_particles_in_several_squares_find_journeys_each_by_its_own_weights(crowded_table):
    motions = np.array([(20.0, 0.5, np.pi / 2, 8.0), (-20.0, -0.5, -np.pi / 2, 7.0), (20.0, 0.5, np.pi / 2 + 0.3, 8.0)])
    which = np.random.default_rng(1).integers(3, size=60_000)
    x, y, direction, speed = motions[which].T
    row, since = np.full(which.size, _likening.NO_ROW), np.zeros(which.size)
    looking = np.flatnonzero(np.arange(which.size) % 2)
    state, alike = np.empty(4, np.uint64), _candidates.room_for(crowded_table)
    random.seed_state(np.uint64(6), state)
    position = np.column_stack([x, y])
    _candidates.find_all(crowded_table, looking.copy(), position, direction, speed, row, since, 0.0, alike, state)
    assert (row[::2] == _likening.NO_ROW).all()
    for i, motion in enumerate(motions):
        assert_found_by_weight(crowded_table, tuple(motion), row[looking][which[looking] == i])
    _candidates.find_all(crowded_table, looking.copy(), position, direction, speed, row, since, 1.0, alike, state)
    assert (row[looking] < _likening.NO_ROW).all()  # all follow journeys of other places


def test_a_fast_vehicle_finds_the_journey_it_is_on_anywhere_between_two_rows():
    table = journeys_of(straight(speed=25.0)).table(**STILL)
    alike = _candidates.room_for(table)
    for x in np.arange(0.5, 100.0, 1.0):
        n_blocks, _ = _candidates.look_around(table, x, 0.0, 0.0, 25.0, -1.0, alike)
        assert (alike.at[_candidates.WEIGHT, : n_blocks * _candidates.BLOCK] > 0).sum() == 1


def energy_distance(a, b):
    """Of samples of the plane, without bias: 0 in the mean where they are of one law."""

    def apart(x, y):
        return np.linalg.norm(x[:, None] - y[None], axis=-1)

    n, m = len(a), len(b)
    return 2 * apart(a, b).mean() - apart(a, a).sum() / (n * (n - 1)) - apart(b, b).sum() / (m * (m - 1))


def test_four_seconds_in_8_steps_and_in_80_are_the_same_to_monte_carlo_error():
    journeys = replace(journeys_of(ring_traffic(np.random.default_rng(0))), nearness=1.0, strength=0.5)
    start = [20.0, 0.0, np.pi / 2, 8.0]
    knobs = {"n": 700, "spreads": ALIVE}
    coarse = futures(journeys, start, [4.0], step_s=0.5, key=1, **knobs)[:, 0]
    fine = futures(journeys, start, [4.0], step_s=0.05, key=2, **knobs)[:, 0]
    later = futures(journeys, start, [4.4], step_s=0.5, key=3, **knobs)[:, 0]
    rng = np.random.default_rng(0)
    both = np.concatenate([coarse, fine])
    by_chance = [energy_distance(*np.split(rng.permutation(both), 2)) for _ in range(60)]
    bound = np.mean(by_chance) + 6 * np.std(by_chance)  # one in ten thousand, with room for its heavier tail
    assert energy_distance(coarse, fine) < bound
    assert energy_distance(later, fine) > bound


def test_deviations_settle_on_their_spreads():
    journeys = replace(journeys_of(straight(n_rows=1201)), strength=1e-12, direction_rate=2.0, speed_rate=2.0)
    table = journeys.table(**STILL | {"direction_spread": 0.1, "speed_spread": 0.05})
    decay, state = _following.decay_over(table, 0.3), np.empty(4, np.uint64)
    random.seed_state(np.uint64(3), state)
    direction, speed = [], []
    for _ in range(4000):
        d, s, row, since = 0.0, 10.0, 0, 0.0
        for _ in range(12):
            drawn = random.draw_normal(state), random.draw_normal(state)
            _, _, d, s, row, since, _ = _following.follow(table, decay, 0.3, d, s, row, since, *drawn)
        direction.append(d)
        speed.append(s)
    left = 1.0 - np.exp(-2 * 2.0 * 3.6)
    assert stats.kstest(direction, stats.norm(0, 0.1 * np.sqrt(left)).cdf).pvalue > FALSE_ALARM
    assert stats.kstest(speed, stats.norm(10, 0.05 * 10.5 * np.sqrt(left)).cdf).pvalue > FALSE_ALARM
    assert stats.kstest(speed, stats.norm(10, 0.06 * 10.5).cdf).pvalue < FALSE_ALARM


def test_where_nobody_moved_alike_the_place_tells_nothing():
    journeys = journeys_of(ring_traffic(np.random.default_rng(0)))
    away = [500.0, 500.0, 1.0, 8.0]
    here = futures(journeys, away, [3.0], n=500, spreads=ALIVE, key=1)[:, 0]
    free = futures(journeys.without_places(), away, [3.0], n=500, spreads=ALIVE, key=1)[:, 0]
    np.testing.assert_array_equal(here, free)
    on_the_ring = [20.0, 0.0, np.pi / 2, 8.0]
    assert not np.array_equal(
        futures(journeys, on_the_ring, [3.0], key=1), futures(journeys.without_places(), on_the_ring, [3.0], key=1)
    )


@pytest.mark.parametrize("start", [[1e300, -1e300, 0.0, 1e5], [0.0, 0.0, 1e6, 0.0], [2e9, 0.0, 0.0, 3.0]])
def test_the_strangest_vehicles_have_finite_futures(start):
    journeys = journeys_of(ring_traffic(np.random.default_rng(0)))
    assert np.isfinite(futures(journeys, start, [0.1, 8.0], spreads=ALIVE)).all()


def test_rows_a_million_metres_apart_take_no_memory():
    far = replace(straight(track_id=1), position=straight().position + 1e9)
    assert journeys_of(Tracks.concatenate([straight(), far])).table(**STILL).first.size < 40_000_000


def test_what_is_alike_is_learned_from_the_vehicles():
    """Vehicles of two lanes 3 m apart that part after a while: who looks across the lane is wrong half the time."""
    rng = np.random.default_rng(0)
    t = 0.1 * np.arange(81)
    parts = []
    for i in range(40):
        lane, speed = i % 2, 10.0 + rng.normal(0, 0.3)
        turned = np.clip(t - 3.0, 0.0, 2.0) * (0.4 if lane else -0.4)
        velocity = speed * np.column_stack([np.cos(turned), np.sin(turned)])
        position = np.array([rng.uniform(0, 5), 2.0 * lane]) + np.cumsum(velocity * 0.1, axis=0)
        parts.append(
            Tracks(
                track_id=np.full(t.size, i), time_ns=(t * 1e9).round().astype(np.int64), position=position,
                direction=turned, speed=np.full(t.size, speed),
            )
        )  # fmt: skip
    learned = learn_likeness(
        replace(journeys_of(Tracks.concatenate(parts)), nearness=1.4), rng=np.random.default_rng(0)
    )
    assert learned.nearness < 1.0
    assert learned.strength < 1.0


def test_of_one_vehicle_nothing_is_learned():
    one = journeys_of(straight())
    assert learn_likeness(one, rng=np.random.default_rng(0)) is one
