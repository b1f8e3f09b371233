"""The vehicle in focus: its speed between the quantiles of the prior's speeds, and Eq. 4 around the circle.

What is usual at the place is the prior, what the vehicle's turn signal or course says is the cue.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from itertools import pairwise

import numpy as np
import rerun as rr
from scipy.special import gammainc

from dirprim_filter.arrays import FloatArray
from dirprim_filter.config import LearningConfig
from dirprim_filter.distributions import VonMisesMixture
from dirprim_filter.distributions.angles import TWO_PI
from dirprim_filter.distributions.product import multiply_mixtures
from dirprim_filter.primitives.primitive_map import PrimitiveMap
from dirprim_filter.viewer.focus import BIN_DEG, Look

QUANTILES = (0.05, 0.5, 0.95)
N_SPEEDS = 160
STANDING_SPEED = LearningConfig().standing_speed
LEAST_SHARE = 0.01
LEAST_FIT = -300.0
"""Natural log; where no mode at all fits, the prior says nothing."""
N_ANGLES = 120
AROUND_PEAK = 4.0 * np.linspace(-1.0, 1.0, 25)
"""Angles in standard deviations of the sharpest mode: a density of one degree would fall between the others."""
COLORS = {
    "belief": (120, 128, 145), "prior": (230, 159, 0), "cue": (86, 180, 233), "posterior": (255, 255, 255),
}  # fmt: skip
"""By curve."""
GRID_COLOR = (55, 60, 72)
SOUTHWARDS = np.array([1.0, -1.0])
"""Two-dimensional views count y downwards."""


def speed_rows(looks: Sequence[Look | None], primitives: PrimitiveMap | None) -> FloatArray:
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
    if primitives is not None:
        prior = primitives.primitive_at(np.array([look.position for look in shown]))
        fit = prior.direction.mode_log_density(np.array([look.direction for look in shown]))
        fit = np.where(prior.speed.mean < STANDING_SPEED, -np.inf, fit)
        weight = np.exp(fit - np.maximum(fit.max(axis=-1, keepdims=True), LEAST_FIT))
        weight /= np.maximum(weight.sum(axis=-1, keepdims=True), np.exp(LEAST_FIT))
        far = prior.speed.mean + 4.0 * np.sqrt(prior.speed.shape) / prior.speed.rate
        grid = np.linspace(0.0, float(far[weight > LEAST_SHARE].max(initial=1.0)), N_SPEEDS)
        below = gammainc(prior.speed.shape[:, None], prior.speed.rate[:, None] * grid[:, None])  # (n, speeds, M)
        share = (weight[:, None] * below).sum(axis=-1)
        for k, quantile in enumerate(QUANTILES):
            rows[there, 3 + k] = grid[(share < quantile).sum(axis=1).clip(max=N_SPEEDS - 1)]
    changed = [i for i, (a, b) in enumerate(pairwise(shown)) if a.track_id != b.track_id]
    rows[[there[i] for i in changed]] = np.nan  # a curve must not run on from one vehicle to the next
    return rows


def polar_curves(looks: Sequence[Look], primitives: PrimitiveMap | None) -> dict[str, FloatArray]:
    """Eq. 4 for one vehicle in each of n frames: prior, cue, posterior and belief as closed lines, (n, k, 2).

    Radii are square roots of densities, so that areas are probabilities; the longest of a frame is 1.
    """
    turn, concentration = np.array([look.cue for look in looks]).T[..., None]
    cue = VonMisesMixture(weight=np.ones_like(turn), mean_direction=turn, concentration=concentration)
    prior = (
        cue if primitives is None else primitives.primitive_at(np.array([look.position for look in looks])).direction
    )
    lines = {}
    for name, mixture in (("prior", prior), ("cue", cue), ("posterior", multiply_mixtures(prior, cue).mixture)):
        theta = _angles(mixture)
        one_each = VonMisesMixture(
            weight=mixture.weight[:, None], mean_direction=mixture.mean_direction[:, None],
            concentration=mixture.concentration[:, None],
        )  # fmt: skip
        lines[name] = (theta, np.exp(0.5 * one_each.log_density(theta)))
    n_bins = max(len(look.belief) for look in looks)
    share = np.array([look.belief if len(look.belief) else np.zeros(n_bins) for look in looks])
    edge = np.repeat(np.arange(n_bins + 1) * np.radians(BIN_DEG), 2)[1:-1]
    steps = np.sqrt(np.repeat(share, 2, axis=1) / np.radians(BIN_DEG))
    lines["belief"] = (np.broadcast_to(edge, steps.shape), steps)
    longest = np.max([radius.max(axis=1, initial=0.0) for _, radius in lines.values()], axis=0)[:, None]
    return {name: _closed(theta, radius / longest) for name, (theta, radius) in lines.items()}


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


def polar_styles() -> Iterator[tuple[str, rr.AsComponents]]:
    """What is static of the polar plot: colours of its curves, rings, letters of the winds, and its key."""
    for name, color in COLORS.items():
        width = 2.0 if name == "posterior" else 1.25
        yield f"/polar/{name}", rr.LineStrips2D.from_fields(colors=color, radii=rr.Radius.ui_points(width))
    no_dot = rr.Radius.ui_points(0.0)
    yield "/polar/vehicle", rr.Points2D.from_fields(colors=COLORS["posterior"], radii=no_dot, show_labels=True)
    circle = np.linspace(0.0, TWO_PI, 73)
    ring = np.stack([np.cos(circle), np.sin(circle)], axis=-1)
    winds = {"E": (1.0, 0.0), "N": (0.0, -1.0), "W": (-1.0, 0.0), "S": (0.0, 1.0)}
    lines = [0.5 * ring, ring, *(np.array([(0.0, 0.0), end]) for end in winds.values())]
    yield "/polar/grid", rr.LineStrips2D(lines, colors=GRID_COLOR, radii=rr.Radius.ui_points(0.5))
    places = [*(1.12 * np.array(end) for end in winds.values()), *((-1.3, -1.35 + 0.23 * i) for i in range(4))]
    key = rr.Points2D(
        np.array(places), labels=[*winds, *reversed(COLORS)], radii=no_dot, show_labels=True,
        colors=[*[GRID_COLOR] * 4, *reversed(COLORS.values())],
    )  # fmt: skip
    yield "/polar/key", key
