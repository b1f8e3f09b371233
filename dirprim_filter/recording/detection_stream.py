"""What a sensor reported, out of a log, an instant at a time."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from dirprim_filter.detections import NO_ID, Detections, is_covariance
from dirprim_filter.recording.damage import Damage
from dirprim_filter.recording.observations import Drops, TimeSource, log_losses, observed_frames
from dirprim_filter.recording.scan import Scan
from dirprim_filter.recording.schemas.observed import ObservedFrame
from tessellation.arrays import FloatArray


class DetectionStream:
    """Iterates the detections of a log, one instant each, ascending; then tells what was lost.

    Attributes:
        topics: what is read.
        dropped: what of the readable messages was left out so far.
    """

    def __init__(
        self,
        log: Scan,
        *,
        topics: frozenset[str],
        time_source: TimeSource,
        start_ns: int | None,
        end_ns: int | None,
        strict: bool,
        motion: bool,
    ) -> None:
        self._log = log
        self.topics = topics
        self._time_source: TimeSource = time_source
        self._start_ns, self._end_ns = start_ns, end_ns
        self._strict, self._motion = strict, motion
        self.dropped = Drops()

    @property
    def damage(self) -> list[Damage]:
        """What of the file could not be read so far."""
        return self._log.damage

    def __iter__(self) -> Iterator[Detections]:
        """The instants.

        Raises:
            DamagedRecordingError: strict, and the log is damaged.
            DecodeError: strict, and a message is not what its schema says.
        """
        self.dropped = drops = Drops()
        frames = observed_frames(
            self._log, drops=drops, time_source=self._time_source,
            start_ns=self._start_ns, end_ns=self._end_ns, strict=self._strict,
        )  # fmt: skip
        instant_ns = -(1 << 63)
        instant = _Instant()
        for time_ns, frame in frames:
            if time_ns < instant_ns:
                drops.backward += len(frame.track_id)
                continue
            if time_ns > instant_ns and instant.parts:
                yield instant.detections(instant_ns)
                instant = _Instant()
            instant_ns = time_ns
            drops.repeated += instant.add(frame if self._motion else frame.without_motion())
        if instant.parts:
            yield instant.detections(instant_ns)
        log_losses(self._log.path, self.damage, drops)


class _Instant:
    """The rows of one time, of one message or several; of a vehicle the first."""

    def __init__(self) -> None:
        self.parts: list[ObservedFrame] = []
        self._names: set[str] = set()

    def add(self, frame: ObservedFrame) -> int:
        """Take a message's rows; -> how many repeat a vehicle."""
        fresh = np.ones(len(frame.track_id), np.bool_)
        for row, name in enumerate(frame.track_id):
            fresh[row] = name == NO_ID or name not in self._names
            self._names.add(name)
        if fresh.any():
            self.parts.append(frame if fresh.all() else frame[fresh])
        return int((~fresh).sum())

    def detections(self, time_ns: int) -> Detections:
        names = [name for part in self.parts for name in part.track_id]
        direction, speed = (
            np.concatenate([getattr(part, name) for part in self.parts]) for name in ("direction", "speed")
        )
        return Detections(
            track_id=np.array(names, dtype=np.str_),
            time_ns=np.full(len(names), time_ns, np.int64),
            position=np.concatenate([part.position for part in self.parts]),
            direction=np.where(np.isfinite(direction), direction, np.nan),
            speed=np.where(np.isfinite(speed) & (speed >= 0), speed, np.nan),
            covariance=_usable(np.concatenate([part.covariance for part in self.parts])),
        )


def _usable(covariance: FloatArray) -> FloatArray:
    """Covariances as they are; NaN, for the filter's own, where a log holds zeros or worse."""
    return np.where(is_covariance(covariance)[:, None, None], covariance, np.nan)
