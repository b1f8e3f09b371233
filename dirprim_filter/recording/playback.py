"""A tracker's log as the frames that it wrote."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from typing import Any

import numpy as np
from google.protobuf.message_factory import GetMessageClass

from dirprim_filter.detections import Detections
from dirprim_filter.estimates import Assignments, Particles, TrackedFrame
from dirprim_filter.forecasting import Forecasts
from dirprim_filter.recording import topic_names
from dirprim_filter.recording.container.log import Log, LogSource, Scan
from dirprim_filter.recording.decoding.protobuf_plan import message_descriptor
from dirprim_filter.recording.foxglove.scenes import forecasts_of
from dirprim_filter.recording.losses import Losses
from dirprim_filter.recording.objects.options import EVERYTHING, ReadOptions
from dirprim_filter.recording.reader import estimate_messages


class Playback:
    """Iterates the frames of a log, ascending in time; then knows what was lost.

    They are the estimates on `/dirprim/tracks`, at the log times of their messages, with the detections and what they
    were assigned to.

    Args:
        source: the log, which may be open.
        options: as for `read_tracks`, of which only the wanted times and `strict` matter.
        smoothed: those that a smoother wrote, on `/dirprim/smoothed`.
        changes: as for `read_tracks`.

    Attributes:
        losses: what was damaged, left out or odd so far.

    Raises:
        NotMcapError: the file is no MCAP log.
    """

    def __init__(
        self, source: LogSource, options: ReadOptions = EVERYTHING, *, smoothed: bool = False, **changes: Any
    ) -> None:
        self._log = source if isinstance(source, Log) else Log(source)
        self._options = replace(options, **changes).of_log(self._log.start_ns)
        self._topic = topic_names.SMOOTHED if smoothed else topic_names.ESTIMATES
        self._forecasts: dict[int, Any] | None = None
        self._origin = np.zeros(2)
        self.losses = Losses()

    def __iter__(self) -> Iterator[TrackedFrame]:
        """The frames.

        Raises:
            DamagedRecordingError: strict, and the log is damaged.
        """
        self.losses, other = Losses(), replace(self._options, strict=False)
        assigned: dict[int, Assignments] = {}
        if self._topic == topic_names.ESTIMATES:
            assigned |= estimate_messages(self._log, topic_names.ASSIGNED, Losses(), other)
        for time_ns, estimates in estimate_messages(self._log, self._topic, self.losses, self._options):
            of = assigned.pop(time_ns, Assignments.none())
            known = {name: getattr(of, name) for name in ("track_id", "time_ns", "position", "group", "origin")}
            yield TrackedFrame(
                time_ns=time_ns, detections=Detections(**known), estimates=estimates, particles=Particles.none(),
                assigned=of.assigned,
            )  # fmt: skip

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
