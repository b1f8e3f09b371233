"""The report of a tracker: what is seen, what is settled, and what is in a gap."""

import numpy as np
import pytest

from dirprim_filter.evaluation.tracked_rows import TrackedRows, names_in_group
from dirprim_filter.evaluation.tracking_report import Scales, TrackingReport
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


def test_errors_in_sight_settled_and_in_gaps_are_those_worked_out_by_hand():
    got = report(rows())
    assert got.rmse == pytest.approx(np.sqrt((OFF**2).mean()))
    assert got.seen_rmse == pytest.approx(np.sqrt((40 * 1 + 10 * 4) / 50))
    assert got.settled_rmse == 1.0  # a second after it appeared, and a second after it was found again
    assert got.hidden_rmse == 3.0
    assert got.gap_rmse == (3.0,)
    assert got.reported == 1.0
    assert np.isnan([got.seen_nees, got.hidden_nees, got.coverage_50, got.coverage_90]).all()


def test_each_vehicle_has_an_error_of_its_own_gap_and_none_where_it_was_not_estimated():
    truth = Tracks(
        track_id=np.repeat(["a", "b", "c"], N), time_ns=np.tile(TIMES, 3), position=np.tile(TRUTH.position, (3, 1)),
        direction=np.zeros(3 * N), speed=np.ones(3 * N),
    )  # fmt: skip
    hidden = np.isin(truth.time_ns, TIMES[HIDDEN]) & (truth.track_id != "c")
    assert report(rows(track_id="b"), truth=truth, is_hidden=hidden).gap_rmse == pytest.approx(
        (np.nan, 3.0), nan_ok=True
    )


def test_where_only_the_tracker_says_so_a_gap_is_what_it_did_not_measure_for_longer_than_a_missed_frame():
    unseen = np.where(HIDDEN, 0.1 * (np.arange(N) - 19), 0.0)
    unseen[50] = 0.1  # missed once
    got = report(rows(unseen_s=unseen), is_hidden=None)
    assert got.hidden_rmse == 3.0
    assert got.seen_rmse == pytest.approx(np.sqrt((40 * 1 + 10 * 4 + 5 * 9) / 55))  # the first half second as well
    assert got.settled_rmse == pytest.approx(np.sqrt((10 * 1 + 20 * 1 + 5 * 9) / 35))
    assert got.gap_rmse == ()
    unknown = report(rows(), is_hidden=None)
    assert unknown.rmse == got.rmse
    assert np.isnan([unknown.seen_rmse, unknown.settled_rmse, unknown.hidden_rmse]).all()


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


def test_ids_of_a_group_are_the_same_with_its_number_and_without():
    names = names_in_group(np.array(["2/a", "a", "3/a", "2/b/c"]), np.array([2, 2, 2, 2]))
    assert names.tolist() == ["a", "a", "3/a", "b/c"]


def test_lengths_are_positive_and_a_truth_has_rows():
    with pytest.raises(ValueError, match="similarity_m: expected a positive distance"):
        TrackingReport.of(rows(), TRUTH, is_hidden=None, with_ids=True, scales=Scales(similarity_m=0.0))
    with pytest.raises(ValueError, match="truth: expected at least one row"):
        report(rows(), is_hidden=None, truth=TRUTH[np.zeros(N, bool)])
    with pytest.raises(ValueError, match="has two rows at 0 ns"):
        TrackedRows(track_id=["a", "a"], time_ns=[0, 0], position=np.zeros((2, 2)))
