"""The ground that the vehicles of a log can come to: of a large map no more is loaded."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING

from dirprim_filter.cli import losses

if TYPE_CHECKING:
    from dirprim_filter.cli.reading import Reading
    from dirprim_filter.primitives.part import Ground

SQUARE_M = 32.0
"""Detections in a square of this side are one place."""


def ground_of(log: Path, reading: Reading, *, seconds: float) -> Callable[[], Ground] | None:
    """What finds the ground by going through a log once more; None for one that can be read but once.

    Args:
        log: whose detections.
        reading: how it is read.
        seconds: for which a vehicle may drive on without a detection.
    """

    def found() -> Ground:
        import numpy as np

        from dirprim_filter.filtering.measurements import FASTEST
        from dirprim_filter.primitives.part import Ground

        squares: set[tuple[float, float]] = set()
        with losses.said_later():
            for detections in reading.detections(log, motion=False):
                squares.update(map(tuple, np.unique(detections.position // SQUARE_M, axis=0).tolist()))
        place = SQUARE_M * (np.array(sorted(squares)).reshape(-1, 2) + 0.5)
        return Ground(place, SQUARE_M + FASTEST * seconds)

    return found if log.is_file() or log.is_dir() else None
