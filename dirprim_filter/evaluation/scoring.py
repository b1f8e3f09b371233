"""Scores of a tracking experiment: each group's frames against its truth, pooled over the groups."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from dirprim_filter.arrays import AnyArray, BoolArray, FloatArray
from dirprim_filter.estimates import EstimateList, Estimates
from dirprim_filter.evaluation.tracked_rows import TrackedRows
from dirprim_filter.evaluation.tracking import normalised_squared
from dirprim_filter.evaluation.tracking_report import Scales, TrackingReport, assigned
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
    """A group as it was, and as it was tracked: what is believed at every instant of the truth."""

    truth: Truth
    estimates: EstimateList


def report(worlds: Sequence[TrackedWorld], *, with_ids: bool, scales: Scales) -> TrackingReport:
    """The figures of one group, or pooled over all: each row and each instant counts as in any other group.

    Args:
        worlds: groups, at least one.
        with_ids: assign estimates to vehicles by id; else by GOSPA's assignment.
        scales: of the metrics.
    """
    rows, truth, is_hidden = _pooled(worlds)
    return TrackingReport.of(rows, truth, is_hidden=is_hidden, with_ids=with_ids, scales=scales)


def row_errors(worlds: Sequence[TrackedWorld], *, with_ids: bool, scales: Scales) -> RowErrors:
    """The errors of each row of the truth, pooled over all groups; arguments as of `report`."""
    rows, truth, is_hidden = _pooled(worlds)
    row, column = assigned(rows, truth, with_ids=with_ids, scales=scales)
    off = rows.position[column] - truth.position[row]
    squared, normalised = np.full((2, len(truth)), np.nan)
    squared[row], normalised[row] = (off**2).sum(axis=1), normalised_squared(off, rows.covariance[column])
    names = truth.group.astype(np.str_) if len(worlds) > 1 else world_names(truth.track_id, truth.group)
    return RowErrors(cluster=names, squared=squared, normalised=normalised, is_hidden=is_hidden)


def _pooled(worlds: Sequence[TrackedWorld]) -> tuple[TrackedRows, Tracks, BoolArray]:
    """Estimates, the truth in order of time, and which of its rows are hidden."""
    believed = [world.estimates.all() for world in worlds]
    groups = [world.truth.tracks.group[0] for world in worlds]
    rows = TrackedRows.of(Estimates.concatenate(believed), group=np.repeat(groups, [len(part) for part in believed]))
    order = np.argsort(np.concatenate([world.truth.tracks.time_ns for world in worlds]), kind="stable")
    is_hidden = np.concatenate([world.truth.is_hidden for world in worlds])[order]
    return rows, Tracks.concatenate([world.truth.tracks for world in worlds]), is_hidden
