"""Estimates, kept in their order."""

from dataclasses import fields

import numpy as np
import pytest

from dirprim_filter.estimates import Estimates


def some(names, *, time_ns=0):
    n = len(names)
    return Estimates(
        track_id=names, time_ns=np.full(n, time_ns), position=np.arange(2.0 * n).reshape(n, 2),
        covariance=np.tile(np.eye(2), (n, 1, 1)), direction=np.zeros(n), direction_resultant=np.ones(n),
        speed=np.arange(float(n)), speed_std=np.ones(n), effective_sample_size=np.ones(n), log_evidence=np.zeros(n),
    )  # fmt: skip


def test_concatenation_keeps_every_row_in_order_and_numbers_among_names_become_text():
    whole = Estimates.concatenate(iter([some([3, 1], time_ns=9), some([2], time_ns=5)]))
    assert whole.track_id.tolist() == [3, 1, 2]
    assert whole.time_ns.tolist() == [9, 9, 5]
    assert whole.speed.tolist() == [0, 1, 0]
    assert Estimates.concatenate([some([3]), some(["x"])]).track_id.tolist() == ["3", "x"]
    empty = Estimates.concatenate([])
    assert len(empty) == 0
    assert empty.covariance.shape == (0, 2, 2)


@pytest.mark.parametrize("name", ["position", "speed_std", "log_evidence", "covariance"])
def test_numbers_that_are_not_finite_are_refused_by_name(name):
    good = some([1, 2])
    columns = {f.name: getattr(good, f.name).copy() for f in fields(Estimates)}
    columns[name][1] = np.nan
    with pytest.raises(ValueError, match=f"{name}: expected finite"):
        Estimates(**columns)
