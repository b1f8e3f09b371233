"""Vehicles that misbehave: what each kind does, and that speeds are those of the displacements."""

import sys
from pathlib import Path

import numpy as np
import pytest

sys.path.insert(0, str(Path(__file__).with_name("benchmarks")))

from misbehaviour import misbehaving

from situations import junction_traffic

DT_S = 0.1


@pytest.fixture(scope="module")
def traffic():
    return junction_traffic(np.random.default_rng(0), n_vehicles=12)


def by_vehicle(tracks):
    for name in np.unique(tracks.track_id):
        own = tracks[tracks.track_id == name]
        yield own, np.diff(own.position, axis=0) / DT_S


def away_from(place, path):
    return np.hypot(*(place[:, None] - path[None]).transpose(2, 0, 1)).min(axis=1)


def stops_dead(before, after, row):
    steps = np.hypot(*np.diff(after[row - 1 :], axis=0).T) / DT_S
    assert np.diff(steps[1:][steps[1:] > 1.0]) == pytest.approx(-6.0 * DT_S, abs=0.15)
    assert steps[-1] < 1e-9


def creeps(before, after, row):
    ways = [np.hypot(*np.diff(path[row:], axis=0).T).sum() for path in (before, after)]
    assert ways[1] == pytest.approx(0.25 * ways[0], abs=0.75 * 10.0**2 / (2 * 6.0))  # and what it takes to brake
    assert away_from(after[row:], before).max() < 0.6  # rows of the path are a metre apart


def turns_round(before, after, row):
    turned = np.arctan2(*np.diff(after[row - 1 :], axis=0)[:, ::-1].T)
    assert np.ptp(np.unwrap(turned)) > 2.5
    assert away_from(after[row + 25 : row + 30], before).max() < 12.0  # past the half circle


def jumps(before, after, row):
    off = np.hypot(*(after - before).T)
    assert (off[:row] == 0.0).all()
    assert off[row:] == pytest.approx(2.0)


@pytest.mark.parametrize("does", [stops_dead, creeps, turns_round, jumps], ids=lambda does: does.__name__)
def test_each_begins_in_its_middle_as_it_drove_and_does_what_its_kind_says(traffic, does):
    found = misbehaving(traffic, kind=does.__name__.replace("_", " "), rng=np.random.default_rng(2))
    for (before, _), (after, _) in zip(by_vehicle(traffic), by_vehicle(found), strict=True):
        off = np.hypot(*(after.position - before.position).T)
        row = int(np.argmax(off > 1e-9))
        assert 0.25 * len(before) < row < 0.75 * len(before) + 2
        assert off[-1] > 1.0
        does(before.position, after.position, row)
