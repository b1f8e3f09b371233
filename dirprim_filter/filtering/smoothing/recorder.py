"""What a tracker did, as a smoother needs it: a chain of links for each belief."""

from __future__ import annotations

from collections import deque
from dataclasses import replace

import numpy as np

from dirprim_filter.arrays import FloatArray, IntArray
from dirprim_filter.detections import NO_ID, Detections
from dirprim_filter.estimates import Estimates
from dirprim_filter.filtering.belief import States, birth_key
from dirprim_filter.filtering.measurements import Evidence, of_sensor
from dirprim_filter.filtering.protocols import BayesFilter, Smoothable
from dirprim_filter.filtering.smoothing import bridge
from dirprim_filter.filtering.smoothing.bridge import Gaussian
from dirprim_filter.filtering.smoothing.chain import GAP_NS, LABELLED_GAP_NS, PAUSE_NS, Chain, Smoothed, may_lead
from dirprim_filter.filtering.smoothing.links import MOVES, Before, Belief, links_of, moments_of, tempered, unlinked
from dirprim_filter.sensor import Sensor
from dirprim_filter.track_ids import qualified_names

WAITED, WAITED_OF = 50, 99
"""Times the usual interval between measurements of one name, the median of the log's last, that a vehicle is waited
for: a bus tells where it is each few minutes."""


class Recorder:
    """Keeps a `Chain` of each belief of a tracker's filter; whoever has used one drops it.

    Args:
        bayes_filter: that holds the beliefs.
        group: of the log.
        sensor: of the detections.

    Attributes:
        filter: as given.
        straight: the straight motion of the same vehicles, in the same slots, as the sensor sees it: with its bias.
        bias_m: (2,) that, along and across.
        chains: all that were begun, in their order, whether they ended or not.
        frames_ns: times of the frames that are not smoothed yet, ascending.

    Raises:
        ValueError: the filter has no smoother.
    """

    def __init__(self, bayes_filter: BayesFilter, group: int = 0, sensor: Sensor | None = None) -> None:
        if not isinstance(bayes_filter, Smoothable):
            name = type(bayes_filter).__name__
            raise ValueError(  # noqa: TRY004  (of a filter it is one that cannot do this)
                f"filter: expected one on a map or of constant velocity, which can be smoothed, got {name}"
            )
        self.filter: Smoothable = bayes_filter
        self.straight = bayes_filter.straight()
        self._group, self._sensor = group, sensor
        self.bias_m = np.zeros(2) if sensor is None else np.array([sensor.along.bias_m, sensor.across.bias_m])
        self.chains: list[Chain] = []
        self.frames_ns: list[int] = []
        self._chain: dict[int, Chain] = {}  # of each slot
        self._labelled: dict[str, Chain] = {}  # the last of each label
        self._intervals: deque[int] = deque(maxlen=WAITED_OF)

    def begun(self, slot: IntArray, measured: Detections, time_ns: int) -> None:
        """Beliefs were initialised by one measurement each: a chain of each begins.

        Where a belief no longer explained its vehicle, its chain ends; or goes on, if it may well have become this one.
        So does that of a label whose belief ended long ago.
        """
        self.straight.reserve(int(slot.max()) + 1)
        states = self.filter.states(slot)
        moments = moments_of(self.filter, states)
        measured = self._sensed(measured, moments[2], np.full(slot.size, np.inf))
        labels = qualified_names(measured.track_id, np.full(slot.size, self._group)).tolist()
        for i, (s, *of_one) in enumerate(zip(slot.tolist(), *moments, strict=True)):
            belief, samples, here = Belief(time_ns, *of_one), _row(states, i), slot[i : i + 1]
            former, label = self._chain.get(s), labels[i] if measured.track_id[i] != NO_ID else ""
            is_same = former is not None and former.last.time_ns == time_ns  # else it was another vehicle's
            if former is not None and is_same and former.is_corrected(belief):
                former.samples = samples
                continue
            away = self._labelled.get(label)
            if away is not None:
                self._intervals.append(time_ns - away.last.time_ns)
            if away is not None and self._is_back(away, belief):
                self.straight.mean[s], self.straight.covariance[s] = away.straight
                self.straight.predict(here, np.array([(time_ns - away.last.time_ns) * 1e-9]))
                self.straight.weigh(here, measured[i : i + 1])
                away.extend(unlinked(away.last), belief, self._straight_of(s), samples)
                self._chain[s] = away
                continue
            self.straight.begin(here, here, measured[i : i + 1])
            self._chain[s] = chain = Chain(belief, self._straight_of(s), samples, label)
            chain.patience_ns = self._patience_ns()
            self.chains.append(chain)
            if label:
                self._labelled[label] = chain

    def _is_back(self, away: Chain, belief: Belief) -> bool:
        out_ns = belief.time_ns - away.last.time_ns
        is_known = not away.is_replaced and 0 < out_ns <= away.patience_ns
        return is_known and bool(may_lead(away.last.mean[:MOVES], out_ns * 1e-9, belief.mean[:2]))

    def _patience_ns(self) -> int:
        """How long a vehicle that its sensor named is waited for."""
        return max(LABELLED_GAP_NS, WAITED * int(np.median(self._intervals or [0])))

    def waits_ns(self, now_ns: int) -> int:
        """Since when a vehicle that its sensor named is away and may come back; or the present."""
        return min(
            (chain.last.time_ns for chain in self.chains if chain.label and not chain.is_over(now_ns, 0)),
            default=now_ns,
        )

    def _straight_of(self, slot: int) -> Gaussian:
        return Gaussian(self.straight.mean[slot].copy(), self.straight.covariance[slot].copy())

    def _sensed(self, measured: Detections, course: FloatArray, since_s: FloatArray) -> Detections:
        """Measurements of vehicles with the covariance of what is new of their errors, see `of_sensor`.

        Their bias stays: which way it points at the ends of a gap is known better when all that is near them was seen.
        """
        if self._sensor is None:
            return measured
        sensed = of_sensor(measured, np.arctan2(course[:, 1], course[:, 0]), since_s, self._sensor)
        return replace(sensed, position=measured.position)

    def moves(self, slot: IntArray, time_ns: IntArray) -> None:
        """Beliefs are about to be predicted from these times (v,); copies of them have no chain, gaps no steps."""
        known = [
            (i, chain) for i, s in enumerate(slot.tolist())
            if (chain := self._chain.get(s)) and time_ns[i] - chain.last.time_ns <= GAP_NS
        ]  # fmt: skip
        if not known:
            return
        states = self.filter.states(slot[[i for i, _ in known]])
        for row, (i, chain) in enumerate(known):
            chain.path.append(Before(int(time_ns[i]), _row(states, row)))

    def weigh(self, slot: IntArray, measured: Detections, time_ns: int) -> Evidence:
        """Have the filter weigh beliefs, and link them to what they were at their last measurement and since."""
        if slot.size == 0:
            return self.filter.weigh(slot, measured)
        expected = self.filter.states(slot)
        evidence = self.filter.weigh(slot, measured)
        found = self.filter.states(slot)
        chains, weight = [self._chain[s] for s in slot.tolist()], expected.weight.copy()
        since_ns = time_ns - np.array([chain.last.time_ns for chain in chains])
        for i in np.flatnonzero(since_ns > GAP_NS).tolist():  # in a gap beliefs fork
            weight[i] = tempered(expected.weight[i], found.weight[i])[0]
        moments = moments_of(self.filter, found)
        paths = [
            chain.path[: 1 if since > GAP_NS else None] for chain, since in zip(chains, since_ns.tolist(), strict=True)
        ]  # fmt: skip
        moved = moments[1] * evidence.is_moved[:, None, None]
        links = links_of(
            self.filter, paths, expected._replace(weight=weight), np.full(slot.size, time_ns), found=moved
        )  # fmt: skip
        fair = ~evidence.is_unexplained | (since_ns > GAP_NS)
        self.straight.predict(slot, since_ns * 1e-9)
        self.straight.weigh(slot[fair], self._sensed(measured, moments[2], since_ns * 1e-9)[fair])
        self._intervals.extend(since_ns.tolist())
        for i, (chain, own, *of_one) in enumerate(zip(chains, links, *moments, strict=True)):
            if since_ns[i] > PAUSE_NS:
                chain.patience_ns = self._patience_ns()
            chain.extend(own, Belief(time_ns, *of_one), self._straight_of(int(slot[i])), _row(found, i))
        return evidence

    def smoothed(self, chain: Chain, time_ns: IntArray) -> Smoothed:
        """Beliefs about a chain's vehicle at times (n,) from its first to its last, given all measurements so far."""
        found = chain.smoothed().at(time_ns)
        for ends, start in chain.gaps(self.straight, self.bias_m):
            rows = np.flatnonzero((time_ns > ends.start_ns) & (time_ns < ends.end_ns))
            if rows.size:
                key = int(birth_key(0, chain.name, ends.start_ns))
                way = bridge.across(self.filter, self.straight, ends, start, time_ns[rows], key=key)
                found.mean[rows], found.covariance[rows] = way
        return found

    def reported(self, time_ns: int, home: IntArray, estimates: Estimates) -> None:
        """A frame's estimates of the vehicles with these slots (v,), whose chains get their names."""
        self.frames_ns.append(time_ns)
        names = qualified_names(estimates.track_id, np.full(len(estimates), self._group)).tolist()
        for slot, name, exists in zip(home.tolist(), names, estimates.existence.tolist(), strict=True):
            chain = self._chain[slot]
            chain.name = chain.name if chain.is_joined else str(name)
            chain.existence = max(chain.existence, exists)


def _row(states: States, i: int) -> States:
    """Of one belief, in memory of its own."""
    return States(*(column[i : i + 1].copy() for column in states))
