"""Which detection is whose? Gates, and the best assignment inside them.

Global nearest neighbour: of all ways to give each track at most one detection and each detection to at most one track,
the one of greatest likelihood. Source: Blackman and Popoli, Design and Analysis of Modern Tracking Systems, 1999.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from dirprim_filter.arrays import BoolArray, FloatArray, IntArray
from dirprim_filter.config import FilterConfig, TrackingConfig
from dirprim_filter.detections import Detections
from dirprim_filter.filtering._gating import nearest_in_gates
from dirprim_filter.filtering.existence import OCCLUDED, VISIBLE
from dirprim_filter.filtering.measurements import measured_covariance
from dirprim_filter.filtering.protocols import BayesFilter

MOST_NEAR = 32
"""Detections that a track is compared with: of a crowd within a metre all pairs would be its square."""


class Pairs(NamedTuple):
    """Rows of one side, each with a row of the other. (n,), (n,)."""

    one: IntArray
    other: IntArray


def associated(
    bayes_filter: BayesFilter, slot: IntArray, detections: Detections, *, existence: FloatArray, size: FloatArray,
    is_confirmed: BoolArray, by_chance: FloatArray, noise: FilterConfig, config: TrackingConfig,
) -> tuple[IntArray, BoolArray]:  # fmt: skip
    """Slots of the tracks that predicted unlabelled detections best, -1 for none; and which are of no new vehicle.

    Confirmed tracks choose first, tentative ones among what they leave. No vehicle is in the body of another: what lies
    in that of a confirmed or earlier track is of this vehicle, which left its belief; or else it is detected twice.

    Args:
        bayes_filter: holds the tracks' beliefs.
        slot: (v,) tracks, moved to the frame's time.
        detections: (d,) of the frame.
        existence: (v, 3) of the tracks.
        size: (v, 3) of their bodies, metres; NaN where unknown.
        is_confirmed: (v,) of the tracks.
        by_chance: (d,) density of clutter and first detections that was expected at each.
        noise: for measurements that report no covariance.
        config: gate and detection probability.

    Returns:
        (d,) and (d,).
    """
    row_of, m = np.full(len(detections), -1, np.int64), bayes_filter.moments(slot)
    predicted, errors = m[:, [2, 3, 3, 4]].reshape(-1, 2, 2), measured_covariance(detections, noise)
    for chosen in (np.flatnonzero(is_confirmed), np.flatnonzero(~is_confirmed)):
        left = np.flatnonzero(row_of < 0)
        if chosen.size == 0 or left.size == 0:
            continue
        pairs = gated(
            m[chosen, :2], predicted[chosen], detections.position[left], errors[left], gate=config.gate
        )  # fmt: skip
        track, other = chosen[pairs.one], left[pairs.other]
        fit = bayes_filter.log_likelihood(slot[track], detections[other])
        visible, occluded = existence[track][:, [VISIBLE, OCCLUDED]].T
        expected = config.detection_probability * (visible / (visible + occluded))  # if it exists: that is judged later
        gain = np.log(expected) - np.log1p(-expected) + fit - np.log(by_chance)[other]
        best = best_pairs(*pairs, gain)
        row_of[other[best]] = track[best]
    is_known = ~np.isnan(size[:, :2]).any(axis=1)
    if not is_known.any():
        return np.append(slot, -1)[row_of], np.zeros(len(detections), np.bool_)
    rank = np.append(np.where(is_confirmed, -1, np.arange(slot.size)), slot.size)
    bodies = np.flatnonzero(is_known & (is_confirmed | np.isin(np.arange(slot.size), row_of)))
    depth = _depth(detections.position, m[bodies], size[bodies])
    inside, body = np.nonzero((depth > 0) & (rank[bodies] < rank[row_of][:, None]))
    is_double = np.isin(np.arange(len(detections)), inside)
    row_of[is_double] = -1
    free = np.flatnonzero(~np.isin(inside, inside[np.isin(bodies[body], row_of)]))
    best = free[best_pairs(inside[free], body[free], depth[inside, body][free])]
    row_of[inside[best]] = bodies[body[best]]
    return np.append(slot, -1)[row_of], is_double


def _depth(position: FloatArray, moments: FloatArray, size: FloatArray) -> FloatArray:
    """(d, t) how deep in bodies, along their course, places (d, 2) are: 1 in the middle, 0 at an edge."""
    off, c, s = position[:, None] - moments[:, :2], np.cos(moments[:, 5]), np.sin(moments[:, 5])
    ahead, aside = off[..., 0] * c + off[..., 1] * s, off[..., 1] * c - off[..., 0] * s
    return np.asarray(1.0 - 2.0 * np.maximum(np.abs(ahead) / size[:, 0], np.abs(aside) / size[:, 1]))


def gated(mean: FloatArray, covariance: FloatArray, position: FloatArray, noise: FloatArray, *, gate: float) -> Pairs:
    """Tracks and detections that may belong together: of each track the nearest in its ellipse.

    Args:
        mean: (t, 2) predicted positions, metres.
        covariance: (t, 2, 2) of them, square metres.
        position: (d, 2) detections.
        noise: (d, 2, 2) their covariance.
        gate: squared Mahalanobis distance of the ellipse.
    """
    near = np.empty((len(mean), min(MOST_NEAR, len(position))), np.int64)
    nearest_in_gates(*map(np.ascontiguousarray, (mean, covariance, position, noise)), gate, near)
    track, place = np.nonzero(near >= 0)
    return Pairs(track, near[track, place])


def best_pairs(one: IntArray, other: IntArray, gain: FloatArray) -> IntArray:
    """Of pairs with a gain those of the best assignment, ascending: each row in one at most, and the greatest sum.

    A sparse assignment (Jonker and Volgenant, A shortest augmenting path algorithm for dense and sparse linear
    assignment problems, 1987, as scipy has it), in which each row of the one side may also stay alone.

    Args:
        one: (p,) what is given.
        other: (p,) to what.
        gain: (p,) what it is worth; pairs that are worth nothing are never chosen.
    """
    useful = np.flatnonzero(gain > 0)
    if all(np.bincount(of[useful], minlength=1).max() < 2 for of in (one, other)):  # none has a choice
        return useful
    from scipy.sparse import coo_array  # noqa: PLC0415 - detections with ids do without
    from scipy.sparse.csgraph import min_weight_full_bipartite_matching  # noqa: PLC0415

    (ones, i), (others, j) = (np.unique(of[useful], return_inverse=True) for of in (one, other))
    alone, most = np.arange(ones.size), gain[useful].max() + 1.0
    cost = np.append(most - gain[useful], np.full(alone.size, most))
    edges = coo_array((cost, (np.append(i, alone), np.append(j, others.size + alone))))
    chosen = min_weight_full_bipartite_matching(edges.tocsr())[1]
    return np.asarray(useful[chosen[i] == j])
