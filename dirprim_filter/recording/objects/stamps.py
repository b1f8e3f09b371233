"""Which stamps of a log can be: those about as far from log time as others near them on their topic.

Clocks may be of any epoch, differ from topic to topic, drift, be set anew or run at another rate than log time; several
sensors of a topic may be late by different times. A stamp that hardly any of its neighbours agrees with is wrong, and
one that is years ahead would end the tracking of all that follows.
"""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Mapping
from pathlib import Path

import numpy as np

from dirprim_filter.arrays import BoolArray, FloatArray, IntArray
from dirprim_filter.recording.container.message_columns import MessageColumns
from dirprim_filter.recording.decoding.field_columns import NO_TIME, signed
from dirprim_filter.recording.errors import RecordingError
from dirprim_filter.track_ids import Numbers, rows_of_each

RUNS_ON_NS = 10_000_000_000
"""A clock that begins at most so long after 0 may have begun at 0."""
NEIGHBOURS = 50
"""So many messages of the topic before a stamp, and as many after it, are asked."""
AGREEING = 0.25
"""Share of them that must agree."""
NEAR_S = 10.0
"""Offsets that differ by less agree; where those of a topic spread, by less than all but so many at both ends do."""
FEWEST = 3
"""Of fewer stamps it is unknown which is wrong; nor is it known where no two agree."""
LATEST_S = 3.0
"""Sensors are not late by more: topics whose offsets differ by more have other clocks, or wait for what they send."""
ENOUGH_S, ENOUGH, FEWEST_PACED = 20.0, 100, 10
"""Seconds and messages that are waited for, and messages of which a pace is taken at the end of a log."""
NEAR_PACE = 2.0
"""A pace is a power of 1000 where it is off by less than this factor."""
OFTEN_S = 0.005
"""No sensor reports so often: where log times do they are those of a conversion, or themselves in another unit."""
UNITS = {
    1e-3: "microseconds", 1e-6: "milliseconds", 1e-9: "seconds",
    1e3: "milliseconds", 1e6: "microseconds", 1e9: "nanoseconds",
}  # fmt: skip
"""Of numbers that were taken for nanoseconds, or for seconds, by their pace."""

Verdict = tuple[BoolArray, BoolArray]
"""Which of some stamps can be; and which cannot so far, but messages to come may agree."""


class Stamps:
    """The stamps of a log, as they come."""

    def __init__(self, path: Path) -> None:
        self._path = path
        self._first_ns: dict[str, int] = {}  # of each topic; `NO_TIME` where its first messages have none
        self._topics: defaultdict[str, _TopicStamps] = defaultdict(_TopicStamps)

    def times(self, batch: MessageColumns, message: IntArray, stamp_ns: IntArray) -> IntArray:
        """(n,) the times of rows: their stamps, `NO_TIME` where these were not set; log times on topics without stamps.

        Args:
            batch: the messages.
            message: (n,) of the batch that each row is of.
            stamp_ns: (n,) what the rows carry.
        """
        channel, has_stamp = batch.channel[message], (stamp_ns != NO_TIME) & (stamp_ns != 0)
        first, backwards = np.full(len(batch.channels), NO_TIME), np.flatnonzero(has_stamp)[::-1]
        first[channel[backwards]] = stamp_ns[backwards]
        for i in np.flatnonzero(np.bincount(channel)).tolist():
            first[i] = self._first_ns.setdefault(batch.channels[i].topic, int(first[i]))
        begun = first[channel]
        is_unset = (stamp_ns == 0) & (begun > RUNS_ON_NS)  # the clock does not run on from 0
        return np.where(begun == NO_TIME, signed(batch.log_time_ns)[message], np.where(is_unset, NO_TIME, stamp_ns))

    def judge(self, batch: MessageColumns, message: IntArray, stamp_ns: IntArray, *, is_last: bool) -> Verdict:
        """Whether stamps can be, that of most rows of a message for all of it.

        Args:
            batch: messages that were left open, which are given again, then new ones.
            message: (k,) of the batch that each stamp is of, ascending,
            stamp_ns: (k,) and the stamp.
            is_last: no more messages come, so nothing stays open.

        Raises:
            RecordingError: they run as if they were of another unit.
        """
        offset_s = (stamp_ns - batch.log_time_ns[message].astype(np.float64)) * 1e-9
        begin = np.flatnonzero(np.diff(message, prepend=-1))
        if not begin.size:
            return np.zeros(0, np.bool_), np.zeros(0, np.bool_)
        count, order = np.diff(begin, append=message.size), np.arange(message.size)
        spread_s = np.maximum.reduceat(offset_s, begin) - np.minimum.reduceat(offset_s, begin)
        if (spread_s > NEAR_S).any():
            order = np.lexsort((offset_s, message))
        middle = order[begin + (count - 1) // 2]
        middle_s = offset_s[middle]
        numbers = Numbers()
        topic = batch.by_channel(lambda channel: numbers[channel.topic])[message[begin]]
        names = list(numbers)
        usual, left_open, near_s = np.zeros(begin.size, np.bool_), np.zeros(begin.size, np.bool_), np.zeros(begin.size)
        for own in rows_of_each(topic):
            name = names[topic[own[0]]]
            usual[own], left_open[own] = self._topics[name].judge(middle_s[own], is_last=is_last)
            near_s[own] = self._topics[name].near_s
            known = middle[own[usual[own]]]
            self._run(name, batch.log_time_ns[message[known]].astype(np.int64), stamp_ns[known], is_last=False)
        usual, left_open, middle_s, near_s = (np.repeat(of, count) for of in (usual, left_open, middle_s, near_s))
        return usual & (np.abs(offset_s - middle_s) <= near_s), left_open

    def end(self) -> None:
        """No more come: judge the paces of few, too, and raise as `judge` does."""
        for name in self._topics:
            self._run(name, *np.empty((2, 0), np.int64), is_last=True)

    def _run(self, topic: str, log_ns: IntArray, stamp_ns: IntArray, *, is_last: bool) -> None:
        if wrong := self._topics[topic].pace.wrong_unit(log_ns, stamp_ns, is_last=is_last):
            raise RecordingError(f"{self._path}: stamps of {topic} {wrong}")

    def clocks(self, transforms: Mapping[str, float]) -> str:
        """What is odd with the clocks of what is read together, some by log time; empty where they agree.

        Args:
            transforms: that were used, by name, and by how many seconds their stamps are ahead of log time.
        """
        by_log_time = [(0.0, name) for name, first_ns in self._first_ns.items() if first_ns == NO_TIME]
        others = [*by_log_time, *((ahead_s, name) for name, ahead_s in transforms.items())]
        ahead = sorted([(of.usual_s, name) for name, of in self._topics.items()] + others)
        if not self._topics or (apart_s := ahead[-1][0] - ahead[0][0]) <= LATEST_S:
            return ""
        first, last = ahead[0][1], ahead[-1][1]
        way = "--time-source log reads both by log time"
        if {first, last} & transforms.keys():
            way = "objects are placed as of that other time, so mend the stamps of one"
        clocks = "are they of another clock, one simulated?"
        return f"times of {last} are {apart_s:.0f} s ahead of those of {first}: {clocks} {way}"


class _TopicStamps:
    """Those of one topic, by their offsets to log time."""

    def __init__(self) -> None:
        self._offset_s, self._is_open = np.empty(0), np.empty(0, np.bool_)  # of the last `NEIGHBOURS`
        self.near_s, self.pace = NEAR_S, Pace()

    @property
    def usual_s(self) -> float:
        """The offset of the last ones, in the median."""
        return float(np.median(self._offset_s))

    def judge(self, offset_s: FloatArray, *, is_last: bool) -> Verdict:
        """As of all, by (k,) seconds from log time to the stamps: first of those left open, then of new ones."""
        n_open = int(self._is_open.sum())
        offset_s = np.concatenate([self._offset_s, offset_s[n_open:]])
        asked = np.concatenate([self._is_open, np.ones(offset_s.size - self._offset_s.size, np.bool_)])
        is_usual = self._is_usual(offset_s, is_last=is_last)
        is_late = np.arange(offset_s.size) >= offset_s.size - NEIGHBOURS
        is_open = asked & ~is_usual & is_late & (not is_last)
        self._offset_s, self._is_open = offset_s[-NEIGHBOURS:], is_open[-NEIGHBOURS:]
        return is_usual[asked], is_open[asked]

    def _is_usual(self, offset_s: FloatArray, *, is_last: bool) -> BoolArray:
        n = offset_s.size
        if n < FEWEST:
            return np.full(n, is_last)
        if np.ptp(offset_s) <= NEAR_S:
            return np.ones(n, np.bool_)
        sorted_s, tail = np.sort(offset_s), int(np.ceil(AGREEING * (n - 1)))
        self.near_s = max(NEAR_S, float(sorted_s[n - 1 - tail] - sorted_s[tail]))
        n_agreeing, n_asked = np.zeros((2, n))
        for step in range(1, min(NEIGHBOURS, n - 1) + 1):
            agrees = np.abs(offset_s[step:] - offset_s[:-step]) <= self.near_s
            for one in (slice(step, None), slice(None, -step)):
                n_agreeing[one] += agrees
                n_asked[one] += 1
        usual = np.asarray(n_agreeing >= np.maximum(AGREEING * n_asked, 1))
        return usual | (is_last and not usual.any())


class Pace:
    """How fast the stamps of a topic run beside log time: those in another unit run by a power of 1000."""

    def __init__(self) -> None:
        self._log_ns, self._stamp_ns = np.empty((2, 0), np.int64)
        self._is_known = False

    def wrong_unit(self, log_ns: IntArray, stamp_ns: IntArray, *, is_last: bool) -> str:
        """What is wrong by the messages so far, of which (k,) are new; empty where nothing is, or more are needed.

        A step of the clock is no pace: it is the median across a quarter of the messages.
        """
        if self._is_known:
            return ""
        self._log_ns = np.concatenate([self._log_ns, log_ns])
        self._stamp_ns = np.concatenate([self._stamp_ns, stamp_ns])
        n = self._log_ns.size
        if n < FEWEST_PACED:
            return ""
        span_s = float(np.ptp(self._log_ns)) * 1e-9
        if not is_last and (n < ENOUGH or span_s < ENOUGH_S):
            return ""
        self._is_known, lag = True, n // 4
        passed, ran = ((of[lag:] - of[:-lag]).astype(np.float64) for of in (self._log_ns, self._stamp_ns))
        pace, logged_s = float(np.median(ran / np.maximum(passed, 1.0))), span_s / n
        for factor, unit in UNITS.items() if logged_s >= OFTEN_S else ():
            if factor / NEAR_PACE < pace < factor * NEAR_PACE and (factor > 1 or logged_s * factor < OFTEN_S):
                way = "time= takes whole nanoseconds, time_s= seconds; --time-source log does without"
                return f"run {pace:.2g} times as fast as log time: are they {unit}? {way}"
        return ""
