"""What a sensor reported, out of a log, an instant at a time."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace

import numpy as np

from dirprim_filter.detections import NO_ID, Detections, is_covariance
from dirprim_filter.distributions.angles import wrap
from dirprim_filter.recording.container.log import Scan
from dirprim_filter.recording.losses import BACKWARD, REPEATED, Losses
from dirprim_filter.recording.objects.observations import Observations
from dirprim_filter.recording.objects.options import ReadOptions
from dirprim_filter.recording.rows import Rows
from dirprim_filter.track_ids import repeated_rows, vehicle_numbers

LATEST_NS = 1_000_000_000
"""So much later than others of later stamps may messages be logged: sensors are late by different times."""
LIVE_LATEST_NS = 100_000_000
"""Of a live pipe, whose estimates are as much later."""
SHARPEST = 1e6
"""Of a cue's concentration: a thousandth of a radian."""


class DetectionStream:
    """Iterates the detections of a log, one instant each, ascending; then knows what was lost.

    Attributes:
        topics: what is read.
        losses: what was damaged, left out or odd so far.
    """

    def __init__(self, scan: Scan, options: ReadOptions, *, topics: frozenset[str], motion: bool) -> None:
        self._scan = scan
        self._options = options
        self.topics = topics
        self._motion = motion
        latest_ns = LIVE_LATEST_NS if scan.log.is_live else LATEST_NS
        self._late_ns = 0 if options.time_source == "log" else latest_ns
        self.losses = Losses()

    @property
    def end_ns(self) -> int | None:
        """The last log time to come, as the chunks say; None of an empty log."""
        last, asked = self._scan.end_ns, self._options.end_ns
        return last if last is None or asked is None else min(last, asked)

    def __iter__(self) -> Iterator[Detections]:
        """The instants.

        Raises:
            DamagedRecordingError: strict, and the log is damaged.
            DecodeError: strict, and a message is not what its schema says.
        """
        observations = Observations(self._scan, self._options)
        self.losses = observations.losses
        came_ns = -(1 << 63) + LATEST_NS
        rest = Detections.none()
        for batch in observations:
            latest_ns = np.maximum.accumulate(np.maximum(batch.time_ns, came_ns))
            in_order = batch.time_ns >= latest_ns - self._late_ns
            self.losses.drop(BACKWARD, ~in_order)
            came_ns = int(latest_ns[-1])
            seen = self._without_repeats(Detections.concatenate([rest, self._detections(batch)[in_order]]))
            is_whole = seen.time_ns < came_ns - self._late_ns
            yield from seen[is_whole].frames()
            rest = seen[~is_whole]  # what follows may be earlier, or of the last instant too
        yield from rest.frames()
        self.losses.log(self._scan.path)

    def _detections(self, rows: Rows) -> Detections:
        """What of a batch may be used: covariances that are none, or of zeros, leave the filter its own noise."""
        is_one_world = self._options.group is not None  # the group that was asked for goes under its own ids
        known_cue = np.isfinite(rows.cue).all(axis=1) & (rows.cue[:, 1] >= 0) & (rows.cue[:, 1] <= SHARPEST)
        seen = Detections(
            track_id=rows.track_id,
            time_ns=rows.time_ns,
            position=rows.position,
            covariance=np.where(is_covariance(rows.covariance)[:, None, None], rows.covariance, np.nan),
            size=rows.size,
            cue=np.where(known_cue[:, None], rows.cue, np.nan) if known_cue.any() else np.empty((0, 2)),
            group=np.zeros_like(rows.group) if is_one_world else rows.group,
        )
        if not self._motion:
            return seen
        return replace(
            seen,
            direction=wrap(np.where(np.isfinite(rows.direction), rows.direction, np.nan)),
            speed=np.where(np.isfinite(rows.speed) & (rows.speed >= 0), rows.speed, np.nan),
        )

    def _without_repeats(self, seen: Detections) -> Detections:
        """Of the rows of a vehicle and an instant the first; all of those that have no name."""
        vehicle = vehicle_numbers(seen.track_id, seen.group) if seen.group.any() else seen.track_id
        repeated = repeated_rows(vehicle, seen.time_ns) & (seen.track_id != NO_ID)
        self.losses.drop(REPEATED, repeated)
        return seen[~repeated] if repeated.any() else seen
