"""Vehicles that misbehave: what each kind does, and that speeds are those of the displacements."""

import sys
from pathlib import Path

import numpy as np
import pytest

sys.path.insert(0, str(Path(__file__).with_name("benchmarks")))

from misbehaviour import KINDS, misbehaving

from situations import junction_traffic

DT_S = 0.1


@pytest.fixture(scope="module")
def traffic():
    return junction_traffic(np.random.default_rng(0), n_vehicles=12)


def by_vehicle(tracks):
    for name in np.unique(tracks.track_id):
        own = tracks[tracks.track_id == name]
        yield own, np.diff(own.position, axis=0) / DT_S


@pytest.mark.parametrize("kind", KINDS)
def test_rows_stay_and_speeds_are_those_of_the_displacements(traffic, kind):
    found = misbehaving(traffic, kind=kind, rng=np.random.default_rng(1))
    np.testing.assert_array_equal(found.track_id, traffic.track_id)
    np.testing.assert_array_equal(found.time_ns, traffic.time_ns)
    for own, velocity in by_vehicle(found):
        pace = np.hypot(*velocity.T)
        usual = np.ones(pace.size, np.bool_)
        if kind == "jumps":  # within half a second of it no speed is of the vehicle
            usual = np.abs(np.arange(pace.size) - np.argmax(pace)) > 5
        middle = 0.5 * (own.speed[1:] + own.speed[:-1])
        assert np.abs(middle - pace)[usual].max() < 1.5  # a course is smoothed over half a second
        assert np.abs(middle - pace)[usual].mean() < 0.2


def first_rows(traffic, found):
    """Of each vehicle both paths, and the row from which on they differ."""
    for (before, _), (after, _) in zip(by_vehicle(traffic), by_vehicle(found), strict=True):
        off = np.hypot(*(after.position - before.position).T)
        yield before, after, off, int(np.argmax(off > 1e-9))


def test_each_begins_in_its_middle_as_it_drove(traffic):
    for kind in set(KINDS) - {"drives against"}:
        found = misbehaving(traffic, kind=kind, rng=np.random.default_rng(2))
        for before, _, off, row in first_rows(traffic, found):
            assert 0.25 * len(before) < row < 0.75 * len(before) + 2, kind
            assert off[-1] > 1.0, kind


def test_what_stops_dead_brakes_by_six_and_stands(traffic):
    found = misbehaving(traffic, kind="stops dead", rng=np.random.default_rng(3))
    for _, after, _, row in first_rows(traffic, found):
        steps = np.hypot(*np.diff(after.position[row - 1 :], axis=0).T) / DT_S
        braking = steps[1:][steps[1:] > 1.0]
        assert np.diff(braking) == pytest.approx(-6.0 * DT_S, abs=0.15)
        assert steps[-1] < 1e-9


def test_what_creeps_goes_its_own_path_at_a_quarter(traffic):
    found = misbehaving(traffic, kind="creeps", rng=np.random.default_rng(4))
    for before, after, _, row in first_rows(traffic, found):
        ways = [np.hypot(*np.diff(of.position[row:], axis=0).T).sum() for of in (before, after)]
        assert ways[1] == pytest.approx(0.25 * ways[0], abs=0.75 * 10.0**2 / (2 * 6.0))  # and what it takes to brake
        away = np.hypot(*(after.position[row:, None] - before.position[None]).transpose(2, 0, 1)).min(axis=1)
        assert away.max() < 0.6  # rows of the path are a metre apart


def test_what_turns_round_drives_back_beside_its_path(traffic):
    found = misbehaving(traffic, kind="turns round", rng=np.random.default_rng(5))
    for before, after, _, row in first_rows(traffic, found):
        turned = np.arctan2(*np.diff(after.position[row - 1 :], axis=0)[:, ::-1].T)
        assert np.ptp(np.unwrap(turned)) > 2.5
        back = after.position[row + 25 : row + 30]  # past the half circle
        away = np.hypot(*(back[:, None] - before.position[None]).transpose(2, 0, 1)).min(axis=1)
        assert away.max() < 12.0


def test_what_drives_against_takes_the_same_path_from_its_end(traffic):
    found = misbehaving(traffic, kind="drives against", rng=np.random.default_rng(6))
    for before, after, *_ in first_rows(traffic, found):
        np.testing.assert_array_equal(after.position, before.position[::-1])


def test_what_jumps_is_two_metres_to_the_left_from_then_on(traffic):
    found = misbehaving(traffic, kind="jumps", rng=np.random.default_rng(7))
    for _, _, off, row in first_rows(traffic, found):
        assert (off[:row] == 0.0).all()
        assert off[row:] == pytest.approx(2.0)


def test_a_kind_that_does_not_exist_is_named(traffic):
    with pytest.raises(ValueError, match="kind: expected one of stops dead, creeps"):
        misbehaving(traffic, kind="flies", rng=np.random.default_rng(0))  # type: ignore[arg-type]
