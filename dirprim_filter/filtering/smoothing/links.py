"""How each state of a belief follows from the one at its next measurement.

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

from dirprim_filter.arrays import AnyArray, FloatArray, IntArray
from dirprim_filter.filtering._kernels import N_MEANS, N_STATES, effective_sample_size
from dirprim_filter.filtering.belief import States
from dirprim_filter.filtering.protocols import Smoothable

LEAST_VARIANCE = np.diag([1e-8, 1e-8, 1e-6, 1e-6, 1e-6])
"""Added to what a later state varies by: standing vehicles' velocities do not vary at all."""
LEAST_EFFECTIVE = 0.4
"""Share of the samples that links across a gap are learned from at least."""
MOVES = 4
"""Of a state: place and velocity, which estimates have."""
HALVINGS = 12
"""Of the interval in which the exponent of weights is looked for."""
LINK = np.dtype([
    ("time_ns", "<i8"), ("ahead", "<i8"), ("mean", "<f8", (N_STATES,)), ("later", "<f8", (N_STATES,)),
    ("gain", "<f8", (N_STATES, N_STATES)), ("spread", "<f8", (N_STATES, N_STATES)), ("course", "<f8", (2,)),
])  # fmt: skip
"""How a state of a vehicle followed from a later one: x | x' ~ N(mean + gain (x' - later), spread).

`ahead` counts the links to the later state's; `course` is the mean of cosine and sine of the direction.
"""


class Belief(NamedTuple):
    """A belief about one vehicle at one time."""

    time_ns: int
    mean: FloatArray  # (5,) x, y, their rates, and what else lasts
    covariance: FloatArray  # (5, 5)
    course: FloatArray  # (2,) mean of cosine and sine of the direction


class Before(NamedTuple):
    """The state of a vehicle before a step."""

    time_ns: int
    state: States  # of one


def moments_of(bayes_filter: Smoothable, states: States) -> tuple[FloatArray, FloatArray, FloatArray]:
    """(v, 5) means, (v, 5, 5) covariances and (v, 2) courses, as of a `Belief`."""
    each = np.arange(len(states.weight))
    mean, covariance = bayes_filter.joint(states, states, vehicle=each, dt_s=np.zeros(each.size))
    return mean[:, :N_STATES], covariance[:, :N_STATES, :N_STATES], mean[:, N_STATES:N_MEANS]


def links_of(
    bayes_filter: Smoothable, paths: Sequence[Sequence[Before]], now: States, now_ns: IntArray, found: FloatArray
) -> list[AnyArray]:
    """(m,) `LINK` for each step of paths (v,) to states that hold at (v,) times.

    P' is the covariance of `now`, C = cov(then, now): gain = C (P' + least)^-1 and spread = P - gain C^T - C gain^T +
    gain P' gain^T, a covariance whatever the gain. Where samples were moved to a measurement, their covariance `found`
    (v, 5, 5), else 0, may be larger than expected. That is noise between the two, or the sweep back would magnify it at
    every step: the map draws vehicles together, so backwards it drives them apart.
    """
    steps, n_steps = [step for path in paths for step in path], np.array([len(path) for path in paths], np.int64)
    vehicle, end, links = np.repeat(np.arange(len(paths)), n_steps), np.cumsum(n_steps), np.empty(len(steps), LINK)
    links["time_ns"] = [step.time_ns for step in steps]
    links["ahead"] = end[vehicle] - np.arange(len(steps))
    then = States(*(np.concatenate(column) for column in zip(*(step.state for step in steps), strict=True)))
    dt_s = (now_ns[vehicle] - links["time_ns"]) * 1e-9
    mean, both = bayes_filter.joint(then, now, vehicle=vehicle, dt_s=dt_s)
    p, c, later = both[:, :N_STATES, :N_STATES], both[:, :N_STATES, N_STATES:], both[:, N_STATES:, N_STATES:]
    more, axes = np.linalg.eigh(found[vehicle] - later)
    later = later + (axes * np.maximum(more, 0.0)[:, None]) @ axes.swapaxes(1, 2)
    gain = np.linalg.solve(later + LEAST_VARIANCE, c.swapaxes(1, 2)).swapaxes(1, 2)
    shared = gain @ c.swapaxes(1, 2)
    links["mean"], links["course"] = mean[:, :N_STATES], mean[:, N_STATES:N_MEANS]
    links["later"] = mean[:, N_MEANS : N_MEANS + N_STATES]
    links["gain"], links["spread"] = gain, p - shared - shared.swapaxes(1, 2) + gain @ later @ gain.swapaxes(1, 2)
    return np.split(links, end)[:-1]


def unlinked(last: Belief) -> AnyArray:
    """(1,) `LINK` of a belief of which later ones say nothing."""
    link = np.zeros(1, LINK)
    link["time_ns"], link["ahead"], link["mean"] = last.time_ns, 1, last.mean
    link["spread"], link["course"] = last.covariance, last.course
    return link


def tempered(before: FloatArray, after: FloatArray) -> tuple[FloatArray, float]:
    """(P,) weights before^(1-t) after^t, with the largest t up to 1 that leaves enough samples; and t.

    All of them are right to learn from how a state follows from a later one: they differ by a function of the later.
    """
    ratio = np.divide(after, before, out=np.zeros_like(after), where=before > 0.0)

    def at(exponent: float) -> FloatArray:
        weight = before * ratio**exponent
        return np.asarray(weight / weight.sum())

    low, high, enough = 0.0, 2.0, LEAST_EFFECTIVE * before.size
    for _ in range(HALVINGS):
        middle = 0.5 * (low + high)
        low, high = (middle, high) if effective_sample_size(at(middle)) >= enough else (low, middle)
        if low >= 1.0:
            return at(1.0), 1.0
    return at(low), low
