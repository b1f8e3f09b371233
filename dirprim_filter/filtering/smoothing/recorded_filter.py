"""A filter that keeps how each of its beliefs came about, for a smoother; what is kept is its implementations' own."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Sequence
from typing import NamedTuple, Self

import numpy as np

from dirprim_filter.arrays import AnyArray, FloatArray, IntArray
from dirprim_filter.detections import Detections
from dirprim_filter.estimates import Samples
from dirprim_filter.filtering.protocols import BayesFilter, Evidence
from dirprim_filter.filtering.smoothing.chain import MOVES, Belief, Chain
from dirprim_filter.primitives.traffic import Traffic

STEP_S = 0.1
"""Of a way across a gap that no filter went."""


class Bridge(NamedTuple):
    """A way from the end of one chain to the beginning of another.

    Attributes:
        log_density: of the place and velocity at its end, given the beginning, per m^2 (m/s)^2.
        links: (m,) of the way.
    """

    log_density: float
    links: AnyArray


class RecordedFilter(ABC):
    """A `BayesFilter` that does what another does, and keeps a `Chain` of each belief.

    Attributes:
        chain: of each slot in which a belief was begun.
        chains: all that were begun, whether they ended or not; whoever has used one drops it.
    """

    def __init__(self, inner: BayesFilter, kind: np.dtype[np.void]) -> None:
        self._inner, self._kind = inner, kind
        self.chain: dict[int, Chain] = {}
        self.chains: list[Chain] = []
        self._time_ns: dict[int, int] = {}

    @property
    def traffic(self) -> Traffic | None:
        """As the filter's."""
        return self._inner.traffic

    def reserve(self, n_slots: int) -> None:
        """Make room for so many slots."""
        self._inner.reserve(n_slots)

    def begin(self, slot: IntArray, key: AnyArray, measured: Detections) -> None:
        """Start beliefs, and a chain of each: the one that the slot had ends.

        It goes on where its belief no longer explained its vehicle, lost from sight, but may well have become this one.
        """
        self._inner.begin(slot, key, measured)
        for s, time_ns in zip(slot.tolist(), measured.time_ns.tolist(), strict=True):
            self._time_ns[s] = time_ns
            self._start(s)
            belief, former = self._belief(s), self.chain.get(s)
            if former is not None and former.last.time_ns == time_ns and former.may_be_at(belief):
                former.correct(belief)
                continue
            if former is not None:
                former.until_ns = time_ns
            self.chain[s] = Chain(belief, self._kind)
            self.chains.append(self.chain[s])

    def copy(self, source: IntArray, target: IntArray) -> None:
        """Make the beliefs of `target` those of `source`; a copy has no chain."""
        self._inner.copy(source, target)
        for s in target.tolist():
            self.chain.pop(s, None)

    def predict(self, slot: IntArray, dt_s: FloatArray) -> None:
        """Move beliefs on."""
        known = np.array([s in self.chain for s in slot.tolist()], np.bool_)
        self._predict(slot, dt_s, known)
        for s, dt in zip(slot[known].tolist(), dt_s[known].tolist(), strict=True):
            self._time_ns[s] += round(dt * 1e9)

    def log_likelihood(self, slot: IntArray, measured: Detections) -> FloatArray:
        """As the filter says."""
        return self._inner.log_likelihood(slot, measured)

    def weigh(self, slot: IntArray, measured: Detections) -> Evidence:
        """Correct beliefs, and link them to what they were at their last measurement and since."""
        return self._weigh(slot, measured)

    def moments(self, slot: IntArray) -> FloatArray:
        """As the filter says."""
        return self._inner.moments(slot)

    def probability_outside(self, slot: IntArray) -> FloatArray:
        """As the filter says."""
        return self._inner.probability_outside(slot)

    def rate_of_ends(self, slot: IntArray) -> FloatArray:
        """As the filter says."""
        return self._inner.rate_of_ends(slot)

    def resample(self, slot: IntArray) -> None:
        """As the filter does."""
        self._inner.resample(slot)

    def particles(self, slot: IntArray) -> Samples:
        """As the filter says."""
        return self._inner.particles(slot)

    def bridges(self, key: AnyArray, end: Sequence[Belief], start: Sequence[Belief]) -> list[Bridge]:
        """Ways (n,) from one belief each to a later one; the beliefs of the first n slots are lost.

        Args:
            key: (n,) uint64, what random numbers follow from.
            end: where each begins.
            start: where it shall end, at a later time.
        """
        slot = np.arange(len(end))
        self.reserve(slot.size)
        mean, covariance = (
            [of[:MOVES] for of in column] for column in zip(*((b.mean, b.covariance) for b in end), strict=True)
        )
        self._place(slot, key, np.array(mean), np.array(covariance)[:, :, :MOVES])
        for s, belief in enumerate(end):
            self._time_ns[s] = belief.time_ns
            self._start(s)
        dt_s = np.array([b.time_ns - a.time_ns for a, b in zip(end, start, strict=True)]) * 1e-9
        n_steps = np.ceil(dt_s / STEP_S - 1e-6).astype(np.int64)
        for i in range(int(n_steps.max(initial=0))):
            on = slot[n_steps > i]
            h = (dt_s / n_steps)[on]
            self._predict(on, h, np.ones(on.size, np.bool_))
            for s, one in zip(on.tolist(), h.tolist(), strict=True):
                self._time_ns[s] += round(one * 1e9)
        return self._arrived(slot, start)

    @abstractmethod
    def sibling(self) -> Self:
        """One of the same filter, without beliefs."""

    @abstractmethod
    def _place(self, slot: IntArray, key: AnyArray, mean: FloatArray, covariance: FloatArray) -> None:
        """Start beliefs from Gaussians of place and velocity."""

    @abstractmethod
    def _arrived(self, slot: IntArray, start: Sequence[Belief]) -> list[Bridge]:
        """Bridges, once the beliefs have been moved on to where they shall end."""

    @abstractmethod
    def _belief(self, slot: int) -> Belief:
        """What is believed now."""

    @abstractmethod
    def _start(self, slot: int) -> None:
        """Forget what stood in the slot."""

    @abstractmethod
    def _predict(self, slot: IntArray, dt_s: FloatArray, known: AnyArray) -> None:
        """Move beliefs on, and keep how those of the `known` were."""

    @abstractmethod
    def _weigh(self, slot: IntArray, measured: Detections) -> Evidence:
        """Correct beliefs and add the links."""
