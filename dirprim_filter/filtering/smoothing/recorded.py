"""Filters that record, for each belief, the regression between successive states that a smoother needs.

Between two measurements particles are not resampled, so each is a path of its own, and the particles' joint moments at
two times give the regression of the earlier on the later. Across a gap they are taken with the weights that the later
measurement gave, as far as enough particles are left: of a belief with several arms that counts which the vehicle took.

Source: Raanes, On the ensemble Rauch-Tung-Striebel smoother, 2016; Beaumont, Zhang and Balding, Approximate Bayesian
Computation in Population Genetics, 2002, for the regression among the samples that come near.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Iterator, Sequence
from typing import Any, NamedTuple, Self

import numpy as np

from dirprim_filter.arrays import AnyArray, FloatArray, IntArray
from dirprim_filter.detections import Detections
from dirprim_filter.estimates import Samples
from dirprim_filter.filtering.kalman import ConstantVelocityKalman
from dirprim_filter.filtering.particle_filter import ParticleFilter
from dirprim_filter.filtering.protocols import BayesFilter, Evidence
from dirprim_filter.filtering.smoothing import _kernels
from dirprim_filter.filtering.smoothing._kernels import N_COLUMNS, N_STATES
from dirprim_filter.filtering.smoothing.chain import MOVES, Belief, Chain, link_type, lower

LEAST_EFFECTIVE = 0.4
"""Share of the particles that links across a gap are learned from at least."""
GAP_NS = 1_000_000_000
"""In less no belief forks, and all particles count: those that came near alone are too sure of who starts or stops."""
STEP_S = 0.1
"""Of a way across a gap that no filter went."""
BANDWIDTH = 0.1
"""Share of the particles' covariance, times n^(-1/4), by which their density is smoothed: it may have several modes."""
LINK = link_type(N_STATES, gain="<f2")
"""Of particles, 189 bytes: a thousand of them do not know a gain to the half per mille that this keeps."""
EXACT_LINK = link_type(MOVES, gain="<f4")


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
            if former is not None and former.last.time_ns == time_ns and former.last.may_be(belief):
                former.last = belief
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

    def look_around(self, slot: IntArray, home: IntArray) -> None:
        """As the filter does."""
        self._inner.look_around(slot, home)

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


class RecordedParticles(RecordedFilter):
    """Of a particle filter; between measurements its particles are kept at each step.

    Args:
        inner: whose particles are looked at.
    """

    def __init__(self, inner: ParticleFilter) -> None:
        super().__init__(inner, LINK)
        self._of = inner
        self._past: dict[int, list[tuple[int, FloatArray]]] = {}

    def _columns(self, slot: IntArray) -> FloatArray:
        cloud = self._of.belief.cloud
        out = np.empty((slot.size, N_COLUMNS, cloud.speed.shape[1]))
        _kernels.columns_of(cloud, self._of.manoeuvres, slot, out)
        return out

    def _belief(self, slot: int) -> Belief:
        one = np.array([slot])
        return next(self._beliefs(one, self._columns(one), self._of.belief.cloud.weight[one]))

    def _beliefs(self, slot: IntArray, columns: FloatArray, weight: FloatArray) -> Iterator[Belief]:
        mean, covariance = np.empty((slot.size, N_COLUMNS)), np.empty((slot.size, N_STATES, N_STATES))
        _kernels.moments_each(weight, columns, mean, covariance)
        for s, m, p in zip(slot.tolist(), mean, covariance, strict=True):
            yield Belief(self._time_ns[s], m[:N_STATES], p, m[N_STATES:])

    def _start(self, slot: int) -> None:
        self._past[slot] = []

    def _predict(self, slot: IntArray, dt_s: FloatArray, known: AnyArray) -> None:
        for s, columns in zip(slot[known].tolist(), self._columns(slot[known]), strict=True):
            self._past[s].append((self._time_ns[s], columns))
        self._inner.predict(slot, dt_s)

    def _weigh(self, slot: IntArray, measured: Detections) -> Evidence:
        cloud = self._of.belief.cloud
        before = cloud.weight[slot]
        evidence = self._inner.weigh(slot, measured)
        after, now = cloud.weight[slot], self._columns(slot)
        since_ns = np.array([self._time_ns[s] - past[0][0] if (past := self._past[s]) else 0 for s in slot.tolist()])
        weight = before.copy()
        for i in np.flatnonzero(since_ns > GAP_NS).tolist():
            _kernels.tempered(before[i], after[i], LEAST_EFFECTIVE * before.shape[1], weight[i])
        links = self._linked(slot, weight, now)
        for s, own, last in zip(slot.tolist(), links, self._beliefs(slot, now, after), strict=True):
            self.chain[s].extend(own, last)
            self._past[s] = []
        return evidence

    def _linked(self, slot: IntArray, weight: FloatArray, now: FloatArray) -> list[AnyArray]:
        """Links of each vehicle's steps since its last measurement, by weights (v, P) of its particles."""
        n_steps = np.array([len(self._past[s]) for s in slot.tolist()], np.int64)
        vehicle = np.repeat(np.arange(slot.size), n_steps)
        steps = [step for s in slot.tolist() for step in self._past[s]]
        links = np.empty(len(steps), LINK)
        if not steps:
            return [links] * slot.size
        mean, later = np.empty((len(steps), N_COLUMNS)), np.empty((len(steps), N_STATES))
        gain, spread = np.empty((2, len(steps), N_STATES, N_STATES))
        then = np.stack([columns for _, columns in steps])
        _kernels.link_each(weight[vehicle], then, now[vehicle], mean, later, gain, spread)
        links["time_ns"] = [time_ns for time_ns, _ in steps]
        links["mean"], links["step"] = mean[:, :N_STATES], later - mean[:, :N_STATES]
        links["gain"], links["spread"], links["course"] = gain, spread[:, *lower(N_STATES)], mean[:, N_STATES:]
        end = np.cumsum(n_steps)
        links["ahead"] = end[vehicle] - np.arange(len(steps))
        links["is_measured"] = links["ahead"] == n_steps[vehicle]
        return np.split(links, end[:-1])

    def sibling(self) -> RecordedParticles:
        """One that moves by the same map, without beliefs."""
        return RecordedParticles(self._of.sibling())

    def _place(self, slot: IntArray, key: AnyArray, mean: FloatArray, covariance: FloatArray) -> None:
        self._of.place(slot, key, mean, covariance)

    def _arrived(self, slot: IntArray, start: Sequence[Belief]) -> list[Bridge]:
        now, n = self._columns(slot), self._of.config.n_particles
        before, weight, density = np.full(n, 1.0 / n), np.empty((slot.size, n)), []
        for i, (columns, belief) in enumerate(zip(now[:, :MOVES], start, strict=True)):
            spread = belief.covariance[:MOVES, :MOVES] + BANDWIDTH * n**-0.25 * np.cov(columns)
            fit = log_gaussian(columns.T - belief.mean[:MOVES], spread)
            top = fit.max()
            near = np.exp(fit - top)
            density.append(float(top + np.log(near.mean())))
            _kernels.tempered(before, near / near.sum(), LEAST_EFFECTIVE * n, weight[i])
        links = self._linked(slot, weight, now)
        return [Bridge(*both) for both in zip(density, links, strict=True)]


class RecordedKalman(RecordedFilter):
    """Of the constant-velocity Kalman filter: then the sweep is Rauch, Tung and Striebel's own.

    Args:
        inner: whose Gaussians are looked at.
    """

    def __init__(self, inner: ConstantVelocityKalman) -> None:
        super().__init__(inner, EXACT_LINK)
        self._of = inner
        self._links: dict[int, list[Any]] = {}

    def _gaussian(self, slot: IntArray) -> tuple[FloatArray, FloatArray]:
        return self._of.mean[slot, 0, :MOVES].copy(), self._of.covariance[slot, 0, :MOVES, :MOVES].copy()

    def _belief(self, slot: int) -> Belief:
        mean, covariance = self._gaussian(np.array([slot]))
        return Belief(self._time_ns[slot], mean[0], covariance[0], _course(mean)[0])

    def _start(self, slot: int) -> None:
        self._links[slot] = []

    def _predict(self, slot: IntArray, dt_s: FloatArray, known: AnyArray) -> None:
        of, dt = slot[known], dt_s[known]
        mean, p = self._gaussian(of)
        self._inner.predict(slot, dt_s)
        later, p_later = self._gaussian(of)
        moved = np.tile(np.eye(MOVES), (of.size, 1, 1))
        moved[:, 0, 2] = moved[:, 1, 3] = dt
        c = p @ moved.transpose(0, 2, 1)
        gain = np.linalg.solve(p_later, c.transpose(0, 2, 1)).transpose(0, 2, 1)
        links = np.empty(of.size, EXACT_LINK)
        links["time_ns"] = [self._time_ns[s] for s in of.tolist()]
        links["mean"], links["step"], links["gain"] = mean, later - mean, gain
        links["spread"] = (p - gain @ p_later @ gain.transpose(0, 2, 1))[:, *lower(MOVES)]
        links["course"], links["ahead"] = _course(mean), 1
        links["is_measured"] = [not self._links[s] for s in of.tolist()]
        for s, one in zip(of.tolist(), links, strict=True):
            self._links[s].append(one)

    def _weigh(self, slot: IntArray, measured: Detections) -> Evidence:
        evidence = self._inner.weigh(slot, measured)
        for s in slot.tolist():
            self.chain[s].extend(np.array(self._links[s], EXACT_LINK), self._belief(s))
            self._links[s] = []
        return evidence

    def sibling(self) -> RecordedKalman:
        """One of the same noise, without beliefs."""
        return RecordedKalman(self._of.sibling())

    def _place(self, slot: IntArray, key: AnyArray, mean: FloatArray, covariance: FloatArray) -> None:
        self._of.place(slot, key, mean, covariance)

    def _arrived(self, slot: IntArray, start: Sequence[Belief]) -> list[Bridge]:
        mean, covariance = self._gaussian(slot)
        return [
            Bridge(
                float(log_gaussian(belief.mean[:MOVES] - m, p + belief.covariance[:MOVES, :MOVES])),
                np.array(self._links[s], EXACT_LINK),
            )
            for s, m, p, belief in zip(slot.tolist(), mean, covariance, start, strict=True)
        ]


def log_gaussian(off: FloatArray, covariance: FloatArray) -> FloatArray:
    """Natural log density of deviations (..., d) from the mean of a Gaussian of covariance (d, d)."""
    squared = np.einsum("...i,...i->...", off, np.linalg.solve(covariance, off[..., None])[..., 0])
    return np.asarray(-0.5 * (squared + np.linalg.slogdet(2.0 * np.pi * covariance)[1]))


def recorded(bayes_filter: BayesFilter) -> RecordedFilter:
    """The filter as one that keeps chains.

    Raises:
        ValueError: a filter that has no smoother.
    """
    if isinstance(bayes_filter, ParticleFilter):
        return RecordedParticles(bayes_filter)
    if isinstance(bayes_filter, ConstantVelocityKalman):
        return RecordedKalman(bayes_filter)
    kind = type(bayes_filter).__name__
    raise ValueError(f"filter: expected a particle filter or constant velocity, which can be smoothed, got {kind}")


def _course(mean: FloatArray) -> FloatArray:
    """(n, 4) -> (n, 2) unit vectors along the velocities; east of one that stands."""
    direction = np.arctan2(mean[:, 3], mean[:, 2])
    return np.column_stack([np.cos(direction), np.sin(direction)])
