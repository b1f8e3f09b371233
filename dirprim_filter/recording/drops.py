"""What of the readable messages of a log was left out, and what is odd about their times."""

from __future__ import annotations

from collections import Counter
from dataclasses import dataclass, field, fields
from typing import Self

import numpy as np

from dirprim_filter.recording.schemas.shredded import NO_TIME
from tessellation.arrays import IntArray

LONG_STEP_NS = 10_000_000_000
"""A topic that is silent for longer than this has a clock that jumped, or a gap: worth telling."""

_WORDS = {
    "undecodable": "messages that cannot be decoded",
    "untimed": "messages without a usable time",
    "invalid": "rows with a position that is not finite or an overlong id",
    "repeated": "rows that repeat a vehicle and a time",
    "backward": "rows out of order in time",
    "alone": "rows too far from others in time to derive a velocity",
    "unplaced": "rows of a time for which no transform of their frame is known",
}


@dataclass(slots=True, kw_only=True)
class Drops:
    """What of the readable messages was left out, counted.

    Attributes:
        undecodable: messages that are not what their schema says.
        untimed: messages without a time of the chosen source, or with one beyond int64.
        invalid: rows whose position is not finite, or whose id is longer than `MAX_NAME_LENGTH`.
        repeated: rows of a vehicle at a time at which it had a row already.
        backward: rows of a time before one that was delivered already.
        alone: rows too far in time from others of their track to derive a velocity.
        unplaced: rows of a time before, after or in a long gap of the transforms of their frame.
        reasons: why messages could not be decoded, how often each.
    """

    undecodable: int = 0
    untimed: int = 0
    invalid: int = 0
    repeated: int = 0
    backward: int = 0
    alone: int = 0
    unplaced: int = 0
    reasons: Counter[str] = field(default_factory=Counter)

    def __iadd__(self, other: Self) -> Self:
        for name in _WORDS:
            setattr(self, name, getattr(self, name) + getattr(other, name))
        self.reasons += other.reasons
        return self

    @property
    def total(self) -> int:
        """Messages and rows left out."""
        return sum(getattr(self, name) for name in _WORDS)

    def __str__(self) -> str:
        told = [f"{getattr(self, name)} {text}" for name, text in _WORDS.items() if getattr(self, name)]
        why = "; ".join(f"{n} x {reason}" for reason, n in self.reasons.most_common(3))
        return (", ".join(told) or "nothing") + (f" ({why})" if why else "")


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
        for f in fields(self):
            setattr(self, f.name, getattr(self, f.name) + getattr(other, f.name))
        return self

    @property
    def is_odd(self) -> bool:
        """Whether something is to be told."""
        return bool(self.zero > 1 or self.backward or self.jumps)

    def __str__(self) -> str:
        seconds = LONG_STEP_NS // 1_000_000_000
        return (
            f"{self.zero} times of zero, {self.backward} that go back, {self.duplicate} that repeat the last one, "
            f"{self.jumps} more than {seconds} s after it"
        )

    def watch(self, time_ns: IntArray, last_ns: int) -> int:
        """Count what is odd in the next times of a channel; the last of them.

        Args:
            time_ns: (n,) nanoseconds, `NO_TIME` where there is none.
            last_ns: the time before them, `NO_TIME` at first.
        """
        known = time_ns[time_ns != NO_TIME]
        if known.size == 0:
            return last_ns
        times = known if last_ns == NO_TIME else np.concatenate([[last_ns], known])
        before, after = times[:-1], times[1:]
        self.zero += int((known == 0).sum())
        self.backward += int((after < before).sum())
        self.duplicate += int((after == before).sum())
        self.jumps += int((after.astype(np.float64) - before.astype(np.float64) > LONG_STEP_NS).sum())
        return int(times[-1])
