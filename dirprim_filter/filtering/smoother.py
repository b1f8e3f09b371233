"""Smoothed estimates: each frame is estimated again from the measurements before and after it.

A measurement hardly changes estimates of long before it. So a sweep over a few seconds is as good as one over the whole
log, and memory does not grow with its length.
"""

from __future__ import annotations

from bisect import bisect_right
from collections import deque
from collections.abc import Callable, Sequence
from dataclasses import replace
from types import TracebackType
from typing import Any, Self

import numpy as np

from dirprim_filter.arrays import FloatArray
from dirprim_filter.estimates import Estimates, Particles, TrackedFrame
from dirprim_filter.filtering.measurements import with_unseen_errors
from dirprim_filter.filtering.protocols import BayesFilter
from dirprim_filter.filtering.smoothing.chain import Chain, Smoothed
from dirprim_filter.filtering.smoothing.recorder import Recorder
from dirprim_filter.filtering.stitching import stitch
from dirprim_filter.filtering.tracker import Tracker
from dirprim_filter.primitives.primitive_map import PrimitiveMap

WHOLE_S = 30.0
"""Measurements so long after an instant do not change its estimate; the longest gap is added."""
STANDING_SPEED = 0.1
"""m/s: a slower velocity has no direction, and the filter's direction is used."""


class Smoother:
    """An `EstimateSink` that passes each frame on, smoothed, once its later measurements are in; a context manager.

    When the context ends, the remaining frames are passed on.

    A vehicle is reported from its first measurement to its last; an unlabelled track only if the filter confirmed it,
    then from its first measurement too.

    Args:
        lag_s: seconds by which frames are late, at least 0. Left out: as long as anything can be learned.
        sinks: take the smoothed frames, in order of time.
        joins_labelled: tracks whose ids were given are pieces that may be joined too.

    Attributes:
        sinks: as given; more may be added before the first frame.
        joined: the names of each two pieces that were joined, the earlier first.

    Raises:
        ValueError: a negative lag.
    """

    def __init__(
        self, *, lag_s: float | None = None, sinks: Sequence[Callable[[TrackedFrame], None]] = (),
        joins_labelled: bool = False,
    ) -> None:  # fmt: skip
        if lag_s is not None and not 0 <= lag_s < np.inf:
            raise ValueError(f"lag_s: expected a finite number of seconds, at least 0, got {lag_s}")
        self.sinks = list(sinks)
        self.joined: list[tuple[str, str]] = []
        self._joins_labelled, self._lag_s = joins_labelled, lag_s
        self._frames: deque[TrackedFrame] = deque()
        self._recorded: list[tuple[Tracker, Recorder]] = []

    @property
    def _gap_ns(self) -> int:
        return max(tracker.longest_gap_ns for tracker, _ in self._recorded)

    def tracker(self, group: int, model: PrimitiveMap | BayesFilter, **options: Any) -> Tracker:
        """A tracker of a group, to be followed by this smoother; options and errors as of a `Tracker`.

        Raises:
            ValueError: a filter that has no smoother.
        """
        tracker = Tracker(model, **options)
        self._recorded.append((tracker, tracker.record(group)))
        return tracker

    def write(self, frame: TrackedFrame) -> None:
        """Take a frame of the filter, and pass on what by now can be smoothed."""
        self._frames.append(replace(frame, particles=Particles.none(), innovations=None))
        lag_ns = int(WHOLE_S * 1e9) + self._gap_ns if self._lag_s is None else int(self._lag_s * 1e9)
        every_ns = lag_ns if self._lag_s is None else 0
        final_ns = frame.time_ns - lag_ns
        if self._lag_s is None:
            final_ns = min([final_ns, *(recorder.waits_ns(frame.time_ns) for _, recorder in self._recorded)])
        if final_ns >= self._frames[0].time_ns + every_ns:
            self._pass_on(final_ns, now_ns=frame.time_ns)

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        if self._frames and (kind is None or issubclass(kind, KeyboardInterrupt)):
            last_ns = self._frames[-1].time_ns
            self._pass_on(last_ns, now_ns=last_ns + self._gap_ns + 1)

    def _pass_on(self, final_ns: int, *, now_ns: int) -> None:
        parts: list[Estimates] = []
        open_names = set()
        gap_ns = self._gap_ns
        for tracker, recorder in self._recorded:
            if self._lag_s is None:
                self.joined += stitch(
                    recorder, tracker, before_ns=final_ns + gap_ns, gap_ns=gap_ns, now_ns=now_ns,
                    joins_labelled=self._joins_labelled,
                )  # fmt: skip
            n_final = bisect_right(recorder.frames_ns, final_ns)
            frames_ns = np.array(recorder.frames_ns[:n_final], np.int64)
            del recorder.frames_ns[:n_final]
            chains: list[tuple[Chain, Smoothed]] = []
            for chain in recorder.chains:
                times = frames_ns[chain.reaches(frames_ns)]
                if chain.name and times.size:
                    chains.append((chain, recorder.smoothed(chain, times)))
                if chain.name and not chain.is_over(now_ns, gap_ns):
                    open_names.add(chain.name)
                chain.forget(before_ns=final_ns)
            recorder.chains = [
                chain for chain in recorder.chains
                if chain.last.time_ns >= final_ns or not chain.is_over(final_ns, gap_ns)
            ]  # fmt: skip
            parts.append(with_unseen_errors(_estimates(chains), tracker.sensor))
        smoothed = Estimates.concatenate(parts)
        smoothed = smoothed[np.argsort(smoothed.time_ns, kind="stable")]
        while self._frames and self._frames[0].time_ns <= final_ns:
            frame = self._frames.popleft()
            first, end = np.searchsorted(smoothed.time_ns, [frame.time_ns, frame.time_ns + 1])
            rows = smoothed[np.arange(first, end)].on_plane(frame.estimates.origin)
            waiting = open_names.difference(rows.track_id.astype(np.str_).tolist())  # and may be measured again
            late = np.array([name in waiting for name in frame.names], np.bool_)
            estimates = Estimates.concatenate([rows, frame.estimates[late]]) if late.any() else rows
            for sink in self.sinks:
                sink(replace(frame, estimates=estimates, group=np.empty(0, np.int64)))


def _estimates(chains: list[tuple[Chain, Smoothed]]) -> Estimates:
    """All beliefs of all chains, as estimates."""
    if not chains:
        return Estimates.concatenate([])
    of = Smoothed(*(np.concatenate(columns) for columns in zip(*(beliefs for _, beliefs in chains), strict=True)))
    n_each = [beliefs.time_ns.size for _, beliefs in chains]
    velocity, spread = of.mean[:, 2:], of.covariance[:, 2:, 2:]
    facing = velocity + STANDING_SPEED * of.course
    length = np.hypot(*facing.T) + 1e-12
    along = facing / length[:, None]
    across = np.column_stack([-along[:, 1], along[:, 0]])
    n = of.time_ns.size
    return Estimates(
        track_id=np.repeat([chain.name for chain, _ in chains], n_each), time_ns=of.time_ns, position=of.mean[:, :2],
        covariance=of.covariance[:, :2, :2], direction=np.arctan2(facing[:, 1], facing[:, 0]),
        direction_resultant=np.exp(-0.5 * _variance(across, spread) / length**2), speed=np.hypot(*velocity.T),
        speed_std=np.sqrt(_variance(along, spread)), effective_sample_size=np.ones(n), log_evidence=np.zeros(n),
        existence=np.repeat([chain.existence for chain, _ in chains], n_each),
        unseen_s=np.asarray((of.time_ns - of.measured_ns) * 1e-9, np.float64),
    )  # fmt: skip


def _variance(axis: FloatArray, covariance: FloatArray) -> FloatArray:
    return np.asarray(np.maximum(np.einsum("ni,nij,nj->n", axis, covariance, axis), 0.0))
