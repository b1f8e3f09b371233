"""Rivals' settings: the best lies inside what was searched, unless a limit forbids to look further."""

import numpy as np
import pytest

from dirprim_filter.evaluation.settings import Axis, choose

SIZE, SHARE = Axis("size, m", 1.0, 2.0), Axis("share", 1.0, 3.0)


def hill(size, share):
    """Highest at 37 and 0.004, oblique."""
    x, y = np.log(size / 37.0), np.log(share / 0.004)
    return -(x**2) - y**2 - 0.8 * x * y


def test_what_is_chosen_is_the_best_of_a_wide_grid_and_lies_inside_what_was_searched():
    size, share = choose([SIZE, SHARE], lambda values: hill(*values))
    steps = np.arange(-15, 16)
    grid = hill(2.0 ** steps[:, None], 3.0 ** steps[None, :])
    i, j = np.unravel_index(grid.argmax(), grid.shape)
    assert (size.chosen, share.chosen) == (2.0 ** steps[i], pytest.approx(3.0 ** steps[j]))
    for choice, factor in ((size, 2.0), (share, 3.0)):
        assert choice.is_inside
        assert choice.low <= choice.chosen / factor * 1.0001
        assert choice.high >= choice.chosen * factor * 0.9999


def test_the_choice_lies_on_a_bound_that_cannot_widen_and_stays_where_little_is_gained():
    (choice,) = choose([SIZE._replace(most=16.0)], lambda values: -abs(np.log(values[0] / 37.0)))
    assert choice == ("size, m", 1.0, 16.0, 16.0)
    assert not choice.is_inside

    def slope(values):
        return -abs(np.log2(values[0] / 8.0))  # each step gains 1

    assert [choose([SIZE], slope, least_gain=gain)[0].chosen for gain in (0.9, 1.1)] == [8.0, 1.0]
