"""The main loop: a log's detections, frame by frame, through the filter to whoever listens."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence

import numpy as np

from dirprim_filter.detections import Detections
from dirprim_filter.estimates import Estimates, EstimateSink, Particles, TrackedFrame
from dirprim_filter.filtering import Tracker


def replay(stream: Iterable[Detections], tracker: Tracker, sinks: Sequence[EstimateSink]) -> int:
    """Track the vehicles of a stream; nothing of it is kept.

    Args:
        stream: frames of one instant each, ascending in time.
        tracker: holds the beliefs; they are those of the last frame when the loop ends.
        sinks: take every tracked frame, in the order given.

    Returns:
        The number of frames.

    Raises:
        ValueError: a frame of several instants, a repeated id, or time going backwards.
    """
    n_frames = 0
    for detections in stream:
        tracker.predict(detections)  # hallucinate: direction and speed from the primitive (Eq. 4), one step on
        tracker.weigh()  # by the measured positions
        frame = TrackedFrame(
            time_ns=int(detections.time_ns[0]),
            detections=detections,
            estimates=tracker.estimate(),
            particles=tracker.particles(),
            innovations=tracker.innovations(),
            begun_anew=tracker.begun_anew(),
        )
        tracker.resample()
        for sink in sinks:
            sink.write(frame)
        n_frames += 1
    return n_frames


def recorded_frames(estimates: Estimates, detections: Detections) -> Iterator[TrackedFrame]:
    """The frames of a run that was written down, ascending in time; its particles are gone.

    Args:
        estimates: of the whole run.
        detections: what was reported; of times at which nothing is believed there is no frame.
    """
    reported = {int(frame.time_ns[0]): frame for frame in detections.frames()}
    order = np.argsort(estimates.time_ns, kind="stable")
    times, starts = np.unique(estimates.time_ns[order], return_index=True)
    empty = np.empty(0)
    gone = Particles(
        position=np.empty((0, 2)), direction=empty, speed=empty, weight=empty, vehicle=np.empty(0, np.int64)
    )
    for time_ns, rows in zip(times.tolist(), np.split(order, starts[1:]), strict=True):
        yield TrackedFrame(
            time_ns=time_ns,
            detections=reported.get(time_ns, Detections.none()),
            estimates=estimates[rows],
            particles=gone,
        )
