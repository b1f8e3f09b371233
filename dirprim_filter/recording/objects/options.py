"""How the objects of logs are read: one value for the command line, the store and Python."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Literal, Self

import numpy as np

from dirprim_filter.arrays import AnyArray, BoolArray, IntArray
from dirprim_filter.origin import Origin
from dirprim_filter.recording.name_patterns import matching
from dirprim_filter.recording.schemas.family import FieldMapping

TimeSource = Literal["log", "publish", "header"]
"""Which of a message's times counts: of logging, of publishing, or the stamp that its contents carry; of topics
without stamps that of logging."""


class FromStart(int):
    """Nanoseconds from the first time of a log, whichever that is."""


@dataclass(frozen=True, slots=True, kw_only=True)
class ReadOptions:
    """Which of a log's messages are read, and how.

    Attributes:
        topics: name of the topic, or a regular expression that matches topics in full. Left out: one topic,
            by what its schema holds: `dirprim.Observations` before ASAM OSI before `foxglove.SceneUpdate`; of
            several of one kind the one with most messages, `/detections...` last, `/dirprim/...` never; or all topics
            of one schema whose messages are of one body each, as of a fleet. Of several topics ids are `topic/id`.
        time_source: which time of a message counts.
        start_ns: the first time wanted, nanoseconds; or `FromStart`.
        end_ns: the first time no longer wanted, likewise.
        strict: raise at the first damage instead of going on.
        frame: in which frame positions are wanted; left out: the root of the tree of the log's transforms, which
            must not be a vehicle's. Without transforms all objects must be of one frame.
        mapping: where to find the fields of objects, for schemas that are not known.
        origin: of the plane for satellite positions; left out: the median of the first ones. Positions in metres are
            of this plane then.
        meets: the name of a map or a log whose origin, or lack of one, `origin` is: a log of the other kind, metres or
            satellite positions, is refused. Left out: the origin holds whatever the log says.
        labels: what the wanted objects are, such as "car|truck": a name or a regular expression for the label that
            their schema gives them, which is empty where it gives none.
        group: the one that is wanted of those that a log holds, by its number there: recordings made apart, whose
            times may overlap. Left out: all; an id that stands in several of them is a vehicle in each.
        format: of tables, and what they do not contain: `trajnet,frames_per_second=25`, `sdd,metres_per_pixel=0.04`; or
            how they call their columns: `csv,x_m=Easting,track_id=Id`. Left out: as the ends of their names say.
    """

    topics: str | None = None
    time_source: TimeSource = "header"
    start_ns: int | None = None
    end_ns: int | None = None
    strict: bool = False
    frame: str | None = None
    mapping: FieldMapping | None = None
    origin: Origin | None = None
    meets: str = ""
    labels: str | None = None
    group: int | None = None
    format: str | None = None

    def of_log(self, first_ns: int | None) -> Self:
        """The same for a log with that first time: times are then its own."""
        start_ns, end_ns = (
            int(at) + (first_ns or 0) if isinstance(at, FromStart) else at for at in (self.start_ns, self.end_ns)
        )
        return replace(self, start_ns=start_ns, end_ns=end_ns)

    def wants(self, time_ns: IntArray, group: IntArray, label: AnyArray) -> BoolArray:
        """(n,) which rows are of the wanted time, group and labels; times are the log's own, as `of_log` makes them.

        Raises:
            ValueError: `labels` is no regular expression.
        """
        wanted = np.ones(time_ns.size, np.bool_) if self.group is None else group == self.group
        if self.start_ns is not None:
            wanted &= time_ns >= self.start_ns
        if self.end_ns is not None:
            wanted &= time_ns < self.end_ns
        if self.labels is not None:
            names, of = np.unique(label, return_inverse=True)
            wanted &= np.array([*map(matching(self.labels, of="labels"), names.tolist())], np.bool_)[of]
        return wanted


EVERYTHING = ReadOptions()
