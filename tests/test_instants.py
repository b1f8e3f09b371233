"""Who is where at an instant: as whoever looks through the log row by row would say."""

import numpy as np

from dirprim_filter.instants import LONGEST_UNSEEN_S, Instants
from dirprim_filter.tracks import Tracks


def seen_at_random(rng):
    n = 300
    return Tracks(
        track_id=rng.integers(0, 6, n), time_ns=rng.choice(5_000_000_000, n, replace=False),
        position=rng.normal(0, 50, (n, 2)), direction=rng.uniform(-3, 3, n), speed=rng.uniform(0, 9, n),
        group=rng.integers(0, 3, n),
    )  # fmt: skip


def test_who_was_last_seen_a_moment_ago_is_there_and_nothing_later_tells():
    rng = np.random.default_rng(0)
    tracks = seen_at_random(rng)
    group, time_ns = rng.integers(0, 4, 50), rng.integers(-(10**9), 6 * 10**9, 50)
    found = Instants.of(tracks, group, time_ns)
    n_there = 0
    for i in range(50):
        rows = slice(found.first[i], found.first[i + 1])
        expected = []
        for vehicle in np.unique(tracks.vehicle):
            own = np.flatnonzero((tracks.vehicle == vehicle) & (tracks.group == group[i]))
            before = own[tracks.time_ns[own] <= time_ns[i]]
            if before.size and time_ns[i] - tracks.time_ns[before[-1]] <= LONGEST_UNSEEN_S * 1e9:
                last, age = before[-1], (time_ns[i] - tracks.time_ns[before[-1]]) * 1e-9
                way = age * tracks.speed[last] * np.exp(1j * tracks.direction[last])
                place = tracks.position[last] + [way.real, way.imag]
                expected.append((vehicle, *place, tracks.direction[last], tracks.speed[last]))
        np.testing.assert_allclose(
            np.column_stack([found.vehicle[rows], found.state[rows]]), np.array(expected).reshape(-1, 5)
        )
        np.testing.assert_array_equal(
            found.rows_of(np.full(found.vehicle[rows].size, i), found.vehicle[rows]), np.arange(rows.start, rows.stop)
        )
        n_there += len(expected)
    assert n_there > 50
    assert found.rows_of(np.array([0, 3]), np.array([99, 98])).tolist() == [-1, -1]


def test_some_instants_are_those_that_were_asked_for_alone():
    rng = np.random.default_rng(1)
    tracks, group, time_ns = seen_at_random(rng), rng.integers(0, 4, 50), rng.integers(0, 5 * 10**9, 50)
    every = Instants.of(tracks, group, time_ns)
    for chosen in (np.array([7, 3, 3, 49]), np.empty(0, np.int64), np.arange(50)):
        some, alone = every.some(chosen), Instants.of(tracks, group[chosen], time_ns[chosen])
        for ours, theirs in zip(some, alone, strict=True):
            np.testing.assert_array_equal(ours, theirs)
    assert every.some(np.array([0])).first[-1] < every.first[-1]
