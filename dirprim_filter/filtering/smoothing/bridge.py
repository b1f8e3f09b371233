"""The way of a vehicle between two measurements that are far apart, given where it was before and came back after.

Two answers are averaged. *Straight on*, with white acceleration, the way is Gaussian, and exact: Rauch's, Tung's and
Striebel's. *By the map*, samples go on from the last measurement, guided: where they are unlikely to arrive they are
resampled on the way, by how well straight motion would bring them to the end, a detour that their weights take back. At
the end those that came near count, and what is still between them and the end is corrected by linear regression.

Source: Rauch, Tung and Striebel, Maximum likelihood estimates of linear dynamic systems, 1965; Del Moral and Murray,
Sequential Monte Carlo with Highly Informative Observations, 2015; Whiteley and Lee, Twisted particle filters, 2014.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import NamedTuple, Self

import numpy as np

from dirprim_filter.arrays import FloatArray, IntArray
from dirprim_filter.distributions import gaussian
from dirprim_filter.filtering._kernels import effective_sample_size
from dirprim_filter.filtering.belief import States
from dirprim_filter.filtering.kalman import ConstantVelocityKalman
from dirprim_filter.filtering.particle_filter import ParticleFilter
from dirprim_filter.filtering.protocols import Smoothable
from dirprim_filter.filtering.smoothing.links import LEAST_VARIANCE, MOVES, tempered

WAYS, ARRIVALS = 8, 2
"""Times the filter's samples go across a gap, for the ways through it and for the evidence of its end: of those that
are resampled on the way few beginnings are left. By 2 errors of 60 s of Chicago's buses were 5.4 % larger [2.6, 9.0],
of 40 s of GeoLife 2.7 % [-.9, 6.3], and regions smaller."""
GUIDES, GUIDE_S = 20, 0.5
"""Resamplings on the way, at most, and seconds between them at least."""
WANDER = 4.0
"""Times the density of the straight motion's acceleration in the guide: roads wind. By 1 errors of gaps of 60 s were
larger on GeoLife and Chicago's buses, by 16 those of 10 and 15 s, when this was chosen."""
RESAMPLED_BELOW = 0.5
"""Share of the samples that is effective."""
POWER = 0.5
"""Of the evidence for the map, as both motions are wrong in part (Grünwald and van Ommen 2017). By .25 and 1 errors are
alike on GeoLife and Chicago's buses, but by 1 regions are too small; in the town by .25 errors are larger."""
LEAST_INFORMATION = 1e-8
"""1/m^2, or s^2/m^2: of a state of which later measurements say nothing."""


class Gaussian(NamedTuple):
    """Of x, y and their rates; of a way at each of its instants, (t, 4) and (t, 4, 4)."""

    mean: FloatArray  # (4,)
    covariance: FloatArray  # (4, 4)

    def unbiased(self, bias_m: FloatArray, course: FloatArray) -> Self:
        """Less a bias (2,) along and across the way; of who hardly moves that is the course (2,) of the filter."""
        along = self.mean[2:] / np.sqrt(self.mean[2:] @ self.mean[2:] + np.trace(self.covariance[2:, 2:]))
        along = along + (1.0 - np.hypot(*along)) * course
        mean, covariance = self.mean.copy(), self.covariance.copy()
        mean[:2] -= bias_m[0] * along + bias_m[1] * np.array([-along[1], along[0]])
        covariance[:2, :2] += 0.5 * (1.0 - along @ along) * (bias_m @ bias_m) * np.eye(2)  # as it may point elsewhere
        return type(self)(mean, covariance)


class Ends(NamedTuple):
    """What straight motion says of both ends of a gap.

    Attributes:
        start_ns: time of the last measurement before.
        end_ns: time of the first after.
        start: the state at the start, given all until then.
        expected: the state at the end, given the same.
        later: the state at the end, given the measurements from there on alone.
    """

    start_ns: int
    end_ns: int
    start: Gaussian
    expected: Gaussian
    later: Gaussian

    @classmethod
    def of(cls, model: ConstantVelocityKalman, start_ns: int, start: Gaussian, end_ns: int, later: Gaussian) -> Self:
        """As above."""
        dt_s = np.array([(end_ns - start_ns) * 1e-9])
        (move,), (noise,) = model.transition(dt_s), model.noise(dt_s)
        expected = Gaussian(move @ start.mean, move @ start.covariance @ move.T + noise)
        return cls(start_ns, end_ns, start, expected, later)

    @property
    def seconds(self) -> float:
        """Between them."""
        return (self.end_ns - self.start_ns) * 1e-9

    def unbiased(self, bias_m: FloatArray, courses: Sequence[FloatArray]) -> Self:
        """Less a sensor's bias (2,), where the filter's courses at start and end are these (2,): see `Gaussian`."""
        if not bias_m.any():
            return self
        start, later = (of.unbiased(bias_m, at) for of, at in zip((self.start, self.later), courses, strict=True))
        moved = (before + after - at for before, after, at in zip(self.expected, start, self.start, strict=True))
        return self._replace(start=start, expected=Gaussian(*moved), later=later)


def without(known: Gaussian, before: Gaussian) -> Gaussian:
    """What was learned since, of a state of which more is known than before: the quotient of both densities."""
    information = np.linalg.inv(known.covariance) - np.linalg.inv(before.covariance)
    value, axes = np.linalg.eigh(0.5 * (information + information.T))
    covariance = (axes / np.maximum(value, LEAST_INFORMATION)) @ axes.T
    gained = np.linalg.solve(known.covariance, known.mean - before.mean)
    return Gaussian(before.mean + covariance @ gained, covariance)


def straight(model: ConstantVelocityKalman, ends: Ends, time_ns: IntArray) -> Gaussian:
    """The way at times (t,), straight on."""
    since_s = np.asarray((time_ns - ends.start_ns) * 1e-9)
    move, noise = model.transition(since_s), model.noise(since_s, over_s=ends.seconds)
    mean, covariance = move @ ends.start.mean, move @ ends.start.covariance @ move.swapaxes(1, 2) + noise
    shared = covariance @ model.transition(ends.seconds - since_s).swapaxes(1, 2)
    spread = ends.expected.covariance + ends.later.covariance
    gain = np.linalg.solve(spread, shared.swapaxes(1, 2)).swapaxes(1, 2)
    return Gaussian(mean + gain @ (ends.later.mean - ends.expected.mean), covariance - gain @ shared.swapaxes(1, 2))


def log_evidence(ends: Ends) -> float:
    """Of the end, by straight motion: the log density of its state as later measurements have it, per m^2 (m/s)^2."""
    spread = ends.expected.covariance + ends.later.covariance
    return float(gaussian.log_density(ends.later.mean - ends.expected.mean, spread))


def across(
    bayes_filter: Smoothable, model: ConstantVelocityKalman, ends: Ends, start: States | None, time_ns: IntArray, *,
    key: int,
) -> Gaussian:  # fmt: skip
    """The way at times (t,) within a gap: the mean of both answers by their evidence; without a map, straight on.

    Args:
        bayes_filter: whose samples go by the map.
        model: of the straight motion.
        ends: by that.
        start: the filter's samples at the start; None: the way is straight.
        time_ns: ascending.
        key: seeds the samples' random numbers.
    """
    by_straight = straight(model, ends, time_ns)
    if start is None or not isinstance(bayes_filter, ParticleFilter) or (share := bayes_filter.own_way_share) == 1.0:
        return by_straight
    by_map, evidence = guided(bayes_filter, model, ends, start, time_ns, n=WAYS * start.weight.shape[1], key=key)
    odds = share * math.exp(min(POWER * (log_evidence(ends) - evidence), 500.0))
    return mixed(by_map, by_straight, (1.0 - share) / (1.0 - share + odds))


def log_density(
    bayes_filter: Smoothable, model: ConstantVelocityKalman, ends: Ends, start: States, *, key: int
) -> float:  # fmt: skip
    """Log density of the state at the end, by both motions in their shares; arguments as of `across`."""
    if not isinstance(bayes_filter, ParticleFilter) or (share := bayes_filter.own_way_share) == 1.0:
        return log_evidence(ends)
    n, nowhere = ARRIVALS * start.weight.shape[1], np.empty(0, np.int64)
    by_map = guided(bayes_filter, model, ends, start, nowhere, n=n, key=key)[1]
    with np.errstate(divide="ignore"):
        return float(np.logaddexp(np.log(share) + log_evidence(ends), np.log1p(-share) + by_map))


def mixed(one: Gaussian, other: Gaussian, share: float) -> Gaussian:
    """The mean and covariance of two ways, the first of which has a share."""
    mean = share * one.mean + (1.0 - share) * other.mean
    apart = one.mean - other.mean
    between = share * (1.0 - share) * apart[:, :, None] * apart[:, None]
    return Gaussian(mean, share * one.covariance + (1.0 - share) * other.covariance + between)


def guided(
    bayes_filter: ParticleFilter, model: ConstantVelocityKalman, ends: Ends, start: States, time_ns: IntArray, *,
    n: int, key: int,
) -> tuple[Gaussian, float]:  # fmt: skip
    """The way at times (t,) by the filter's own motion, from n of its samples at the start; and the log evidence."""
    rng, (target, spread) = np.random.default_rng(key), ends.later
    n_guides = min(GUIDES, math.ceil(ends.seconds / GUIDE_S))
    guides = ends.start_ns + np.arange(1, n_guides + 1) * (ends.end_ns - ends.start_ns) // n_guides
    slot = np.zeros(1, np.int64)
    samples = bayes_filter.resumed(key, start.sample[0][:, systematic(start.weight[0], n, rng)])
    asked, ways = set(time_ns.tolist()), list[FloatArray]()
    now_ns, evidence, log_guide, log_weight, before = ends.start_ns, 0.0, np.zeros(n), np.zeros(n), np.zeros(n)
    for next_ns in np.unique(np.concatenate([guides, time_ns])).tolist():
        samples.predict(slot, np.array([(next_ns - now_ns) * 1e-9]))
        now_ns, state = next_ns, samples.states(slot).sample[0, :MOVES].T
        rest_s = np.array([(ends.end_ns - now_ns) * 1e-9])
        off, loose = state @ model.transition(rest_s)[0].T - target, WANDER * model.noise(rest_s, over_s=ends.seconds)
        guide = gaussian.log_density(off, spread + loose[0])  # at the end what later measurements say
        before, log_weight, log_guide = log_weight, log_weight + guide - log_guide, guide
        if now_ns in asked:
            ways.append(state)
        weight = np.exp(log_weight - log_weight.max())
        if effective_sample_size(weight / weight.sum()) < RESAMPLED_BELOW * n and now_ns < ends.end_ns:
            evidence += float(log_weight.max() + np.log(weight.mean()))
            rows = systematic(weight, n, rng)
            samples.choose(rows)
            ways, log_guide, log_weight = [way[rows] for way in ways], log_guide[rows], np.zeros(n)
    evidence += float(log_weight.max() + np.log(weight.mean()))
    weight, exponent = tempered(np.exp(before - before.max()), weight)
    left = spread / max(1.0 - exponent, 1e-12)
    return _regressed(np.reshape(ways, (-1, n, MOVES)), state, weight, target, left), evidence


def _regressed(
    way: FloatArray, end: FloatArray, weight: FloatArray, target: FloatArray, spread: FloatArray
) -> Gaussian:  # fmt: skip
    """Ways (t, P, 4) of samples that came to ends (P, 4), by weights (P,), given the end, of such a spread (4, 4)."""
    mean, reached = np.einsum("p,tpi->ti", weight, way), weight @ end
    off, from_reached = way - mean[:, None], end - reached
    by_weight = weight[:, None] * from_reached
    covariance = np.einsum("p,tpi,tpj->tij", weight, off, off)
    shared = np.einsum("tpi,pj->tij", off, by_weight)
    found = by_weight.T @ from_reached + LEAST_VARIANCE[:MOVES, :MOVES]
    gain = np.linalg.solve(found + spread, shared.swapaxes(1, 2)).swapaxes(1, 2)
    return Gaussian(mean + gain @ (target - reached), covariance - gain @ shared.swapaxes(1, 2))


def systematic(weight: FloatArray, n: int, rng: np.random.Generator) -> IntArray:
    """(n,) rows drawn by weights (P,), each as often as its weight but for less than one."""
    total = np.cumsum(weight)
    row = np.searchsorted(total, (np.arange(n) + rng.uniform()) * (total[-1] / n))
    return np.asarray(np.minimum(row, weight.size - 1), np.int64)
