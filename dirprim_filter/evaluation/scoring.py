"""Scores of a tracking experiment: each group's frames against its truth, pooled over the groups."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from dirprim_filter.arrays import AnyArray, BoolArray, FloatArray
from dirprim_filter.estimates import EstimateList, Estimates
from dirprim_filter.evaluation.tracked_rows import TrackedRows
from dirprim_filter.evaluation.tracking_report import Scales, TrackingReport
from dirprim_filter.evaluation.truth import judged_truth
from dirprim_filter.track_ids import world_names
from dirprim_filter.tracks import Tracks


@dataclass(frozen=True, slots=True, kw_only=True)
class Truth:
    """Where the vehicles of a group were, and in which rows (n,) they were out of the sensor's sight."""

    tracks: Tracks
    is_hidden: BoolArray


class RowErrors(NamedTuple):
    """One method's errors in one run, a number for each row of the truth.

    Attributes:
        cluster: (n,) str, of whom: the group, where there are several, else the vehicle.
        squared: (n,) square metres; NaN without an estimate.
        normalised: (n,) the same in units of the covariance.
        is_hidden: (n,) whether the vehicle was out of sight.
    """

    cluster: AnyArray
    squared: FloatArray
    normalised: FloatArray
    is_hidden: BoolArray


@dataclass(frozen=True, slots=True, kw_only=True)
class TrackedWorld:
    """A group as it was, and as it was tracked: the estimates at every instant of the truth."""

    truth: Truth
    estimates: EstimateList


def scored(worlds: Sequence[TrackedWorld], *, with_ids: bool, scales: Scales) -> tuple[TrackingReport, RowErrors]:
    """The figures of one group, or pooled over all, and the errors they are of: each row counts as in any other group.

    Where vehicles of a group have rows at different instants, the truth is interpolated: see `judged_truth`. An
    interpolated row is hidden where both its neighbours are.

    Args:
        worlds: groups, at least one.
        with_ids: assign estimates to vehicles by id; else by GOSPA's assignment.
        scales: of the metrics.
    """
    estimates = [world.estimates.all() for world in worlds]
    groups = [world.truth.tracks.group[0] for world in worlds]
    rows = TrackedRows.of(Estimates.concatenate(estimates), group=np.repeat(groups, [len(part) for part in estimates]))
    judged = [judged_truth(world.truth.tracks) for world in worlds]
    order = np.argsort(np.concatenate([of.tracks.time_ns for of in judged]), kind="stable")
    truth = Tracks.concatenate([of.tracks for of in judged])  # in order of time
    is_hidden = np.concatenate([of.both(world.truth.is_hidden) for of, world in zip(judged, worlds, strict=True)])[
        order
    ]
    report, (squared, normalised) = TrackingReport.with_errors(
        rows, truth, is_hidden=is_hidden, with_ids=with_ids, scales=scales,
        interpolated=sum(of.n_interpolated for of in judged) / len(truth),
    )  # fmt: skip
    names = truth.group.astype(np.str_) if len(worlds) > 1 else world_names(truth.track_id, truth.group)
    return report, RowErrors(cluster=names, squared=squared, normalised=normalised, is_hidden=is_hidden)
