import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from tessellation import OUTSIDE, GridTessellation


def test_outside_is_said_and_far_outliers_do_not_allocate_the_plane_between():
    grid = GridTessellation.covering(np.array([[0.5, 0.5], [10.5, 0.5]]), cell_size=1.0)
    away = np.array([[5.5, 0.5], [-0.5, 0.5], [0.5, 1.5], [1e12, -1e12]])
    assert (grid.cell_of(away) == OUTSIDE).all()
    with pytest.raises(ValueError, match="outliers"):
        GridTessellation.covering(np.array([[0.0, 0.0], [1e9, 1e9]]), cell_size=1.0)
    with pytest.raises(ValueError, match="finite"):
        GridTessellation.covering(np.array([[0.0, np.nan]]), cell_size=1.0)


@given(st.floats(-1e6, 1e6), st.floats(-1e6, 1e6), st.floats(0.01, 1e3))
def test_one_datum_makes_one_cell_that_holds_it(x, y, cell_size):
    grid = GridTessellation.covering(np.array([[x, y]]), cell_size=cell_size)
    assert grid.n_cells == 1
    assert grid.cell_of(np.array([x, y])) == 0


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        ({"cell_size": 0.0}, "cell_size"),
        ({"cell_size": float("nan")}, "cell_size"),
        ({"n_x": 0}, "at least one column"),
        ({"square": np.array([2, 1])}, "ascending"),
        ({"square": np.array([0, 2**62, -(2**62) - 1, 3])}, "ascending"),  # differences wrap
        ({"square": np.array([99])}, "expected numbers from 0 to 3"),
        ({"n_x": 10**6, "n_y": 10**6}, "larger cells"),
    ],
)
def test_a_grid_that_cannot_be_is_refused(arguments, message):
    good = {"origin": np.zeros(2), "cell_size": 1.0, "n_x": 2, "n_y": 2, "square": np.array([0, 3])}
    with pytest.raises(ValueError, match=message):
        GridTessellation(**(good | arguments))
