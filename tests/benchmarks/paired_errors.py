"""Errors of estimates at rows of a truth, by drive or scenario, so that methods are compared at the same rows."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from dirprim_filter.arrays import FloatArray, IntArray
from dirprim_filter.detections import NO_ID, Detections
from dirprim_filter.estimates import Estimates
from dirprim_filter.evaluation.calibration.pairing import Scene
from dirprim_filter.tracks import Tracks


class RowErrors(NamedTuple):
    """Of estimates that are near a true position; (n,) rows.

    Attributes:
        key: which vehicle at which time.
        squared: square metres.
        column: which estimate it is.
    """

    key: IntArray
    squared: FloatArray
    column: IntArray

    @classmethod
    def of(cls, estimates: Estimates | Detections, truth: Tracks, *, gate_m: float) -> RowErrors:
        """Estimates of one group beside the truth, interpolated to their times; nearest together."""
        as_seen = Detections(
            track_id=np.full(len(estimates), NO_ID), time_ns=estimates.time_ns, position=estimates.position,
            group=np.full(len(estimates), truth.group[0]),
        )  # fmt: skip
        scene = Scene(as_seen, truth)
        rows = scene.truth_at(0.0)
        row, column = scene.matched(rows, gate_m=gate_m)
        off = estimates.position[column] - rows.position[row]
        return cls(_keys(estimates.time_ns[column], rows.vehicle[row]), (off**2).sum(axis=1), column)


def true_rows(truth: Tracks, time_ns: IntArray) -> tuple[Tracks, IntArray]:
    """A group's truth, interpolated, at instants, and the keys of its rows."""
    instants = np.unique(time_ns)
    nowhere = Detections(
        track_id=np.full(instants.size, NO_ID), time_ns=instants, position=np.zeros((instants.size, 2)),
        group=np.full(instants.size, truth.group[0]),
    )  # fmt: skip
    scene = Scene(nowhere, truth)
    rows = scene.truth_at(0.0)
    is_asked = np.isin(rows.frame, scene.frame_of)  # the scene fills pauses with instants of its own
    rows = type(rows)(*(column[is_asked] for column in rows))
    times = instants[np.searchsorted(scene.frame_of, rows.frame)]
    at = Tracks(
        track_id=scene.names[rows.vehicle], time_ns=times, position=rows.position, speed=rows.speed,
        direction=np.arctan2(rows.course[:, 1], rows.course[:, 0]), group=np.full(times.size, truth.group[0]),
    )  # fmt: skip
    return at, _keys(times, rows.vehicle)


def _keys(time_ns: IntArray, vehicle: IntArray) -> IntArray:
    return np.asarray(time_ns // 1000 * 64 + vehicle)
