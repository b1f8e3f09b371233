"""What is plotted over time: how sure the filter is, how right, and of how many vehicles."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from itertools import pairwise
from typing import NamedTuple

import numpy as np
import rerun as rr

from dirprim_filter.arrays import FloatArray
from dirprim_filter.config import LearningConfig
from dirprim_filter.estimates import TrackedFrame
from dirprim_filter.primitives.primitive_map import PrimitiveMap
from dirprim_filter.track_ids import as_texts
from dirprim_filter.tracks import Tracks
from dirprim_filter.viewer.focus import Look

Color = tuple[int, int, int]
BLUE, DARK_BLUE, ORANGE, GREY, GREEN = (120, 200, 255), (70, 120, 160), (233, 104, 20), (120, 128, 145), (90, 190, 90)
STANDING_SPEED = LearningConfig().standing_speed
RIGHT_SQUARE = 2.0
"""Mean of a squared error of the plane that is normalised by its true covariance."""
LEAST_FIT = -300.0
"""Natural log; where no mode at all fits, the prior says nothing."""
JITTER = 1e-12


class Curves(NamedTuple):
    """The curves that share a plot."""

    title: str
    names: tuple[str, ...]
    colors: tuple[Color, ...]
    range: tuple[float, float] | None = None


PLOTS: Mapping[str, Curves] = {
    "/focus/speed": Curves(
        "Speed, m/s: blue estimate, orange prior, each +- its deviation",
        ("estimate", "less its deviation", "plus its deviation", "prior", "less its deviation", "plus its deviation"),
        (BLUE, DARK_BLUE, DARK_BLUE, ORANGE, GREY, GREY),
    ),
    "/metrics/consistency": Curves(
        "NEES, NIS: orange truth, blue innovation, 2 is right", ("NEES (truth)", "NIS (innovation)", "right"),
        (ORANGE, BLUE, GREY), (0.0, 10.0),
    ),
    "/metrics/ess": Curves("Effective sample size: mean blue, lowest grey", ("mean", "lowest"), (BLUE, GREY)),
    "/metrics/existence": Curves(
        "Vehicles: reported grey, expected orange, measured blue, of those following the map green",
        ("reported", "expected", "measured", "following the map"), (GREY, ORANGE, BLUE, GREEN),
    ),
}  # fmt: skip
"""By entity."""


def curve_styles() -> Iterator[tuple[str, rr.SeriesLines]]:
    """Names, colours and widths of all curves."""
    for path, curves in PLOTS.items():
        widths = [1.5] * len(curves.names)
        yield path, rr.SeriesLines(names=list(curves.names), colors=list(curves.colors), widths=widths)


def frame_metrics(frame: TrackedFrame, truth: Tracks | None) -> Mapping[str, tuple[float, ...]]:
    """The values of one frame's curves, by entity; NaN, a gap in the curve, where there is none."""
    estimates = frame.estimates
    is_measured = estimates.unseen_s == 0
    following = float(estimates.follows_map[is_measured].sum())
    ess = estimates.effective_sample_size
    nis = np.nan if frame.innovations is None else _mean(frame.innovations.squared)
    return {
        "/metrics/existence": (len(estimates), float(estimates.existence.sum()), int(is_measured.sum()), following),
        "/metrics/ess": (_mean(ess), float(ess.min(initial=np.inf)) if ess.size else np.nan),
        "/metrics/consistency": (_nees(frame, truth), nis, RIGHT_SQUARE),
    }


def speed_rows(looks: Sequence[Look | None], primitives: PrimitiveMap | None) -> FloatArray:
    """(n, 6) speed and prior, each alone, less and plus its deviation; NaN without a vehicle in focus.

    The prior is p(speed | position, direction) of vehicles in motion: each mode's gamma, weighed by how well the
    direction fits the mode; those that stand have no direction.
    """
    rows = np.full((len(looks), 6), np.nan)
    there = [i for i, look in enumerate(looks) if look is not None]
    shown = [look for look in looks if look is not None]
    if not shown:
        return rows
    of_both = [np.array([look.speed for look in shown]).T]
    if primitives is not None:
        prior = primitives.primitive_at(np.array([look.position for look in shown]))
        fit = prior.direction.mode_log_density(np.array([look.direction for look in shown]))
        fit = np.where(prior.speed.mean < STANDING_SPEED, -np.inf, fit)
        weight = np.exp(fit - np.maximum(fit.max(axis=-1, keepdims=True), LEAST_FIT))
        weight /= np.maximum(weight.sum(axis=-1, keepdims=True), np.finfo(float).tiny)
        mean = (weight * prior.speed.mean).sum(axis=-1)
        square = (weight * prior.speed.mean**2 * (1.0 + 1.0 / prior.speed.shape)).sum(axis=-1)
        of_both.append(np.stack([mean, np.sqrt(np.maximum(square - mean**2, 0.0))]))
    for first, (mean, deviation) in zip((0, 3), of_both, strict=False):
        rows[there, first : first + 3] = np.stack([mean, np.maximum(mean - deviation, 0.0), mean + deviation], axis=-1)
    changed = [i for i, (a, b) in enumerate(pairwise(shown), 1) if a.track_id != b.track_id]
    rows[[there[i] for i in changed]] = np.nan  # a curve must not run on from one vehicle to the next
    return rows


def _nees(frame: TrackedFrame, truth: Tracks | None) -> float:
    """Mean normalised estimation error squared of the positions of the frame's known vehicles; NaN of none."""
    if truth is None:
        return float("nan")
    now = truth[slice(*np.searchsorted(truth.time_ns, [frame.time_ns, frame.time_ns + 1]))]
    place = dict(zip(as_texts(now.track_id).tolist(), now.position, strict=True))
    known = [row for row, name in enumerate(frame.names) if name in place]
    if not known:
        return float("nan")
    error = frame.estimates.position[known] - np.array([place[frame.names[row]] for row in known])
    covariance = frame.estimates.covariance[known] + JITTER * np.eye(2)
    return float(np.einsum("ni,ni->n", error, np.linalg.solve(covariance, error[..., None])[..., 0]).mean())


def _mean(values: FloatArray) -> float:
    known = values[~np.isnan(values)]
    return float(known.mean()) if known.size else np.nan
