"""A third tessellation: all that `Tessellation` asks for, and nothing compiled."""

import numpy as np

from tessellation import OUTSIDE

ROW = np.sqrt(3.0) / 2.0
"""From one row of hexagons to the next, in widths."""
FARTHEST = 1e9
"""Widths; what lies beyond counts as being there."""
KEY = np.array([1 << 31, 1])
"""By which each hexagon has a number of its own."""


class Hexagons:
    """Regular hexagons that hold data, a corner to the north, `width` metres from side to side.

    Hexagon (q, r) has its centre at origin + width (q + r / 2, ROW r).
    """

    def __init__(self, *, origin, width, axial):
        self.origin, self.width, self.axial = origin, width, axial
        self.n_cells = len(self.axial)
        self.area = np.full(self.n_cells, ROW * width**2)
        self.centers = self.origin + width * (self.axial @ np.array([[1.0, 0.0], [0.5, ROW]]))
        self._key, self._order = (key := self.axial @ KEY), np.argsort(key)

    @classmethod
    def covering(cls, position, *, width):
        origin = position.min(axis=0)
        return cls(origin=origin, width=width, axial=np.unique(_axial(position, origin, width), axis=0))

    @property
    def parameters(self):
        return {"origin": self.origin, "width": self.width, "axial": self.axial}

    def cell_of(self, position):
        position = np.asarray(position, dtype=np.float64)
        if not np.isfinite(position).all():
            raise ValueError("position: expected finite numbers")
        key = _axial(position.reshape(-1, 2), self.origin, self.width) @ KEY
        cell = self._order[np.searchsorted(self._key, key, sorter=self._order).clip(max=self.n_cells - 1)]
        return np.where(self._key[cell] == key, cell, OUTSIDE).reshape(position.shape[:-1])

    def polygons(self):
        turn = np.pi / 6 + np.pi / 3 * np.arange(6)
        return list(self.centers[:, None] + self.width / np.sqrt(3) * np.column_stack([np.cos(turn), np.sin(turn)]))


def _axial(position, origin, width):
    """(n, 2) the hexagon of each position: the nearest, by the three axes of which one follows from the others."""
    x, y = np.clip((position - origin) / width, -FARTHEST, FARTHEST).T
    exact = np.stack([x - y / ROW / 2, y / ROW, -x - y / ROW / 2])
    q, r, s = np.rint(exact)
    dq, dr, ds = np.abs([q, r, s] - exact)
    q, r = np.where((dq > dr) & (dq > ds), -r - s, q), np.where((dr >= dq) & (dr > ds), -q - s, r)
    return np.column_stack([q, r]).astype(np.int64)
