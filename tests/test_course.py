"""Course and speed are those of the positions: over a window as long as their noise asks for, then a smoother's."""

import logging
import math
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from dirprim_filter.course import (
    HALF_WINDOWS_S,
    MAX_COURSE_ERROR,
    MAX_GAP_S,
    NOISE_SPAN_S,
    STANDING_M,
    STANDING_NOISE,
    motion_of,
)
from dirprim_filter.distributions.angles import difference, wrap
from dirprim_filter.recording.tables import read_named
from dirprim_filter.smoothed_motion import LEAST_ROWS, SmoothedMotion
from dirprim_filter.tracks import Tracks
from oracles import central_differences, filterpy_constant_velocity, nearest_moving, noise_of_neighbours

RADIUS_M, SLIP = 20.0, 0.15
DATA = Path(__file__).resolve().parents[2] / "shared" / "data" / "town03"


def circling(*, speed, noise=0.0, n_vehicles=40, n=100, seed=3):
    """Vehicles on a circle at 10 Hz, whose bodies point `SLIP` inwards: vehicle, time, position, yaw, true course."""
    rng = np.random.default_rng(seed)
    vehicle, step = (part.ravel() for part in np.indices((n_vehicles, n)))
    angle = vehicle + speed * 0.1 * step / RADIUS_M
    position = RADIUS_M * np.stack([np.cos(angle), np.sin(angle)], axis=-1)
    course = wrap(angle + np.pi / 2)
    return vehicle, step * 10**8, position + rng.normal(0.0, noise, position.shape), wrap(course + SLIP), course


def is_inner(time_ns, half_window_s):
    """Where a window reaches to both sides: at the ends it is one-sided, and the course that of its middle."""
    return (time_ns >= half_window_s * 1e9) & (time_ns <= time_ns.max() - half_window_s * 1e9)


@pytest.mark.parametrize(
    ("noise", "speed", "half_window_s", "keeps"),
    [(0.0, 4.0, 0.25, False), (0.05, 8.0, 0.25, False), (0.05, 4.0, 0.5, False), (0.1, 4.0, 1.0, False),
     (0.5, 8.0, None, False), (2.0, 8.0, None, True)],
)  # fmt: skip
def test_the_window_grows_with_the_noise_then_a_smoother_until_the_heading_is_better(
    noise, speed, half_window_s, keeps, caplog
):
    vehicle, time_ns, position, yaw, course = circling(speed=speed, noise=noise)
    found = motion_of(vehicle, time_ns, position, yaw)
    assert (found.half_window_s, found.keeps_heading) == (half_window_s, keeps)
    assert found.noise == pytest.approx(noise, rel=0.05, abs=0.003)  # turning has a third difference too: 2 mm
    assert found.median_speed == pytest.approx(speed, rel=0.03)
    with caplog.at_level(logging.INFO):
        Tracks.from_positions(track_id=vehicle, time_ns=time_ns, position=position, heading=yaw)
    assert ("the body's heading is kept" in caplog.text) == keeps
    assert ("by a smoother" if half_window_s is None else f"over +-{half_window_s:g} s") in caplog.text
    if half_window_s is None:
        derived = motion_of(vehicle, time_ns, position)  # of an unknown yaw the smoother is what there is
        assert not derived.keeps_heading
        wide, span_s = central_differences(vehicle, time_ns, position, half_window_s=1.0, max_gap_s=2.0)
        off, by_differences = (
            np.std(difference(of, course)[is_inner(time_ns, 1.0)])
            for of in (derived.direction, np.arctan2(*wide.T[::-1]))
        )
        assert off < by_differences
        assert np.std(found.speed) < np.std(np.hypot(*wide.T) / span_s)
        np.testing.assert_array_equal(found.direction, yaw if keeps else derived.direction)
    else:
        inner = is_inner(time_ns, half_window_s)
        off = difference(found.direction, course)
        assert np.std(off[inner]) < MAX_COURSE_ERROR * 1.1
        assert abs(off[inner].mean()) < 0.005  # the tangent, and not the yaw
        if noise == 0.0:
            assert np.abs(off[inner]).max() < 0.01
            assert np.abs(off).max() < speed / RADIUS_M * 0.125 + 0.01  # a window to one side is late by half of it
            np.testing.assert_allclose(found.speed[inner], speed, rtol=2e-3)


@settings(max_examples=90, deadline=None)
@given(seed=st.integers(0, 2**32 - 1))
def test_motion_is_that_of_the_slow_oracle_on_irregular_tracks_with_gaps(seed):
    rng = np.random.default_rng(seed)
    n = int(rng.integers(1, 60))
    vehicle = rng.integers(0, 4, n)
    steps = [1_000_000, 20_000_000, 100_000_000, 250_000_000, 400_000_000, 1_000_000_000, 2_000_000_000, 2_000_000_001]
    slow = int(rng.choice([1, 1, 20]))  # of these gaps are longer too
    time_ns = 1_700_000_000_000_000_000 + slow * rng.choice(steps, n).cumsum()
    stands = rng.random() < 0.5
    pace = rng.choice([0.0, 0.02, 5.0], n) if stands else rng.choice([3.0, 9.0], n)
    turn = rng.normal(0, 0.3, n).cumsum()
    position = (pace[:, None] * np.stack([np.cos(turn), np.sin(turn)], axis=-1)).cumsum(axis=0)
    yaw = np.where(rng.random(n) < 0.3, np.nan, rng.uniform(-3, 3, n))
    order = rng.permutation(n)
    of, when, where, yaw = vehicle[order], time_ns[order], position[order], yaw[order]
    found = motion_of(of, when, where, yaw)

    apart = np.concatenate([np.diff(np.sort(when[of == v])) for v in np.unique(of)]) * 1e-9
    gap_s = min(max(3.0 * np.median(apart), MAX_GAP_S), 60.0) if apart.size else MAX_GAP_S
    widest, _ = central_differences(of, when, where, half_window_s=HALF_WINDOWS_S[-1], max_gap_s=gap_s)
    noise = noise_of_neighbours(of, when, where, np.hypot(*widest.T) > STANDING_M, max_span_s=NOISE_SPAN_S)
    if found.half_window_s is None:  # of rows enough for a smoother
        return
    np.testing.assert_allclose(found.noise, noise, rtol=1e-6, atol=1e-9)
    moved, span_s = central_differences(of, when, where, half_window_s=found.half_window_s, max_gap_s=gap_s)
    metres = np.hypot(*moved.T)
    np.testing.assert_allclose(found.speed, np.where(span_s > 0, metres / np.where(span_s > 0, span_s, 1), np.nan))
    if found.keeps_heading:
        return
    moves = metres >= max(STANDING_M, STANDING_NOISE * np.sqrt(2) * noise)
    nearest = nearest_moving(of, when, moves, max_gap_s=gap_s)
    course = np.arctan2(moved[:, 1], moved[:, 0])
    own = np.where(np.isnan(yaw), course, yaw)
    np.testing.assert_allclose(found.direction, wrap(np.where(nearest >= 0, course[nearest], own)), atol=1e-9)


def test_another_vehicle_changes_no_course_and_a_group_is_another_vehicle():
    vehicle, *columns, _ = circling(speed=8.0, n_vehicles=2, n=30)
    shuffled = np.random.default_rng(0).permutation(vehicle.size)
    names = "group", "time_ns", "position", "heading"
    given = {name: of[shuffled] for name, of in zip(names, (vehicle, *columns), strict=True)}
    both = Tracks.from_positions(track_id=np.full(vehicle.size, 7), **given)
    for k in (0, 1):
        own = vehicle == k
        alone = motion_of(vehicle[own], *(column[own] for column in columns))
        np.testing.assert_array_equal(both.direction[both.group == k], alone.direction)
        np.testing.assert_array_equal(both.heading[both.group == k], columns[2][own])


def test_speeds_stay_as_reported_throughout_and_rows_alone_in_time_where_all_is_known():
    vehicle, time_ns, position, yaw, _ = circling(speed=8.0, n_vehicles=2)
    reported = np.where((vehicle == 1) & (time_ns == 10**9), np.nan, 3.0)
    tracks = Tracks.from_positions(track_id=vehicle, time_ns=time_ns, position=position, heading=yaw, speed=reported)
    assert set(tracks.speed[tracks.track_id == 0]) == {3.0}
    np.testing.assert_allclose(tracks.speed[tracks.track_id == 1], 8.0, rtol=2e-3)
    tracks = Tracks.from_positions(
        track_id=["a", "b", "c"], time_ns=[0, 0, 0], position=np.zeros((3, 2)), heading=[1.0, 2.0, np.nan],
        speed=[4.0, np.nan, 4.0],
    )  # fmt: skip
    assert tracks.track_id.tolist() == ["a"]
    assert (tracks.direction.tolist(), tracks.heading.tolist(), tracks.speed.tolist()) == ([1.0], [1.0], [4.0])


@pytest.mark.skipif(not DATA.exists(), reason=f"real data are not at {DATA}")
@pytest.mark.parametrize(("scene", "median", "high"), [("roundabout", 0.038, 0.157), ("intersection", 0.005, 0.105)])
def test_on_the_bends_of_town03_yaw_and_course_differ_as_was_measured(scene, median, high):
    tracks = read_named(DATA / f"{scene}.csv").tracks
    driving = tracks.speed > 1.0
    off = np.abs(difference(tracks.heading, tracks.direction))[driving]
    assert np.quantile(off, [0.5, 0.9]) == pytest.approx([median, high], abs=0.005)
    order = np.lexsort((tracks.time_ns, tracks.vehicle))
    step = np.diff(tracks.position[order], axis=0)
    near = (np.diff(tracks.vehicle[order]) == 0) & (np.hypot(*step.T) > 0.3)
    of_course, of_yaw = (np.quantile(np.abs(difference(np.arctan2(*step.T[::-1]), angle[order][:-1])[near]), 0.9)
                         for angle in (tracks.direction, tracks.heading))  # fmt: skip
    assert of_course < 0.5 * of_yaw


def wandering(*, density, noise, interval_s, n_vehicles=60, n=60, seed=0):
    """Vehicles of white acceleration at irregular times: time, true velocity, measured place, who follows."""
    rng = np.random.default_rng(seed)
    dt = interval_s * rng.uniform(0.5, 1.5, (n_vehicles, n))
    velocity = rng.normal(0.0, 10.0, (n_vehicles, 1, 2)) + np.zeros((n_vehicles, n, 2))
    place = rng.normal(0.0, 500.0, (n_vehicles, 1, 2)) + np.zeros((n_vehicles, n, 2))
    for i in range(1, n):
        h = dt[:, i]
        covariance = density * np.array([[h**3 / 3, h**2 / 2], [h**2 / 2, h]]).transpose(2, 0, 1)
        added = np.linalg.cholesky(covariance) @ rng.standard_normal((n_vehicles, 2, 2))
        place[:, i] = place[:, i - 1] + h[:, None] * velocity[:, i - 1] + added[:, 0]
        velocity[:, i] = velocity[:, i - 1] + added[:, 1]
    measured = place + rng.normal(0.0, noise, place.shape)
    follows = np.tile(np.arange(n) < n - 1, n_vehicles)[:-1]
    return dt.cumsum(axis=1).ravel(), velocity.reshape(-1, 2), measured.reshape(-1, 2), follows


def found_of(time_s, measured, follows):
    return SmoothedMotion.of(time_s, measured, follows, np.ones(time_s.size, np.bool_))


@pytest.mark.parametrize(
    ("density", "noise", "interval_s"), [(1.0, 5.0, 2.0), (0.02, 5.0, 9.0), (4.0, 2.0, 0.1), (1.0, 0.5, 1.0)]
)
def test_noise_and_spread_of_velocities_come_back(density, noise, interval_s):
    off, spreads = [], []
    for seed in range(5):
        law = {"density": density, "noise": noise, "interval_s": interval_s}
        time_s, velocity, measured, follows = wandering(**law, seed=seed)
        found = found_of(time_s, measured, follows)
        assert found.noise == pytest.approx(noise, rel=0.08)  # 7,200 coordinates, some fit the motion: 5 deviations
        inner = np.tile(np.minimum(np.arange(60), np.arange(60)[::-1]) > 15, 60)
        off.append(np.std((found.velocity - velocity)[inner]))
        spreads.append(found.spread)
    assert np.mean(spreads) == pytest.approx(np.mean(off), rel=0.15)  # of steps of one length, without end
    shuffled = np.random.default_rng(0).permutation(time_s.size)  # the negative control: places of other times
    assert found_of(time_s, measured[shuffled], follows).noise > 2.0 * noise


def test_it_is_the_smoother_of_another_package_under_its_own_noise_and_the_density_it_was_made_with():
    density, noise = 1.0, 3.0
    time_s, _, measured, follows = wandering(density=density, noise=noise, interval_s=1.0, n_vehicles=40)
    found = found_of(time_s, measured, follows)
    law = {"density": density, "noise_m": noise, "first_speed_std": 1e3}
    _, (smoothed, _) = filterpy_constant_velocity(measured[:60], time_s[:60], **law)
    off = np.abs(found.velocity[:60] - smoothed[:, 2:])
    assert off.max() < 0.5 * found.spread  # the chosen ratio is not quite that of the making
    assert np.median(off) < 0.1 * found.spread


def test_turned_shifted_and_slower_worlds_have_turned_and_slower_velocities():
    time_s, _, measured, follows = wandering(density=1.0, noise=3.0, interval_s=1.0)
    found = found_of(time_s, measured, follows)
    turn = np.array([[math.cos(1.0), -math.sin(1.0)], [math.sin(1.0), math.cos(1.0)]])
    turned = found_of(time_s, 10.0 * measured @ turn.T + [5e5, -4e6], follows)
    np.testing.assert_allclose(turned.velocity, 10.0 * found.velocity @ turn.T, atol=1e-3)
    slow = found_of(100.0 * time_s, measured, follows)
    np.testing.assert_allclose(100.0 * slow.velocity, found.velocity, atol=1e-6)
    assert (turned.noise, slow.noise) == pytest.approx((10.0 * found.noise, found.noise), rel=1e-6)


def test_exact_positions_have_a_spline_s_velocities_and_of_few_rows_nothing_is_said():
    time_s = np.arange(200.0)
    place = np.column_stack([100.0 * np.sin(0.1 * time_s), 100.0 * np.cos(0.1 * time_s)])
    found = found_of(time_s, place, np.ones(199, np.bool_))
    assert found.noise < 0.05
    np.testing.assert_allclose(np.hypot(*found.velocity[5:-5].T), 10.0, rtol=1e-3)
    few = slice(0, LEAST_ROWS)
    assert found_of(time_s[few], place[few], np.ones(LEAST_ROWS - 1, np.bool_)) is None


def test_rows_of_one_instant_or_nearly_and_rows_alone_are_borne():
    time_s, velocity, measured, follows = wandering(density=1.0, noise=1.0, interval_s=1.0)
    time_s[1::2] = time_s[::2] + 1e-9  # two rows in a nanosecond, over and over
    alone = np.zeros_like(follows)
    alone[: follows.size // 2] = follows[: follows.size // 2]
    found = found_of(time_s, measured, alone)
    assert np.isfinite(found.velocity).all()
    assert np.std((found.velocity - velocity)[: follows.size // 2 - 60]) < 5.0  # of 10: half of the times are wrong
