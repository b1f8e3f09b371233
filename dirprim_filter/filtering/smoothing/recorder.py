"""What a tracker did, as a smoother needs it: a chain of links for each belief."""

from __future__ import annotations

import numpy as np

from dirprim_filter.arrays import BoolArray, IntArray
from dirprim_filter.detections import Detections
from dirprim_filter.estimates import Estimates
from dirprim_filter.filtering.protocols import BayesFilter, Evidence, Smoothable, States
from dirprim_filter.filtering.smoothing.chain import Chain
from dirprim_filter.filtering.smoothing.links import Belief, Step, links_of, moments_of, tempered
from dirprim_filter.track_ids import qualified_names

GAP_NS = 1_000_000_000
"""In less no belief forks, and all samples count: those that came near alone are too sure of who starts or stops."""


class Recorder:
    """Keeps a `Chain` of each belief of a tracker's filter; whoever has used one drops it.

    Args:
        bayes_filter: that holds the beliefs.
        group: of the log.

    Attributes:
        filter: as given.
        chains: all that were begun, in their order, whether they ended or not.
        frames_ns: times of the frames that are not smoothed yet, ascending.

    Raises:
        ValueError: the filter has no smoother.
    """

    def __init__(self, bayes_filter: BayesFilter, group: int = 0) -> None:
        if not isinstance(bayes_filter, Smoothable):
            name = type(bayes_filter).__name__
            raise ValueError(  # noqa: TRY004  (of a filter it is one that cannot do this)
                f"filter: expected one on a map or of constant velocity, which can be smoothed, got {name}"
            )
        self.filter: Smoothable = bayes_filter
        self._group = group
        self.chains: list[Chain] = []
        self.frames_ns: list[int] = []
        self._chain: dict[int, Chain] = {}  # of each slot

    def begun(self, slot: IntArray, time_ns: int) -> None:
        """Beliefs were initialised: a chain of each begins.

        Where a belief no longer explained its vehicle, its chain ends; or goes on, if it may well have become this one.
        """
        moments = moments_of(self.filter, self.filter.states(slot))
        for s, *of_one in zip(slot.tolist(), *moments, strict=True):
            belief, former = Belief(time_ns, *of_one), self._chain.get(s)
            is_same = former is not None and former.last.time_ns == time_ns  # else it was another vehicle's
            if former is None or not (is_same and former.is_corrected(belief)):
                self._chain[s] = Chain(belief)
                self.chains.append(self._chain[s])

    def moves(self, slot: IntArray, time_ns: IntArray) -> None:
        """Beliefs are about to be predicted from these times (v,); copies of them have no chain."""
        known = [(i, chain) for i, s in enumerate(slot.tolist()) if (chain := self._chain.get(s))]
        states = self.filter.states(slot[[i for i, _ in known]])
        for row, (i, chain) in enumerate(known):
            state = States(*(column[row : row + 1].copy() for column in states))
            chain.path.append(Step(int(time_ns[i]), state))

    def weigh(self, slot: IntArray, measured: Detections, time_ns: int) -> Evidence:
        """Have the filter weigh beliefs, and link them to what they were at their last measurement and since."""
        if slot.size == 0:
            return self.filter.weigh(slot, measured)
        expected = self.filter.states(slot)
        evidence = self.filter.weigh(slot, measured)
        found = self.filter.states(slot)
        chains, weight = [self._chain[s] for s in slot.tolist()], expected.weight.copy()
        for i, chain in enumerate(chains):
            if time_ns - chain.last.time_ns > GAP_NS:
                weight[i] = tempered(expected.weight[i], found.weight[i])
        moments, paths = moments_of(self.filter, found), [chain.path for chain in chains]
        moved = moments[1] * evidence.is_moved[:, None, None]
        links = links_of(
            self.filter, paths, expected._replace(weight=weight), np.full(slot.size, time_ns), found=moved
        )  # fmt: skip
        for chain, own, *of_one in zip(chains, links, *moments, strict=True):
            chain.extend(own, Belief(time_ns, *of_one))
        return evidence

    def reported(self, time_ns: int, home: IntArray, estimates: Estimates, is_labelled: BoolArray) -> None:
        """A frame's estimates of the vehicles with these slots (v,), whose chains get their names."""
        self.frames_ns.append(time_ns)
        names = qualified_names(estimates.track_id, np.full(len(estimates), self._group)).tolist()
        columns = zip(home.tolist(), names, estimates.existence.tolist(), is_labelled.tolist(), strict=True)
        for slot, name, exists, labelled in columns:
            chain = self._chain[slot]
            chain.name = chain.name if chain.is_joined else str(name)
            chain.is_labelled = labelled
            chain.existence = max(chain.existence, exists)
