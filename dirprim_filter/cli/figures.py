"""The figures of trackers as a table: a line for each figure, a column for each tracker."""

from __future__ import annotations

from collections.abc import Callable, Sequence

from dirprim_filter.cli.texts import columns

FIGURES = {
    "rmse": "RMSE, m", "seen_rmse": "RMSE in sight, m", "hidden_rmse": "RMSE in gaps, m",
    "direction_rmse": "RMSE of course, rad", "speed_rmse": "RMSE of speed, m/s",
    "nees": "NEES", "seen_nees": "NEES in sight", "hidden_nees": "NEES in gaps",
    "coverage_90": "truth in 90 %", "hidden_coverage_90": "in 90 %, in gaps",
    "reported": "reported", "interpolated": "truth interpolated", "hota": "HOTA", "deta": "DetA", "assa": "AssA",
    "loca": "LocA", "idf1": "IDF1", "mota": "MOTA", "switches": "identity switches",
    "gospa": "GOSPA per vehicle, m",
    "localisation": "  localisation, m2", "missed": "  missed, m2", "false": "  false, m2",
}  # fmt: skip
"""The figures of a `TrackingReport`, and what tables call them."""


def figure_lines(names: Sequence[str], cell: Callable[[int, str], str]) -> list[str]:
    """The lines of all figures; `cell`: of a column, by its number, and a figure."""
    return columns([["", *names], *([head, *(cell(i, of) for i in range(len(names)))] for of, head in FIGURES.items())])
