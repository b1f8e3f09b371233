"""Groups of a log are scenes of their own: recordings made apart, each tracked by a tracker of its own."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from dataclasses import replace

import numpy as np

from dirprim_filter.detections import Detections
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
        self._now: list[int] = []

    @property
    def recoveries(self) -> int:
        """How many beliefs, in all groups, no longer explained their vehicle's positions and were reinitialised."""
        return sum(tracker.recoveries for tracker in self._trackers.values())

    @property
    def n_groups(self) -> int:
        """How many groups have come so far."""
        return len(self._trackers)

    def predict(
        self, detections: Detections, *, time_ns: int | None = None, groups: Iterable[int] = (), is_scan: bool = True
    ) -> None:  # fmt: skip
        """Move the beliefs of the groups that have a frame; each as `Tracker.predict`, errors included.

        Those of the detections have one, those of `groups`, and all where the sensor did not look.
        """
        self._now = sorted({*np.unique(detections.group).tolist(), *(groups if is_scan else self._trackers)})
        for group in self._now:
            if group not in self._trackers:
                self._trackers[group] = self._make(group)
            self._trackers[group].predict(detections[detections.group == group], time_ns=time_ns, is_scan=is_scan)

    def weigh(self) -> None:
        """Weigh the moved beliefs by the frame's measurements."""
        for group in self._now:
            self._trackers[group].weigh()

    def frame(self) -> TrackedFrame:
        """All of the frame at hand, of vehicles named `group/id`; those of group 0 keep their ids.

        Raises:
            ValueError: there is no group yet.
        """
        parts = [_renamed(self._trackers[group].frame(), group) for group in self._now]
        if not parts:
            raise ValueError("frame: expected that of at least one group, got none")
        if len(parts) == 1:
            return parts[0]
        innovations = [part.innovations for part in parts if part.innovations is not None]
        return TrackedFrame(
            time_ns=parts[0].time_ns,
            detections=Detections.concatenate([part.detections for part in parts]),
            estimates=Estimates.concatenate([part.estimates for part in parts]),
            particles=BeliefSamples.concatenate(part.particles for part in parts),
            innovations=np.concatenate(innovations) if len(innovations) == len(parts) else None,
            reinitialised=tuple(name for part in parts for name in part.reinitialised),
            group=np.concatenate([part.group for part in parts]),
        )  # fmt: skip

    def resample(self) -> None:
        """Renew the samples of measured beliefs that have lost their weight."""
        for group in self._now:
            self._trackers[group].resample()


def _renamed(frame: TrackedFrame, group: int) -> TrackedFrame:
    if group == 0:
        return frame
    estimates = frame.estimates
    names, anew = (
        qualified_names(of, np.full(of.size, group))
        for of in (estimates.track_id, np.array(frame.reinitialised, np.str_))
    )
    return replace(
        frame, detections=frame.detections.in_one_group(), estimates=replace(estimates, track_id=names),
        reinitialised=tuple(anew.tolist()), group=np.full(len(estimates), group),
    )  # fmt: skip
