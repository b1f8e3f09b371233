"""A rival's settings, chosen by held-out training vehicles on a grid that widens until the best is inside it."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from functools import cache
from typing import NamedTuple

LEAST_GAIN = 1e-3
"""Nat a row: a setting is taken for another one only where it gains more, so that a search along a plateau ends."""
MOST_STEPS = 40
"""From the start, to either side."""


class Axis(NamedTuple):
    """A setting that is searched in geometric steps.

    Attributes:
        name: with its unit.
        start: where the search begins.
        factor: from one value to the next, above 1.
        least: physical limit; values below are not tried.
        most: physical limit; values above are not tried.
    """

    name: str
    start: float
    factor: float = 2.0
    least: float = 0.0
    most: float = float("inf")


class Choice(NamedTuple):
    """What was chosen for a setting, and the least and greatest value that were tried."""

    name: str
    low: float
    chosen: float
    high: float


def choose(
    axes: Sequence[Axis], score: Callable[[tuple[float, ...]], float], *, least_gain: float = LEAST_GAIN
) -> tuple[Choice, ...]:
    """Climb from the start, setting by setting, until no neighbour on the grid is better.

    Both neighbours of what is chosen have been tried on every axis, but for those beyond a physical limit.

    Args:
        axes: the settings.
        score: what is best where greatest, of the settings' values, such as the mean log density of held-out rows.
        least_gain: in its unit; what gains less is not taken.

    Raises:
        ValueError: a setting runs off: it is still better 40 steps from the start.
    """

    @cache
    def score_at(place: tuple[int, ...]) -> float:
        return score(values(place))

    def values(place: tuple[int, ...]) -> tuple[float, ...]:
        return tuple(axis.start * axis.factor**steps for axis, steps in zip(axes, place, strict=True))

    tried = [{0} for _ in axes]
    best, before = (0,) * len(axes), None
    while best != before:
        before = best
        for i, axis in enumerate(axes):
            for step in (1, -1):
                there = (*best[:i], best[i] + step, *best[i + 1 :])
                if abs(there[i]) > MOST_STEPS:
                    raise ValueError(f"{axis.name}: expected a best value within {MOST_STEPS} steps of {axis.start:g}")
                if axis.least <= values(there)[i] <= axis.most:
                    tried[i].add(there[i])
                    best = there if score_at(there) > score_at(best) + least_gain else best
    low, high = (values(tuple(extreme(steps) for steps in tried)) for extreme in (min, max))
    return tuple(map(Choice, (axis.name for axis in axes), low, values(best), high))
