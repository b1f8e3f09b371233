"""The report of a tracker: what is seen, and what is in a gap."""

from dataclasses import replace

import numpy as np
import pytest

from dirprim_filter.evaluation.tracked_rows import TrackedRows
from dirprim_filter.evaluation.tracking_report import Scales, TrackingReport, errors_by_row
from dirprim_filter.tracks import Tracks

STEP_NS = 100_000_000
N = 60
HIDDEN = (np.arange(N) >= 20) & (np.arange(N) < 30)
OFF = np.where(HIDDEN, 3.0, np.where((np.arange(N) >= 30) & (np.arange(N) < 40), 2.0, 1.0))
"""Errors, metres: 1 in sight, 3 in the gap, 2 in the second after it."""
TIMES = np.arange(N) * STEP_NS
TRUTH = Tracks(
    track_id=["v"] * N, time_ns=TIMES, position=np.column_stack([np.arange(N), np.zeros(N)]),
    direction=np.zeros(N), speed=np.full(N, 10.0),
)  # fmt: skip


def rows(*, unseen_s=(), track_id="v"):
    return TrackedRows(
        track_id=[track_id] * N, time_ns=TIMES, position=TRUTH.position + OFF[:, None] * [0.0, 1.0], unseen_s=unseen_s
    )


def report(of, *, is_hidden=HIDDEN, with_ids=True, truth=TRUTH):
    return TrackingReport.of(of, truth, is_hidden=is_hidden, with_ids=with_ids, scales=Scales())


def test_errors_in_sight_and_in_gaps_are_those_worked_out_by_hand():
    got = report(rows())
    assert got.rmse == pytest.approx(np.sqrt((OFF**2).mean()))
    assert got.seen_rmse == pytest.approx(np.sqrt((40 * 1 + 10 * 4) / 50))
    assert got.hidden_rmse == 3.0
    assert got.reported == 1.0
    assert np.isnan([got.seen_nees, got.hidden_nees, got.coverage_90]).all()


def test_where_only_the_tracker_says_so_a_gap_is_what_it_did_not_measure_for_longer_than_a_missed_frame():
    unseen = np.where(HIDDEN, 0.1 * (np.arange(N) - 19), 0.0)
    unseen[50] = 0.1  # missed once
    got = report(rows(unseen_s=unseen), is_hidden=None)
    assert got.hidden_rmse == 3.0
    assert got.seen_rmse == pytest.approx(np.sqrt((40 * 1 + 10 * 4 + 5 * 9) / 55))  # the first half second as well
    unknown = report(rows(), is_hidden=None)
    assert unknown.rmse == got.rmse
    assert np.isnan([unknown.seen_rmse, unknown.hidden_rmse]).all()


TWO = Tracks(
    track_id=["a", "b", "a", "b"], time_ns=[0, 0, 10, 10], position=[[0, 0], [100, 0], [1, 0], [100, 0]],
    direction=[0.0, np.pi, 0.0, -3.0], speed=[10.0, 0.4, 10.0, 6.0],
)  # fmt: skip


def tracked(names, time_ns, position, **known):
    return TrackedRows(track_id=names, time_ns=time_ns, position=position, **known)


def isotropic(*variance):
    return np.array(variance)[:, None, None] * np.eye(2)


def test_errors_of_motion_and_nees_are_those_worked_out_by_hand():
    found = tracked(
        ["b", "a", "b"], [10, 0, 0], [[100.0, 2.0], [3.0, 4.0], [100.0, 0.0]], direction=[3.0, 0.2, 0.0],
        speed=[6.0, 13.0, 4.4], covariance=isotropic(4.0, 5.0, 1.0),
    )  # fmt: skip
    got = report(found, is_hidden=None, truth=TWO)
    assert got.reported == 0.75
    assert got.rmse == pytest.approx(np.sqrt((4 + 25 + 0) / 3))
    # b stands at 0 ns, so its course does not count; at 10 ns it turns across the wrap
    assert got.direction_rmse == pytest.approx(np.sqrt(((2 * np.pi - 6.0) ** 2 + 0.2**2) / 2))
    assert got.speed_rmse == pytest.approx(np.sqrt((0 + 9 + 16) / 3))
    assert got.nees == pytest.approx((4 / 4 + 25 / 5 + 0) / 3)
    standing = report(found[[2]], is_hidden=None, truth=TWO)
    assert (standing.rmse, np.isnan(standing.direction_rmse)) == (0.0, True)


def test_what_is_unknown_of_some_rows_does_not_count():
    nan = np.nan
    some = tracked(
        ["a", "a", "b"], [0, 10, 10], [[0, 1], [1, 3], [100, 0]], direction=[0.3, nan, nan], speed=[nan, 11.0, nan]
    )
    got = report(some, is_hidden=None, truth=TWO)
    assert (got.direction_rmse, got.speed_rmse) == (pytest.approx(0.3), 1.0)
    assert np.isnan(got.nees)


def test_nees_weighs_by_the_whole_covariance():
    skewed = tracked(["a"], [0], [[1.0, 1.0]], covariance=[[[2.0, 1.0], [1.0, 2.0]]])
    got = report(skewed, is_hidden=None, truth=TWO)
    assert got.nees == pytest.approx(2 / 3)  # (1, 1) lies along the axis of variance 3


def test_rows_without_a_truth_have_no_error_and_ids_are_the_same_as_number_and_text():
    sure = tracked(["a"], [0], [[0.0, 1.0]])
    stray = tracked(["a", "a", "c", "b"], [0, 5, 0, 11], [[0.0, 1.0], *np.full((3, 2), 1e6)])
    of_both = (report(of, is_hidden=None, truth=TWO) for of in (sure, stray))
    assert [(of.rmse, of.reported) for of in of_both] == [(1.0, 0.25)] * 2
    numbered = Tracks(track_id=[7], time_ns=[0], position=[[0, 0]], direction=[0], speed=[1])
    for names in (["7"], ["7", "x"], [7], ["0/7"]):
        found = tracked(names, [0] * len(names), [[0.0, 3.0], [0.0, 0.0]][: len(names)])
        got = report(found, is_hidden=None, truth=numbered)
        assert (got.rmse, got.reported) == (3.0, 1.0)


def test_a_filter_that_tells_the_truth_of_its_errors_has_a_nees_of_two():
    rng = np.random.default_rng(0)
    n = 20_000
    truth = Tracks(
        track_id=np.arange(n), time_ns=np.arange(n), position=np.zeros((n, 2)), direction=np.zeros(n), speed=np.ones(n)
    )
    found = tracked(np.arange(n), np.arange(n), rng.normal(0, 0.5, (n, 2)), covariance=isotropic(*np.full(n, 0.25)))
    five_errors = 5 * 2 / np.sqrt(n)  # chi squared of 2 degrees deviates by 2
    assert report(found, is_hidden=None, truth=truth).nees == pytest.approx(2.0, abs=five_errors)
    boasting = replace(found, covariance=0.8 * found.covariance)
    assert report(boasting, is_hidden=None, truth=truth).nees > 2.0 + five_errors


@pytest.mark.parametrize("with_ids", [True, False])
def test_errors_by_row_are_those_of_a_slow_loop_and_add_to_the_report(with_ids):
    rng = np.random.default_rng(1)
    truth = Tracks(
        track_id=np.tile(np.repeat(["a", "b", "c"], N), 2), time_ns=np.tile(TIMES, 6), group=np.repeat([0, 4], 3 * N),
        position=np.concatenate([TRUTH.position + np.array([0.0, 20.0 * k]) for k in range(3)] * 2),
        direction=np.zeros(6 * N), speed=np.ones(6 * N),
    )  # fmt: skip
    hidden = rng.random(6 * N) < 0.3
    kept = (rng.random(6 * N) < 0.8) & ~((truth.track_id == "b") & (truth.group == 4))
    rows = tracked(
        truth.track_id[kept], truth.time_ns[kept], truth.position[kept] + rng.normal(0, 0.5, (kept.sum(), 2)),
        group=truth.group[kept],
    )  # fmt: skip
    squared, normalised = errors_by_row(rows, truth, with_ids=with_ids, scales=Scales())
    assert np.isnan(squared[~kept]).all()
    assert np.isnan(normalised).all()  # no covariance is stated
    off = rows.position - truth.position[kept]
    assert squared[kept] == pytest.approx([x * x + y * y for x, y in off.tolist()])
    whole = report(rows, truth=truth, is_hidden=hidden, with_ids=with_ids)
    expected = [np.sqrt(squared[kept & (hidden == is_hidden)].mean()) for is_hidden in (False, True)]
    assert [whole.seen_rmse, whole.hidden_rmse] == pytest.approx(expected)


def test_gospa_and_its_parts_are_per_vehicle_whatever_the_number_of_instants():
    got = report(rows())
    assert got.gospa**2 == pytest.approx(got.localisation + got.missed + got.false)
    assert got.localisation == pytest.approx((OFF**2).mean())
    half = report(rows()[np.arange(0, N, 2)])
    assert half.missed == pytest.approx(0.5 * 12.5)
    assert half.reported == 0.5


def test_names_that_a_tracker_makes_up_mean_nothing_without_ids():
    other = Tracks(
        track_id=np.repeat(["v", "track-7"], N), time_ns=np.tile(TIMES, 2), direction=np.zeros(2 * N),
        position=np.concatenate([TRUTH.position, TRUTH.position + np.array([0.0, 80.0])]), speed=np.full(2 * N, 10.0),
    )  # fmt: skip
    assert report(rows(track_id="track-7"), is_hidden=None, with_ids=False, truth=other).rmse < 2.0
    assert report(rows(track_id="track-7"), is_hidden=None, with_ids=True, truth=other).rmse > 70.0


def test_lengths_are_positive_and_a_truth_has_rows():
    with pytest.raises(ValueError, match="similarity_m: expected a positive distance"):
        TrackingReport.of(rows(), TRUTH, is_hidden=None, with_ids=True, scales=Scales(similarity_m=0.0))
    with pytest.raises(ValueError, match="truth: expected at least one row"):
        report(rows(), is_hidden=None, truth=TRUTH[np.zeros(N, bool)])
    with pytest.raises(ValueError, match="has two rows at 0 ns"):
        TrackedRows(track_id=["a", "a"], time_ns=[0, 0], position=np.zeros((2, 2)))
