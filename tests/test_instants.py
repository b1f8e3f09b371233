"""Who is where at an instant: as whoever looks through the log row by row would say."""

import numpy as np

from dirprim_filter.instants import LONGEST_UNSEEN_S, Instants
from dirprim_filter.tracks import Tracks

STEP_NS = 12_500_000
"""Of clocks: twenty of these are as long as a vehicle may be unseen."""


def seen_at_random(rng):
    n = 300
    return Tracks(
        track_id=rng.integers(0, 6, n), time_ns=STEP_NS * rng.choice(400, n, replace=False),
        position=rng.normal(0, 50, (n, 2)), direction=rng.uniform(-3, 3, n), speed=rng.uniform(0, 9, n),
        group=rng.integers(0, 3, n),
    )  # fmt: skip


def test_who_was_last_seen_a_moment_ago_is_there_and_nothing_later_tells():
    rng = np.random.default_rng(0)
    tracks = seen_at_random(rng)
    group, time_ns = rng.integers(0, 4, 400), STEP_NS * rng.integers(-80, 480, 400)
    found = Instants.of(tracks, group, time_ns)
    n_there = n_just = 0
    for i in range(400):
        rows = slice(found.first[i], found.first[i + 1])
        expected = []
        for vehicle in np.unique(tracks.vehicle):
            own = np.flatnonzero((tracks.vehicle == vehicle) & (tracks.group == group[i]))
            before = own[tracks.time_ns[own] <= time_ns[i]]
            if before.size and time_ns[i] - tracks.time_ns[before[-1]] <= LONGEST_UNSEEN_S * 1e9:
                n_just += time_ns[i] - tracks.time_ns[before[-1]] == 20 * STEP_NS
                last, age = before[-1], (time_ns[i] - tracks.time_ns[before[-1]]) * 1e-9
                way = age * tracks.speed[last] * np.exp(1j * tracks.direction[last])
                place = tracks.position[last] + [way.real, way.imag]
                expected.append((vehicle, *place, tracks.direction[last], tracks.speed[last]))
        np.testing.assert_allclose(
            np.column_stack([found.vehicle[rows], found.state[rows]]), np.array(expected).reshape(-1, 5)
        )
        n_there += len(expected)
    assert n_there > 50
    assert n_just > 0  # on the boundary itself
    later = Instants.of(tracks, group, time_ns + 100_000_000)
    instant, then = (np.repeat(np.arange(400), np.diff(of.first)) for of in (found, later))
    pairs = list(zip(then.tolist(), later.vehicle.tolist(), strict=True))
    expected = [pairs.index(of) if of in pairs else -1 for of in zip(instant, found.vehicle, strict=True)]
    assert later.rows_of(found).tolist() == expected
    assert -1 in expected
    nothing = Instants.of(tracks, group[:0], time_ns[:0])
    assert nothing.rows_of(found).tolist() == [-1] * len(expected)
