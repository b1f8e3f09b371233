"""Where a sensor sees: polygons against an independent library, and what bad ones say."""

import math

import numpy as np
import pytest
from matplotlib.path import Path

from dirprim_filter.sight import MOST_VERTICES, Sight

SQUARE = ((0.0, 0.0), (10.0, 0.0), (10.0, 10.0), (0.0, 10.0))
BENT = ((20.0, 0.0), (30.0, 0.0), (30.0, 10.0), (25.0, 2.0), (20.0, 10.0))


def test_positions_are_in_sight_as_matplotlib_has_them():
    position = np.random.default_rng(0).uniform(-5.0, 35.0, (50, 40, 2))
    flat = position.reshape(-1, 2)
    inside = [Path(polygon).contains_points(flat) for polygon in (SQUARE, BENT)]
    sees = Sight((SQUARE, BENT)).sees(position)
    np.testing.assert_array_equal(sees.ravel(), inside[0] | inside[1])
    assert inside[0].any()
    assert inside[1].any()
    assert (sees.ravel() != inside[0]).any()  # one polygon is not the other's


def test_the_probability_of_being_in_sight_is_the_share_of_samples_there():
    rng = np.random.default_rng(1)
    mean = np.array([[5.0, 5.0], [10.0, 5.0], [-40.0, 5.0], [9.0, 9.0]])
    covariance = np.array([[[1.0, 0.3], [0.3, 0.5]]] * 3 + [[[4.0, 3.0], [3.0, 6.0]]])
    sight = Sight((SQUARE,))
    found = sight.probability(mean, covariance)
    sampled = [sight.sees(rng.multivariate_normal(m, c, 4000)).mean() for m, c in zip(mean, covariance, strict=True)]
    np.testing.assert_allclose(found, sampled, atol=0.1)  # parts are sixteenths
    assert found[0] == 1.0
    assert found[2] == 0.0


@pytest.mark.parametrize(
    ("value", "says"),
    [
        ("all", "expected a list of polygons"),
        ([], "at least one polygon, got none"),
        ([[[0, 0], [1, 1]]], "polygon 1: expected at least 3 vertices, got 2"),
        ([[[0, 0], [1, 1], [1]]], "expected a list of polygons"),
        ([[[0, 0], [1, 1], [1, "2"]]], "expected a list of polygons"),
        ([[[0, 0], [1, 1], [1, math.inf]]], "polygon 1: expected finite metres"),
        ([[[0, 0], [1, 1], [1, 0]] * MOST_VERTICES], f"at most {MOST_VERTICES} vertices"),
    ],
)
def test_bad_polygons_are_one_line(value, says):
    with pytest.raises(ValueError, match="sight: ") as error:
        Sight.of(value)
    assert says in str(error.value)
