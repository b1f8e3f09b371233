"""What pictures of an experiment show, against what is computed by hand."""

import numpy as np
import pytest

from dirprim_filter.evaluation.error_curves import SQUARES, by_place, reliability, rmse
from dirprim_filter.evaluation.scores import RowErrors, TrackedScene, scored
from dirprim_filter.evaluation.tracked_rows import TrackedRows
from situations import tracks_of


def errors(cluster, squared, unseen_s, normalised=None, position=None):
    squared, unseen_s = np.array(squared), np.array(unseen_s)
    known = np.full(squared.shape, np.nan) if normalised is None else np.array(normalised)
    place = np.zeros((squared.size, 2)) if position is None else position
    return RowErrors(np.array(cluster), squared, known, unseen_s > 0, unseen_s, place)


def test_errors_are_of_the_rows_that_were_unseen_so_long_and_intervals_are_over_vehicles_of_all_runs():
    runs = [errors(["a", "a", "b"], [1.0, 9.0, 4.0], [0.0, 1.0, 1.0]), errors(["b", "c"], [np.nan, 16.0], [1.0, 1.0])]
    found = rmse(runs, above_s=0.0, to_s=1.0)
    assert found.value == pytest.approx(np.sqrt((9 + 4 + 16) / 3))
    assert (found.n_clusters, found.low < found.value < found.high) == (3, True)
    assert rmse(runs, above_s=-np.inf, to_s=0.0)[:1] == (1.0,)
    assert np.isnan(rmse(runs, above_s=1.0, to_s=2.0).value)


def test_errors_by_place_are_those_of_the_rows_in_each_square():
    rng = np.random.default_rng(1)
    place, squared = rng.uniform([0.0, 10.0], [60.0, 40.0], (500, 2)), rng.uniform(0.0, 9.0, 500)
    hidden, squared[7] = np.arange(500) % 5, np.nan
    runs = [errors(hidden[at], squared[at], hidden[at] / 9, position=place[at]) for at in (np.s_[:200], np.s_[200:])]
    middles, found = by_place(runs, is_hidden=True)
    known = (hidden > 0) & np.isfinite(squared)
    side = np.ptp(place[known], axis=0).max() / SQUARES
    nearest = np.abs(place[known][:, None] - middles).max(axis=2)  # in the metric whose circles are squares
    assert nearest.min(axis=1).max() <= side * (0.5 + 1e-9)
    own = nearest.argmin(axis=1)
    assert found == pytest.approx([np.sqrt(squared[known][own == i].mean()) for i in range(len(found))])
    assert [len(of) for of in by_place([errors([0], [np.nan], [1.0])], is_hidden=True)] == [0, 0]


def test_a_tracker_that_is_right_is_on_the_diagonal_and_one_that_is_too_sure_below_it():
    square, share = np.random.default_rng(0).chisquare(2, 20_000), np.array([0.1, 0.5, 0.9])
    hidden = np.ones(square.size)
    right, sure = (
        reliability([errors(hidden, square, hidden, of)], share, is_hidden=True) for of in (square, 2 * square)
    )
    assert right == pytest.approx(share, abs=0.015)
    assert (sure < share - 0.03).all()
    assert np.isnan(reliability([errors(hidden, square, hidden)], share, is_hidden=False)).all()


def test_a_vehicle_is_unseen_since_its_last_row_in_sight_and_other_instants_of_a_tracker_are_interpolated():
    """Two vehicles at 10 Hz, the second hidden from its fourth row to its sixth; a tracker that reports each .2 s."""
    truth = tracks_of(np.stack([np.column_stack([np.arange(8.0), np.full(8, 9.0 * i)]) for i in range(2)]),
                      time_ns=np.arange(8) * 10**8, direction=0.0, speed=10.0)  # fmt: skip
    hidden = (truth.track_id == 1) & (truth.time_ns >= 3 * 10**8) & (truth.time_ns <= 5 * 10**8)
    slow = truth[truth.time_ns % (2 * 10**8) == 0]
    rows = TrackedRows(track_id=slow.track_id, time_ns=slow.time_ns, position=slow.position + np.array([0.0, 0.5]))
    report, found = scored([TrackedScene(truth, hidden, rows)], with_ids=True)
    assert found.unseen_s[found.is_hidden] == pytest.approx([0.1, 0.2, 0.3])
    assert not found.unseen_s[~found.is_hidden].any()
    assert report.reported == pytest.approx(14 / 16)  # none after its last row
    assert np.nanmax(found.squared) == pytest.approx(0.25)
