"""What pictures of a tracking experiment show: errors by seconds unseen and by place, and reliability."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import pairwise

import numpy as np

from dirprim_filter.arrays import FloatArray
from dirprim_filter.evaluation.intervals import Interval, clustered, interval, mean
from dirprim_filter.evaluation.scores import RowErrors
from dirprim_filter.evaluation.tracking import TrackingTable, hota_of
from dirprim_filter.evaluation.tracking_report import coverage

N_TIMES = 6
"""Parts of a gap whose errors are drawn."""
SHARES = np.linspace(0.05, 0.95, 19)
SQUARES = 30
"""Of a map of errors, along its longer side."""
HEADS = ("panel", "method", "x", "y", "value", "low", "high")


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


def by_time(errors: Sequence[RowErrors], gap_s: float) -> tuple[FloatArray, list[Interval]]:
    """(k,) seconds since vehicles were last seen, 0 and the middles of the parts of a gap; and the RMSE of each."""
    edges = np.concatenate([[-np.inf, 0.0], np.linspace(0.0, gap_s, N_TIMES + 1)[1:] if gap_s else []])
    middle = np.array([0.0, *(0.5 * (edges[1:-1] + edges[2:]))])
    return middle, [rmse(errors, above_s=above, to_s=to) for above, to in pairwise(edges)]


def by_place(errors: Sequence[RowErrors], *, is_hidden: bool) -> tuple[FloatArray, FloatArray]:
    """(k, 2) middles of the squares where vehicles were in gaps, or in sight; and (k,) the RMSE in each, metres.

    The longer side of all places has `SQUARES` of them. Rows without an estimate are left out.
    """
    chosen = [(of.is_hidden == is_hidden) & np.isfinite(of.squared) for of in errors]
    position, squared = (
        np.concatenate([getattr(of, name)[rows] for of, rows in zip(errors, chosen, strict=True)])
        for name in ("position", "squared")
    )
    if not len(squared):
        return position, squared
    west_south = position.min(axis=0)
    side = max(float(np.ptp(position, axis=0).max()), 1e-9) / SQUARES
    square, of_row = np.unique(((position - west_south) // side).astype(np.int64), axis=0, return_inverse=True)
    of_row = of_row.ravel()
    return west_south + side * (square + 0.5), np.sqrt(np.bincount(of_row, squared) / np.bincount(of_row))


def curves(table: TrackingTable) -> list[tuple[str | float, ...]]:
    """All that the figure of an experiment shows: rows of `HEADS`, NaN where a panel has no such thing.

    `time`: RMSE in metres by seconds since last seen (x). `reliability`: the share of true positions in regions that
    should hold a share (x). `map`: RMSE of the first method in squares about places (x, y). `method`: RMSE in gaps
    (x is 1) and in sight (0), without ids HOTA. low to high is a 95 % interval over vehicles or groups.
    """
    gap_s, nan, is_hidden = table.experiment.gap_s * (table.n_gaps > 0), float("nan"), table.n_gaps > 0
    rows: list[tuple[str | float, ...]] = []
    for of in table.methods:
        times = zip(*by_time(of.errors, gap_s), strict=True)
        rows += [("time", of.name, float(at), nan, *found[:3]) for at, found in times]
        shares = zip(SHARES, reliability(of.errors, SHARES, is_hidden=is_hidden), strict=True)
        rows += [("reliability", of.name, float(share), nan, float(held), nan, nan) for share, held in shares]
        figures = {nan: hota_of(table, of)} if not table.experiment.with_ids else by_sight(of.errors)
        rows += [("method", of.name, at, nan, *found[:3]) for at, found in figures.items()]
    first = table.methods[0]
    places = zip(*by_place(first.errors, is_hidden=is_hidden), strict=True)
    return rows + [("map", first.name, *map(float, place), float(error), nan, nan) for place, error in places]


def by_sight(errors: Sequence[RowErrors]) -> dict[float, Interval]:
    """RMSE in sight, 0, and in gaps, 1."""
    return {0.0: rmse(errors, above_s=-np.inf, to_s=0.0), 1.0: rmse(errors, above_s=0.0, to_s=np.inf)}
