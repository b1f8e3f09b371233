"""Point location: rasters of cells, of any extent, and of the generators that may be nearest.

After Edahiro, Kokubo and Asano (1984), "A new point-location algorithm and its practical efficiency": buckets of a
regular raster answer in constant time. A pixel lists the generators that may be nearest in it, so the nearest of them
is, to the last bit, the nearest of all.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from tessellation._arrays import FloatArray, IntArray, read_only
from tessellation._kernels import SIDE, Locator, locate_all
from tessellation.protocols import Tessellation

PIXELS_PER_CELL = 16
"""So many at least, on average, if `MAX_REFINEMENT` allows: few pixels then list several candidates."""
MAX_REFINEMENT = 64
PIXELS_ACROSS = 48
"""Of the raster of cells that have no locator of their own, across a cell of mean area."""
MAX_PIXELS = 20_000_000
"""The largest such raster; beyond, its pixels are larger: 80 MB."""
LARGEST = 1 << 28
"""Numbers of pixels that have a cell beside them: a gigabyte."""
N_NEAREST = 8
"""Candidates that are looked up at once; where these may not be all, four times as many."""
MARGIN = 1e-9
"""Relative, some million times what rounding of squared distances costs: a candidate more does no harm."""


class Pixels(NamedTuple):
    """Pixels of a raster and their values, see `Locator`; (n,) each."""

    row: IntArray
    column: IntArray
    value: IntArray


NONE = Pixels(*np.empty((3, 0), np.int64))


def locator_of(cells: Tessellation) -> Locator:
    """What compiled code asks for the cell of a point: the cells' own attribute `locator`, else a raster of them.

    A raster answers as `cell_of` does at the centres of its pixels.
    """
    own = getattr(cells, "locator", None)
    if isinstance(own, Locator):
        return own
    corners = [corners for corners in cells.polygons() if len(corners)]
    if not corners:
        return in_blocks(np.zeros(2), 1.0, (1, 1), NONE)
    low, high = np.concatenate(corners).min(axis=0), np.concatenate(corners).max(axis=0)
    least = float(np.sqrt(np.prod(high - low) / MAX_PIXELS))
    side = max(float(np.sqrt(cells.area.sum() / len(corners))) / PIXELS_ACROSS, least)
    n_x, n_y = (int(n) + 1 for n in (high - low) / side)
    x, y = low[0] + side * (np.arange(n_x) + 0.5), low[1] + side * (np.arange(n_y) + 0.5)
    pixel = np.stack([cells.cell_of(np.column_stack([x, np.full(n_x, north)])) for north in y.tolist()])
    row, column = np.nonzero(pixel >= 0)
    return in_blocks(low, 1.0 / side, (n_y, n_x), Pixels(row, column, pixel[row, column]))


def in_blocks(
    origin: FloatArray, per_metre: float, shape: tuple[int, int], pixels: Pixels,
    *, first: IntArray | None = None, entry: FloatArray | None = None,
) -> Locator:  # fmt: skip
    """The locator of some pixels, see `Locator`; all others have no cell.

    Raises:
        ValueError: pixels so scattered that their blocks take too much memory.
    """
    row, column, value = pixels
    n_y, n_x = (-(-n // SIDE) for n in shape)
    place, of = np.unique(row // SIDE * n_x + column // SIDE, return_inverse=True)
    if place.size * SIDE**2 > LARGEST:
        raise ValueError(
            f"cells: {place.size} blocks of {SIDE} x {SIDE} pixels take {place.size * SIDE**2} numbers, more than "
            f"{LARGEST}; choose larger cells or remove far outliers"
        )
    block = np.full(n_y * n_x, -1, np.int32)
    block[place] = np.arange(place.size)
    pixel = np.full((place.size, SIDE * SIDE), -1, np.int32)
    pixel[of, row % SIDE * SIDE + column % SIDE] = value
    first, entry = np.zeros(1, np.int64) if first is None else first, np.empty((0, 3)) if entry is None else entry
    return Locator(float(origin[0]), float(origin[1]), per_metre, block.reshape(n_y, n_x), pixel, first, entry)


def pixels_of(locator: Locator, finer: int = 1) -> Pixels:
    """The pixels that have a cell, each divided into `finer` times `finer`."""
    north, east = np.nonzero(locator.block >= 0)
    pixel = locator.pixel[locator.block[north, east]]
    of, at = np.nonzero(pixel != -1)
    row, column = north[of] * SIDE + at // SIDE, east[of] * SIDE + at % SIDE
    i, j = np.divmod(np.arange(finer * finer), finer)
    row, column = ((finer * whole[:, None] + part).ravel() for whole, part in ((row, i), (column, j)))
    return Pixels(row, column, np.repeat(pixel[of, at].astype(np.int64), finer * finer))


def voronoi_locator(generators: FloatArray, region: Locator) -> Locator:
    """The locator of the nearest generator where `region` has a cell.

    Args:
        generators: (n_cells, 2) metres, no two the same.
        region: of square cells. Its pixels are halved until there are `PIXELS_PER_CELL`; a power of two keeps its
            borders, to the last bit.
    """
    row, column, _ = pixels_of(region)
    origin, n = np.array([region.origin_x, region.origin_y]), len(generators)
    shape = (SIDE * region.block.shape[0], SIDE * region.block.shape[1])
    if n == 0 or row.size == 0:
        return in_blocks(origin, region.pixels_per_metre, shape, NONE)
    finer = 1
    while finer < MAX_REFINEMENT and row.size * finer**2 < PIXELS_PER_CELL * n:
        finer *= 2
    row, column, _ = pixels_of(region, finer)
    per_metre = region.pixels_per_metre * finer
    center = origin + (np.column_stack([column, row]) + 0.5) / per_metre
    rounding = 4.0 * float(np.spacing(np.abs(center).max()))
    which, cell = _candidates(generators, center, 0.5 * (1.0 + MARGIN) / per_metre + rounding)
    many = np.bincount(which, minlength=row.size)
    first = np.concatenate([[0], np.cumsum(many)])
    value = np.where(many == 1, cell[first[:-1]], -1 - np.cumsum(many > 1))
    listed = many[which] > 1
    return in_blocks(
        origin, per_metre, (shape[0] * finer, shape[1] * finer), Pixels(row, column, value),
        first=np.concatenate([[0], np.cumsum(many[many > 1])]),
        entry=np.column_stack([generators[cell[listed]], cell[listed]]),
    )  # fmt: skip


def _candidates(generators: FloatArray, center: FloatArray, half: float) -> tuple[IntArray, IntArray]:
    """Pairs (p,), (p,) of a square, of half side `half` around a center, and a generator that may be nearest in it.

    Generator g is nowhere nearest in a square if the generator h nearest to its center c is nearer in all of it:
    |g - c|^2 - |h - c|^2 > 2 half (|h_x - g_x| + |h_y - g_y|). Ascending.
    """
    from scipy.spatial import cKDTree  # noqa: PLC0415 - grids do without

    tree, pairs = cKDTree(generators), []
    which, k = np.arange(len(center)), min(N_NEAREST, len(generators))
    while which.size:
        distance, near = (np.reshape(column, (-1, k)) for column in tree.query(center[which], k=k, workers=-1))
        apart = np.abs(generators[near] - generators[near[:, :1]]).sum(axis=2)
        squared = distance**2
        most = 2.0 * half * apart + MARGIN * (squared + squared[:, :1]) + half * half * MARGIN
        may = squared - squared[:, :1] <= most
        # What is not among the k is at least as far as the last of them.
        all_seen = (distance[:, -1] > (distance[:, 0] + 2.0 * np.sqrt(2.0) * half) * (1.0 + MARGIN)) | (
            k == len(generators)
        )
        i, j = np.nonzero(may & all_seen[:, None])
        pairs.append(np.column_stack([which[i], near[i, j]]))
        which, k = which[~all_seen], min(4 * k, len(generators))
    pair = np.concatenate(pairs)
    square, cell = pair[np.lexsort(pair.T[::-1])].T.copy()
    return square, cell


def cells_of(locator: Locator, position: FloatArray) -> IntArray:
    """The cell of each position. (n, 2) -> (n,)."""
    cell = np.empty(len(position), np.int64)
    locate_all(locator, read_only(position), cell)
    return cell
