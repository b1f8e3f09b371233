"""What a smoother needs of a filter: how each state of a belief follows from the one at its next measurement.

Between two measurements particles are not resampled, so each is a path of its own, and the particles' joint moments at
two times give the regression of the earlier on the later. Across a gap they are taken with the weights that the later
measurement gave, as far as enough particles are left: of a belief with several arms that counts which the vehicle took.

Source: Raanes, On the ensemble Rauch-Tung-Striebel smoother, 2016; Beaumont, Zhang and Balding, Approximate Bayesian
Computation in Population Genetics, 2002, for the regression among the samples that come near.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from dirprim_filter.arrays import AnyArray, BoolArray, FloatArray, IntArray
from dirprim_filter.detections import Detections
from dirprim_filter.estimates import Estimates
from dirprim_filter.filtering.protocols import BayesFilter, Evidence, Smoothable
from dirprim_filter.filtering.smoothing import _kernels
from dirprim_filter.filtering.smoothing._kernels import LEAST_EFFECTIVE, N_COLUMNS, N_STATES
from dirprim_filter.filtering.smoothing.chain import LINK, MOVES, Belief, Chain
from dirprim_filter.track_ids import qualified_names

GAP_NS = 1_000_000_000
"""In less no belief forks, and all particles count: those that came near alone are too sure of who starts or stops."""
LEAST_VARIANCE = np.diag([1e-8, 1e-8, 1e-6, 1e-6, 1e-6])
"""Added to what a later state varies by: standing vehicles' velocities do not vary at all."""
STEP_S = 0.1
"""Of a path across a gap that no filter went."""


class Bridge(NamedTuple):
    """A path from the end of one chain to the beginning of another."""

    log_density: float  # of the place and velocity at its end, given the beginning, per m^2 (m/s)^2
    links: AnyArray  # (m,) of the path


class Recorder:
    """Keeps a `Chain` of each belief of a tracker's filter; whoever has used one drops it.

    Args:
        group: of the log.

    Attributes:
        chains: all that were begun, in their order, whether they ended or not.
        frames_ns: times of the frames that are not smoothed yet, ascending.
    """

    def __init__(self, group: int = 0) -> None:
        self._group = group
        self.chains: list[Chain] = []
        self.frames_ns: list[int] = []
        self._chain: dict[int, Chain] = {}  # of each slot
        self._time_ns: dict[int, int] = {}
        self._past: dict[int, list[tuple[int, FloatArray, int]]] = {}  # times, states of beliefs, and which

    def follow(self, bayes_filter: BayesFilter) -> None:
        """Keep the beliefs of this filter.

        Raises:
            ValueError: it has no smoother.
        """
        if not isinstance(bayes_filter, Smoothable):
            name = type(bayes_filter).__name__
            raise ValueError(  # noqa: TRY004  (of a filter it is one that cannot do this)
                f"filter: expected one on a map or of constant velocity, which can be smoothed, got {name}"
            )
        self._filter = bayes_filter

    def begun(self, slot: IntArray, time_ns: int) -> None:
        """Beliefs were initialised: a chain of each begins, and the one that the slot had ends.

        It goes on where its belief no longer explained its vehicle, lost from sight, but may well have become this one.
        """
        beliefs = self._beliefs(slot, self._filter.states(slot), self._filter.weights(slot), [time_ns] * slot.size)
        for s, belief in zip(slot.tolist(), beliefs, strict=True):
            former = self._chain.get(s)
            self._time_ns[s], self._past[s] = time_ns, []
            if former is not None and former.last.time_ns == time_ns and former.may_be_at(belief):
                former.correct(belief)
                continue
            if former is not None:
                former.until_ns = time_ns
            self._chain[s] = Chain(belief)
            self.chains.append(self._chain[s])

    def moves(self, slot: IntArray, dt_ns: IntArray) -> None:
        """Beliefs are about to be predicted by so many nanoseconds."""
        known = np.array([s in self._past for s in slot.tolist()], np.bool_)
        slots = slot[known]
        is_waiting = np.array([bool(self._past[s]) for s in slots.tolist()], np.bool_)
        for of in (slots[~is_waiting], slots[is_waiting]):  # an array is kept while any vehicle of it is not measured
            states = self._filter.states(of)
            for row, s in enumerate(of.tolist()):
                self._past[s].append((self._time_ns[s], states, row))
        for s, dt in zip(slots.tolist(), dt_ns[known].tolist(), strict=True):
            self._time_ns[s] += dt

    def weigh(self, slot: IntArray, measured: Detections) -> Evidence:
        """Have the filter weigh beliefs, and link them to what they were at their last measurement and since."""
        before, now = self._filter.weights(slot), self._filter.states(slot)
        evidence = self._filter.weigh(slot, measured)
        after, times = self._filter.weights(slot), [self._time_ns[s] for s in slot.tolist()]
        weight = before.copy()
        for i, (s, time_ns) in enumerate(zip(slot.tolist(), times, strict=True)):
            if self._past[s] and time_ns - self._past[s][0][0] > GAP_NS:
                _kernels.tempered(before[i], after[i], LEAST_EFFECTIVE * before.shape[1], weight[i])
        moved = now.copy()
        moved[evidence.is_moved] = self._filter.states(slot[evidence.is_moved])
        lasts, expected = self._beliefs(slot, moved, after, times), self._beliefs(slot, now, weight, times)
        added = _wider(lasts, expected) * evidence.is_moved[:, None, None]  # not for other weights across a gap
        links = self._linked(slot, weight, now, added=added)
        for s, own, last in zip(slot.tolist(), links, lasts, strict=True):
            self._chain[s].extend(own, last)
            self._past[s] = []
        return evidence

    def reported(self, time_ns: int, home: IntArray, estimates: Estimates, is_labelled: BoolArray) -> None:
        """A frame's estimates of the vehicles with these slots (v,), whose chains get their names."""
        self.frames_ns.append(time_ns)
        names = qualified_names(estimates.track_id, np.full(len(estimates), self._group)).tolist()
        columns = zip(home.tolist(), names, estimates.existence.tolist(), is_labelled.tolist(), strict=True)
        for slot, name, exists, labelled in columns:
            chain = self._chain[slot]
            chain.name = str(name) if chain.n_pieces == 1 else chain.name
            chain.is_labelled = labelled
            chain.existence = max(chain.existence, exists)

    def sibling(self) -> Recorder:
        """One of the same filter, without beliefs."""
        other = Recorder()
        other.follow(self._filter.sibling())
        return other

    def bridges(self, key: AnyArray, end: Sequence[Belief], start: Sequence[Belief]) -> list[Bridge]:
        """Paths (n,) from one belief each to a later one; the beliefs of the first n slots are lost.

        Args:
            key: (n,) uint64, what random numbers follow from.
            end: where each begins.
            start: where it shall end, at a later time.
        """
        slot = np.arange(len(end))
        self._filter.reserve(slot.size)
        ends, starts = (
            (np.array([b.mean[:MOVES] for b in of]), np.array([b.covariance[:MOVES, :MOVES] for b in of]))
            for of in (end, start)
        )
        self._filter.place(slot, key, *ends)
        for s, belief in enumerate(end):
            self._time_ns[s], self._past[s] = belief.time_ns, []
        gap_ns = np.array([b.time_ns - a.time_ns for a, b in zip(end, start, strict=True)], np.int64)
        n_steps = np.ceil(gap_ns * 1e-9 / STEP_S - 1e-6).astype(np.int64)
        for i in range(int(n_steps.max(initial=0))):
            on = slot[n_steps > i]
            dt_ns: IntArray = gap_ns[on] * (i + 1) // n_steps[on] - gap_ns[on] * i // n_steps[on]
            self.moves(on, dt_ns)
            self._filter.predict(on, np.asarray(dt_ns * 1e-9, np.float64))
        now = self._filter.states(slot)
        density, weight = self._filter.arrivals(now, *starts)
        return [Bridge(*both) for both in zip(density.tolist(), self._linked(slot, weight, now), strict=True)]

    def _beliefs(self, slot: IntArray, states: FloatArray, weight: FloatArray, time_ns: list[int]) -> list[Belief]:
        each = np.arange(slot.size)
        mean, covariance = self._filter.joint(weight, states, states, row=each, vehicle=each, dt_s=np.zeros(slot.size))
        return [
            Belief(t, m[:N_STATES], p[:N_STATES, :N_STATES], m[N_STATES:N_COLUMNS])
            for t, m, p in zip(time_ns, mean, covariance, strict=True)
        ]

    def _linked(
        self, slot: IntArray, weight: FloatArray, now: FloatArray, *, added: FloatArray | None = None
    ) -> list[AnyArray]:
        """Links of each vehicle's steps since its last measurement, by weights (v, P) of its samples.

        P' is the covariance of `now` with what is `added` (v, 5, 5) to it, C = cov(then, now): gain = C (P' + least)^-1
        and spread = P - gain C^T - C gain^T + gain P' gain^T, a covariance whatever the gain.
        """
        n_steps = np.array([len(self._past[s]) for s in slot.tolist()], np.int64)
        vehicle = np.repeat(np.arange(slot.size), n_steps)
        steps = [step for s in slot.tolist() for step in self._past[s]]
        end, links = np.cumsum(n_steps), np.empty(len(steps), LINK)
        links["time_ns"] = [time_ns for time_ns, *_ in steps]
        now_ns = np.array([self._time_ns[s] for s in slot.tolist()], np.int64)
        dt_s = (now_ns[vehicle] - links["time_ns"]) * 1e-9
        row, kept = np.array([row for *_, row in steps], np.int64), np.array([id(states) for _, states, _ in steps])
        for i in np.unique(kept, return_index=True)[1].tolist():
            at = np.flatnonzero(kept == kept[i])
            mean, both = self._filter.joint(weight, steps[i][1], now, row=row[at], vehicle=vehicle[at], dt_s=dt_s[at])
            p, c, later = both[:, :N_STATES, :N_STATES], both[:, :N_STATES, N_STATES:], both[:, N_STATES:, N_STATES:]
            later = later if added is None else later + added[vehicle[at]]
            gain = np.linalg.solve(later + LEAST_VARIANCE, c.swapaxes(1, 2)).swapaxes(1, 2)
            shared = gain @ c.swapaxes(1, 2)
            links["mean"][at] = mean[:, :N_STATES]
            links["step"][at] = mean[:, N_COLUMNS : N_COLUMNS + N_STATES] - mean[:, :N_STATES]
            links["course"][at], links["gain"][at] = mean[:, N_STATES:N_COLUMNS], gain
            links["spread"][at] = p - shared - shared.swapaxes(1, 2) + gain @ later @ gain.swapaxes(1, 2)
        links["ahead"] = end[vehicle] - np.arange(len(steps))
        links["is_measured"] = links["ahead"] == n_steps[vehicle]
        return np.split(links, end)[:-1]


def _wider(beliefs: Sequence[Belief], expected: Sequence[Belief]) -> FloatArray:
    """(v, 5, 5) by which covariances are larger than expected: where samples were moved to a measurement.

    That is noise between the two, or the sweep back would magnify it at every step: the map draws vehicles together, so
    backwards it drives them apart.
    """
    more = np.array([one.covariance - other.covariance for one, other in zip(beliefs, expected, strict=True)])
    size, axes = np.linalg.eigh(more.reshape(-1, N_STATES, N_STATES))
    return np.asarray((axes * np.maximum(size, 0.0)[:, None]) @ axes.swapaxes(1, 2))
