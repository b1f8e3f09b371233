"""Rasters in blocks: the same cells as without, to the last bit, in memory by what is covered."""

import numpy as np
import pytest

from dirprim_filter.primitives.motion_table import reaching
from tessellation import GridTessellation, VoronoiTessellation, locate
from tessellation._kernels import locate_all
from tessellation.blocks import Blocks


def streets(rng, n=300):
    """Places along some streets, in clusters, so that pixels are crowded."""
    way = rng.uniform(-90.0, 110.0, n)
    side = rng.normal(0.0, 1.5, n)
    return np.where(rng.random(n)[:, None] < 0.5, np.column_stack([way, side]), np.column_stack([side + 30.0, way]))


def both(monkeypatch, build):
    """What is built without blocks, and with them."""
    dense = build()
    monkeypatch.setattr(locate, "DENSE_SQUARES", 0)
    return dense, build()


def probes(rng, position, cell_size):
    """Places all over, at what is covered, and on the borders of squares."""
    near = position[rng.integers(len(position), size=4000)] + rng.normal(0.0, 3.0, (4000, 2))
    borders = np.round(near / cell_size) * cell_size
    return np.concatenate([near, borders, rng.uniform(-150.0, 150.0, (4000, 2)), np.array([[1e9, 0.0], [-1e9, 1e300]])])


@pytest.mark.parametrize("cell_size", [3.0, 0.7])
def test_square_cells_in_blocks_are_those_without(monkeypatch, cell_size):
    rng = np.random.default_rng(0)
    position = streets(rng)
    dense, sparse = both(monkeypatch, lambda: GridTessellation.covering(position, cell_size=cell_size))
    assert dense.locator.block == 0 < sparse.locator.block
    assert sparse.locator.pixel.size * 16 < dense.locator.pixel.size
    where = probes(rng, position, cell_size)
    assert np.array_equal(dense.cell_of(where), sparse.cell_of(where))
    assert (dense.cell_of(where) >= 0).any()
    assert (dense.cell_of(where) < 0).any()
    assert all(np.array_equal(dense.neighbors(c), sparse.neighbors(c)) for c in range(dense.n_cells))


@pytest.mark.parametrize("n_cells", [1, 7, 150, 4000])
def test_nearest_generators_in_blocks_are_those_without(monkeypatch, n_cells):
    """With few generators blocks lie far from theirs; with many, pixels are crowded; one of them owns nothing."""
    rng = np.random.default_rng(n_cells)
    position = streets(rng)
    generators = np.vstack([streets(rng, n_cells) + rng.normal(0.0, 0.3, (n_cells, 2)), [[500.0, 500.0]]])
    dense, sparse = both(monkeypatch, lambda: VoronoiTessellation.covering(position, generators=generators, reach=3.0))
    assert dense.locator.block == 0 < sparse.locator.block
    where = probes(rng, position, 3.0)
    assert np.array_equal(dense.cell_of(where), sparse.cell_of(where))
    np.testing.assert_allclose(sparse.area, dense.area, rtol=1e-9, atol=1e-9)
    assert all(np.array_equal(dense.neighbors(c), sparse.neighbors(c)) for c in range(0, dense.n_cells, 17))


@pytest.mark.parametrize("reach_m", [0.0, 3.5, 120.0])
def test_cells_in_blocks_reach_as_far_as_without(monkeypatch, reach_m):
    """Where two cells are as near, either may have the place: that it is covered is the same everywhere."""
    rng = np.random.default_rng(2)
    position = streets(rng, 100)
    dense, sparse = both(
        monkeypatch,
        lambda: VoronoiTessellation.covering(position, generators=streets(np.random.default_rng(3), 40), reach=3.0),
    )
    monkeypatch.setattr("dirprim_filter.primitives.motion_table.MAX_REFINEMENT", 2)  # both as fine
    found = []
    where = probes(rng, position, 1.0)[:-2] + 1e-3
    for cells in (dense, sparse):
        cell = np.empty(len(where), np.int64)
        locate_all(reaching(cells.locator, reach_m), where, cell)
        found.append(cell)
    same_size = dense.locator.pixels_per_metre == sparse.locator.pixels_per_metre * sparse.locator.block
    unlike = np.mean((found[0] >= 0) != (found[1] >= 0))
    assert unlike == 0.0 if same_size else unlike < 0.02
    assert np.mean(found[0] != found[1]) < 0.02


def test_a_city_takes_memory_by_what_is_covered():
    """100 km each way, 40 km of streets; some 30 times what the largest raster could hold."""
    rng = np.random.default_rng(4)
    way = np.linspace(0.0, 1e5, 20_000)
    position = np.vstack([np.column_stack([way[:4000], 0.5 * way[:4000]]), np.column_stack([way[-4000:], way[-4000:]])])
    cells = VoronoiTessellation.covering(position, generators=position[::8] + rng.normal(0, 1, (1000, 2)), reach=3.0)
    region = cells.region
    assert region.n_x * region.n_y > 30_000**2
    locator = cells.locator
    assert locator.pixel.nbytes + locator.entry.nbytes < 64e6
    covered = position[rng.integers(len(position), size=500)] + rng.uniform(-3.0, 3.0, (500, 2))
    squared = ((covered[:, None] - cells.generators) ** 2).sum(axis=2)
    assert np.array_equal(cells.cell_of(covered), squared.argmin(axis=1))
    assert (cells.cell_of(rng.uniform(3e4, 7e4, (500, 2))) == -1).all()


def test_squares_too_scattered_for_memory_are_refused():
    square = np.arange(0, 1 << 33, 8191, dtype=np.int64)[: 1 << 20]
    with pytest.raises(ValueError, match=r"blocks of 16 x 16 pixels take .* remove far outliers"):
        Blocks.of_squares(np.zeros(2), 3.0, 1 << 20, 1 << 13, square[::1])


def test_extents_beyond_what_rasters_hold_are_refused_before_memory_is_taken():
    for n_x, n_y in ((1 << 31, 1), (1 << 18, 1 << 17), (1 << 62, 1 << 62)):
        with pytest.raises(ValueError, match="squares, more than 8589934592 in blocks"):
            GridTessellation(origin=np.zeros(2), cell_size=1.0, n_x=n_x, n_y=n_y, square=np.empty(0, np.int64))
