"""Scores against numbers worked out by hand."""

import numpy as np
import pytest

from dirprim_filter.estimates import Estimates
from dirprim_filter.evaluation.tracking import score
from dirprim_filter.tracks import Tracks


def estimates(names, time_ns, position, *, direction=0.0, speed=10.0, variance=1.0):
    n = len(names)
    return Estimates(
        track_id=names, time_ns=time_ns, position=position,
        covariance=np.broadcast_to(variance, (n, 1, 1)) * np.eye(2), direction=np.broadcast_to(direction, n),
        direction_resultant=np.ones(n), speed=np.broadcast_to(speed, n), speed_std=np.ones(n),
        effective_sample_size=np.ones(n), log_evidence=np.zeros(n),
    )  # fmt: skip


TRUTH = Tracks(
    track_id=["a", "b", "a", "b"], time_ns=[0, 0, 10, 10], position=[[0, 0], [100, 0], [1, 0], [100, 0]],
    direction=[0.0, np.pi, 0.0, -3.0], speed=[10.0, 0.4, 10.0, 6.0],
)  # fmt: skip


def test_scores_are_those_worked_out_by_hand():
    found = estimates(
        ["b", "a", "b"], [10, 0, 0], [[100.0, 2.0], [3.0, 4.0], [100.0, 0.0]],
        direction=[3.0, 0.2, 0.0], speed=[6.0, 13.0, 4.4], variance=np.array([4.0, 5.0, 1.0])[:, None, None],
    )  # fmt: skip
    got = score(found, TRUTH)
    assert (got.n_rows, got.n_vehicles) == (3, 2)
    assert got.position_rmse == pytest.approx(np.sqrt((4 + 25 + 0) / 3))
    # b stands at 0 ns, so its course does not count; at 10 ns it turns across the wrap
    assert got.direction_rmse == pytest.approx(np.sqrt(((2 * np.pi - 6.0) ** 2 + 0.2**2) / 2))
    assert got.speed_rmse == pytest.approx(np.sqrt((0 + 9 + 16) / 3))
    assert got.nees == pytest.approx((4 / 4 + 25 / 5 + 0) / 3)


def test_nees_weighs_by_the_whole_covariance():
    found = estimates(["a"], [0], [[1.0, 1.0]])
    skewed = type(found)(
        **{name: getattr(found, name) for name in found.__dataclass_fields__}
        | {"covariance": [[[2.0, 1.0], [1.0, 2.0]]]}
    )
    assert score(skewed, TRUTH).nees == pytest.approx(2 / 3)  # (1, 1) lies along the axis of variance 3


def test_rows_without_a_truth_do_not_count_and_ids_are_the_same_as_number_and_text():
    sure = estimates(["a"], [0], [[0.0, 1.0]])
    stray = estimates(["a", "c", "b"], [5, 0, 11], np.full((3, 2), 1e6))
    assert score(Estimates.concatenate([stray, sure]), TRUTH) == score(sure, TRUTH)
    numbered = Tracks(track_id=[7], time_ns=[0], position=[[0, 0]], direction=[0], speed=[1])
    assert score(estimates(["7"], [0], [[0.0, 3.0]]), numbered).position_rmse == 3.0
    among_names = estimates(["7", "x"], [0, 0], [[0.0, 3.0], [0.0, 0.0]])
    assert score(among_names, numbered).n_rows == 1


def test_of_standing_vehicles_the_direction_has_no_score():
    got = score(estimates(["b"], [0], [[100.0, 0.0]]), TRUTH)
    assert np.isnan(got.direction_rmse)
    assert got.position_rmse == 0


@pytest.mark.parametrize("found", [estimates(["z"], [0], [[0.0, 0.0]]), Estimates.concatenate([])])
def test_no_estimate_with_a_truth_is_refused(found):
    with pytest.raises(ValueError, match="estimates: expected rows of vehicles and times that the truth holds"):
        score(found, TRUTH)


def test_a_filter_that_tells_the_truth_of_its_errors_has_a_nees_of_two():
    rng = np.random.default_rng(0)
    n = 20_000
    truth = Tracks(track_id=np.arange(n), time_ns=np.zeros(n, int), position=np.zeros((n, 2)),
                   direction=np.zeros(n), speed=np.ones(n))  # fmt: skip
    found = estimates(np.arange(n), np.zeros(n, int), rng.normal(0, 0.5, (n, 2)), variance=0.25)
    five_errors = 5 * 2 / np.sqrt(n)  # chi squared of 2 degrees deviates by 2
    assert score(found, truth).nees == pytest.approx(2.0, abs=five_errors)
    boasting = estimates(np.arange(n), np.zeros(n, int), found.position, variance=0.2)
    assert score(boasting, truth).nees > 2.0 + five_errors
