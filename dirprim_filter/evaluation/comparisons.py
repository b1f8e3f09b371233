"""Two trackers on the same rows: how much nearer is one, and is the difference beyond chance?

With ids each row of the truth in which both have an estimate counts. What is independent are vehicles, or groups where
there are several. Without ids which estimate is of which vehicle is for the tracker to say, so HOTA is compared: group
by group, or in a log of one group run by run, which separates noise from noise and holds for its traffic alone.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from dirprim_filter.evaluation.experiment import SMOOTHED_SUFFIX, MethodResult, TrackingTable
from dirprim_filter.evaluation.intervals import Interval, difference_of_means, paired, reduction_of_rmse
from dirprim_filter.evaluation.scoring import RowErrors

SAID = {"prior": "the map", "place-free": "the same filter without the map"}
"""What sentences call methods."""


class TrackingComparison(NamedTuple):
    """One method beside another; None where nothing can be compared.

    Attributes:
        first: name of a method,
        other: and of another.
        in_sight: share by which the first's RMSE in sight is below the other's.
        in_gaps: the same in gaps.
        hota: HOTA of the first less that of the other.
    """

    first: str
    other: str
    in_sight: Interval | None
    in_gaps: Interval | None
    hota: Interval | None

    @property
    def sentence(self) -> str:
        """What a reader wants to know; empty where nothing can be compared."""
        of_both = f"{_said(self.first)} against {_said(self.other)}"
        parts = [
            f"{where} {_percent(found)}"
            for where, found in (("in gaps", self.in_gaps), ("in sight", self.in_sight))
            if found is not None
        ]
        if parts:
            return f"{of_both}: error {', '.join(parts)}"
        return f"{of_both}: HOTA {_difference(self.hota)}" if self.hota is not None else ""

    def as_table(self) -> dict[str, object]:
        """Names and values, for JSON."""
        return {
            name: value._asdict() if isinstance(value, Interval) else value for name, value in self._asdict().items()
        }


def comparisons(table: TrackingTable) -> list[TrackingComparison]:
    """The first method beside each other, filters with filters and smoothers with smoothers."""
    names = [method.name for method in table.methods]
    first = names[0] + SMOOTHED_SUFFIX
    pairs = [(names[0], name) for name in names[1:] if not name.endswith(SMOOTHED_SUFFIX)]
    pairs += [(first, name) for name in names if name.endswith(SMOOTHED_SUFFIX) and name != first and first in names]
    return [compared(table, *pair) for pair in pairs]


def compared(table: TrackingTable, first: str, other: str) -> TrackingComparison:
    """Two methods of a table, over all its seeds."""
    a, b = (next(of for of in table.methods if of.name == name) for name in (first, other))
    errors = list(zip(a.errors, b.errors, strict=True)) if table.experiment.with_ids else []
    return TrackingComparison(
        first=first, other=other, in_sight=_nearer(errors, is_hidden=False), in_gaps=_nearer(errors, is_hidden=True),
        hota=None if table.experiment.with_ids else _hota(table, a, b),
    )  # fmt: skip


def _nearer(seeds: Sequence[tuple[RowErrors, RowErrors]], *, is_hidden: bool) -> Interval | None:
    rows = [a.is_hidden == is_hidden for a, _ in seeds]
    columns = [(a.cluster[of], a.squared[of], b.squared[of]) for (a, b), of in zip(seeds, rows, strict=True)]
    cluster, first, other = (
        (np.concatenate(column) for column in zip(*columns, strict=True)) if seeds else [np.empty(0)] * 3
    )
    found = paired(cluster, first, other, reduction_of_rmse)
    return found if found.n_clusters else None


def _hota(table: TrackingTable, a: MethodResult, b: MethodResult) -> Interval:
    """Over groups, the runs' mean of each; of a single group over runs."""
    own, others = (np.array([report.hota for seed in of.by_group for report in seed]) for of in (a, b))
    groups = np.array([group for seed in table.groups for group in seed])
    runs = np.repeat(np.arange(len(table.groups)), [len(seed) for seed in table.groups])
    cluster = groups if np.unique(groups).size > 1 else runs
    return paired(cluster, own, others, difference_of_means)


def _said(name: str) -> str:
    method, smoothed, _ = name.partition(SMOOTHED_SUFFIX)
    return SAID.get(method, method) + smoothed


def _percent(found: Interval) -> str:
    """A share by which errors are smaller."""
    sign, word = (1.0, "smaller") if found.value >= 0 else (-1.0, "larger")
    low, high = sorted((sign * found.low, sign * found.high))
    return f"{sign * found.value:.0%} {word} ({low:.0%} to {high:.0%}){_chance(found)}"


def _difference(found: Interval) -> str:
    return f"{found.value:+.3f} ({found.low:+.3f} to {found.high:+.3f}){_chance(found)}"


def _chance(found: Interval) -> str:
    return "" if found.is_apart else ", not distinguishable"
