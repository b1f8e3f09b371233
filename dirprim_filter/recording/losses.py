"""What of a log or a table did not come through, and what is odd about the times of its messages."""

from __future__ import annotations

import logging
from collections import Counter
from collections.abc import Collection
from dataclasses import dataclass, field, fields, replace
from pathlib import Path
from typing import Self

import numpy as np

from dirprim_filter.arrays import BoolArray, IntArray
from dirprim_filter.recording.container.damage import Damage
from dirprim_filter.recording.container.message_columns import MessageColumns
from dirprim_filter.recording.decoding.field_columns import NO_TIME
from dirprim_filter.track_ids import Numbers

logger = logging.getLogger(__name__)

LONG_STEP_NS = 10_000_000_000
"""A topic that is silent for longer than this has a clock that jumped, or a gap: worth telling."""

UNDECODABLE = "messages that cannot be decoded"
UNTIMED = "messages without a usable time"
TRANSFORMS = "transforms that are not finite, or place a frame in itself"
INVALID = "with a position that is none or an overlong id"
REPEATED = "that repeat a vehicle and a time"
BACKWARD = "out of order in time"
UNPLACED = "of a time for which no transform of their frame is known"
ALONE = "alone in time, so that no velocity can be derived"


@dataclass(frozen=True, slots=True, kw_only=True)
class ClockFaults:
    """What is odd about the times of messages, each compared with the one before on its channel; none is left out.

    Attributes:
        zero: times of 0, in ROS stamps that were not set; those of a topic that has but one, or whose clock runs on
            from there, do not count.
        backward: times before the last one.
        duplicate: times equal to the last one; usual where each object has a message of its own.
        jumps: times more than `LONG_STEP_NS` after the last one.
    """

    zero: int = 0
    backward: int = 0
    duplicate: int = 0
    jumps: int = 0

    def __add__(self, other: Self) -> Self:
        return type(self)(**{f.name: getattr(self, f.name) + getattr(other, f.name) for f in fields(self)})

    @property
    def is_odd(self) -> bool:
        """Whether something is to be reported."""
        return bool(self.zero or self.backward or self.jumps)

    def __str__(self) -> str:
        odd = (
            (self.zero, "of zero"), (self.backward, "before the last one"), (self.duplicate, "equal to the last one"),
            (self.jumps, f"more than {LONG_STEP_NS // 1_000_000_000} s after the one before"),
        )  # fmt: skip
        return ", ".join(f"{n} {'times' if n > 1 else 'time'} {what}" for n, what in odd if n)


@dataclass(slots=True, kw_only=True)
class Losses:
    """What of a log or a table did not come through.

    Attributes:
        damage: what of the files could not be read.
        dropped: how many rows, or messages, were left out, by reason.
        why: the reasons why messages could not be decoded, how often each.
        clock: what is odd about the times of the messages; nothing is lost by it.
        notes: what was put right without a loss, and how often.
    """

    damage: list[Damage] = field(default_factory=list)
    dropped: Counter[str] = field(default_factory=Counter)
    why: Counter[str] = field(default_factory=Counter)
    clock: ClockFaults = field(default_factory=ClockFaults)
    notes: Counter[str] = field(default_factory=Counter)

    def __iadd__(self, other: Self) -> Self:
        for f in fields(self):
            setattr(self, f.name, getattr(self, f.name) + getattr(other, f.name))
        return self

    def drop(self, reason: str, left_out: BoolArray | int) -> None:
        """Count the rows of a mask, or so many, that are left out for a reason."""
        if n := int(np.sum(left_out)):
            self.dropped[reason] += n

    def note(self, what: str, n: int) -> None:
        """Count what was put right."""
        if n:
            self.notes[what] += n

    def fail(self, reasons: Collection[str]) -> None:
        """Count messages that cannot be decoded, each for its reason."""
        self.drop(UNDECODABLE, len(reasons))
        self.why.update(reasons)

    def __str__(self) -> str:
        """What was left out."""
        units = dict.fromkeys((UNDECODABLE, UNTIMED, TRANSFORMS), "")
        counts = [f"{n} {units.get(reason, 'rows ')}{reason}" for reason, n in self.dropped.items()]
        why = "; ".join(f"{n} x {reason}" for reason, n in self.why.most_common(3))
        return (", ".join(counts) or "nothing") + (f" ({why})" if why else "")

    def log(self, path: Path) -> None:
        """One warning for what of a file could not be read, one for what was left out, one for odd times."""
        if self.damage:
            more = f", and {len(self.damage) - 1} more" if len(self.damage) > 1 else ""
            logger.warning("%s: damaged, the rest is read: %s%s", path, self.damage[0], more)
        if self.dropped:
            logger.warning("%s: left out %s", path, self)
        if self.clock.is_odd:
            logger.warning("%s: %s", path, self.clock)


class Clock:
    """Watches the times of a log's messages as they come."""

    def __init__(self) -> None:
        self._faults = ClockFaults()
        self._topics = Numbers()
        self._last_ns = np.empty(0, np.int64)
        self._zero = np.empty(0, np.int64)  # times of 0 of each topic
        self._runs_from_zero = np.empty(0, np.bool_)

    @property
    def faults(self) -> ClockFaults:
        """What was odd so far."""
        return replace(self._faults, zero=int(self._zero[(self._zero > 1) & ~self._runs_from_zero].sum()))

    def watch_objects(self, messages: MessageColumns, message: IntArray, time_ns: IntArray) -> None:
        """Count what is odd in the times of objects, of which those of a message share one.

        Args:
            messages: of which the objects are.
            message: (n,) which message each object is of, ascending.
            time_ns: (n,) nanoseconds, `NO_TIME` where there is none.
        """
        of, first = np.unique(message, return_index=True)
        self.watch(messages.by_channel(lambda channel: self._topics[channel.topic])[of], time_ns[first])

    def watch(self, topic: IntArray, time_ns: IntArray) -> None:
        """Count what is odd in the next times of topics.

        Args:
            topic: (n,) number of the topic of each message, from 0.
            time_ns: (n,) nanoseconds, `NO_TIME` where there is none.
        """
        known = time_ns != NO_TIME
        n = int(topic.max(initial=-1)) + 1
        if (more := n - self._last_ns.size) > 0:
            self._last_ns = np.append(self._last_ns, np.full(more, NO_TIME))
            self._zero = np.append(self._zero, np.zeros(more, np.int64))
            self._runs_from_zero = np.append(self._runs_from_zero, np.zeros(more, np.bool_))
        seen = np.flatnonzero(np.bincount(topic[known]))
        seen = seen[self._last_ns[seen] != NO_TIME]
        topics = np.concatenate([seen, topic[known]])
        times = np.concatenate([self._last_ns[seen], time_ns[known]])
        order = np.argsort(topics, kind="stable")
        topics, times = topics[order], times[order]
        same = topics[1:] == topics[:-1]
        before, after = times[:-1][same], times[1:][same]
        self._zero += np.bincount(topic[time_ns == 0], minlength=self._zero.size)
        self._runs_from_zero[topics[1:][same][(before == 0) & (after > 0) & (after <= LONG_STEP_NS)]] = True
        self._faults += ClockFaults(
            backward=int((after < before).sum()),
            duplicate=int((after == before).sum()),
            jumps=int((after.astype(np.float64) - before.astype(np.float64) > LONG_STEP_NS).sum()),
        )
        self._last_ns[topics] = times  # the last of a topic is written last
