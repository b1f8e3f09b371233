"""The objects that a log's messages report, batch by batch, and what had to be left out."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace

import numpy as np

from dirprim_filter.arrays import AnyArray, BoolArray, FloatArray, IntArray
from dirprim_filter.recording.container.log import Scan
from dirprim_filter.recording.container.message_columns import MessageColumns
from dirprim_filter.recording.decoding.field_columns import MAX_NAME_LENGTH, NO_TIME, signed
from dirprim_filter.recording.errors import DamagedRecordingError, DecodeError
from dirprim_filter.recording.losses import INVALID, UNPLACED, UNTIMED, Losses
from dirprim_filter.recording.objects.options import ReadOptions
from dirprim_filter.recording.rows import Rows
from dirprim_filter.recording.schemas.decoders import Decoders, batches, by_schema
from dirprim_filter.recording.transforms.frame_change import FrameChange
from dirprim_filter.recording.transforms.geodesy import FARTHEST_M, Origin

RUNS_ON_NS = 10_000_000_000
"""A clock that begins at most so long after 0 may have begun at 0."""


class Observations:
    """Reads the objects of one log once through, and counts what it leaves out.

    Attributes:
        losses: what was damaged, left out or odd so far.
    """

    def __init__(self, scan: Scan, options: ReadOptions) -> None:
        self.losses = Losses()
        self._scan = scan
        self._options = options
        self._decoders = Decoders(options.mapping)
        self._frame = FrameChange(scan.log, options.frame, options.origin, strict=options.strict)
        topics = {c.topic for c in scan.log.channels() if scan.is_wanted(c.topic) and self._decoders.reads(c)}
        self._are_several = len(topics) > 1
        self._first_stamp: dict[str, int] = {}  # of each topic; `NO_TIME` where its first messages have none

    @property
    def origin(self) -> Origin | None:
        """Of the plane on which satellite positions were put; None where none was needed or given."""
        return self._frame.origin

    @property
    def frame(self) -> str:
        """Of the positions: its name, or the place of the plane they were put on; empty where none is named."""
        if self._frame.origin is not None:
            return "plane at {:.9f},{:.9f}".format(*self._frame.origin)
        return self._frame.target

    def __iter__(self) -> Iterator[Rows]:
        """Objects in order of log time; messages of other schemas are passed over.

        Raises:
            DamagedRecordingError: strict, and the log is damaged.
            DecodeError: strict, and a message is not what its schema says.
            MissingTransformError: nothing joins the frame of objects to the one asked for.
        """
        columns = self._scan.columns()
        self.losses.damage = self._scan.damage
        for batch in batches(columns, self._decoders, at_once=self._scan.log.is_live):
            self._check_intact()
            if len(rows := self._timed(batch)):
                yield rows
        self._frame.check()
        if self._frame.tree is not None:
            self._frame.tree.losses.damage = [
                broken for broken in self._frame.tree.losses.damage if broken not in self._scan.damage
            ]
            self.losses += self._frame.tree.losses
        self._check_intact()

    def _check_intact(self) -> None:
        if self._options.strict and self.losses.damage:
            raise DamagedRecordingError(self._scan.path, self.losses.damage)

    def _timed(self, batch: MessageColumns) -> Rows:
        """The valid objects of a batch within the wanted time."""
        parts = []
        for places, messages in by_schema(batch):
            rows, failures = self._decoders.rows(messages)
            if self._options.strict and failures:
                raise DecodeError.of(self._scan.path, messages, failures)
            self.losses.fail(failures.values())
            time_ns = self._times(messages, rows)
            names = _by_topic(messages, rows) if self._are_several else rows.track_id
            parts.append(replace(rows, time_ns=time_ns, track_id=names, message=places[rows.message]))
        rows = Rows.concatenate(parts)
        if len(parts) > 1:
            rows = rows[np.argsort(rows.message, kind="stable")]
        rows = rows[self._wanted(rows)]
        with np.errstate(all="ignore"):  # transforms of any origin; what is not finite is left out below
            rows, placed = self._frame.apply(rows)
        self.losses.drop(UNPLACED, ~placed)
        near = _is_near(rows.position)
        self.losses.drop(INVALID, placed & ~near)
        return rows[placed & near]

    def _times(self, messages: MessageColumns, rows: Rows) -> IntArray:
        """(n,) the time of each row; `NO_TIME` where it has none that fits into int64."""
        times = messages.publish_time_ns if self._options.time_source == "publish" else messages.log_time_ns
        time_ns = signed(times)[rows.message]
        if self._options.time_source != "header":
            return time_ns
        channel, has_stamp = messages.channel[rows.message], (rows.stamp_ns != NO_TIME) & (rows.stamp_ns != 0)
        first = np.full(len(messages.channels), NO_TIME)
        for i in np.flatnonzero(np.bincount(channel)).tolist():
            stamps = rows.stamp_ns[has_stamp & (channel == i)]
            first[i] = self._first_stamp.setdefault(
                messages.channels[i].topic, int(stamps[0]) if stamps.size else NO_TIME
            )
        begun = first[channel]
        is_unset = (rows.stamp_ns == 0) & (begun > RUNS_ON_NS)  # the clock does not run on from 0
        return np.where(begun == NO_TIME, time_ns, np.where(is_unset, NO_TIME, rows.stamp_ns))

    def _wanted(self, rows: Rows) -> BoolArray:
        timed = rows.time_ns != NO_TIME
        self.losses.drop(UNTIMED, np.unique(rows.message[~timed]).size)
        wanted = timed & self._options.wants(rows.time_ns, rows.group, rows.label)
        valid = _is_near(rows.position)
        if rows.track_id.dtype.itemsize // 4 > MAX_NAME_LENGTH:
            valid &= np.asarray(np.strings.str_len(rows.track_id) <= MAX_NAME_LENGTH)
        self.losses.drop(INVALID, wanted & ~valid)
        return np.asarray(wanted & valid)


def _by_topic(messages: MessageColumns, rows: Rows) -> AnyArray:
    """(n,) str, the ids of objects with their topics in front: each vehicle of a fleet calls itself `base_link`."""
    topic = messages.topic[rows.message]
    is_own = (rows.track_id == "") | np.strings.startswith(rows.track_id, topic)  # none, or made of the topic
    return np.where(is_own, rows.track_id, np.strings.add(np.strings.add(topic, "/"), rows.track_id))


def _is_near(position: FloatArray) -> BoolArray:
    """(n,) where it is finite and on the Earth."""
    return np.asarray((np.abs(position[:, 0]) <= FARTHEST_M) & (np.abs(position[:, 1]) <= FARTHEST_M))
