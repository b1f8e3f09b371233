"""The report of a tracker beside a slow loop over its rows: in sight, in gaps, of motion, of covariances."""

from dataclasses import replace

import numpy as np
import pytest

from dirprim_filter.evaluation.tracked_rows import TrackedRows
from dirprim_filter.evaluation.tracking_report import report_of
from dirprim_filter.tracks import Tracks
from situations import tracks_of

N = 40


def lane(name, north, *, group=0):
    """A vehicle that drives east at 10 m/s, and stands in its first five rows as far as its speed says."""
    way, speed = np.column_stack([np.arange(N), np.full(N, north)]), np.where(np.arange(N) < 5, 0.4, 10.0)
    return tracks_of([way], track_id=name, direction=3.1, speed=speed, group=group)


TRUTH = Tracks.concatenate([lane(name, 20.0 * k, group=g) for g in (0, 4) for k, name in enumerate("abc")])
HIDDEN = np.random.default_rng(0).random(len(TRUTH)) < 0.3


def tracked(seed):
    """Most rows of the truth, with errors across the wrap; some are of no vehicle, some lack this or that."""
    rng = np.random.default_rng(seed)
    row = np.flatnonzero((rng.random(len(TRUTH)) < 0.8) & ~((TRUTH.track_id == "b") & (TRUTH.group == 4)))
    n = row.size
    root = rng.normal(size=(n, 2, 2))
    covariance = root @ np.swapaxes(root, 1, 2) + 0.2 * np.eye(2)
    direction, speed = TRUTH.direction[row] + rng.normal(0, 0.1, n), TRUTH.speed[row] + rng.normal(0, 1.0, n)
    for unknown in (covariance, direction, speed):
        unknown[rng.random(n) < 0.2] = np.nan
    names = np.where(rng.random(n) < 0.1, np.char.add("none ", np.arange(n).astype(str)), TRUTH.track_id[row])
    return TrackedRows(
        track_id=names, time_ns=TRUTH.time_ns[row], group=TRUTH.group[row], covariance=covariance,
        position=TRUTH.position[row] + rng.normal(0, 0.5, (n, 2)), direction=direction, speed=speed,
        unseen_s=rng.choice([0.0, 0.1, 0.5, 0.6, np.nan], n),
    )  # fmt: skip


def slowly(rows, truth, is_hidden):
    """Each row of the truth by itself."""
    own = {(g, i, t): k for k, (g, i, t) in enumerate(zip(rows.group, rows.track_id, rows.time_ns, strict=True))}
    lists = {name: [] for name in ("rmse", "seen_rmse", "hidden_rmse", "direction_rmse", "speed_rmse", "nees")}
    lists |= {name: [] for name in ("seen_nees", "hidden_nees", "coverage_90", "hidden_coverage_90")}
    by_row, n_found = np.full((2, len(truth)), np.nan), 0
    for i in range(len(truth)):
        k = own.get((truth.group[i], truth.track_id[i], truth.time_ns[i]))
        if k is None:
            continue
        n_found += 1
        hidden = rows.unseen_s[k] > 0.5 if is_hidden is None else is_hidden[i]
        seen = rows.unseen_s[k] <= 0.5 if is_hidden is None else not is_hidden[i]
        where = [""] + ["seen_"] * bool(seen) + ["hidden_"] * bool(hidden)
        off = rows.position[k] - truth.position[i]
        by_row[0, i] = off @ off
        for prefix in where:
            lists[f"{prefix}rmse"].append(off @ off)
        if np.isfinite(rows.covariance[k]).all():
            by_row[1, i] = off @ np.linalg.solve(rows.covariance[k], off)
            for prefix in where:
                lists[f"{prefix}nees"].append(by_row[1, i])
                if prefix != "seen_":
                    lists[f"{prefix}coverage_90"].append(by_row[1, i] <= -2.0 * np.log(0.1))
        if np.isfinite(rows.direction[k]) and truth.speed[i] >= 0.5:
            lists["direction_rmse"].append(np.angle(np.exp(1j * (rows.direction[k] - truth.direction[i]))) ** 2)
        if np.isfinite(rows.speed[k]):
            lists["speed_rmse"].append((rows.speed[k] - truth.speed[i]) ** 2)
    figures = {name: np.mean(of) if of else np.nan for name, of in lists.items()}
    figures = {name: np.sqrt(of) if name.endswith("rmse") else of for name, of in figures.items()}
    return figures | {"reported": n_found / len(truth)}, by_row


def report(of, *, is_hidden=None, with_ids=True, truth=TRUTH):
    return report_of(of, truth, is_hidden=is_hidden, with_ids=with_ids).report


@pytest.mark.parametrize("is_hidden", [None, HIDDEN], ids=["as the tracker says", "as is known"])
@pytest.mark.parametrize("seed", range(3))
def test_errors_are_those_of_a_slow_loop_over_the_rows_of_the_same_name(seed, is_hidden):
    rows = tracked(seed)
    expected, by_row = slowly(rows, TRUTH, is_hidden)
    found, errors = report_of(rows, TRUTH, is_hidden=is_hidden, with_ids=True)
    assert {name: getattr(found, name) for name in expected} == pytest.approx(expected, rel=1e-9)
    np.testing.assert_allclose(errors, by_row, rtol=1e-9)
    unknown = report(replace(rows, unseen_s=(), covariance=()), is_hidden=None)
    assert np.isnan([unknown.seen_rmse, unknown.hidden_rmse, unknown.nees, unknown.coverage_90]).all()


def test_a_filter_that_states_the_truth_of_its_errors_has_a_nees_of_two():
    rng = np.random.default_rng(0)
    n = 20_000
    truth = tracks_of(np.zeros((n, 1, 2)), time_ns=np.arange(n)[:, None])
    found = TrackedRows(
        track_id=np.arange(n), time_ns=np.arange(n), position=rng.normal(0, 0.5, (n, 2)),
        covariance=np.tile(0.25 * np.eye(2), (n, 1, 1)),
    )  # fmt: skip
    five_errors = 5 * 2 / np.sqrt(n)  # chi squared of 2 degrees deviates by 2
    assert report(found, truth=truth).nees == pytest.approx(2.0, abs=five_errors)
    boasting = replace(found, covariance=0.8 * found.covariance)
    assert report(boasting, truth=truth).nees > 2.0 + five_errors


def test_gospa_and_its_parts_are_per_vehicle_whatever_the_number_of_instants():
    rows = TrackedRows(track_id=TRUTH.track_id, time_ns=TRUTH.time_ns, group=TRUTH.group, position=TRUTH.position + 0.6)
    whole, half = report(rows), report(rows[np.arange(0, len(TRUTH), 2)])
    assert whole.gospa**2 == pytest.approx(whole.localisation + whole.missed + whole.false)
    assert (whole.localisation, whole.missed) == pytest.approx((0.72, 0.0))
    assert (half.missed, half.reported) == pytest.approx((0.5 * 12.5, 0.5))


def test_lengths_are_positive_and_a_truth_has_rows():
    rows = tracked(0)
    with pytest.raises(ValueError, match="similarity_m: expected a positive distance"):
        report_of(rows, TRUTH, with_ids=True, similarity_m=0.0)
    with pytest.raises(ValueError, match="truth: expected at least one row"):
        report(rows, truth=TRUTH[np.zeros(len(TRUTH), bool)])
    with pytest.raises(ValueError, match="has two rows at 0 ns"):
        TrackedRows(track_id=["a", "a"], time_ns=[0, 0], position=np.zeros((2, 2)))
