"""How vehicles move where the place says nothing: a Markov chain of what they do, learned and driven."""

from dataclasses import replace

import numpy as np
import pytest
from scipy import stats

from dirprim_filter.primitives.background import learn_chain
from dirprim_filter.primitives.motion import FLOATS, background_manoeuvres, joined
from dirprim_filter.primitives.rows import Scale
from dirprim_filter.primitives.visits import Visits
from moving import motion_by_hand, moved, squares

FALSE_ALARM = 1e-4  # of each statistical test below; seeds are fixed
N = 20_000
STEP_S = 0.1


def visits_of(speed, course, *, vehicle=None):
    """One visit of each vehicle, outside of all cells, at instants 0.1 s apart."""
    n = speed.size
    vehicle = np.zeros(n, np.int64) if vehicle is None else vehicle
    begin = np.flatnonzero(np.diff(vehicle, prepend=-1))
    end = np.append(begin[1:], n)
    velocity = speed[:, None] * np.column_stack([np.cos(course), np.sin(course)])
    return Visits(
        vehicle=vehicle, segment=vehicle, position=np.cumsum(STEP_S * velocity, axis=0), course=course, speed=speed,
        begin=begin, end=end, cell=np.full(begin.size, -1), stands=speed[begin] < 0.3, weight=np.ones(begin.size),
        scale=Scale(),
    )  # fmt: skip


def two_habits(rng, *, n_vehicles=60, seconds=20):
    """Vehicles at 10 m/s that now go straight on, now turn left on 50 m, and change as a coin says every second."""
    turns = np.repeat(rng.random((n_vehicles, seconds)) < 0.5, 10, axis=1)
    course = np.cumsum(np.where(turns, 0.02, 0.0), axis=1) + rng.uniform(-np.pi, np.pi, (n_vehicles, 1))
    vehicle = np.repeat(np.arange(n_vehicles), turns.shape[1])
    return visits_of(np.full(vehicle.size, 10.0), course.ravel(), vehicle=vehicle)


def test_groups_tell_who_turns_from_who_does_not():
    columns, follow = learn_chain(two_habits(np.random.default_rng(1)), rng=np.random.default_rng(0))
    moves = columns["start_rate"] == 0
    share, curvature = columns["seconds"][moves], columns["curvature"][moves]
    assert share.sum() == pytest.approx(1.0)
    # Windows of a second are straight, left, or partly; of each habit there is one that is nothing else.
    assert curvature.min() == pytest.approx(0.0, abs=2e-3)
    assert curvature.max() == pytest.approx(0.02, abs=2e-3)
    assert share @ curvature == pytest.approx(0.01, abs=1e-3)
    np.testing.assert_allclose(columns["log_pace"][moves], np.log(10.3), rtol=1e-9)
    # Where habits are independent from second to second, seconds that begin anywhere share on average 1/4 of them:
    # the integral of f (1 - f) by that of f^2 + (1 - f)^2.
    before, after = follow.nonzero()
    count = np.asarray(follow[before, after]).ravel()
    turned = columns["curvature"] - np.average(columns["curvature"][before], weights=count)
    shared = np.average(turned[before] * turned[after], weights=count) / np.average(turned[before] ** 2, weights=count)
    assert shared == pytest.approx(0.25, abs=0.05)
    assert (columns["start_rate"][after] == 0).all()  # none stood


def test_who_brakes_and_who_speeds_up_are_of_different_groups():
    rng = np.random.default_rng(2)
    gained = rng.choice([-1.0, 1.0], 80)
    speed = 10.0 + gained[:, None] * np.arange(0.0, 4.0, STEP_S)
    vehicle = np.repeat(np.arange(80), speed.shape[1])
    columns, _ = learn_chain(
        visits_of(speed.ravel(), np.zeros(vehicle.size), vehicle=vehicle), rng=np.random.default_rng(0)
    )
    moves = columns["start_rate"] == 0
    by_pace = columns["acceleration"][moves, 0] + columns["acceleration"][moves, 3] * (
        np.exp(columns["log_pace"][moves]) - 0.3
    )
    np.testing.assert_allclose(np.abs(by_pace), 1.0, atol=0.05)
    assert {-1.0, 1.0} == set(np.sign(by_pace))


def test_the_share_of_those_that_stand_and_their_start_rate_are_counted():
    speed = np.concatenate([np.zeros(100), np.full(300, 5.0)] * 4)
    vehicle = np.repeat(np.arange(4), 400)
    rows = visits_of(speed, np.zeros(speed.size), vehicle=vehicle)
    begin = np.sort(np.concatenate([rows.begin, rows.begin + 100]))
    visits = replace(
        rows, begin=begin, end=np.append(begin[1:], speed.size), cell=np.full(8, -1), stands=speed[begin] < 0.3
    )
    columns, _ = learn_chain(visits, rng=np.random.default_rng(0))
    assert columns["seconds"][-1] == pytest.approx(0.25)
    assert columns["start_rate"][-1] == pytest.approx(4.1 / 41.0)
    assert (columns["start_rate"][:-1] == 0).all()


def chain(count):
    """Two background manoeuvres, straight and left, that follow each other as counted, and no cell to drive in."""
    nowhere = motion_by_hand([0], course=0.0)
    free = background_manoeuvres(
        share=[0.5, 0.5], log_pace=[2.3, 2.3], log_pace_spread=[1.0, 1.0], acceleration=np.zeros((2, 2)),
        push=[0.0, 0.0], turning=[0.0, 0.0], curvature=[0.0, 1e-6], standing=0.0, start_rate=0.1,
    )  # fmt: skip
    placed = {name: getattr(nowhere, name)[:1] for name in (*FLOATS, "cell", "mode")}
    before, after = np.nonzero(count)
    return replace(
        nowhere, **joined(placed, free), first=np.searchsorted(before + 1, np.arange(5)), following=after + 1,
        count=np.asarray(count, np.float64)[before, after],
    )  # fmt: skip


def test_vehicles_of_no_place_go_over_once_a_second_as_counted():
    """The share that turns after t seconds is that of the chain whose rows are drawn at rate 1/s."""
    count = np.array([[3.0, 1.0], [2.0, 2.0]])
    rate = count / count.sum(axis=1, keepdims=True) - np.eye(2)
    for seconds in (0.5, 2.0):
        found = moved(squares(1, 1, chain(count)), seconds, n=N, place=(500.0, 500.0), step_s=0.02)
        assert (found.manoeuvre > 0).all()
        turning = int((found.manoeuvre == 2).sum())
        # exp(Q t) of two states: what is left of the difference from the stationary share decays at a + b.
        a, b = rate[0, 1], rate[1, 0]
        still = a / (a + b)
        expected = still + (0.5 - still) * np.exp(-(a + b) * seconds)
        assert stats.binomtest(turning, N, expected).pvalue > FALSE_ALARM
        assert stats.binomtest(turning, N, 0.5).pvalue < FALSE_ALARM  # as if none went over
