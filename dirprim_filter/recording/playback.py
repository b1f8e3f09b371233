"""A recorded log as frames that come at a chosen speed: a tracker's estimates, else the objects as they were seen."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterable, Iterator
from dataclasses import replace
from typing import Any

import numpy as np

from dirprim_filter.detections import NO_ID, Detections
from dirprim_filter.estimates import Estimates, Particles, TrackedFrame
from dirprim_filter.recording import topic_names
from dirprim_filter.recording.container.log import Log, LogSource, Scan
from dirprim_filter.recording.decoding.field_columns import NANOSECONDS
from dirprim_filter.recording.losses import Losses
from dirprim_filter.recording.objects.options import EVERYTHING, ReadOptions
from dirprim_filter.recording.reader import estimate_messages, has_estimates, stream_detections

LONGEST_S = 86_400.0
"""No frame is waited for longer than a day."""


class Playback:
    """Iterates the frames of a log, ascending in time; then knows what was lost.

    Where the log has estimates on `/dirprim/tracks`, these, at the log times of their messages; else its objects, with
    the direction and the speed that it states; those without a name are shown as detected and no more.

    Args:
        source: the log, which may be open.
        options: as for `read_tracks`. If topics are named, the log's estimates are passed over; of estimates only the
            wanted times and `strict` matter.
        seen: what was reported when the estimates were made; of times without estimates there is no frame.
        smoothed: of the estimates those that a smoother wrote, on `/dirprim/smoothed`.
        changes: as for `read_tracks`.

    Attributes:
        topics: what is played.
        end_ns: the last log time to come, as the chunks say; None of an empty log.

    Raises:
        NotMcapError: the file is no MCAP log.
        NoTracksError: the log has neither estimates nor objects.
    """

    def __init__(
        self,
        source: LogSource,
        options: ReadOptions = EVERYTHING,
        *,
        seen: Detections | None = None,
        smoothed: bool = False,
        **changes: Any,
    ) -> None:
        self._log = log = source if isinstance(source, Log) else Log(source)
        self._options = options = replace(options, **changes).of_log(log.start_ns)
        self._losses, self._stream = Losses(), None
        self._seen = {int(frame.time_ns[0]): frame for frame in seen.frames()} if seen is not None else {}
        self._topic = topic_names.SMOOTHED if smoothed else topic_names.ESTIMATES
        self.topics = frozenset({self._topic})
        self.end_ns = Scan(log, end_ns=options.end_ns).end_ns
        if options.topics not in (None, self._topic) or not has_estimates(log, self._topic):
            self._stream = stream_detections(log, options, motion=True)
            self.topics = self._stream.topics

    @property
    def losses(self) -> Losses:
        """What was damaged, left out or odd so far."""
        return self._losses if self._stream is None else self._stream.losses

    def __iter__(self) -> Iterator[TrackedFrame]:
        """The frames.

        Raises:
            DamagedRecordingError: strict, and the log is damaged.
        """
        if self._stream is not None:
            for reported in self._stream:
                seen = reported.in_one_group()
                yield _frame(int(seen.time_ns[0]), seen, _reported(seen[seen.track_id != NO_ID]))
            return
        self._losses = Losses()
        for time_ns, estimates in estimate_messages(self._log, self._topic, self._losses, self._options):
            yield _frame(time_ns, self._seen.get(time_ns, Detections.none()), estimates)


def paced(
    frames: Iterable[TrackedFrame],
    rate: float,
    *,
    clock: Callable[[], float] = time.monotonic,
    sleep: Callable[[float], None] = time.sleep,
) -> Iterator[TrackedFrame]:
    """The frames, each when its time has come by the clock; one that is late comes at once.

    The rate is checked at once, not at the first frame.

    Args:
        frames: ascending in time.
        rate: seconds of the log for each second of the clock; infinity waits for nothing.
        clock: seconds that pass.
        sleep: waits for so many seconds.

    Raises:
        ValueError: a rate that is not positive.
    """
    if not rate > 0:
        raise ValueError(f"rate: expected more than 0 seconds of the log each second, got {rate}")
    begun: list[tuple[int, float]] = []

    def when_due(frame: TrackedFrame) -> TrackedFrame:
        if not begun:
            begun.append((frame.time_ns, clock()))
        wait = begun[0][1] + (frame.time_ns - begun[0][0]) / NANOSECONDS / rate - clock()
        if wait > 0:
            sleep(min(wait, LONGEST_S))
        return frame

    return map(when_due, frames)


def _reported(seen: Detections) -> Estimates:
    """What is known of the vehicles of an instant."""
    n = len(seen)
    return Estimates(
        track_id=seen.track_id, time_ns=seen.time_ns, position=seen.position, covariance=np.zeros((n, 2, 2)),
        direction=np.nan_to_num(seen.direction), direction_resultant=np.isfinite(seen.direction).astype(np.float64),
        speed=np.nan_to_num(seen.speed), speed_std=np.zeros(n), effective_sample_size=np.ones(n),
        log_evidence=np.zeros(n), origin=seen.origin,
    )  # fmt: skip


def _frame(time_ns: int, detections: Detections, estimates: Estimates) -> TrackedFrame:
    return TrackedFrame(time_ns=time_ns, detections=detections, estimates=estimates, particles=Particles.none())
