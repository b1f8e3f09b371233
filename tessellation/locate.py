"""Point location: the raster of candidate generators of a Voronoi tessellation, and large batches on several threads.

After Edahiro, Kokubo and Asano (1984), "A new point-location algorithm and its practical efficiency": buckets of a
regular raster answer in constant time. Here a bucket holds the generators that may be nearest in it, and one that is
crowded is divided again, so that clustered generators cost no more.
"""

from __future__ import annotations

import os
from concurrent.futures import ThreadPoolExecutor
from itertools import pairwise
from weakref import WeakKeyDictionary

import numpy as np

from tessellation._arrays import FloatArray, IntArray
from tessellation._kernels import HEADER, Locator, PixelArray, locate_all
from tessellation._raster import DEEPEST, LARGEST_SIDE, Frame, fill
from tessellation.blocks import DENSE_SQUARES, LARGEST_ENTRY, Blocks
from tessellation.protocols import Tessellation

PIXELS_PER_CELL = 2
"""At least, on average; fewer candidates in a pixel against more memory."""
FINE_RASTER_PIXELS = 1 << 17
"""A raster of so few pixels stays in the processor's cache, so it may have more of them for a cell."""
MAX_REFINEMENT = 64
PIXELS_ACROSS = 48
"""Of the raster of cells that have no locator of their own, across a cell of mean area."""
MAX_PIXELS = 20_000_000
"""The largest such raster; beyond, its pixels are larger: 80 MB."""
BATCH_FOR_THREADS = 1 << 16
"""Fewer points are located sooner than threads are started."""
MAX_THREADS = 8


def locator_of(cells: Tessellation) -> Locator:
    """What compiled code asks for the cell of a point: the cells' own attribute `locator`, else a raster of them.

    A raster answers as `cell_of` does at the centres of its pixels.
    """
    own = getattr(cells, "locator", None)
    if isinstance(own, Locator):
        return own
    try:
        if cells not in _RASTERS:
            _RASTERS[cells] = _raster_of(cells)
        return _RASTERS[cells]
    except TypeError:  # cells that are not hashable, or not weakly referenced
        return _raster_of(cells)


_RASTERS: WeakKeyDictionary[Tessellation, Locator] = WeakKeyDictionary()
"""Of cells without a locator of their own, while they live: a raster takes longer than most of what asks for it."""


def _raster_of(cells: Tessellation) -> Locator:
    corners = [corners for corners in cells.polygons() if len(corners)]
    if not corners:
        return Locator(0.0, 0.0, 1.0, np.full((1, 1), -1, np.int32), np.zeros(4))
    low, high = np.concatenate(corners).min(axis=0), np.concatenate(corners).max(axis=0)
    least = float(np.sqrt(np.prod(high - low) / MAX_PIXELS))
    side = max(float(np.sqrt(cells.area.sum() / len(corners))) / PIXELS_ACROSS, least)
    n_x, n_y = (int(n) + 1 for n in (high - low) / side)
    x, y = low[0] + side * (np.arange(n_x) + 0.5), low[1] + side * (np.arange(n_y) + 0.5)
    pixel = np.stack([cells.cell_of(np.column_stack([x, np.full(n_x, north)])) for north in y.tolist()])
    return Locator(float(low[0]), float(low[1]), 1.0 / side, pixel.astype(np.int32), np.zeros(4))


def grid_locator(origin: FloatArray, cell_size: float, n_x: int, n_y: int, square: IntArray) -> Locator:
    """The locator of square cells, see `GridTessellation`, one to a pixel."""
    if n_x * n_y > DENSE_SQUARES:
        return Blocks.of_squares(origin, cell_size, n_x, n_y, square).locator()
    pixel = np.full(n_x * n_y, -1, np.int32)
    pixel[square] = np.arange(square.size)
    return Locator(float(origin[0]), float(origin[1]), 1.0 / cell_size, pixel.reshape(n_y, n_x), np.zeros(4))


def voronoi_locator(generators: FloatArray, region: Locator) -> Locator:
    """The locator of the nearest generator where `region` has a cell.

    Args:
        generators: (n_cells, 2) metres, no two the same.
        region: of square cells. Its pixels are halved until there are `PIXELS_PER_CELL`; a power of two keeps its
            borders, to the last bit.

    Raises:
        ValueError: generators so crowded that the lists of candidates do not fit.
    """
    blocks = Blocks.of(region)
    if blocks is not None and len(generators) and blocks.place.size:
        return _voronoi_in_blocks(generators, blocks)
    covers = region.pixel >= 0
    if len(generators) == 0 or not covers.any():
        return Locator(*region[:3], np.full(covers.shape, -1, np.int32), np.zeros(4))
    refinement = 1
    wanted = PIXELS_PER_CELL * len(generators)
    most = max(8 * wanted, FINE_RASTER_PIXELS)
    while refinement < MAX_REFINEMENT and (
        covers.sum() * refinement**2 < wanted or 4 * covers.size * refinement**2 <= FINE_RASTER_PIXELS
    ):
        if 4 * covers.size * refinement**2 > most:
            break
        refinement *= 2
    n_y, n_x = covers.shape
    largest = max(abs(region.origin_x), abs(region.origin_y)) + max(covers.shape) / region.pixels_per_metre
    rounding = 4.0 * float(np.spacing(largest))
    per_metre = region.pixels_per_metre * refinement
    frame = Frame(region.origin_x, region.origin_y, per_metre, n_x * refinement, n_y * refinement, rounding)
    covered = np.zeros((n_y + 1, n_x + 1), np.int32)
    covered[1:, 1:] = covers.cumsum(axis=0, dtype=np.int32).cumsum(axis=1, dtype=np.int32)
    everyone = np.arange(len(generators))
    entry = np.zeros(max(1024, 12 * len(generators)))
    # Address 0 names no list, so the first four numbers are spare: `locate_all` may touch them.
    value, entry, top = _filled(frame, generators, everyone, covered, refinement, entry=entry, top=4, depth=1)
    if top > LARGEST_ENTRY:
        raise ValueError(f"generators: {len(generators)} of them need {top} candidates, more than {LARGEST_ENTRY}")
    pixel = value.reshape(frame.n_y, frame.n_x)
    return Locator(frame.x, frame.y, per_metre, pixel, entry[:top].copy())


def _voronoi_in_blocks(generators: FloatArray, region: Blocks) -> Locator:
    """Likewise, block by block: each is a raster of its own, of the generators that may be nearest in it.

    So it depends on no generator that is far: pixels are not halved, and a crowded one is divided by itself.
    """
    covers, side, per_metre = region.value >= 0, region.value.shape[1], region.pixels_per_metre
    extent = max(region.shape) * side / per_metre
    rounding = 4.0 * float(np.spacing(max(abs(region.origin_x), abs(region.origin_y)) + extent))
    entry, top = np.zeros(max(1024, 12 * len(generators))), 4
    value = np.empty((len(covers), side, side), np.int32)
    for i, candidate in enumerate(region.candidates(generators)):
        row, column = divmod(int(region.place[i]), region.shape[1])
        x, y = (low + n * side / per_metre for low, n in ((region.origin_x, column), (region.origin_y, row)))
        covered = np.zeros((side + 1, side + 1), np.int32)
        covered[1:, 1:] = covers[i].cumsum(axis=0, dtype=np.int32).cumsum(axis=1, dtype=np.int32)
        frame = Frame(x, y, per_metre, side, side, rounding)
        inner, entry, top = _filled(frame, generators, candidate, covered, 1, entry=entry, top=top, depth=1)
        value[i] = inner.reshape(side, side)
    return region._replace(value=value, listed=entry[:top]).locator()


def _filled(
    frame: Frame,
    generators: FloatArray,
    candidate: IntArray,
    covered: PixelArray,
    refinement: int,
    *,
    entry: FloatArray,
    top: int,
    depth: int,
) -> tuple[PixelArray, FloatArray, int]:
    """The values of a frame's pixels, where a crowded one has a frame of smaller pixels; then `entry`, its end."""
    value = np.full(frame.n_y * frame.n_x, -1, np.int32)
    deepest = depth > DEEPEST
    entry, top, crowded, n, waiting = fill(
        frame, generators, candidate, covered, refinement, deepest, entry, top, value
    )
    for place, start, end in crowded[:n].reshape(-1, 3):
        side = 2
        while side < LARGEST_SIDE and side * side < 2 * (end - start):
            side *= 2
        row, column = divmod(int(place), frame.n_x)
        x, y = frame.x + column / frame.pixels_per_metre, frame.y + row / frame.pixels_per_metre
        smaller = Frame(x, y, frame.pixels_per_metre * side, side, side, frame.rounding)
        here = top
        top += HEADER + side * side
        if top > entry.size:
            entry = np.concatenate([entry, np.zeros(max(top - entry.size, entry.size))])
        whole = np.array([[0, 0], [0, 1]], np.int32)
        inner, entry, top = _filled(
            smaller, generators, waiting[start:end], whole, side, entry=entry, top=top, depth=depth + 1
        )
        entry[here : here + HEADER] = x, y, smaller.pixels_per_metre, side, 0.0, 0.0
        entry[here + HEADER : here + HEADER + side * side] = inner
        value[place] = -2 - 8 * here
    return value, entry, top


def cells_of(locator: Locator, position: FloatArray) -> IntArray:
    """The cell of each position. (n, 2) -> (n,). A large batch is shared out to the processor's cores."""
    n = len(position)
    cell = np.empty(n, np.int64)
    n_threads = min(MAX_THREADS, os.cpu_count() or 1, n // BATCH_FOR_THREADS)
    if n_threads < 2:
        locate_all(locator, position, cell)
        return cell
    border = np.linspace(0, n, n_threads + 1).astype(int)
    with ThreadPoolExecutor(n_threads) as threads:
        parts = [threads.submit(locate_all, locator, position[a:b], cell[a:b]) for a, b in pairwise(border)]
    for part in parts:
        part.result()
    return cell
