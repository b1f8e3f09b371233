"""The raster of some cells: it says of every point what that of all cells says, by the part's numbers."""

import numpy as np
import pytest

from tessellation import OUTSIDE, GridTessellation, VoronoiTessellation
from tessellation.locate import cells_of
from tessellation.located_part import LocatedPart


def cells_of_kind(kind, rng):
    place = rng.uniform(-40.0, 60.0, (400, 2))
    if kind == "grid":
        return GridTessellation.covering(place, cell_size=3.0)
    crowded = np.concatenate([place[:150], place[:3].repeat(30, axis=0) + rng.normal(0.0, 0.05, (90, 2))])
    return VoronoiTessellation.covering(place, generators=crowded, reach=3.0)


@pytest.mark.parametrize("kind", ["grid", "voronoi"])
def test_a_part_answers_as_the_whole(kind):
    rng = np.random.default_rng(3)
    whole = cells_of_kind(kind, rng)
    part = LocatedPart.of(whole, np.flatnonzero(whole.centers[:, 0] > 10.0))
    place = rng.uniform(-60.0, 80.0, (20_000, 2))
    expected = part.number[whole.cell_of(place)]
    np.testing.assert_array_equal(cells_of(part.locator, place), expected)
    np.testing.assert_array_equal(part.cell_of(place), expected)
    assert (expected >= 0).any()
    assert (expected != whole.cell_of(place)).any()
    of_all = LocatedPart.of(whole, np.arange(whole.n_cells))
    np.testing.assert_array_equal(cells_of(of_all.locator, place), whole.cell_of(place))
    of_none = LocatedPart.of(whole, np.empty(0, np.int64))
    assert (cells_of(of_none.locator, place) == OUTSIDE).all()
