"""The main loop: a log's detections, frame by frame, through the filter to whoever listens."""

from __future__ import annotations

from collections import deque
from collections.abc import Collection, Iterable, Sequence
from typing import Any, NamedTuple

from dirprim_filter.detections import Detections
from dirprim_filter.estimates import EstimateSink
from dirprim_filter.filtering import GroupTracker, Tracker


class Look(NamedTuple):
    """What a sensor saw at an instant.

    Attributes:
        time_ns: when.
        detections: what it saw.
        groups: of the log in which it looked; those of the detections at least.
    """

    time_ns: int
    detections: Detections
    groups: Collection[int]


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
        rate_hz: between two frames of a group that are farther apart it has estimates so often, as long as it has a
            vehicle.

    Returns:
        The number of frames of the stream.

    Raises:
        ValueError: a frame of several instants, a repeated id, or time going backwards.
    """
    is_grouped = isinstance(tracker, GroupTracker)
    looks = (
        Look(int(seen.time_ns[0]), seen, set(seen.group.tolist()) if is_grouped else [0]) for seen in stream
    )  # fmt: skip
    return follow(looks, tracker, sinks, rate_hz=rate_hz)


def follow(
    looks: Iterable[Look], tracker: Tracker | GroupTracker, sinks: Sequence[EstimateSink], *,
    rate_hz: float | None = None,
) -> int:  # fmt: skip
    """As `replay`, of looks in which nothing may have been seen."""
    n_looks, every_ns, due = 0, round(1e9 / rate_hz) if rate_hz else 0, dict[int, int]()
    coming, ahead = iter(looks), deque[Look]()  # the look at hand, and those that were read to know what comes
    of = tracker.of if isinstance(tracker, GroupTracker) else lambda _: tracker

    def take(look: Look, between: Collection[int]) -> None:
        """A frame of the groups that are looked at, and of those that are due `between` two looks."""
        at: dict[str, Any] = {"is_scan": not between}
        if isinstance(tracker, GroupTracker):
            at = {"groups": look.groups, "between": between}
        frame = tracker.track(look.detections, time_ns=look.time_ns, **at)
        for sink in sinks:
            sink.write(frame)
        for group in (*look.groups, *between) if every_ns else ():
            due.pop(group, None)
            if of(group).n_tracks:
                due[group] = look.time_ns + every_ns

    def taken_out(time_ns: int) -> set[int]:
        """The groups that are due then, but for those that are looked at within half an interval."""
        groups = {group for group, due_ns in due.items() if due_ns == time_ns}
        while groups and ahead[-1].time_ns <= time_ns + every_ns // 2 and (look := next(coming, None)):
            ahead.append(look)
        for group in groups:
            del due[group]
        return groups.difference(*(look.groups for look in ahead if look.time_ns <= time_ns + every_ns // 2))

    while look := ahead[0] if ahead else next(coming, None):
        if not ahead:
            ahead.append(look)
        while (next_ns := min(due.values(), default=look.time_ns)) < look.time_ns:
            if groups := taken_out(next_ns):
                take(Look(next_ns, Detections.none(), ()), groups)
        take(look, taken_out(look.time_ns))
        ahead.popleft()
        n_looks += 1
    return n_looks
