"""The vehicle ahead: found as a slow twin finds it, and the response is what drivers do who respond to it."""

from dataclasses import replace

import numpy as np
import pytest

from dirprim_filter.primitives import _leader
from dirprim_filter.primitives.leader import N_FEATURES, LeaderResponse
from dirprim_filter.primitives.leader_learning import LeaderSums
from dirprim_filter.tracks import Tracks
from oracles import leader_features, leader_of
from situations import tracks_of


def test_the_leader_and_what_a_driver_goes_by_are_those_of_the_slow_twin():
    rng, found = np.random.default_rng(0), 0
    for _ in range(30):
        others = np.column_stack([rng.uniform(-30, 30, (40, 2)), rng.uniform(-np.pi, np.pi, 40), rng.uniform(0, 9, 40)])
        curvature, seen = rng.uniform(-0.05, 0.05, 40), np.empty((40, 3))
        _leader.behind(others[None], -1, others[:, :2].copy(), others[:, 2].copy(), curvature, seen)
        for i in range(40):
            gap, speed, which = leader_of(i, others, curvature[i])
            assert seen[i, 2] == which
            if which >= 0:
                np.testing.assert_allclose(seen[i, :2], [gap, speed], atol=1e-12)
                found += 1
    assert found > 50
    others = np.array([[[5.0, 0.0, 0.0, 3.0], [9.0, 0.0, 0.0, 4.0]]])
    for own, gap in ((0, 9.0), (1, 5.0), (-1, 5.0)):
        seen = np.empty((1, 3))
        _leader.behind(others, own, np.zeros((1, 2)), np.zeros(1), np.zeros(1), seen)
        assert seen[0, 0] == gap
    rng = np.random.default_rng(1)
    feature = np.empty(N_FEATURES)
    for of in rng.uniform(0, [20, 60, 60], (200, 3)):  # its speed, the gap, the leader's speed
        _leader.describe(*of, feature)
        np.testing.assert_allclose(feature, leader_features(*of), rtol=1e-12)


def eastward(rows):
    """Vehicles that head east, of rows (vehicle, tenth of a second, east, north, speed)."""
    (track_id, tick), (*place, speed) = np.array(rows).T[:2].astype(np.int64), np.array(rows).T[2:]
    return tracks_of([np.column_stack(place)], track_id=track_id, time_ns=10**8 * tick, speed=speed)


def pairs(rng, n, *, responds):
    """Drivers behind leaders of other speeds: they take on their leader's speed at 0.4/s, or keep to their own."""
    rows = []
    for pair in range(n):
        own, lead, gap = rng.uniform(4, 12), rng.uniform(4, 12), rng.uniform(15, 35)
        place, wanted = -gap, rng.uniform(4, 12)
        for tick in range(40):
            rows.append((2 * pair, tick, place, 100.0 * pair, own))
            rows.append((2 * pair + 1, tick, 0.1 * tick * lead, 100.0 * pair, lead))
            own += 0.1 * 0.4 * ((lead if responds else wanted) - own)
            place += 0.1 * own
    return eastward(rows)


def test_a_law_that_drivers_follow_is_learned_and_none_where_they_follow_none():
    rng = np.random.default_rng(2)
    response = LeaderSums.of(pairs(rng, 80, responds=True)).response()
    assert response.trust == pytest.approx(80 / 130)
    for own, lead in ((6.0, 10.0), (10.0, 6.0), (8.0, 8.0)):
        expected = (lead - own) * (1.0 - np.exp(-0.4))  # gained in one second
        assert leader_features(own, 25.0, lead) @ response.gain == pytest.approx(expected, abs=0.15)
    assert response.push < 0.2
    assert LeaderSums.of(pairs(rng, 80, responds=False)).response() is None


def test_who_stands_starts_as_often_as_it_did_behind_such_a_leader():
    """Behind one that drives off every other vehicle starts within a second; behind one that stands none does."""
    rows = []
    for pair in range(60):
        goes, starts = pair % 2 == 0, pair % 4 == 0
        for tick in range(0, 21, 5):
            rows.append((2 * pair, tick, 0.0, 100.0 * pair, 1.0 if starts and tick > 5 else 0.0))
            rows.append((2 * pair + 1, tick, 8.0 + 0.5 * tick * goes, 100.0 * pair, 5.0 * goes))
    sums = LeaderSums.of(eastward(rows))
    three = 30.0 * 3  # instants of each, last no vehicle's
    assert sums.stood.tolist() == [three, 0.0, 15.0 * 2 + 15.0 * 3, three]
    assert sums.started.tolist() == [0.0, 0.0, 30.0, 0.0]


def test_sums_of_two_groups_are_the_sums_of_each():
    """At the same places and times, yet no driver has a leader in another recording."""
    rng = np.random.default_rng(3)
    one, other = pairs(rng, 12, responds=True), pairs(rng, 9, responds=False)
    other = replace(other, group=other.group + 1)
    sums = map(LeaderSums.of, (Tracks.concatenate([one, other]), one, other))
    for both, *each in zip(*((*of.acceleration, *of[1:]) for of in sums), strict=True):
        np.testing.assert_allclose(sum(each), both, atol=1e-6)


def test_who_knows_nothing_of_leaders_has_no_response():
    pair = pairs(np.random.default_rng(4), 1, responds=True)
    for tracks in (pair[:1], pair):
        assert LeaderSums.of(tracks).response() is None


@pytest.mark.parametrize("wrong", [{"trust": 1.1}, {"push": -1.0}, {"gain": np.zeros(3)}, {"start_rate": -np.ones(3)}])
def test_a_response_that_makes_no_sense_is_refused(wrong):
    numbers = {"gain": np.zeros(N_FEATURES), "push": 1.0, "trust": 0.5, "start_rate": np.ones(3)}
    with pytest.raises(ValueError, match=next(iter(wrong))):
        LeaderResponse(**numbers | wrong)
