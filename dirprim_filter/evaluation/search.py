"""Settings of greatest score, on grids that widen until the best is inside: no rival lies on a bound of its grid."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import NamedTuple

FACTORS = (10.0**0.5, 10.0**0.25)
"""Between neighbours of the grid: first coarse, then fine about the best."""
MOST_STEPS = 16
"""Steps of the coarse grid to either side of the start: eight powers of ten."""


class Searched(NamedTuple):
    """A setting as it was chosen.

    Attributes:
        value: the best, between
        low: a smaller and
        high: a larger one that were tried and are no better.
    """

    value: float
    low: float
    high: float


def best_settings(
    score: Callable[[Mapping[str, float]], float], start: Mapping[str, float], *, tolerance: float = 0.01
) -> dict[str, Searched]:
    """Climb from neighbour to neighbour, one positive setting after the other, until none is better.

    Args:
        score: of settings by name: larger is better; asked once for each point.
        start: where to begin: positive numbers.
        tolerance: what a neighbour must gain to be better, in units of the score.

    Raises:
        ValueError: a setting runs off: its score still rises eight powers of ten from the start.
    """
    names, known = tuple(start), dict[tuple[float, ...], float]()

    def at(point: tuple[float, ...]) -> float:
        if point not in known:
            known[point] = score(dict(zip(names, point, strict=True)))
        return known[point]

    def beside(point: tuple[float, ...], i: int, factor: float) -> tuple[float, ...]:
        value = float(f"{point[i] * factor:.12g}")  # the same point, whichever way it is reached
        if (
            abs(value / start[names[i]]) > FACTORS[0] ** MOST_STEPS
            or value * FACTORS[0] ** MOST_STEPS < start[names[i]]
        ):
            raise ValueError(f"{names[i]}: expected a best value within eight powers of ten of {start[names[i]]:g}")
        return (*point[:i], value, *point[i + 1 :])

    best = tuple(start.values())
    for factor in FACTORS:
        before = None
        while best != before:
            before = best
            for i in range(len(names)):
                for way in (factor, 1.0 / factor):
                    while at(beside(best, i, way)) > at(best) + tolerance:
                        best = beside(best, i, way)
    last = FACTORS[-1]
    return {
        name: Searched(best[i], beside(best, i, 1.0 / last)[i], beside(best, i, last)[i])
        for i, name in enumerate(names)
    }
