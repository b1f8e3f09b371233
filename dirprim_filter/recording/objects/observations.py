"""The objects that a log's messages report, batch by batch or an instant at a time, and what had to be left out."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from typing import Any

import numpy as np

from dirprim_filter.arrays import AnyArray, BoolArray, FloatArray, IntArray
from dirprim_filter.columns import known_covariances
from dirprim_filter.detections import NO_ID, Detections
from dirprim_filter.distributions.angles import wrap
from dirprim_filter.recording import losses
from dirprim_filter.recording.container.log import Scan
from dirprim_filter.recording.container.message_columns import MessageColumns
from dirprim_filter.recording.decoding.field_columns import MAX_NAME_LENGTH, NO_TIME, signed
from dirprim_filter.recording.errors import DamagedRecordingError, DecodeError, warn
from dirprim_filter.recording.objects.options import ReadOptions
from dirprim_filter.recording.objects.stamps import Stamps
from dirprim_filter.recording.objects.twist_axes import TwistAxes
from dirprim_filter.recording.rows import Rows
from dirprim_filter.recording.schemas.decoders import Decoders, batches, by_schema, joined
from dirprim_filter.recording.schemas.family import finite
from dirprim_filter.recording.transforms.frame_change import FrameChange
from dirprim_filter.recording.transforms.geodesy import FARTHEST_M
from dirprim_filter.recording.transforms.transform_tree import SharedTransforms
from dirprim_filter.track_ids import NO_NAMES, repeated_rows, vehicle_numbers


class Observations:
    """Reads the objects of one log once through, and counts what it leaves out.

    Args:
        scan: the messages.
        options: which of them, and how.
        shared: the transforms of logs that are read beside it.

    Attributes:
        losses: what was damaged, left out or odd so far.
        frame: what brings positions into one, with its name and its origin.
    """

    def __init__(self, scan: Scan, options: ReadOptions, shared: SharedTransforms | None = None) -> None:
        self.losses = losses.Losses()
        self._scan = scan
        self._options = options
        self._decoders = Decoders(options.mapping)
        self.frame = FrameChange(
            scan.log, options.frame, options.origin, meets=options.meets, strict=options.strict, shared=shared
        )  # fmt: skip
        self._axes = TwistAxes(scan.log.path)
        topics = {c.topic for c in scan.log.channels() if scan.is_wanted(c.topic) and self._decoders.reads(c)}
        self._are_several = len(topics) > 1
        self._stamps = Stamps(scan.log.path)
        self._open: list[MessageColumns] = []  # whose stamps are not judged yet

    def __iter__(self) -> Iterator[Rows]:
        """Objects in order of log time; messages of other schemas are passed over.

        Raises:
            DamagedRecordingError: strict, and the log is damaged.
            DecodeError: strict, and a message is not what its schema says.
            MissingTransformError: nothing joins the frame of objects to the one asked for.
            RecordingError: stamps run as if they were of another unit.
        """
        columns = self._scan.columns()
        self.losses.damage = self._scan.damage
        held: list[tuple[Rows, IntArray]] = []
        for read in self._read(batches(columns, self._decoders.reads, at_once=self._scan.log.is_live)):
            self._check_intact()
            held.append(read)
            if not self.frame.waits(read[0]):
                yield from self._placed(held)
                held = []
        yield from self._placed(held)
        self.frame.check()
        for note in filter(None, (*sorted(self._decoders.notes), self._stamps.clocks(self.frame.ahead_s))):
            warn(self._scan.log.path, note)
        lost = self.frame.tree.losses
        lost.damage = [broken for broken in lost.damage if broken not in self._scan.damage]
        self.losses += lost
        self._check_intact()

    def _check_intact(self) -> None:
        if self._options.strict and self.losses.damage:
            raise DamagedRecordingError(self._scan.log.path, self.losses.damage)

    def _read(self, read: Iterator[MessageColumns]) -> Iterator[tuple[Rows, IntArray]]:
        for batch in read:
            yield self._timed(joined([*self._open, batch]), is_last=False)
        for batch in self._open:
            yield self._timed(batch, is_last=True)
        self._stamps.end()

    def _timed(self, batch: MessageColumns, *, is_last: bool) -> tuple[Rows, IntArray]:
        """The valid objects of a batch within the wanted time, in their own frames, and (n,) their topics' numbers."""
        parts = []
        for places, messages in by_schema(batch):
            rows, failures = self._decoders.rows(messages)
            if self._options.strict and failures:
                raise DecodeError(self._scan.log.path, messages, failures)
            self.losses.fail(failures.values())
            names = _by_topic(messages, rows) if self._are_several else rows.track_id
            parts.append(replace(rows, track_id=names, message=places[rows.message]))
        rows = Rows.concatenate(parts)
        if len(parts) > 1:
            rows = rows[np.argsort(rows.message, kind="stable")]
        if (source := self._options.time_source) == "header":
            rows = replace(rows, time_ns=self._stamps.times(batch, rows.message, rows.stamp_ns))
            rows = self._usual(batch, rows, is_last=is_last)
        else:
            times = batch.publish_time_ns if source == "publish" else batch.log_time_ns
            rows = replace(rows, time_ns=signed(times)[rows.message])
        rows = rows[self._wanted(rows)]
        if n := np.count_nonzero(negative := rows.speed < 0):
            self.losses.note(losses.NEGATIVE, int(n))
            rows = replace(rows, speed=np.where(negative, np.nan, rows.speed))
        return rows, batch.by_channel(lambda channel: self._axes.topics[channel.topic])[rows.message]

    def _usual(self, batch: MessageColumns, rows: Rows, *, is_last: bool) -> Rows:
        """The rows whose stamps can be, and those without; messages of which more must be known come again."""
        stamped = np.flatnonzero((rows.time_ns == rows.stamp_ns) & (rows.time_ns != NO_TIME))
        usual, is_open = self._stamps.judge(batch, rows.message[stamped], rows.time_ns[stamped], is_last=is_last)
        if usual.all():
            self._open = []
            return rows
        later, kept = np.unique(rows.message[stamped[is_open]]), np.ones(len(rows), np.bool_)
        self._open = [batch[later]] if later.size else []
        kept[stamped] = usual
        given_later = np.isin(rows.message, later)
        self.losses.drop(losses.STRAY, ~kept & ~given_later)
        return rows[kept & ~given_later]

    def _placed(self, held: list[tuple[Rows, IntArray]]) -> Iterator[Rows]:
        """The same objects in one frame, but for those that are not to be had there."""
        for rows, topic in held:
            with np.errstate(all="ignore"):  # transforms of any origin; what is not finite is left out below
                found, placed = self.frame.apply(rows)
            self.losses.drop(losses.UNPLACED, ~placed)
            near = _is_near(found.position)
            self.losses.drop(losses.INVALID if self.frame.origin is None else losses.FAR, placed & ~near)
            if len(good := found[placed & near]):
                yield self._axes.apply(good, topic[placed & near])

    def _wanted(self, rows: Rows) -> BoolArray:
        timed = rows.time_ns != NO_TIME
        self.losses.drop(losses.UNTIMED, np.unique(rows.message[~timed]).size)
        wanted = timed & self._options.wants(rows.time_ns, rows.group, rows.label)
        valid = _is_near(rows.position)
        if rows.track_id.dtype.itemsize // 4 > MAX_NAME_LENGTH:
            valid &= np.asarray(np.strings.str_len(rows.track_id) <= MAX_NAME_LENGTH)
        self.losses.drop(losses.INVALID, wanted & ~valid)
        return np.asarray(wanted & valid)


def _by_topic(messages: MessageColumns, rows: Rows) -> AnyArray:
    """(n,) str, the ids of objects with their topics in front: each vehicle of a fleet calls itself `base_link`."""
    topic = messages.topic[rows.message]
    is_own = (rows.track_id == "") | np.strings.startswith(rows.track_id, topic)  # none, or made of the topic
    return np.where(is_own, rows.track_id, np.strings.add(np.strings.add(topic, "/"), rows.track_id))


def _is_near(position: FloatArray) -> BoolArray:
    """(n,) where it is finite and on the Earth."""
    return np.asarray((np.abs(position[:, 0]) <= FARTHEST_M) & (np.abs(position[:, 1]) <= FARTHEST_M))


HELD_BYTES, ROW_BYTES = 1 << 24, 1 << 8
"""So much of a log waits to be put in order of time, as sensors are late by different times: a row takes `ROW_BYTES`
and its id, so 50,000 rows."""
LIVE_LATEST_NS = 100_000_000
"""So much later than others of later stamps may messages of a live pipe come, whose estimates are as much later."""
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
        self.losses = losses.Losses()

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
            RecordingError: stamps run as if they were of another unit.
        """
        observations = Observations(self._scan, self._options)
        self.losses = observations.losses
        done_ns, n_rows, rest = -(1 << 63), 0, Detections.none()
        for batch in observations:
            in_order = batch.time_ns >= done_ns
            self.losses.drop(losses.TOO_LATE if self._scan.log.is_live else losses.BACKWARD, ~in_order)
            own = self._detections(batch)[in_order].on_plane(observations.frame.origin)
            seen = self._without_repeats(Detections.concatenate([rest, own]))
            done_ns, n_rows = max(done_ns, self._known_until(seen)), n_rows + len(batch)
            is_whole = seen.time_ns < done_ns
            yield from seen[is_whole].frames()
            rest = seen[~is_whole]  # what follows may be earlier, or of the last instant too
        yield from rest.frames()
        self.losses.doubt_ids(n_rows)
        self.losses.log(self._scan.log.path)

    def _known_until(self, seen: Detections) -> int:
        """Before which time nothing is waited for."""
        if not len(seen):
            return -(1 << 63)
        if self._scan.log.is_live:
            return int(seen.time_ns.max()) - LIVE_LATEST_NS
        n_ready = len(seen) - HELD_BYTES // (ROW_BYTES + seen.track_id.itemsize)
        return int(np.partition(seen.time_ns, n_ready)[n_ready]) if n_ready > 0 else int(seen.time_ns.min())

    def _detections(self, rows: Rows) -> Detections:
        """What of a batch may be used: covariances that are none, or of zeros, leave the filter its own noise."""
        is_one_world = self._options.group is not None  # the group that was asked for goes under its own ids
        known_cue = np.isfinite(rows.cue).all(axis=1) & (rows.cue[:, 1] >= 0) & (rows.cue[:, 1] <= SHARPEST)
        motion: dict[str, Any] = {}
        if self._motion:
            motion = {"direction": wrap(finite(rows.direction, np.nan)), "speed": finite(rows.speed, np.nan)}
        return Detections(
            track_id=np.where(np.isin(rows.track_id, NO_NAMES), NO_ID, rows.track_id), time_ns=rows.time_ns,
            position=rows.position, size=rows.size, confidence=rows.confidence,
            covariance=known_covariances(rows.covariance),
            cue=np.where(known_cue[:, None], rows.cue, np.nan) if known_cue.any() else np.empty((0, 2)),
            group=np.zeros_like(rows.group) if is_one_world else rows.group, **motion,
        )  # fmt: skip

    def _without_repeats(self, seen: Detections) -> Detections:
        """Of the rows of a vehicle and an instant the first; all of those that have no name."""
        vehicle = vehicle_numbers(seen.track_id, seen.group) if seen.group.any() else seen.track_id
        repeated = repeated_rows(vehicle, seen.time_ns) & (seen.track_id != NO_ID)
        self.losses.drop(losses.REPEATED, repeated)
        return seen[~repeated] if repeated.any() else seen
