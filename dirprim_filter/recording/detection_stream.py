"""What a sensor reported, out of a log, an instant at a time."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from dirprim_filter.detections import Detections
from dirprim_filter.recording.damage import Damage
from dirprim_filter.recording.drops import ClockFaults, Drops
from dirprim_filter.recording.field_mapping import FieldMapping
from dirprim_filter.recording.geodesy import Origin
from dirprim_filter.recording.observations import Observations, TimeSource, log_losses
from dirprim_filter.recording.scan import Scan


class DetectionStream:
    """Iterates the detections of a log, one instant each, ascending; then tells what was lost.

    Attributes:
        topics: what is read.
        dropped: what of the readable messages was left out so far.
        clock: what is odd about the times of the messages so far.
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
        frame: str | None,
        mapping: FieldMapping | None,
        origin: Origin | None,
    ) -> None:
        self._log = log
        self.topics = topics
        self._time_source: TimeSource = time_source
        self._start_ns, self._end_ns = start_ns, end_ns
        self._strict = strict
        self._frame, self._mapping, self._origin = frame, mapping, origin
        self.dropped = Drops()
        self.clock = ClockFaults()

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
        observations = Observations(
            self._log, time_source=self._time_source, start_ns=self._start_ns, end_ns=self._end_ns, strict=self._strict,
            frame=self._frame, mapping=self._mapping, origin=self._origin,
        )  # fmt: skip
        self.dropped, self.clock = observations.drops, observations.clock
        drops = self.dropped
        instant_ns = -(1 << 63)
        rows: dict[str, tuple[float, float]] = {}
        for batch in observations:
            for time_ns, name, (x, y) in zip(
                batch.time_ns.tolist(), batch.rows.track_id.tolist(), batch.rows.position.tolist(), strict=True
            ):
                if time_ns < instant_ns:
                    drops.backward += 1
                    continue
                if time_ns > instant_ns and rows:
                    yield _instant(instant_ns, rows)
                    rows = {}
                instant_ns = time_ns
                drops.repeated += name in rows
                rows.setdefault(name, (x, y))
        if rows:
            yield _instant(instant_ns, rows)
        log_losses(self._log.path, self.damage, drops, self.clock)


def _instant(time_ns: int, rows: dict[str, tuple[float, float]]) -> Detections:
    return Detections(
        track_id=np.array(list(rows), dtype=np.str_),
        time_ns=np.full(len(rows), time_ns, np.int64),
        position=np.array(list(rows.values()), dtype=np.float64),
    )
