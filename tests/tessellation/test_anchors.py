"""Anchors lie in their cells, wherever the generators lie."""

import numpy as np

from tessellation import GridTessellation, VoronoiTessellation
from tessellation.anchors import anchors


def an_l_shape():
    """Cells of an L-shaped region of squares, some with their generator beyond it."""
    region = GridTessellation(origin=np.zeros(2), cell_size=2.0, n_x=4, n_y=4, square=np.array([0, 1, 2, 3, 4, 8, 12]))
    inside = np.array([[1.0, 1.0], [5.0, 0.5], [1.2, 5.0]])
    beyond = np.array([[7.0, 2.6], [3.0, 4.0], [-1.0, 7.0]])
    return VoronoiTessellation(generators=np.concatenate([inside, beyond]), region=region)


def test_anchors_lie_in_their_cells_and_are_the_centres_where_those_do():
    cells = an_l_shape()
    number = np.arange(cells.n_cells)
    is_home = cells.cell_of(cells.centers) == number
    assert is_home.tolist() == [True] * 3 + [False] * 3  # else this shows nothing
    found = anchors(cells)
    np.testing.assert_array_equal(cells.cell_of(found), number)
    np.testing.assert_array_equal(found[is_home], cells.centers[is_home])
    # Not just anywhere in the cell: of a fine lattice over it few points are much nearer to the generator.
    x, y = np.meshgrid(np.linspace(0.01, 7.99, 200), np.linspace(0.01, 7.99, 200))
    lattice = np.stack([x, y], axis=-1).reshape(-1, 2)
    home = cells.cell_of(lattice)
    for c in number[~is_home]:
        nearest = np.hypot(*(lattice[home == c] - cells.centers[c]).T).min()
        assert np.hypot(*(found[c] - cells.centers[c])) <= nearest + 1.0


def test_a_cell_that_owns_nothing_keeps_its_centre_and_squares_have_theirs():
    region = GridTessellation(origin=np.zeros(2), cell_size=2.0, n_x=1, n_y=1, square=np.array([0]))
    cells = VoronoiTessellation(generators=np.array([[1.0, 1.0], [50.0, 50.0]]), region=region)
    np.testing.assert_array_equal(anchors(cells), cells.centers)
    np.testing.assert_array_equal(anchors(region), [[1.0, 1.0]])
