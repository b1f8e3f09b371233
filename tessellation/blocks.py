"""Rasters of large extents: blocks of pixels where there are cells, and nothing where there are none.

A pixel of the raster is then a block, and a block's pixels stand in `Locator.entry` like those of a crowded pixel.
They are counted from the raster's origin: a point falls into the one that it would fall into without blocks, to the
last bit.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from scipy.ndimage import distance_transform_edt
from scipy.spatial import cKDTree

from tessellation._arrays import FloatArray, IntArray
from tessellation._kernels import HEADER, Locator, PixelArray

BLOCK_SQUARES = 16
"""Side of a block, a power of two: as wide as a street and what is beside it."""
DENSE_SQUARES = 1 << 18
"""Up to so many squares a raster has no blocks, and a point is found in one step instead of two: 1.5 km at 3 m."""
LARGEST_ENTRY = 1 << 28
"""Numbers in `Locator.entry`: what 31 bits of a pixel can name beside the length of a list."""


class Blocks(NamedTuple):
    """The blocks of a raster that have cells."""

    origin_x: float
    origin_y: float
    pixels_per_metre: float  # within blocks
    shape: tuple[int, int]  # blocks north and east
    place: IntArray  # (b,) which blocks: row * shape[1] + column, ascending
    value: PixelArray  # (b, m, m) of their pixels, as of `Locator.pixel`
    listed: FloatArray  # as of `Locator.entry`, what they name

    @classmethod
    def of_squares(cls, origin: FloatArray, cell_size: float, n_x: int, n_y: int, square: IntArray) -> Blocks:
        """Of square cells, see `GridTessellation`.

        Raises:
            ValueError: squares so scattered that their blocks take too much memory.
        """
        row, column = np.divmod(square, n_x)
        shape = -(-n_y // BLOCK_SQUARES), -(-n_x // BLOCK_SQUARES)
        place, of = np.unique(row // BLOCK_SQUARES * shape[1] + column // BLOCK_SQUARES, return_inverse=True)
        _check(place.size, BLOCK_SQUARES)
        value = np.full((place.size, BLOCK_SQUARES, BLOCK_SQUARES), -1, np.int32)
        value[of, row % BLOCK_SQUARES, column % BLOCK_SQUARES] = np.arange(square.size)
        return cls(float(origin[0]), float(origin[1]), 1.0 / cell_size, shape, place, value, np.zeros(4))

    @classmethod
    def of(cls, locator: Locator) -> Blocks | None:
        """Of a locator that `locator` made; None of another."""
        entry, pixel, side = locator.entry, locator.pixel.ravel(), locator.block
        if side == 0:
            return None
        place = np.flatnonzero(pixel < -1)
        at = (-2 - pixel[place].astype(np.int64)) >> 3
        value = entry[(at + HEADER)[:, None] + np.arange(side * side)].astype(np.int32)
        shape = locator.pixel.shape
        return cls(
            locator.origin_x, locator.origin_y, locator.pixels_per_metre * side, (shape[0], shape[1]), place,
            value.reshape(-1, side, side), entry[: at[0] if at.size else entry.size],
        )  # fmt: skip

    def locator(self) -> Locator:
        """The locator: blocks stand behind what they name, in order.

        Raises:
            ValueError: more numbers than pixels can name.
        """
        b, side = len(self.value), self.value.shape[1]
        _check(b, side, self.listed.size)
        row, column = np.divmod(self.place, self.shape[1])
        rows = np.empty((b, HEADER + side * side))
        rows[:, :4] = self.origin_x, self.origin_y, self.pixels_per_metre, side
        rows[:, 4], rows[:, 5] = column * side, row * side
        rows[:, HEADER:] = self.value.reshape(b, side * side)
        pixel = np.full(self.shape[0] * self.shape[1], -1, np.int32)
        pixel[self.place] = -2 - 8 * (self.listed.size + np.arange(b) * rows.shape[1])
        return Locator(
            self.origin_x, self.origin_y, self.pixels_per_metre / side, pixel.reshape(self.shape),
            np.concatenate([self.listed, rows.ravel()]), side,
        )  # fmt: skip

    def candidates(self, generators: FloatArray) -> list[IntArray]:
        """Of each block the generators that may be nearest somewhere in it, ascending.

        One that is h from its centre is no farther than h + r from any point of it, where r is half its diagonal: so
        what is beyond h + 2 r is nowhere nearest.
        """
        side = self.value.shape[1] / self.pixels_per_metre
        row, column = np.divmod(self.place, self.shape[1])
        center = np.array([self.origin_x, self.origin_y]) + side * (np.column_stack([column, row]) + 0.5)
        tree = cKDTree(generators)
        near = tree.query(center)[0] + np.sqrt(2.0) * side
        return [np.array(sorted(found)) for found in tree.query_ball_point(center, near * (1.0 + 1e-9) + 1e-6)]

    def reaching(self, reach_m: float, finer: int) -> Blocks:
        """Those whose cells also cover what lies within `reach_m` of them, to the nearest; of smaller pixels."""
        side = self.value.shape[1] * finer
        per_metre = self.pixels_per_metre * finer
        margin = int(np.ceil(reach_m * per_metre))
        rings = -(-margin // side)
        shape = self.shape[0] + 2 * rings, self.shape[1] + 2 * rings
        row, column = np.divmod(self.place, self.shape[1])
        there = {
            place: i for i, place in enumerate(zip((row + rings).tolist(), (column + rings).tolist(), strict=True))
        }
        beside = range(-rings, rings + 1)
        window = slice(rings * side - margin, (rings + 1) * side + margin)
        inner = slice(margin, margin + side)
        place, value = [], []
        for north, east in sorted({(r + i, c + j) for r, c in there for i in beside for j in beside}):
            around = np.full(((2 * rings + 1) * side,) * 2, -1, np.int32)
            for i in beside:
                for j in beside:
                    number = there.get((north + i, east + j))
                    if number is not None:
                        at = (slice((k + rings) * side, (k + rings + 1) * side) for k in (i, j))
                        around[tuple(at)] = self.value[number].repeat(finer, axis=0).repeat(finer, axis=1)
            near = around[window, window]
            if (near != -1).any():
                distance, nearest = distance_transform_edt(near == -1, return_indices=True)
                reached = np.where(distance <= reach_m * per_metre, near[tuple(nearest)], np.int32(-1))[inner, inner]
                place.append(north * shape[1] + east)
                value.append(reached)
        block_m = self.value.shape[1] / self.pixels_per_metre
        return Blocks(
            self.origin_x - rings * block_m, self.origin_y - rings * block_m, per_metre, shape, np.array(place),
            np.stack(value), self.listed,
        )  # fmt: skip


def _check(n_blocks: int, side: int, n_entries: int = 0) -> None:
    n = n_entries + n_blocks * (HEADER + side * side)
    if n > LARGEST_ENTRY:
        raise ValueError(
            f"cells: {n_blocks} blocks of {side} x {side} pixels take {n} numbers, more than {LARGEST_ENTRY}; choose "
            "larger cells or remove far outliers"
        )
