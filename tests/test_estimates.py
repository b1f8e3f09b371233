"""Estimates, kept in their order."""

from dataclasses import fields

import numpy as np
import pytest

from dirprim_filter.estimates import Estimates
from situations import estimates_of


def test_concatenation_keeps_every_row_in_order_and_numbers_among_names_become_text():
    whole = Estimates.concatenate(iter([estimates_of([3, 1], time_ns=9, speed=[0, 1]), estimates_of([2], time_ns=5)]))
    assert whole.track_id.tolist() == [3, 1, 2]
    assert whole.time_ns.tolist() == [9, 9, 5]
    assert whole.speed.tolist() == [0, 1, 1]
    assert Estimates.concatenate([estimates_of([3]), estimates_of(["x"])]).track_id.tolist() == ["3", "x"]
    empty = Estimates.concatenate([])
    assert len(empty) == 0
    assert empty.covariance.shape == (0, 2, 2)


@pytest.mark.parametrize("name", ["position", "speed_std", "log_evidence", "covariance"])
def test_numbers_that_are_not_finite_are_refused_by_name(name):
    good = estimates_of([1, 2])
    columns = {f.name: getattr(good, f.name).copy() for f in fields(Estimates)}
    columns[name][1] = np.nan
    with pytest.raises(ValueError, match=f"{name}: expected finite"):
        Estimates(**columns)
