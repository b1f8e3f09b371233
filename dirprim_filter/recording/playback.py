"""A recorded log as frames that come at a chosen speed: a tracker's estimates, else the objects as they were seen."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterable, Iterator
from dataclasses import replace
from typing import Any

import numpy as np
from google.protobuf.message_factory import GetMessageClass

from dirprim_filter.arrays import AnyArray
from dirprim_filter.detections import NO_ID, Detections
from dirprim_filter.estimates import Assignments, Estimates, Particles, TrackedFrame
from dirprim_filter.forecasting import Forecasts
from dirprim_filter.recording import topic_names
from dirprim_filter.recording.container.log import Log, LogSource, Scan
from dirprim_filter.recording.decoding.field_columns import NANOSECONDS
from dirprim_filter.recording.decoding.protobuf_plan import message_descriptor
from dirprim_filter.recording.foxglove.scenes import forecasts_of
from dirprim_filter.recording.losses import Losses
from dirprim_filter.recording.objects.options import EVERYTHING, ReadOptions
from dirprim_filter.recording.reader import estimate_messages, has_estimates, stream_detections
from dirprim_filter.recording.schemas import ASSIGNMENTS_SCHEMA

NOTHING_ASSIGNED: AnyArray = np.empty(0, np.str_)
LONGEST_S = 86_400.0
"""No frame is waited for longer than a day."""


class Playback:
    """Iterates the frames of a log, ascending in time; then knows what was lost.

    Where the log has estimates on `/dirprim/tracks`, these, at the log times of their messages, with the detections and
    what they were assigned to; else its objects, with
    the direction and the speed that it states; those without a name are shown as detected and no more.

    Args:
        source: the log, which may be open.
        options: as for `read_tracks`. If topics are named, the log's estimates are passed over; of estimates only the
            wanted times and `strict` matter.
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
        smoothed: bool = False,
        **changes: Any,
    ) -> None:
        self._log = log = source if isinstance(source, Log) else Log(source)
        self._options = options = replace(options, **changes).of_log(log.start_ns)
        self._losses, self._stream = Losses(), None
        self._topic = topic_names.SMOOTHED if smoothed else topic_names.ESTIMATES
        self.topics = frozenset({self._topic})
        self._forecasts: dict[int, Any] | None = None
        self._origin = np.zeros(2)
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
        self._losses, other = Losses(), replace(self._options, strict=False)
        assigned: dict[int, Assignments] = {}
        if self._topic == topic_names.ESTIMATES:
            assigned |= estimate_messages(
                self._log, topic_names.ASSIGNED, Losses(), other, schema=ASSIGNMENTS_SCHEMA
            )  # fmt: skip
        for time_ns, estimates in estimate_messages(self._log, self._topic, self._losses, self._options):
            of = assigned.pop(time_ns, Assignments.none())
            known = {name: getattr(of, name) for name in ("track_id", "time_ns", "position", "group", "origin")}
            yield _frame(time_ns, Detections(**known), estimates, of.assigned)

    def forecast(self, frame: TrackedFrame) -> Forecasts | None:
        """The forecast that was drawn of a frame of estimates; None where there is none."""
        if self._forecasts is None:
            topics = (topic_names.FORECAST, topic_names.TRANSFORM)
            kinds = {of.topic: GetMessageClass(message_descriptor(of.schema.name, of.schema.data))
                     for of in self._log.channels() if of.topic in topics}  # fmt: skip
            self._forecasts = {}
            for message in Scan(self._log, kinds.__contains__):  # the transform stands at the beginning
                drawn: Any = kinds[message.topic].FromString(message.data)
                if message.topic == topic_names.FORECAST:
                    self._forecasts[message.log_time_ns] = drawn
                else:
                    self._origin = np.array([drawn.translation.x, drawn.translation.y])
        update = self._forecasts.pop(frame.time_ns, None)
        if update is None:
            return None
        start = dict(zip(frame.names, frame.estimates.position, strict=True))
        return forecasts_of(update, frame.time_ns, self._origin, start)


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


def _frame(
    time_ns: int, detections: Detections, estimates: Estimates, assigned: AnyArray = NOTHING_ASSIGNED
) -> TrackedFrame:  # fmt: skip
    particles = Particles.none()
    return TrackedFrame(
        time_ns=time_ns, detections=detections, estimates=estimates, particles=particles, assigned=assigned
    )  # fmt: skip
