"""Where a sensor sees: polygons in the plane, beyond which a vehicle is there and cannot be detected."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Self

import numpy as np
from scipy.special import ndtri

from dirprim_filter.arrays import BoolArray, FloatArray

MOST_VERTICES = 1_000
"""Of all polygons together: every belief is looked up against each edge in every frame."""
N_QUANTILES = 4
"""Of a Gaussian along each of its axes: probabilities come in steps of one sixteenth."""


@dataclass(frozen=True, slots=True)
class Sight:
    """The union of simple polygons, holes and blind strips being what none of them covers.

    Attributes:
        polygons: of each the (x, y) of its vertices, metres, in either sense; the last joins the first.

    Raises:
        ValueError: no polygon, one of fewer than three vertices, too many vertices, or one that is no finite point.
    """

    polygons: tuple[tuple[tuple[float, float], ...], ...]

    def __post_init__(self) -> None:
        if not self.polygons:
            raise ValueError("sight: expected at least one polygon, got none")
        for i, polygon in enumerate(self.polygons, start=1):
            if len(polygon) < 3:
                raise ValueError(f"sight: polygon {i}: expected at least 3 vertices, got {len(polygon)}")
            if not all(math.isfinite(x) and math.isfinite(y) for x, y in polygon):
                raise ValueError(f"sight: polygon {i}: expected finite metres, got {polygon}")
        n_vertices = sum(map(len, self.polygons))
        if n_vertices > MOST_VERTICES:
            raise ValueError(f"sight: expected at most {MOST_VERTICES} vertices, got {n_vertices}: simplify it")

    @classmethod
    def of(cls, value: object) -> Self:
        """Of nested lists, as a file has them: `[[[x, y], [x, y], [x, y]], ...]`.

        Raises:
            ValueError: they are no such lists of numbers.
        """
        expected = "sight: expected a list of polygons [[x, y], [x, y], [x, y], ...]"
        if not isinstance(value, list):
            raise ValueError(f"{expected}, got {value!r}")  # noqa: TRY004 - a file's, no caller's
        for polygon in value:
            if not (isinstance(polygon, list) and all(_is_point(vertex) for vertex in polygon)):
                raise ValueError(f"{expected}, got {polygon!r} for one")
        return cls(tuple(tuple((float(x), float(y)) for x, y in polygon) for polygon in value))

    @property
    def boxes(self) -> FloatArray:
        """(n, 4) west, south, east and north of each polygon, metres."""
        return np.array([np.append(np.min(polygon, axis=0), np.max(polygon, axis=0)) for polygon in self.polygons])

    def sees(self, position: FloatArray) -> BoolArray:
        """(..., 2) -> (...) whether positions are in a polygon, by how often a ray eastwards leaves it (even-odd)."""
        inside = np.zeros(position.shape[:-1], np.bool_)
        for polygon in self.polygons:
            inside |= _is_in(np.array(polygon), position)
        return inside

    def probability(self, mean: FloatArray, covariance: FloatArray) -> FloatArray:
        """(v, 2), (v, 2, 2) -> (v,) share of sixteen equally likely parts of each Gaussian whose middle is seen."""
        (xx, xy), (_, yy) = np.moveaxis(covariance, 0, -1)
        root = np.sqrt(np.maximum(xx, 1e-12))
        across = np.sqrt(np.maximum(yy - (xy / root) ** 2, 0.0))
        one, other = _STANDARD
        x = mean[:, None, 0] + root[:, None] * one
        y = mean[:, None, 1] + (xy / root)[:, None] * one + across[:, None] * other
        return np.asarray(self.sees(np.stack([x, y], axis=-1)).mean(axis=1))


_QUANTILES = ndtri((np.arange(N_QUANTILES) + 0.5) / N_QUANTILES)
_STANDARD = np.repeat(_QUANTILES, N_QUANTILES), np.tile(_QUANTILES, N_QUANTILES)


def _is_point(value: object) -> bool:
    return (
        isinstance(value, Sequence)
        and len(value) == 2
        and all(isinstance(number, int | float) and not isinstance(number, bool) for number in value)
    )


def _is_in(polygon: FloatArray, position: FloatArray) -> BoolArray:
    x, y = position[..., 0], position[..., 1]
    inside = np.zeros(x.shape, np.bool_)
    for (x0, y0), (x1, y1) in zip(polygon, np.roll(polygon, -1, axis=0), strict=True):
        if y0 != y1:
            inside ^= ((y0 > y) != (y1 > y)) & (x < x0 + (y - y0) * (x1 - x0) / (y1 - y0))
    return inside
