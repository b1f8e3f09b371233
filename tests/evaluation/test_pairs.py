"""Methods compared gap by gap, against numbers worked out by hand and against a slow loop."""

from dataclasses import fields

import numpy as np
import pytest

from dirprim_filter.evaluation.experiment import MethodResult
from dirprim_filter.evaluation.pairs import compare_gaps
from dirprim_filter.evaluation.tracking_report import TrackingReport

NAN = float("nan")


def result(*gaps_of_seeds):
    figures = dict.fromkeys((field.name for field in fields(TrackingReport)), 1.0)
    return MethodResult(
        name="prior", reports=tuple(TrackingReport(**(figures | {"gap_rmse": tuple(gaps)})) for gaps in gaps_of_seeds)
    )


def test_gaps_that_only_one_method_tells_of_do_not_count():
    found = compare_gaps(result([1.0, NAN, 5.0], [2.0]), result([3.0, 9.0, 4.0], [NAN]))
    assert found is not None
    assert (found.n, found.nearer) == (2, 0.5)
    assert found.less_m == pytest.approx(np.sqrt((9 + 16) / 2) - np.sqrt((1 + 25) / 2))
    assert compare_gaps(result([NAN]), result([1.0])) is None
    assert compare_gaps(result([]), result([])) is None


def test_the_interval_is_that_of_a_slow_loop_and_holds_nought_where_there_is_no_difference():
    rng = np.random.default_rng(0)
    a, b, c = rng.gamma(2.0, 1.0, (3, 200))
    found = compare_gaps(result(a), result(b + 1.0))
    assert found is not None
    loop = []
    for _ in range(4000):
        drawn = rng.integers(200, size=200)
        loop.append(np.sqrt((b[drawn] + 1.0) @ (b[drawn] + 1.0) / 200) - np.sqrt(a[drawn] @ a[drawn] / 200))
    assert (found.low_m, found.high_m) == pytest.approx(np.quantile(loop, [0.025, 0.975]), abs=0.03)
    assert found.low_m > 0.5
    same = compare_gaps(result(a), result(c))
    assert same is not None
    assert same.low_m < 0.0 < same.high_m
