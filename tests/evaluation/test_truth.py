"""A tracker against the truth: at instants of its own, row by row beside a slow loop, and by place and time unseen."""

from dataclasses import replace

import numpy as np
import pytest

from dirprim_filter.distributions.angles import wrap
from dirprim_filter.evaluation.error_curves import SQUARES, by_place, reliability, rmse
from dirprim_filter.evaluation.scores import RowErrors, TrackedScene, score_rows, scored
from dirprim_filter.evaluation.tracked_rows import TrackedRows
from dirprim_filter.evaluation.tracking_report import report_of
from dirprim_filter.evaluation.truth import interpolated, judged_rows, judged_truth, known_at
from dirprim_filter.tracks import Tracks
from situations import estimates_of, tracks_of

STEP_NS = 100_000_000
N_VEHICLES, N = 6, 80
FIGURES = ("hota", "mota", "rmse", "direction_rmse", "speed_rmse", "reported", "idf1")


def where(vehicle, seconds):
    """Position, direction and speed of vehicles that drive in circles of their own, some 25 m apart."""
    pace, radius = 6.0 + vehicle, 12.0 + vehicle
    angle = vehicle + pace / radius * seconds
    center = np.column_stack([40.0 * (vehicle % 3), 40.0 * (vehicle // 3)])
    around = np.column_stack([np.cos(angle), np.sin(angle)])
    return center + radius[:, None] * around, wrap(angle + 0.5 * np.pi), pace


def truth_of(offset_ns=0):
    """Rows at 10 Hz of each vehicle, by clocks with offsets (N_VEHICLES,)."""
    vehicle = np.repeat(np.arange(N_VEHICLES), N)
    offset = np.broadcast_to(np.asarray(offset_ns, np.int64), N_VEHICLES)
    time_ns = np.tile(np.arange(N) * STEP_NS, N_VEHICLES) + offset[vehicle]
    position, direction, speed = where(vehicle, time_ns * 1e-9)
    return Tracks(track_id=vehicle, time_ns=time_ns, position=position, direction=direction, speed=speed)


def tracked_at(time_ns):
    """All vehicles at times within the truth, as a tracker says: errs by its own sines, loses one, swaps two."""
    vehicle, when = np.repeat(np.arange(N_VEHICLES), len(time_ns)), np.tile(time_ns, N_VEHICLES)
    seconds = when * 1e-9
    position, direction, speed = where(vehicle, seconds)
    off = 0.6 * np.column_stack([np.sin(seconds + vehicle), np.cos(1.7 * seconds - vehicle)])
    name = np.where((seconds > 4.0) & (vehicle < 2), 1 - vehicle, vehicle)
    rows = TrackedRows(
        track_id=name, time_ns=when, position=position + off, direction=wrap(direction + 0.1 * np.sin(seconds)),
        speed=speed + 0.5,
    )  # fmt: skip
    return rows[(vehicle != 4) | (seconds < 3.0) | (seconds > 5.0)]


def table_of(rows, truth, **others):
    return score_rows({"it": rows} | others, truth, with_ids=False)


def figures(found):
    return np.array([getattr(found, name) for name in FIGURES])


@pytest.mark.parametrize("seed", range(3))
def test_clocks_of_vehicles_change_no_figure(seed):
    """Neither where the tracker follows the asynchronous rows, nor in frames between them; row by row all is wrong."""
    frames = np.arange(N) * STEP_NS
    synchronous = table_of(tracked_at(frames), truth_of()).scores[0].report
    truth = truth_of(np.random.default_rng(seed).integers(-STEP_NS, STEP_NS, N_VEHICLES))
    rows = tracked_at(np.unique(truth.time_ns))
    for found in (table_of(rows, truth), table_of(tracked_at(frames), truth)):
        assert found.n_interpolated > 0.7 * found.n_rows
        np.testing.assert_allclose(figures(found.scores[0].report), figures(synchronous), atol=0.02)
        assert found.scores[0].report.switches == synchronous.switches
    naive = report_of(rows, truth, with_ids=False).report
    assert naive.mota < -1.0 < 0.5 < synchronous.mota
    assert naive.hota < 0.6 * synchronous.hota


def test_frames_are_judged_as_they_are_to_the_last_digit():
    """With misses, and with a vehicle that is away for long: a missing estimate is a miss."""
    truth = truth_of()
    truth = truth[(truth.track_id != 2) | (truth.time_ns < 2e9) | (truth.time_ns > 4e9)]
    assert judged_truth(truth).tracks is truth
    rows = tracked_at(np.unique(truth.time_ns))
    rows = rows[np.random.default_rng(0).random(len(rows)) > 0.3]
    table = table_of(rows, truth)
    assert repr(table.scores[0].report) == repr(report_of(rows, truth, with_ids=False).report)  # NaN as well
    assert (table.n_interpolated, table.n_instants) == (0, N)
    assert (table.scores[0].n_interpolated, table.scores[0].left_out) == (0, 0)
    assert table.scores[0].report.reported < 0.72


def of_one(times_s, *, group=0, track_id="a"):
    times_s = np.asarray(times_s, np.float64)
    place, time_ns = np.column_stack([10.0 * times_s, -times_s]), (times_s * 1e9).astype(np.int64)
    return tracks_of([place], track_id=track_id, time_ns=time_ns, group=group, speed=2.0 * times_s)


@pytest.mark.parametrize(
    ("times_s", "longest_s", "known_s"),
    [
        ([0.0, 0.1, 0.2, 0.3, 1.3, 2.4], 1.0, [0.05, 0.2, 0.7, 1.2]),  # a second is bridged, 1.1 s are not
        ([0.0, 2.0, 4.0, 6.0, 11.0, 16.1], 5.0, [0.05, 0.2, 0.7, 1.2, 2.0, 8.0]),  # nor are 5.1 s, but 5 s
        ([3.0], 1.0, []),
    ],
)
def test_between_rows_too_far_apart_there_is_no_truth_and_beyond_them_neither(times_s, longest_s, known_s):
    truth, asked_ns = of_one(times_s), np.rint(np.multiply([-0.1, 0.05, 0.2, 0.7, 1.2, 2.0, 8.0, 14.05, 14.2], 1e9))
    assert judged_truth(truth).longest_gap_s == pytest.approx(longest_s)
    group, asked_ns = np.zeros(asked_ns.size, np.int64), asked_ns.astype(np.int64)
    instant, before, after = known_at(truth, group, asked_ns, longest_gap_s=longest_s)
    order = np.argsort(instant)
    got = interpolated(truth, before[order], after[order], asked_ns[instant[order]])
    np.testing.assert_allclose(got.time_ns * 1e-9, known_s)
    np.testing.assert_allclose(got.position[:, 0], 10.0 * np.array(known_s), atol=1e-9)
    np.testing.assert_allclose(got.speed, 2.0 * np.array(known_s), atol=1e-9)


def test_groups_know_nothing_of_each_others_instants():
    """One group is in frames, the other is not."""
    one = of_one(np.arange(10) / 4, group=1)
    others = [of_one(np.arange(10) / 4 + offset, group=2, track_id=name) for offset, name in ((0.0, "a"), (0.125, "b"))]
    judged = judged_truth(Tracks.concatenate([one, *others]))
    assert np.bincount(judged.tracks.group).tolist() == [0, 10, 20 + 18]  # of each other's 10 instants 9 are within


def row_of(times_s, direction, **columns):
    times_s = np.asarray(times_s, np.float64)
    return TrackedRows(
        track_id=np.full(times_s.size, "t"), time_ns=np.rint(times_s * 1e9).astype(np.int64), direction=direction,
        position=np.column_stack([10.0 * times_s, -times_s]), **columns,
    )  # fmt: skip


def test_rows_of_a_tracker_are_interpolated_within_its_own_interval():
    """Direction turns the shorter way round; a covariance is the mean of both; 0.5 s without a row are a silence."""
    covariance = np.multiply.outer([1.0, 3.0, 3.0, 3.0, 5.0, 5.0], np.eye(2))
    rows = row_of([0.0, 0.2, 0.4, 0.6, 1.1, 1.3], [3.0, -3.0, 3.0, 3.0, 0.0, 0.0], covariance=covariance)
    found, n_interpolated, left_out, beyond = judged_rows(rows, judged_truth(of_one(np.arange(13) / 10)).tracks)
    np.testing.assert_allclose(found.time_ns * 1e-9, [0.0, 0.1, 0.2, 0.3, 0.4, 0.5, 0.6, 1.1, 1.2])
    np.testing.assert_allclose(found.position[:, 0], found.time_ns * 1e-8)
    np.testing.assert_allclose(found.direction[:4], [3.0, np.pi, -3.0, np.pi])
    np.testing.assert_allclose(found.covariance[[0, 1, 2, 8]], np.multiply.outer([1.0, 2.0, 3.0, 5.0], np.eye(2)))
    assert (n_interpolated, left_out, beyond) == (4, 1, 0)
    assert judged_rows(rows[2:4], of_one(np.arange(13) / 10)).beyond == 10


@pytest.mark.parametrize("late_s", [-0.4, 0.0, 0.15])
def test_the_delay_that_errors_come_of_is_found(late_s):
    """Beside errors of half a metre of their own."""
    truth, rng = truth_of(), np.random.default_rng(0)
    place, _, _ = where(truth.vehicle, truth.time_ns * 1e-9 - late_s)
    off = rng.normal(0.0, 0.5, place.shape)
    rows = TrackedRows(track_id=truth.track_id, time_ns=truth.time_ns, position=place + off)
    found = report_of(rows, truth, with_ids=True)
    assert found.late_s == pytest.approx(late_s, abs=0.02)
    assert (found.late_share > 0.5) == (late_s != 0.0)


def test_times_that_were_rounded_are_those_of_the_truth():
    truth = of_one(np.arange(31) / 30)
    found, n_interpolated, left_out, _ = judged_rows(row_of(np.round(np.arange(31) / 30, 3), np.zeros(31)), truth)
    assert (found.time_ns.tolist(), n_interpolated, left_out) == (truth.time_ns.tolist(), 0, 0)


@pytest.mark.parametrize("step_ms", [100, 200, 400])
@pytest.mark.parametrize("phase_ms", [0, 30, 50])
def test_a_tracker_is_judged_alone_whatever_its_clock_and_who_stands_beside_it(step_ms, phase_ms):
    """Its rate costs it nothing but the ends of its tracks; what it leaves out does."""
    truth = truth_of()
    others = {"fast": tracked_at(np.arange(7, 600) * 13_000_000), "same": tracked_at(np.arange(N) * STEP_NS)}
    times_ns = np.arange(phase_ms, 7901, step_ms) * 1_000_000
    rows = tracked_at(times_ns)
    alone, beside = (table_of(rows, truth, **more) for more in ({}, others))
    assert repr(alone.scores[0]) == repr(beside.scores[0])
    assert alone.n_rows == beside.n_rows == len(truth)
    every = beside.scores[2].report
    lost = 2 * -(-max(step_ms, phase_ms) // 100) / N  # at most at both ends
    np.testing.assert_allclose(figures(alone.scores[0].report), figures(every), atol=0.03 + 1.5 * lost)
    silent = rows[np.random.default_rng(0).random(times_ns.size * N_VEHICLES)[: len(rows)] > 0.3]
    report = table_of(silent, truth).scores[0].report
    assert report.reported < alone.scores[0].report.reported - 0.2
    assert report.hota < alone.scores[0].report.hota - 0.07


def test_an_interpolated_row_is_hidden_where_both_its_neighbours_are_and_unseen_since_the_last_in_sight():
    truth = Tracks.concatenate([of_one(np.arange(6) / 4), of_one(np.arange(6) / 4 + 0.125, track_id="b")])
    hidden = (truth.track_id == "a") & (truth.time_ns >= 500_000_000) & (truth.time_ns <= 750_000_000)
    judged = judged_truth(truth)
    is_hidden = judged.both(hidden)
    assert (judged.tracks.time_ns[is_hidden] * 1e-9).tolist() == [0.5, 0.625, 0.75]
    assert set(judged.tracks.track_id[is_hidden]) == {"a"}
    off = np.where(is_hidden, 3.0, 1.0)[:, None] * [0.0, 1.0]
    estimates = estimates_of(
        judged.tracks.track_id, time_ns=judged.tracks.time_ns, direction=judged.tracks.direction,
        position=judged.tracks.position + off,
    )  # fmt: skip
    got, found = scored([TrackedScene(truth, hidden, TrackedRows.of(estimates))], with_ids=True)
    assert (got.reported, got.interpolated) == (1.0, pytest.approx(10 / 22))
    assert (got.seen_rmse, got.hidden_rmse) == pytest.approx((1.0, 3.0))
    assert set(found.cluster) == {"a", "b"}
    assert found.squared == pytest.approx(np.where(is_hidden, 9.0, 1.0))
    np.testing.assert_array_equal(found.is_hidden, is_hidden)
    np.testing.assert_allclose(found.unseen_s[is_hidden], [0.125, 0.25, 0.375])
    assert not found.unseen_s[~is_hidden].any()
    slow = TrackedRows.of(estimates)[judged.tracks.time_ns % 250_000_000 == 0]
    assert scored([TrackedScene(truth, hidden, slow)], with_ids=True)[0].reported == pytest.approx(20 / 22)


N_ROWS = 40


def lane(name, north, *, group=0):
    """A vehicle that drives east at 10 m/s, and stands in its first five rows as far as its speed says."""
    east = np.arange(N_ROWS)
    way, speed = np.column_stack([east, np.full(N_ROWS, north)]), np.where(east < 5, 0.4, 10.0)
    return tracks_of([way], track_id=name, direction=3.1, speed=speed, group=group)


LANES = Tracks.concatenate([lane(name, 20.0 * k, group=g) for g in (0, 4) for k, name in enumerate("abc")])
HIDDEN = np.random.default_rng(0).random(len(LANES)) < 0.3


def tracked_on(seed):
    """Most rows of the truth, with errors across the wrap; some are of no vehicle, some lack this or that."""
    rng = np.random.default_rng(seed)
    row = np.flatnonzero((rng.random(len(LANES)) < 0.8) & ~((LANES.track_id == "b") & (LANES.group == 4)))
    n = row.size
    root = rng.normal(size=(n, 2, 2))
    covariance = root @ np.swapaxes(root, 1, 2) + 0.2 * np.eye(2)
    direction, speed = LANES.direction[row] + rng.normal(0, 0.1, n), LANES.speed[row] + rng.normal(0, 1.0, n)
    for unknown in (covariance, direction, speed):
        unknown[rng.random(n) < 0.2] = np.nan
    names = np.where(rng.random(n) < 0.1, np.char.add("none ", np.arange(n).astype(str)), LANES.track_id[row])
    return TrackedRows(
        track_id=names, time_ns=LANES.time_ns[row], group=LANES.group[row], covariance=covariance,
        position=LANES.position[row] + rng.normal(0, 0.5, (n, 2)), direction=direction, speed=speed,
        unseen_s=rng.choice([0.0, 0.1, 0.5, 0.6, np.nan], n),
    )  # fmt: skip


def slowly(rows, truth, is_hidden):
    """Each row of the truth by itself: squared error, NEES, squared turn and pace; NaN where one is not known."""
    own = {key: k for k, key in enumerate(zip(rows.group, rows.track_id, rows.time_ns, strict=True))}
    by_row, unseen_s = np.full((4, len(truth)), np.nan), np.full(len(truth), np.nan)
    for i, key in enumerate(zip(truth.group, truth.track_id, truth.time_ns, strict=True)):
        if key in own:
            k = own[key]
            off, known = rows.position[k] - truth.position[i], np.isfinite(rows.covariance[k]).all()
            nees = off @ np.linalg.solve(rows.covariance[k], off) if known else np.nan
            turn = np.angle(np.exp(1j * (rows.direction[k] - truth.direction[i]))) if truth.speed[i] >= 0.5 else np.nan
            by_row[:, i] = off @ off, nees, turn**2, (rows.speed[k] - truth.speed[i]) ** 2
            unseen_s[i] = rows.unseen_s[k] if is_hidden is None else is_hidden[i]
    turn, pace = np.sqrt(np.nanmean(by_row[2:], axis=1))
    figures = {"direction_rmse": turn, "speed_rmse": pace, "reported": np.isfinite(by_row[0]).mean()}
    for prefix, chosen in (("", True), ("seen_", unseen_s <= 0.5), ("hidden_", unseen_s > 0.5)):
        squared, nees = (of[np.isfinite(of) & chosen] for of in by_row[:2])
        figures |= {f"{prefix}rmse": np.sqrt(squared.mean()), f"{prefix}nees": nees.mean()}
        figures |= {f"{prefix}coverage_90": (nees <= -2.0 * np.log(0.1)).mean()} if prefix != "seen_" else {}
    return figures, by_row[:2]


def report(of, truth=LANES):
    return report_of(of, truth, with_ids=True).report


@pytest.mark.parametrize("is_hidden", [None, HIDDEN], ids=["as the tracker says", "as is known"])
@pytest.mark.parametrize("seed", range(3))
def test_errors_are_those_of_a_slow_loop_over_the_rows_of_the_same_name(seed, is_hidden):
    rows = tracked_on(seed)
    expected, by_row = slowly(rows, LANES, is_hidden)
    found, errors = report_of(rows, LANES, is_hidden=is_hidden, with_ids=True)[:2]
    assert {name: getattr(found, name) for name in expected} == pytest.approx(expected, rel=1e-9)
    np.testing.assert_allclose(errors, by_row, rtol=1e-9)
    unknown = report(replace(rows, unseen_s=(), covariance=()))
    assert np.isnan([unknown.seen_rmse, unknown.hidden_rmse, unknown.nees, unknown.coverage_90]).all()


def test_gospa_and_its_parts_are_per_vehicle_whatever_the_number_of_instants():
    rows = TrackedRows(track_id=LANES.track_id, time_ns=LANES.time_ns, group=LANES.group, position=LANES.position + 0.6)
    whole, half = report(rows), report(rows[np.arange(0, len(LANES), 2)])
    assert whole.gospa**2 == pytest.approx(whole.localisation + whole.missed + whole.false)
    assert (whole.localisation, whole.missed) == pytest.approx((0.72, 0.0))
    assert (half.missed, half.reported) == pytest.approx((0.5 * 12.5, 0.5))


def test_lengths_are_positive_and_a_truth_has_rows():
    rows = tracked_on(0)
    with pytest.raises(ValueError, match="similarity_m: expected a positive distance"):
        report_of(rows, LANES, with_ids=True, similarity_m=0.0)
    with pytest.raises(ValueError, match="truth: expected at least one row"):
        report(rows, truth=LANES[np.zeros(len(LANES), bool)])
    with pytest.raises(ValueError, match="has two rows at 0 ns"):
        TrackedRows(track_id=["a", "a"], time_ns=[0, 0], position=np.zeros((2, 2)))


# What pictures of an experiment show


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
