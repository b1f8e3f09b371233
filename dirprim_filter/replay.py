"""The main loop: a log's detections, frame by frame, through the filter to whoever listens."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from typing import Any

from dirprim_filter.detections import Detections
from dirprim_filter.estimates import EstimateSink, TrackedFrame
from dirprim_filter.filtering import GroupTracker, Tracker


def replay(
    stream: Iterable[Detections], tracker: Tracker | GroupTracker, sinks: Sequence[EstimateSink], *,
    rate_hz: float | None = None,
) -> int:  # fmt: skip
    """Track the vehicles of a stream; nothing of it is kept.

    Args:
        stream: frames of one instant each, ascending in time.
        tracker: holds the beliefs; they are those of the last frame when the loop ends. A stream of several groups
            needs one for each: `GroupTracker`.
        sinks: take every tracked frame, in the order given.
        rate_hz: between two frames farther apart there are estimates so often, as long as there is a vehicle.

    Returns:
        The number of frames of the stream.

    Raises:
        ValueError: a frame of several instants, a repeated id, or time going backwards.
    """
    n_frames, frame = 0, None
    every_ns = round(1e9 / rate_hz) if rate_hz else 0
    for detections in stream:
        if every_ns and frame is not None and len(detections):
            until_ns = int(detections.time_ns[0]) - every_ns // 2
            while len(frame.estimates) and frame.time_ns + every_ns < until_ns:
                frame = step(tracker, Detections.none(), sinks, time_ns=frame.time_ns + every_ns, is_scan=False)
        frame = step(tracker, detections, sinks)
        n_frames += 1
    return n_frames


def step(
    tracker: Tracker | GroupTracker, detections: Detections, sinks: Sequence[EstimateSink], **at: Any
) -> TrackedFrame:
    """One frame of the loop, for the sinks; `at` and errors as of `Tracker.track`."""
    frame = tracker.track(detections, **at)
    for sink in sinks:
        sink.write(frame)
    return frame
