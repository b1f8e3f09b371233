"""What of the readable messages of a log was left out, and what is odd about their times."""

from __future__ import annotations

from collections import Counter
from collections.abc import Collection
from dataclasses import dataclass, field
from typing import Self

import numpy as np

from dirprim_filter.arrays import IntArray
from dirprim_filter.recording.container.message_columns import MessageColumns
from dirprim_filter.recording.decoding.field_columns import NO_TIME
from dirprim_filter.track_ids import Numbers

LONG_STEP_NS = 10_000_000_000
"""A topic that is silent for longer than this has a clock that jumped, or a gap: worth telling."""

_WORDS = {
    "undecodable": "messages that cannot be decoded",
    "untimed": "messages without a usable time",
    "invalid": "rows with a position that is none or an overlong id",
    "repeated": "rows that repeat a vehicle and a time",
    "backward": "rows out of order in time",
    "alone": "rows too far from others in time to derive a velocity",
    "unplaced": "rows of a time for which no transform of their frame is known",
    "transforms": "transforms that are not finite, or place a frame in itself",
}


@dataclass(slots=True, kw_only=True)
class Drops:
    """What of the readable messages was left out, counted.

    Attributes:
        undecodable: messages that are not what their schema says, those of transforms among them.
        untimed: messages without a time of the chosen source, or with one beyond int64.
        invalid: rows whose position is not finite, beyond `FARTHEST_M` or no fix; or whose id is longer than
            `MAX_NAME_LENGTH`.
        repeated: rows of a vehicle at a time at which it had a row already.
        backward: rows of a time before one that was delivered already.
        alone: rows too far in time from others of their track to derive a velocity.
        unplaced: rows of a time before, after or in a long gap of the transforms of their frame.
        transforms: transforms that are not finite, turn by no rotation, or place a frame in itself.
        reasons: why messages could not be decoded, how often each.
    """

    undecodable: int = 0
    untimed: int = 0
    invalid: int = 0
    repeated: int = 0
    backward: int = 0
    alone: int = 0
    unplaced: int = 0
    transforms: int = 0
    reasons: Counter[str] = field(default_factory=Counter)

    def __iadd__(self, other: Self) -> Self:
        for name in _WORDS:
            setattr(self, name, getattr(self, name) + getattr(other, name))
        self.reasons += other.reasons
        return self

    def fail(self, reasons: Collection[str]) -> None:
        """Count messages that cannot be decoded, each for its reason."""
        self.undecodable += len(reasons)
        self.reasons.update(reasons)

    @property
    def total(self) -> int:
        """Messages and rows left out."""
        return sum(getattr(self, name) for name in _WORDS)

    @property
    def lost(self) -> int:
        """Those left out for a fault of theirs; a row alone in time has none, it only has no motion."""
        return self.total - self.alone

    def __str__(self) -> str:
        counts = [f"{getattr(self, name)} {text}" for name, text in _WORDS.items() if getattr(self, name)]
        why = "; ".join(f"{n} x {reason}" for reason, n in self.reasons.most_common(3))
        return (", ".join(counts) or "nothing") + (f" ({why})" if why else "")


@dataclass(slots=True, kw_only=True)
class ClockFaults:
    """What is odd about the times of messages, each compared with the one before on its channel; none is left out.

    Attributes:
        zero: times of 0: in ROS a stamp that was not set.
        backward: times before the last one.
        duplicate: times equal to the last one; usual where each object has a message of its own.
        jumps: times more than `LONG_STEP_NS` after the last one.
    """

    zero: int = 0
    backward: int = 0
    duplicate: int = 0
    jumps: int = 0

    def __iadd__(self, other: Self) -> Self:
        for name in ("zero", "backward", "duplicate", "jumps"):
            setattr(self, name, getattr(self, name) + getattr(other, name))
        return self

    @property
    def is_odd(self) -> bool:
        """Whether something is to be reported."""
        return bool(self.zero > 1 or self.backward or self.jumps)

    def __str__(self) -> str:
        odd = (
            (self.zero, "of zero"), (self.backward, "before the last one"), (self.duplicate, "equal to the last one"),
            (self.jumps, f"more than {LONG_STEP_NS // 1_000_000_000} s after the one before"),
        )  # fmt: skip
        return ", ".join(f"{n} {'times' if n > 1 else 'time'} {what}" for n, what in odd if n)


class Clock:
    """Watches the times of a log's messages as they come.

    Attributes:
        faults: what was odd so far.
    """

    def __init__(self) -> None:
        self.faults = ClockFaults()
        self._topics = Numbers()
        self._last_ns = np.empty(0, np.int64)

    def watch_objects(self, messages: MessageColumns, message: IntArray, time_ns: IntArray) -> None:
        """Count what is odd in the times of objects, of which those of a message share one.

        Args:
            messages: of which the objects are.
            message: (n,) which message each object is of, ascending.
            time_ns: (n,) nanoseconds, `NO_TIME` where there is none.
        """
        of, first = np.unique(message, return_index=True)
        numbers = np.array([self._topics[channel.topic] for channel in messages.channels], np.int64)
        self.watch(numbers[messages.channel[of]], time_ns[first])

    def watch(self, topic: IntArray, time_ns: IntArray) -> None:
        """Count what is odd in the next times of topics.

        Args:
            topic: (n,) number of the topic of each message, from 0.
            time_ns: (n,) nanoseconds, `NO_TIME` where there is none.
        """
        known = time_ns != NO_TIME
        n = int(topic.max(initial=-1)) + 1
        if n > self._last_ns.size:
            self._last_ns = np.concatenate([self._last_ns, np.full(n - self._last_ns.size, NO_TIME)])
        seen = np.flatnonzero(self._last_ns != NO_TIME)
        topics = np.concatenate([seen, topic[known]])
        times = np.concatenate([self._last_ns[seen], time_ns[known]])
        order = np.argsort(topics, kind="stable")
        topics, times = topics[order], times[order]
        same = topics[1:] == topics[:-1]
        before, after = times[:-1][same], times[1:][same]
        self.faults += ClockFaults(
            zero=int((time_ns == 0).sum()),
            backward=int((after < before).sum()),
            duplicate=int((after == before).sum()),
            jumps=int((after.astype(np.float64) - before.astype(np.float64) > LONG_STEP_NS).sum()),
        )
        self._last_ns[topics] = times  # the last of a topic is written last
