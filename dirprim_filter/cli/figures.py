"""The figures of trackers as a table: a line for each figure, a column for each tracker."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence

FIGURES = {
    "rmse": "RMSE, m", "seen_rmse": "RMSE in sight, m", "settled_rmse": "RMSE settled, m",
    "hidden_rmse": "RMSE in gaps, m", "direction_rmse": "RMSE of course, rad", "speed_rmse": "RMSE of speed, m/s",
    "nees": "NEES", "seen_nees": "NEES in sight", "hidden_nees": "NEES in gaps",
    "coverage_50": "truth in 50 %", "coverage_90": "truth in 90 %", "hidden_coverage_90": "in 90 %, in gaps",
    "reported": "reported", "interpolated": "truth interpolated", "hota": "HOTA", "deta": "DetA", "assa": "AssA",
    "loca": "LocA", "idf1": "IDF1", "mota": "MOTA", "switches": "identity switches", "swaps": "  swaps",
    "breaks": "  breaks",
    "late_start": "missed: late start", "early_end": "  early end", "merged": "  merged", "overlooked": "  overlooked",
    "duplicate": "false: duplicate", "ghost": "  ghost", "gospa": "GOSPA per vehicle, m",
    "localisation": "  localisation, m2", "missed": "  missed, m2", "false": "  false, m2",
}  # fmt: skip
"""The figures of a `TrackingReport`, and what tables call them."""
UNKNOWN = "-"


def figure_lines(names: Sequence[str], cell: Callable[[int, str], str]) -> list[str]:
    """The lines of all figures; `cell`: of a column, by its number, and a figure."""
    cells = {figure: [cell(i, figure) for i in range(len(names))] for figure in FIGURES}
    width = max(16, *(len(text) for text in (*names, *(text for row in cells.values() for text in row))))
    return [row("", names, width), *(row(head, cells[figure], width) for figure, head in FIGURES.items())]


def row(head: str, cells: Sequence[str], width: int = 16) -> str:
    """One line of a table."""
    return f"{head:<22}" + "".join(f"  {cell:>{width}}" for cell in cells)


def number(value: float) -> str:
    """Three decimals for small numbers, none for large ones; a dash if unknown."""
    if math.isnan(value):
        return UNKNOWN
    if isinstance(value, int):
        return str(value)
    return f"{value:.3f}" if abs(value) < 100 else f"{value:.0f}"
