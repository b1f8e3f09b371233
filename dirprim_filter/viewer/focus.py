"""The vehicle in focus: the one asked for, else the one with the largest innovations; and the curves shown of it.

In dense traffic only a few are drawn in full, by the same measure: a thousand ellipses would hide each other.

Shown are its speed between the quantiles of the prior's speeds, and Eq. 4 around the circle: what is usual at the place
(the prior), what its course says (the cue), and both together.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field
from heapq import nsmallest
from itertools import pairwise
from typing import NamedTuple

import numpy as np
from scipy.special import gammainc

from dirprim_filter.arrays import BoolArray, FloatArray
from dirprim_filter.config import LearningConfig
from dirprim_filter.distributions import VonMisesMixture
from dirprim_filter.distributions.angles import TWO_PI
from dirprim_filter.distributions.product import multiply_mixtures
from dirprim_filter.estimates import Estimates, TrackedFrame
from dirprim_filter.primitives.primitive_map import PrimitiveMap

KEPT_S = 8.0
"""Seconds for which a vehicle stays in focus: quick changes would make its plots useless."""
MEMORY_S = 2.0
"""Over which a vehicle's log evidence is averaged."""
COURSE_S = 1.0
"""Over which its course is taken."""
TURN_SPREAD = 0.3
"""Radians by which a vehicle may turn from its course; the cue is no surer."""
CROWD = 40
"""More vehicles than this are a crowd,"""
STILL_CROWD = 32
"""and remain one down to this: a vehicle more or less must not change the picture."""
DRAWN_IN_FULL = 12
"""Of a crowd."""
QUANTILES = (0.05, 0.5, 0.95)
N_SPEEDS = 160
STANDING_SPEED = LearningConfig().standing_speed
LEAST_SHARE = 0.01
LEAST_FIT = -300.0
"""Natural log; where no mode at all fits, the prior says nothing."""
BIN_DEG = 5
N_ANGLES = 120
AROUND_PEAK = 4.0 * np.linspace(-1.0, 1.0, 25)
"""Angles in standard deviations of the sharpest mode: a density of one degree would fall between the others."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Look:
    """The vehicle in one frame.

    Attributes:
        time_ns: of the frame.
        track_id: of the vehicle.
        position: (2,) metres.
        speed: m/s, estimated, and its standard deviation.
        direction: radians, estimated.
        course: radians, from where it was a while ago; and its concentration, 0 where it has not moved.
        belief: (n_bins,) share of its particles by direction; empty where there are none.
    """

    time_ns: int
    track_id: str
    position: FloatArray
    speed: tuple[float, float]
    direction: float
    course: tuple[float, float]
    belief: FloatArray = field(default_factory=lambda: np.empty(0))


class _Places(NamedTuple):
    """Where the vehicles of one frame were."""

    time_ns: int
    row_of: dict[str, int]
    position: FloatArray
    spread: FloatArray  # metres


class Focus:
    """Follows the vehicle to look at from frame to frame.

    Args:
        chosen: its id; None: the one with the largest innovations.
    """

    def __init__(self, chosen: str | None) -> None:
        self._chosen = chosen
        self._now: str | None = None
        self._since_ns = 0
        self._before: set[str] = set()
        self._evidence: dict[str, float] = {}
        self._past: deque[_Places] = deque()
        self._last_ns: int | None = None
        self._is_crowd = False
        self._few: set[str] = set()
        self._few_since_ns = 0

    def see(self, frame: TrackedFrame) -> Look | None:
        """The vehicle in this frame; None where it is not there."""
        believed, names = frame.estimates, frame.names
        self._remember(frame.time_ns, names, believed)
        name = self._chosen or self._worst(frame.time_ns, names, believed)
        if name is None or name not in names:
            return None
        row = names.index(name)
        mine = frame.particles.of(row)
        bins = np.floor(mine.direction % TWO_PI / TWO_PI * (360 // BIN_DEG)).astype(np.int64)
        return Look(
            time_ns=frame.time_ns,
            track_id=name,
            position=believed.position[row],
            speed=(float(believed.speed[row]), float(believed.speed_std[row])),
            direction=float(believed.direction[row]),
            course=self._course(name),
            belief=np.asarray(np.bincount(bins, mine.weight, 360 // BIN_DEG), np.float64) if len(mine) else np.empty(0),
        )

    def in_full(self, frame: TrackedFrame, *, box: FloatArray) -> BoolArray:
        """Which vehicles of the frame that was seen last are drawn with all that is known of them. -> (n,).

        All, unless they are a crowd: then some within the box, (2, 2) metres, that the filter understands least, each
        for `KEPT_S` at most, and the vehicle to look at.
        """
        believed, names = frame.estimates, frame.names
        self._is_crowd = len(names) > (STILL_CROWD if self._is_crowd else CROWD)
        if not self._is_crowd:
            return np.ones(len(names), np.bool_)
        if frame.time_ns >= self._few_since_ns + KEPT_S * 1e9 or not self._few:
            self._few, self._few_since_ns = set(), frame.time_ns
        is_near = ((believed.position >= box[0]) & (believed.position <= box[1])).all(axis=1)
        near = [name for name, is_in in zip(names, is_near.tolist(), strict=True) if is_in and name in self._before]
        kept = [name for name in near if name in self._few]
        others = (name for name in near if name not in self._few)
        self._few = {*kept, *nsmallest(DRAWN_IN_FULL - len(kept), others, key=self._evidence.__getitem__)}
        shown = self._few | {self._chosen or self._now}
        return np.array([name in shown for name in names], np.bool_)

    def _remember(self, time_ns: int, names: list[str], believed: Estimates) -> None:
        passed_s = 0.0 if self._last_ns is None else (time_ns - self._last_ns) * 1e-9
        kept = float(np.exp(-passed_s / MEMORY_S))
        self._last_ns = time_ns
        before, now = self._evidence, believed.log_evidence.tolist()
        self._before = set(before)
        self._evidence = {
            name: kept * before.get(name, one) + (1.0 - kept) * one for name, one in zip(names, now, strict=True)
        }
        spread = np.sqrt(0.5 * np.trace(believed.covariance, axis1=1, axis2=2))
        row_of = dict(zip(names, range(len(names)), strict=True))
        self._past.append(_Places(time_ns, row_of, believed.position, spread))
        while self._past[0].time_ns < time_ns - 1.5e9 * COURSE_S:
            self._past.popleft()

    def _worst(self, time_ns: int, names: list[str], believed: Estimates) -> str | None:
        """The present one for `KEPT_S`; then, of those measured now, the one of the lowest log evidence."""
        if self._now in names and time_ns < self._since_ns + KEPT_S * 1e9:
            return self._now
        here = [name for name, unseen_s in zip(names, believed.unseen_s, strict=True) if unseen_s == 0]
        followed = [name for name in here if name in self._before]
        self._since_ns = time_ns
        self._now = min(followed, key=self._evidence.__getitem__, default=None)
        return self._now

    def _course(self, name: str) -> tuple[float, float]:
        now = then = self._past[-1]
        for past in reversed(self._past):
            if name not in past.row_of:
                break
            then = past
        start, end = (places.position[places.row_of[name]] for places in (then, now))
        start_spread, end_spread = (float(places.spread[places.row_of[name]]) for places in (then, now))
        distance = float(np.hypot(*(end - start)))
        if now.time_ns - then.time_ns < 0.5e9 * COURSE_S or distance <= start_spread + end_spread:
            return 0.0, 0.0
        variance = (start_spread**2 + end_spread**2) / distance**2 + TURN_SPREAD**2
        return float(np.arctan2(*(end - start)[::-1])), 1.0 / variance


def speed_rows(looks: list[Look | None], primitives: PrimitiveMap | None) -> FloatArray:
    """(n, 6) estimate, less and plus its deviation, the quantiles of the prior; NaN without a vehicle in focus.

    The prior is p(speed | position, direction) of vehicles in motion: each mode's gamma, weighed by how well the
    direction fits the mode; those that stand have no direction.
    """
    rows = np.full((len(looks), 3 + len(QUANTILES)), np.nan)
    there = [i for i, look in enumerate(looks) if look is not None]
    shown = [look for look in looks if look is not None]
    if not shown:
        return rows
    speed, deviation = np.array([look.speed for look in shown]).T
    rows[there, :3] = np.stack([speed, np.maximum(speed - deviation, 0.0), speed + deviation], axis=-1)
    changed = [i for i, (a, b) in enumerate(pairwise(shown)) if a.track_id != b.track_id]
    if primitives is not None:
        prior = primitives.primitive_at(np.array([look.position for look in shown]))
        fit = prior.direction.mode_log_density(np.array([look.direction for look in shown]))
        fit = np.where(prior.speed.mean < STANDING_SPEED, -np.inf, fit)
        weight = np.exp(fit - np.maximum(fit.max(axis=-1, keepdims=True), LEAST_FIT))
        weight /= np.maximum(weight.sum(axis=-1, keepdims=True), np.exp(LEAST_FIT))
        far = prior.speed.mean + 4.0 * np.sqrt(prior.speed.shape) / prior.speed.rate
        fastest = float(far[weight > LEAST_SHARE].max(initial=1.0))
        grid = np.linspace(0.0, fastest, N_SPEEDS)
        below = gammainc(prior.speed.shape[:, None], prior.speed.rate[:, None] * grid[:, None])  # (n, speeds, M)
        share = (weight[:, None] * below).sum(axis=-1)
        for k, quantile in enumerate(QUANTILES):
            rows[there, 3 + k] = grid[(share < quantile).sum(axis=1).clip(max=N_SPEEDS - 1)]
    rows[[there[i] for i in changed]] = np.nan  # a curve must not run on from one vehicle to the next
    return rows


@dataclass(frozen=True, slots=True, kw_only=True)
class PolarCurves:
    """Densities around the circle, drawn so that areas are probabilities: closed lines, (n, k, 2), x east, y north."""

    prior: FloatArray
    cue: FloatArray
    posterior: FloatArray
    belief: FloatArray


def polar_curves(looks: Sequence[Look], primitives: PrimitiveMap | None) -> PolarCurves:
    """Eq. 4 for one vehicle in each of n frames: radii are square roots of densities, the longest of a frame is 1."""
    course, concentration = np.array([look.course for look in looks]).T[..., None]
    cue = VonMisesMixture(weight=np.ones_like(course), mean_direction=course, concentration=concentration)
    prior = (
        cue if primitives is None else primitives.primitive_at(np.array([look.position for look in looks])).direction
    )
    posterior = multiply_mixtures(prior, cue).mixture
    lines = {}
    for name, mixture in (("prior", prior), ("cue", cue), ("posterior", posterior)):
        theta = _angles(mixture)
        one_each = VonMisesMixture(
            weight=mixture.weight[:, None],
            mean_direction=mixture.mean_direction[:, None],
            concentration=mixture.concentration[:, None],
        )
        lines[name] = (theta, np.exp(0.5 * one_each.log_density(theta)))
    n_bins = max(len(look.belief) for look in looks)
    share = np.array([look.belief if len(look.belief) else np.zeros(n_bins) for look in looks])
    edge = np.repeat(np.arange(n_bins + 1) * np.radians(BIN_DEG), 2)[1:-1]
    steps = np.sqrt(np.repeat(share, 2, axis=1) / np.radians(BIN_DEG))
    lines["belief"] = (np.broadcast_to(edge, steps.shape), steps)
    longest = np.max([radius.max(axis=1, initial=0.0) for _, radius in lines.values()], axis=0)[:, None]
    return PolarCurves(**{name: _closed(theta, radius / longest) for name, (theta, radius) in lines.items()})


def _angles(mixture: VonMisesMixture) -> FloatArray:
    """Angles all around, ascending, and more of them about the heaviest modes. (n, M) -> (n, k)."""
    heavy = np.argsort(-mixture.weight, axis=-1)[:, :3]
    deviation = 1.0 / np.sqrt(np.maximum(np.take_along_axis(mixture.concentration, heavy, axis=-1), 1.0))
    near = np.take_along_axis(mixture.mean_direction, heavy, axis=-1)[..., None] + deviation[..., None] * AROUND_PEAK
    around = np.broadcast_to(np.linspace(0.0, TWO_PI, N_ANGLES, endpoint=False), (len(heavy), N_ANGLES))
    return np.sort(np.concatenate([around, near.reshape(len(heavy), -1) % TWO_PI], axis=1), axis=1)


def _closed(theta: FloatArray, radius: FloatArray) -> FloatArray:
    line = radius[..., None] * np.stack([np.cos(theta), np.sin(theta)], axis=-1)
    return np.concatenate([line, line[:, :1]], axis=1)


def polar_grid() -> Iterator[tuple[FloatArray, str]]:
    """The rings and the cross under the curves: lines (k, 2) and what to write at their ends."""
    circle = np.linspace(0.0, TWO_PI, 73)
    for radius in (0.5, 1.0):
        yield radius * np.stack([np.cos(circle), np.sin(circle)], axis=-1), ""
    for letter, end in (("E", (1.0, 0.0)), ("N", (0.0, 1.0)), ("W", (-1.0, 0.0)), ("S", (0.0, -1.0))):
        yield np.array([(0.0, 0.0), end]), letter
