"""The main loop: a log's detections, frame by frame, through the filter to whoever listens."""

from __future__ import annotations

from collections.abc import Iterable, Sequence

from dirprim_filter.detections import Detections
from dirprim_filter.estimates import EstimateSink
from dirprim_filter.filtering import Tracker, Worlds


def replay(stream: Iterable[Detections], tracker: Tracker | Worlds, sinks: Sequence[EstimateSink]) -> int:
    """Track the vehicles of a stream; nothing of it is kept.

    Args:
        stream: frames of one instant each, ascending in time.
        tracker: holds the beliefs; they are those of the last frame when the loop ends. A stream of several groups
            needs one for each: `Worlds`.
        sinks: take every tracked frame, in the order given.

    Returns:
        The number of frames.

    Raises:
        ValueError: a frame of several instants, a repeated id, or time going backwards.
    """
    n_frames = 0
    for detections in stream:
        tracker.predict(detections)  # one step on, by the manoeuvres of the map
        tracker.weigh()  # by the measured positions
        frame = tracker.frame()
        for sink in sinks:
            sink.write(frame)
        tracker.resample()
        n_frames += 1
    return n_frames
