"""What several trackers wrote, beside one truth."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass

import numpy as np

from dirprim_filter.evaluation.steps import StepCount
from dirprim_filter.evaluation.tracked_rows import TrackedRows
from dirprim_filter.evaluation.tracking_report import Scales, TrackingReport
from dirprim_filter.tracks import Tracks


@dataclass(frozen=True, slots=True, kw_only=True)
class Score:
    """One tracker's figures.

    Attributes:
        name: what it is called.
        n_rows: how many of its rows were compared.
        left_out: how many were not: the truth does not hold their instants.
        n_tracks: how many tracks they are of.
        report: the figures.
    """

    name: str
    n_rows: int
    left_out: int
    n_tracks: int
    report: TrackingReport


@dataclass(frozen=True, slots=True, kw_only=True)
class ScoreTable:
    """Trackers side by side.

    Attributes:
        n_groups: of the truth, each a world of its own.
        n_vehicles: of the truth.
        n_rows: of the truth.
        with_ids: whether estimates were assigned to vehicles by id.
        scales: of the metrics.
        scores: of each tracker.
    """

    n_groups: int
    n_vehicles: int
    n_rows: int
    with_ids: bool
    scales: Scales
    scores: tuple[Score, ...]


def score_rows(
    results: Mapping[str, TrackedRows],
    truth: Tracks,
    *,
    with_ids: bool,
    scales: Scales,
    progress: Callable[[int, int], None] | None = None,
) -> ScoreTable:
    """Score what trackers wrote, by name.

    Args:
        results: what each says, in the groups of the truth.
        truth: where vehicles were.
        with_ids: assign estimates to vehicles by id; else by GOSPA's assignment.
        scales: of the metrics.
        progress: called with the number of results scored, and their total.

    Raises:
        ValueError: a result has no row at any instant of the truth or a length is not positive.
    """
    steps = StepCount(len(results), progress)
    scores = []
    for name, rows in results.items():
        kept = rows.at_instants_of(truth)
        if len(kept) == 0:
            raise ValueError(
                f"{name}: expected rows at instants of the truth, {_span(truth)}, got none; its own are {_span(rows)}"
            )
        scores.append(
            Score(
                name=name, n_rows=len(kept), left_out=len(rows) - len(kept), n_tracks=kept.n_tracks,
                report=TrackingReport.of(kept, truth, is_hidden=None, with_ids=with_ids, scales=scales),
            )
        )  # fmt: skip
        steps.add()
    return ScoreTable(
        n_groups=int(np.unique(truth.group).size),
        n_vehicles=truth.n_tracks, n_rows=len(truth),
        with_ids=with_ids, scales=scales, scores=tuple(scores),
    )  # fmt: skip


def _span(rows: TrackedRows | Tracks) -> str:
    return f"{rows.time_ns.min()} to {rows.time_ns.max()} ns" if len(rows) else "none"
