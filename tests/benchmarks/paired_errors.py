"""Errors of estimates at rows of a truth, by drive or scenario, so that methods are compared at the same rows."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from dirprim_filter.arrays import BoolArray, FloatArray, IntArray
from dirprim_filter.detections import NO_ID, Detections
from dirprim_filter.estimates import Estimates
from dirprim_filter.evaluation.calibration.pairing import Scene
from dirprim_filter.evaluation.tracking_report import normalised_squared
from dirprim_filter.tracks import Tracks


@dataclass(frozen=True, slots=True, kw_only=True)
class RowErrors:
    """Of estimates that are near a true position; (n,) rows.

    Attributes:
        key: which vehicle at which time.
        off: (n, 2) metres, east and north.
        course: (n, 2) unit vector along the true vehicle's way.
        covariance: (n, 2, 2) square metres.
        column: which estimate it is.
    """

    key: IntArray
    off: FloatArray
    course: FloatArray
    covariance: FloatArray
    column: IntArray

    @classmethod
    def of(cls, estimates: Estimates | Detections, truth: Tracks, *, gate_m: float, lag_s: float = 0.0) -> RowErrors:
        """Estimates of one group beside the truth, interpolated to `lag_s` before their times; nearest together."""
        as_seen = Detections(
            track_id=np.full(len(estimates), NO_ID), time_ns=estimates.time_ns, position=estimates.position,
            group=np.full(len(estimates), truth.group[0]),
        )  # fmt: skip
        scene = Scene(as_seen, truth)
        rows = scene.truth_at(lag_s)
        row, column = scene.matched(rows, gate_m=gate_m)
        time_ns = estimates.time_ns[column]
        vehicle = rows.vehicle[row]
        return cls(
            key=_keys(time_ns, vehicle), off=estimates.position[column] - rows.position[row],
            course=rows.course[row], covariance=estimates.covariance[column], column=column,
        )  # fmt: skip

    def __getitem__(self, rows: BoolArray | IntArray) -> RowErrors:
        return RowErrors(
            key=self.key[rows], off=self.off[rows], course=self.course[rows], covariance=self.covariance[rows],
            column=self.column[rows],
        )  # fmt: skip

    def at(self, key: IntArray) -> RowErrors:
        """The rows of these keys, in the order of keys."""
        order = np.argsort(self.key)
        kept = order[np.isin(self.key[order], key)]
        return self[kept]

    @property
    def squared(self) -> FloatArray:
        """(n,) square metres."""
        return np.asarray((self.off**2).sum(axis=1))

    @property
    def normalised(self) -> FloatArray:
        """(n,) squared, in units of the covariance."""
        return normalised_squared(self.off, self.covariance)


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
