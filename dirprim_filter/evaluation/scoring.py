"""Scores of a tracking experiment: each group's frames against its truth, pooled over the groups."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from dirprim_filter.arrays import BoolArray
from dirprim_filter.estimates import EstimateList, Estimates
from dirprim_filter.evaluation.tracked_rows import TrackedRows
from dirprim_filter.evaluation.tracking_report import Scales, TrackingReport
from dirprim_filter.tracks import Tracks


@dataclass(frozen=True, slots=True, kw_only=True)
class Truth:
    """Where the vehicles of a group were, and in which rows (n,) they were out of the sensor's sight."""

    tracks: Tracks
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
    believed = [world.estimates.all() for world in worlds]
    groups = [world.truth.tracks.group[0] for world in worlds]
    rows = TrackedRows.of(Estimates.concatenate(believed), group=np.repeat(groups, [len(part) for part in believed]))
    order = np.argsort(np.concatenate([world.truth.tracks.time_ns for world in worlds]), kind="stable")
    return TrackingReport.of(
        rows,
        Tracks.concatenate([world.truth.tracks for world in worlds]),  # in order of time
        is_hidden=np.concatenate([world.truth.is_hidden for world in worlds])[order],
        with_ids=with_ids,
        scales=scales,
    )
