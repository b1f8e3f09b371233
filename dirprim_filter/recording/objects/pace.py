"""How fast the stamps of a topic run beside log time: stamps in another unit than was stated run by a power of 1000."""

from __future__ import annotations

import numpy as np

from dirprim_filter.arrays import IntArray

ENOUGH_S, ENOUGH, FEWEST = 20.0, 100, 10
"""Seconds and messages that are waited for, and messages of which a pace is taken at the end of a log."""
NEAR = 2.0
"""A pace is a power of 1000 where it is off by less than this factor."""
OFTEN_S = 0.005
"""No sensor reports so often: where log times do they are those of a conversion, or themselves in another unit."""
UNITS = {
    1e-3: "microseconds", 1e-6: "milliseconds", 1e-9: "seconds",
    1e3: "milliseconds", 1e6: "microseconds", 1e9: "nanoseconds",
}  # fmt: skip
"""Of numbers that were taken for nanoseconds, or for seconds, by their pace."""


class Pace:
    """That of one topic."""

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
        if n < FEWEST:
            return ""
        span_s = float(np.ptp(self._log_ns)) * 1e-9
        if not is_last and (n < ENOUGH or span_s < ENOUGH_S):
            return ""
        self._is_known, lag = True, n // 4
        passed, ran = ((of[lag:] - of[:-lag]).astype(np.float64) for of in (self._log_ns, self._stamp_ns))
        return _wrong_unit(float(np.median(ran / np.maximum(passed, 1.0))), span_s / n)


def _wrong_unit(pace: float, logged_s: float) -> str:
    """By a pace of stamps whose messages are logged so many seconds apart."""
    if logged_s < OFTEN_S:
        return ""
    for factor, unit in UNITS.items():
        if factor / NEAR < pace < factor * NEAR and (factor > 1 or logged_s * factor < OFTEN_S):
            way = "time= takes whole nanoseconds, time_s= seconds"
            return f"run {pace:.2g} times as fast as log time: are they {unit}? {way}; --time-source log does without"
    return ""
