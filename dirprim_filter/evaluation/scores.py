"""Scores of trackers beside a truth: of an experiment's groups, pooled, and of what several trackers wrote."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from dirprim_filter.arrays import AnyArray, BoolArray, FloatArray
from dirprim_filter.evaluation.metrics.comparison import SIMILARITY_M
from dirprim_filter.evaluation.splits import steps
from dirprim_filter.evaluation.tracked_rows import TrackedRows, instant_numbers
from dirprim_filter.evaluation.tracking_report import TrackingReport, report_of
from dirprim_filter.evaluation.truth import judged_rows, judged_truth
from dirprim_filter.track_ids import qualified_names
from dirprim_filter.tracks import Tracks


class TrackedScene(NamedTuple):
    """A group as it was, and as it was tracked.

    Attributes:
        truth: where its vehicles were.
        is_hidden: (n,) in which rows they were out of the sensor's sight.
        rows: what a tracker says of it.
    """

    truth: Tracks
    is_hidden: BoolArray
    rows: TrackedRows


class RowErrors(NamedTuple):
    """One method's errors in one run, a number for each row of the truth.

    Attributes:
        cluster: (n,) str, of whom: the group, where there are several, else the vehicle.
        squared: (n,) square metres; NaN without an estimate.
        normalised: (n,) the same in units of the covariance.
        is_hidden: (n,) whether the vehicle was out of sight,
        unseen_s: (n,) and for how many seconds; 0 in sight.
        position: (n, 2) metres, where it was.
    """

    cluster: AnyArray
    squared: FloatArray
    normalised: FloatArray
    is_hidden: BoolArray
    unseen_s: FloatArray
    position: FloatArray


def scored(
    scenes: Sequence[TrackedScene], *, with_ids: bool, similarity_m: float = SIMILARITY_M
) -> tuple[TrackingReport, RowErrors]:
    """The figures of one group, or pooled over all, and the errors they are of: each row counts as in any other group.

    Where vehicles of a group have rows at different instants, the truth is interpolated: see `judged_truth`; so are
    estimates of other instants: see `judged_rows`. An interpolated row is hidden where both its neighbours are.

    Args:
        scenes: groups, at least one.
        with_ids: assign estimates to vehicles by id; else by GOSPA's assignment.
        similarity_m: metres, the length of all metrics.
    """
    judged = [judged_truth(scene.truth) for scene in scenes]
    order = np.argsort(np.concatenate([of.tracks.time_ns for of in judged]), kind="stable")
    truth = Tracks.concatenate([of.tracks for of in judged])  # in order of time
    hidden = [of.both(scene.is_hidden) for of, scene in zip(judged, scenes, strict=True)]
    is_hidden = np.concatenate(hidden)[order]
    rows = judged_rows(TrackedRows.concatenate(scene.rows for scene in scenes), truth).rows
    found = report_of(
        rows, truth, is_hidden=is_hidden, with_ids=with_ids, similarity_m=similarity_m,
        interpolated=sum(of.n_interpolated for of in judged) / len(truth),
    )  # fmt: skip
    report, (squared, normalised) = found.report, found.errors
    names = truth.group.astype(np.str_) if len(scenes) > 1 else qualified_names(truth.track_id, truth.group)
    return report, RowErrors(names, squared, normalised, is_hidden, _unseen_s(truth, is_hidden), truth.position)


def _unseen_s(truth: Tracks, is_hidden: BoolArray) -> FloatArray:
    """(n,) seconds since a vehicle was last in sight; 0 where it is, and of the first rows where it never was."""
    order = np.lexsort((truth.time_ns, truth.vehicle))
    vehicle, time_ns = truth.vehicle[order], truth.time_ns[order]
    begins = np.diff(vehicle, prepend=-1) != 0
    last = np.maximum.accumulate(np.where(begins | ~is_hidden[order], np.arange(order.size), 0))
    unseen_s = np.empty(order.size)
    unseen_s[order] = (time_ns - time_ns[last]) * 1e-9
    return unseen_s


@dataclass(frozen=True, slots=True, kw_only=True)
class Score:
    """One tracker's figures.

    Attributes:
        name: what it is called.
        n_rows: of it at the instants that were judged, interpolated ones included.
        n_interpolated: of these rows: see `judged_rows`.
        left_out: how many of its rows are of groups or times without a truth.
        beyond: how many rows of the truth are before or after all of its own.
        late_s: seconds by which its errors look late, see `Judged`,
        late_share: how much of the squared error such a delay explains, a share.
        n_tracks: how many tracks they are of.
        n_instants: at how many instants they are.
        report: the figures.
    """

    name: str
    n_rows: int
    n_interpolated: int
    left_out: int
    beyond: int
    late_s: float
    late_share: float
    n_tracks: int
    n_instants: int
    report: TrackingReport


@dataclass(frozen=True, slots=True, kw_only=True)
class ScoreTable:
    """Trackers side by side.

    Attributes:
        n_groups: of the truth, each a scene of its own.
        n_vehicles: of the truth.
        n_rows: of the truth at the instants that were judged, interpolated ones included.
        n_interpolated: of these rows.
        longest_gap_s: seconds between two rows of a vehicle, above which none was interpolated.
        n_instants: how many instants were judged, the truth's own.
        with_ids: whether estimates were assigned to vehicles by id.
        similarity_m: metres, the length of all metrics.
        scores: of each tracker.
    """

    n_groups: int
    n_vehicles: int
    n_rows: int
    n_interpolated: int
    longest_gap_s: float
    n_instants: int
    with_ids: bool
    similarity_m: float
    scores: tuple[Score, ...]


def score_rows(
    results: Mapping[str, TrackedRows],
    truth: Tracks,
    *,
    with_ids: bool,
    similarity_m: float = SIMILARITY_M,
    progress: Callable[[int, int], None] | None = None,
) -> ScoreTable:
    """Score what trackers wrote, by name, each as if it were alone: at the truth's instants, see `judged_rows`.

    Args:
        results: what each says, in the groups of the truth.
        truth: where vehicles were, at instants of the results or at others.
        with_ids: assign estimates to vehicles by id; else by GOSPA's assignment.
        similarity_m: metres, the length of all metrics.
        progress: called with the number of results scored, and their total.

    Raises:
        ValueError: a result has no row at an instant at which the truth is known.
    """
    done = steps(len(results), progress)
    judged = judged_truth(truth)
    n_rows = len(judged.tracks)
    scores = []
    for name, rows in results.items():
        kept, n_interpolated, left_out, beyond = judged_rows(rows, judged.tracks)
        if len(kept) == 0:
            raise ValueError(
                f"{name}: expected rows at instants at which the truth is known, {_span(truth)}, got none; its own are "
                f"{_span(rows)}"
            )
        found = report_of(
            kept, judged.tracks, with_ids=with_ids, similarity_m=similarity_m,
            interpolated=judged.n_interpolated / n_rows,
        )  # fmt: skip
        scores.append(Score(
            name=name, n_rows=len(kept), n_interpolated=n_interpolated, left_out=left_out, beyond=beyond,
            late_s=found.late_s, late_share=found.late_share, n_tracks=kept.n_tracks, n_instants=_n_instants(kept),
            report=found.report,
        ))  # fmt: skip
        done()
    return ScoreTable(
        n_groups=int(np.unique(truth.group).size), n_vehicles=judged.tracks.n_tracks, n_rows=n_rows,
        n_interpolated=judged.n_interpolated, longest_gap_s=judged.longest_gap_s,
        n_instants=_n_instants(judged.tracks), with_ids=with_ids, similarity_m=similarity_m, scores=tuple(scores),
    )  # fmt: skip


def _n_instants(rows: TrackedRows | Tracks) -> int:
    return int(instant_numbers(rows)[0].max(initial=-1)) + 1


def _span(rows: TrackedRows | Tracks) -> str:
    return f"{rows.time_ns.min()} to {rows.time_ns.max()} ns" if len(rows) else "none"
