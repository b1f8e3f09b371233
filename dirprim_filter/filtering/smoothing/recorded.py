"""Filters that record, for each belief, the regression between successive states that a smoother needs.

Between two measurements particles are not resampled, so each is a path of its own, and the particles' joint moments at
two times give the regression of the earlier on the later. Across a gap they are taken with the weights that the later
measurement gave, as far as enough particles are left: of a belief with several arms that counts which the vehicle took.

Source: Raanes, On the ensemble Rauch-Tung-Striebel smoother, 2016; Beaumont, Zhang and Balding, Approximate Bayesian
Computation in Population Genetics, 2002, for the regression among the samples that come near.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

from dirprim_filter import filtering
from dirprim_filter.arrays import AnyArray, FloatArray, IntArray
from dirprim_filter.detections import Detections
from dirprim_filter.filtering.particle_filter import ParticleFilter
from dirprim_filter.filtering.protocols import BayesFilter, Evidence
from dirprim_filter.filtering.smoothing import _kernels
from dirprim_filter.filtering.smoothing._kernels import N_COLUMNS, N_STATES
from dirprim_filter.filtering.smoothing.chain import MOVES, Belief, link_type, lower
from dirprim_filter.filtering.smoothing.recorded_filter import Bridge, RecordedFilter
from dirprim_filter.primitives.cues import Cue

if TYPE_CHECKING:
    from dirprim_filter.filtering.kalman import ConstantVelocityKalman

LEAST_EFFECTIVE = 0.4
"""Share of the particles that links across a gap are learned from at least."""
GAP_NS = 1_000_000_000
"""In less no belief forks, and all particles count: those that came near alone are too sure of who starts or stops."""
BANDWIDTH = 0.1
"""Share of the particles' covariance, times n^(-1/4), by which their density is smoothed: it may have several modes."""
LINK = link_type(N_STATES, gain="<f2")
"""Of particles, 189 bytes: a thousand of them do not know a gain to the half per mille that this keeps."""
EXACT_LINK = link_type(MOVES, gain="<f4")


class RecordedParticles(RecordedFilter):
    """Of a particle filter; between measurements its particles are kept at each step.

    Args:
        inner: whose particles are looked at.
    """

    def __init__(self, inner: ParticleFilter) -> None:
        super().__init__(inner, LINK)
        self._of = inner
        self._past: dict[int, list[tuple[int, FloatArray, int]]] = {}  # times, particles of vehicles, and which

    def _columns(self, slot: IntArray) -> FloatArray:
        cloud = self._of.belief.cloud
        out = np.empty((slot.size, N_COLUMNS, cloud.speed.shape[1]))
        self._of.split(_kernels.columns_of, (cloud, self._of.manoeuvres), (slot, out), (), each_ns=12.0)
        return out

    def _belief(self, slot: int) -> Belief:
        one = np.array([slot])
        return next(self._beliefs(one, self._columns(one), self._of.belief.cloud.weight[one]))

    def _beliefs(self, slot: IntArray, columns: FloatArray, weight: FloatArray) -> Iterator[Belief]:
        mean, covariance = np.empty((slot.size, N_COLUMNS)), np.empty((slot.size, N_STATES, N_STATES))
        self._of.split(_kernels.moments_each, (), (weight, columns, mean, covariance), (), each_ns=10.0)
        for s, m, p in zip(slot.tolist(), mean, covariance, strict=True):
            yield Belief(self._time_ns[s], m[:N_STATES], p, m[N_STATES:])

    def _start(self, slot: int) -> None:
        self._past[slot] = []

    def _predict(self, slot: IntArray, dt_s: FloatArray, known: AnyArray) -> None:
        slots = slot[known]
        is_waiting = np.array([bool(self._past[s]) for s in slots.tolist()], np.bool_)
        for of in (slots[~is_waiting], slots[is_waiting]):  # an array is kept while any vehicle of it is not measured
            columns = self._columns(of)
            for row, s in enumerate(of.tolist()):
                self._past[s].append((self._time_ns[s], columns, row))
        self._inner.predict(slot, dt_s)

    def _weigh(self, slot: IntArray, measured: Detections) -> Evidence:
        cloud = self._of.belief.cloud
        before, now = cloud.weight[slot], self._columns(slot)
        evidence = self._inner.weigh(slot, measured)
        after = cloud.weight[slot]
        since_ns = np.array([self._time_ns[s] - past[0][0] if (past := self._past[s]) else 0 for s in slot.tolist()])
        weight = before.copy()
        for i in np.flatnonzero(since_ns > GAP_NS).tolist():
            _kernels.tempered(before[i], after[i], LEAST_EFFECTIVE * before.shape[1], weight[i])
        moved = now.copy()
        moved[evidence.is_moved] = self._columns(slot[evidence.is_moved])
        beliefs = list(self._beliefs(slot, moved, after))
        links = self._linked(slot, weight, now, np.array([belief.covariance for belief in beliefs]))
        for s, own, last in zip(slot.tolist(), links, beliefs, strict=True):
            self.chain[s].extend(own, last)
            self._past[s] = []
        return evidence

    def _linked(
        self, slot: IntArray, weight: FloatArray, now: FloatArray, believed: FloatArray | None = None
    ) -> list[AnyArray]:
        """Links of each vehicle's steps since its last measurement, by weights (v, P) of its particles.

        A measurement may leave a belief wider than expected, `believed` (v, 5, 5), where particles were moved to it.
        What it adds to the later state is noise between the two, or the sweep back would magnify it at every step: the
        map draws vehicles together, so backwards it drives them apart.
        """
        n_steps = np.array([len(self._past[s]) for s in slot.tolist()], np.int64)
        vehicle = np.repeat(np.arange(slot.size), n_steps)
        steps = [step for s in slot.tolist() for step in self._past[s]]
        links = np.empty(len(steps), LINK)
        if not steps:
            return [links] * slot.size
        added = np.zeros((slot.size, N_STATES, N_STATES))
        if believed is not None:
            expected = np.array([belief.covariance for belief in self._beliefs(slot, now, weight)])
            size, axes = np.linalg.eigh(believed - expected)
            added = (axes * np.maximum(size, 0.0)[:, None]) @ axes.transpose(0, 2, 1)
        mean, later = np.empty((len(steps), N_COLUMNS)), np.empty((len(steps), N_STATES))
        gain, spread = np.empty((2, len(steps), N_STATES, N_STATES))
        row, kept = np.array([row for *_, row in steps]), np.array([id(columns) for _, columns, _ in steps])
        for i in np.unique(kept, return_index=True)[1].tolist():
            at = np.flatnonzero(kept == kept[i])
            which, results = (at, row[at], vehicle[at]), (mean, later, gain, spread)
            self._of.split(_kernels.link_each, (weight, steps[i][1], now, added), which, results, each_ns=40.0)
        links["time_ns"] = [time_ns for time_ns, *_ in steps]
        links["mean"], links["step"] = mean[:, :N_STATES], later - mean[:, :N_STATES]
        links["gain"], links["spread"], links["course"] = gain, spread[:, *lower(N_STATES)], mean[:, N_STATES:]
        end = np.cumsum(n_steps)
        links["ahead"] = end[vehicle] - np.arange(len(steps))
        links["is_measured"] = links["ahead"] == n_steps[vehicle]
        return np.split(links, end[:-1])

    def sibling(self) -> RecordedParticles:
        """One that moves by the same map, without beliefs."""
        return RecordedParticles(self._of.sibling())

    def weigh_by_cue(self, slot: IntArray, cue: Cue) -> FloatArray:
        """As the filter does."""
        return self._of.weigh_by_cue(slot, cue)

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
    if isinstance(
        bayes_filter, filtering.ConstantVelocityKalman
    ):  # which is imported only now: filterpy takes a second
        return RecordedKalman(bayes_filter)
    kind = type(bayes_filter).__name__
    raise ValueError(f"filter: expected a particle filter or constant velocity, which can be smoothed, got {kind}")


def _course(mean: FloatArray) -> FloatArray:
    """(n, 4) -> (n, 2) unit vectors along the velocities; east of one that stands."""
    direction = np.arctan2(mean[:, 3], mean[:, 2])
    return np.column_stack([np.cos(direction), np.sin(direction)])
