"""Higher order tracking accuracy: detection and association, weighed alike.

Source: Luiten et al., HOTA: A Higher Order Metric for Evaluating Multi-Object Tracking, IJCV 2021; the matching as in
its reference, TrackEval.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from dirprim_filter.evaluation.metrics.comparison import EPSILON, Comparison
from dirprim_filter.filtering.association import best_pairs

THRESHOLDS = np.arange(0.05, 0.99, 0.05)
"""Similarities from which a pair is a match; every score is the mean over them."""
LEAST = 1e-10
"""In place of 0 over 0: where nothing matches, what matches is well localised."""


class Hota(NamedTuple):
    """Scores between 0 and 1, means over the thresholds of similarity.

    Attributes:
        hota: sqrt(deta assa) at each threshold.
        deta: detection accuracy, TP / (TP + FN + FP).
        assa: association accuracy, the mean over matches c of TPA(c) / (TPA(c) + FNA(c) + FPA(c)).
        loca: localisation accuracy, mean similarity of the matches.
    """

    hota: float
    deta: float
    assa: float
    loca: float


def hota(comparison: Comparison) -> Hota:
    """The scores, by the comparison's similarity."""
    near, similarity = comparison.near, comparison.similarity
    n_rows, n_columns = comparison.vehicle.size, comparison.track.size
    if not (n_rows and n_columns):
        return Hota(0.0, 0.0, 0.0, 1.0)
    vehicle, track, of_pair = comparison.companions(near)
    n_own = np.bincount(comparison.vehicle)[vehicle] + np.bincount(comparison.track)[track]
    # of each vehicle and track, how much of their time they share, as an intersection over union
    of_row = np.bincount(near.row, similarity, minlength=n_rows)[near.row]
    of_column = np.bincount(near.column, similarity, minlength=n_columns)[near.column]
    shared = np.bincount(of_pair, similarity / (of_row + of_column - similarity), minlength=vehicle.size)
    alignment = shared / (n_own - shared)
    chosen = best_pairs(near.row, near.column, alignment[of_pair] * similarity)
    matched = similarity[chosen] >= THRESHOLDS[:, None] - EPSILON
    n_matched = matched.sum(axis=1)
    deta = n_matched / (n_rows + n_columns - n_matched)
    n_together = np.stack([np.bincount(of_pair[chosen[mask]], minlength=vehicle.size) for mask in matched])
    assa = (n_together**2 / (n_own - n_together)).sum(axis=1) / np.maximum(1, n_matched)
    loca = np.maximum(LEAST, matched @ similarity[chosen]) / np.maximum(LEAST, n_matched)
    return Hota(float(np.sqrt(deta * assa).mean()), float(deta.mean()), float(assa.mean()), float(loca.mean()))
