"""GOSPA against all assignments, and against Stone Soup's where it is installed."""

from datetime import datetime
from itertools import permutations

import numpy as np
import pytest

from dirprim_filter.evaluation.gospa import SwitchCount, gospa

CUTOFF_M = 4.0


def by_enumeration(truth, estimated):
    """Square of the metric: the cheapest way to give the fewer to the more, each pair at most at the cut-off."""
    few, many = sorted((truth, estimated), key=len)
    alone = 0.5 * CUTOFF_M**2 * (len(many) - len(few))
    return alone + min(
        sum(min(((few[i] - many[j]) ** 2).sum(), CUTOFF_M**2) for i, j in enumerate(chosen))
        for chosen in permutations(range(len(many)), len(few))
    )


def scenes():
    rng = np.random.default_rng(0)
    for n, m in [(0, 0), (0, 3), (2, 0), (1, 1), (3, 3), (2, 5), (5, 3), (4, 4)]:
        for _ in range(5):
            yield rng.uniform(0, 8, (n, 2)), rng.uniform(0, 8, (m, 2))


def test_the_metric_is_the_cheapest_of_all_assignments_and_its_parts_add_up():
    for truth, estimated in scenes():
        got = gospa(truth, estimated, cutoff_m=CUTOFF_M)
        assert got.distance**2 == pytest.approx(by_enumeration(truth, estimated), abs=1e-9)
        assert got.localisation + got.missed + got.false == pytest.approx(got.distance**2, abs=1e-9)
        off = np.linalg.norm(truth[got.vehicle] - estimated[got.estimate], axis=1)
        assert (off < CUTOFF_M).all()
        assert got.localisation == pytest.approx((off**2).sum())


def test_stone_soups_metric_and_its_parts_are_the_same():
    pytest.importorskip("stonesoup", reason="pip install stonesoup==1.9")
    from stonesoup.metricgenerator.ospametric import GOSPAMetric
    from stonesoup.types.state import State

    theirs = GOSPAMetric(p=2, c=CUTOFF_M)
    now = datetime(2026, 1, 1)
    compared = 0
    for truth, estimated in scenes():
        if len(truth) + len(estimated) == 0:
            continue
        states = [[State(place[:, None], timestamp=now) for place in places] for places in (estimated, truth)]
        expected = theirs.compute_gospa_metric(*states)[0].value
        got = gospa(truth, estimated, cutoff_m=CUTOFF_M)
        for name in ("distance", "localisation", "missed", "false"):
            assert getattr(got, name) == pytest.approx(expected[name], abs=1e-9), name
        compared += 1
    assert compared == 35


def test_a_cutoff_is_a_distance():
    with pytest.raises(ValueError, match="cutoff_m: expected a positive distance"):
        gospa(np.zeros((1, 2)), np.zeros((1, 2)), cutoff_m=0.0)


def test_a_switch_is_another_track_than_the_last_however_long_ago():
    count = SwitchCount()
    count.add(["a", "b"], ["1", "2"])
    count.add(["a"], ["1"])
    assert count.n_switches == 0
    count.add(["a", "b"], ["2", "1"])
    assert count.n_switches == 2
    count.add([], [])
    count.add(["b"], ["1"])
    assert count.n_switches == 2
