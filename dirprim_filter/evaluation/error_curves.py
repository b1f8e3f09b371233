"""What pictures of a tracking experiment show: errors by how long a vehicle was unseen, and reliability."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from dirprim_filter.arrays import FloatArray
from dirprim_filter.evaluation.intervals import Interval, clustered, interval, mean
from dirprim_filter.evaluation.scores import RowErrors
from dirprim_filter.evaluation.tracking_report import coverage


def rmse(errors: Sequence[RowErrors], *, above_s: float, to_s: float) -> Interval:
    """Root mean square error in metres of vehicles that were unseen for so long, above one time and up to another.

    Its interval is over vehicles or groups; NaN where there is none. In sight they are unseen for 0 s.
    """
    chosen = [(of.unseen_s > above_s) & (of.unseen_s <= to_s) & np.isfinite(of.squared) for of in errors]
    parts = [(of.cluster[rows], of.squared[rows]) for of, rows in zip(errors, chosen, strict=True)]
    cluster, squared = (np.concatenate(column) for column in zip(*parts, strict=True))
    sums = clustered(cluster, [squared, np.ones_like(squared)])
    return interval(sums, lambda total: np.sqrt(mean(total)))


def reliability(errors: Sequence[RowErrors], share: FloatArray, *, is_hidden: bool) -> FloatArray:
    """(k,) how many of the true positions lie in the ellipses that should hold a share (k,) of them; NaN of none.

    Of vehicles in gaps, or in sight. A tracker whose shares are below those asked for is too sure.
    """
    normalised = np.concatenate([of.normalised[of.is_hidden == is_hidden] for of in errors])
    return np.array([coverage(normalised, one) for one in share.tolist()])
