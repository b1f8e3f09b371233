"""Groups of a log are scenes of their own: recordings made apart, each tracked by a tracker of its own."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from dataclasses import replace

import numpy as np

from dirprim_filter.arrays import FloatArray
from dirprim_filter.detections import NO_ID, Detections
from dirprim_filter.estimates import Estimates, TrackedFrame
from dirprim_filter.filtering.belief import BeliefSamples
from dirprim_filter.filtering.tracker import Tracker
from dirprim_filter.track_ids import qualified_names


class GroupTracker:
    """Trackers side by side, one for each group: the estimates of one depend on no other.

    Takes the place of a `Tracker` where a stream may hold several groups. A group has a frame at an instant where it
    has detections then.

    Args:
        make: the tracker of a group, asked for when its first frame comes.
    """

    def __init__(self, make: Callable[[int], Tracker]) -> None:
        self._make = make
        self._trackers: dict[int, Tracker] = {}

    @property
    def recoveries(self) -> int:
        """How many beliefs, in all groups, no longer explained their vehicle's positions and were reinitialised."""
        return sum(tracker.recoveries for tracker in self._trackers.values())

    @property
    def n_groups(self) -> int:
        """How many groups have come so far."""
        return len(self._trackers)

    def of(self, group: int) -> Tracker:
        """The tracker of a group."""
        if group not in self._trackers:
            self._trackers[group] = self._make(group)
        return self._trackers[group]

    def track(
        self, detections: Detections, *, time_ns: int | None = None, groups: Iterable[int] = (),
        between: Iterable[int] = (),
    ) -> TrackedFrame:  # fmt: skip
        """One frame of the groups that have one, each as `Tracker.track`, of vehicles named `group/id`.

        Those of group 0 keep their ids.

        Args:
            detections: one instant, each id of a group once.
            time_ns: the frame's time; left out, that of the detections.
            groups: in which the sensor looked, beside those of the detections.
            between: which have a frame though their sensor did not look.

        Raises:
            ValueError: no group has a frame; or as `Tracker.track`.
        """
        parts, looked = [], {*detections.group.tolist(), *groups}
        every = sorted({*looked, *between})
        for group in every:
            seen = detections if len(every) == 1 else detections[detections.group == group]
            frame = self.of(group).track(seen, time_ns=time_ns, is_scan=group in looked)
            parts.append(_renamed(frame, group))
        if not parts:
            raise ValueError("groups: expected a frame of at least one, got none")
        if len(parts) == 1:
            return parts[0]
        return TrackedFrame(
            time_ns=parts[0].time_ns,
            detections=Detections.concatenate([part.detections for part in parts]),
            estimates=Estimates.concatenate([part.estimates for part in parts]),
            particles=BeliefSamples.concatenate(part.particles for part in parts),
            innovations=_joined([part.innovations for part in parts]),
            expected=_joined([part.expected for part in parts]),
            reinitialised=tuple(name for part in parts for name in part.reinitialised),
            group=np.concatenate([part.group for part in parts]),
            assigned=np.concatenate([part.assigned for part in parts]),
        )  # fmt: skip


def _joined(values: Sequence[FloatArray | None]) -> FloatArray | None:
    """All of them; None where one is not known."""
    known = [value for value in values if value is not None]
    return np.concatenate(known) if len(known) == len(values) else None


def _renamed(frame: TrackedFrame, group: int) -> TrackedFrame:
    if group == 0:
        return frame
    seen, estimates = frame.detections, frame.estimates
    ids, names, anew, assigned = (
        np.where(of == NO_ID, NO_ID, qualified_names(of, np.full(of.size, group)))
        for of in (seen.track_id, estimates.track_id, np.array(frame.reinitialised, np.str_), frame.assigned)
    )
    return replace(
        frame, detections=replace(seen, track_id=ids), estimates=replace(estimates, track_id=names),
        reinitialised=tuple(anew.tolist()), group=np.full(len(estimates), group), assigned=assigned,
    )  # fmt: skip
