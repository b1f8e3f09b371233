from dataclasses import replace

import numpy as np
import pytest
from scipy import stats

from dirprim_filter.distributions.angles import wrap
from dirprim_filter.evaluation.baselines import gaussian_process
from dirprim_filter.evaluation.density import Method, all_methods, conclusion, evaluate_density, rows_to_judge
from dirprim_filter.evaluation.intervals import Interval
from dirprim_filter.evaluation.settings import Axis
from situations import rows_of, tracks_of


class Constant:
    """Gives each row the density that its direction says."""

    def __init__(self, factor):
        self.factor = factor

    def direction_log_density(self, position, direction):
        return np.log(self.factor * direction)


def constant(name="constant", factor=1.0):
    return Method(name, lambda _train, _values, _rng: Constant(factor))


def chosen(method_names, tracks):
    return [method for method in all_methods(max_speed=float(tracks.speed.max())) if method.name in method_names]


@pytest.fixture(scope="module")
def few(ring):
    return ring[ring.track_id < 12]


def test_the_scores_are_the_hand_computed_ones():
    rows = rows_of(np.array([0.5, 1.0, 1.5, 2.0]), np.ones(4))
    table = evaluate_density(rows, n_folds=2, methods=[constant()], rng=np.random.default_rng(1))
    score = table.methods[0].direction
    assert (table.n_rows, table.n_held_out, table.n_folds, table.n_vehicles) == (4, 4, 2, 4)
    assert score.mean == pytest.approx(1.25)
    log = np.log([0.5, 1.0, 1.5, 2.0])
    half = stats.t.ppf(0.975, 3) * log.std(ddof=1) / 2  # a vehicle for each row
    assert score.mean_log == pytest.approx((log.mean(), log.mean() - half, log.mean() + half, 4))
    assert table.methods[0].speed is None
    assert table.methods[0].settings == ()


def test_the_first_method_is_compared_with_each_by_pairs():
    class Offset(Constant):  # worse by a nat in each row, and in a tenth of the rows by ten
        def direction_log_density(self, position, direction):
            return np.log(direction) - np.where(direction > 1.9, 10.0, 1.0)

    direction = np.tile(np.linspace(0.1, 2.0, 20), 2)
    rows = rows_of(direction, np.ones(40))
    offset = Method("offset", lambda _train, _values, _rng: Offset(1.0))
    methods = [constant(), offset, constant("half", 0.5)]
    first, worse, half = evaluate_density(rows, n_folds=3, methods=methods, rng=np.random.default_rng(1)).methods
    paired = np.where(direction > 1.9, 10.0, 1.0)
    t = stats.ttest_1samp(paired, 0.0).confidence_interval()
    assert worse.direction.behind == pytest.approx((paired.mean(), t.low, t.high, 40))
    assert half.direction.behind == pytest.approx((np.log(2), np.log(2), np.log(2), 40))
    assert first.direction.behind == (0.0, 0.0, 0.0, 40)


def test_slow_rows_count_for_nothing(few):
    tracks = replace(few, speed=np.where(few.track_id == 3, 0.5, few.speed))
    assert 3 not in rows_to_judge(tracks, interval_s=None).track_id
    assert len(rows_to_judge(few, interval_s=1.0)) == 12 * 10
    with pytest.raises(ValueError, match=r"faster than 0.5 m/s, got none among 100"):
        rows_to_judge(tracks[tracks.track_id == 3], interval_s=1.0)


@pytest.fixture(scope="module")
def on_the_ring(ring):
    rng = np.random.default_rng(4)
    course = wrap(ring.direction + 0.05 * rng.standard_normal(len(ring)))  # of exact ones no noise is too small
    methods = [method for method in all_methods(max_speed=20.0) if method.name != "primitive, curved"]
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(gaussian_process, "MAX_ROWS", 150)
        tracks = replace(ring, direction=course)
        return evaluate_density(tracks, n_folds=2, interval_s=1.2, methods=methods, rng=rng)


def test_on_a_ring_all_that_knows_the_place_beats_what_does_not(on_the_ring):
    score = {row.name: row for row in on_the_ring.methods}
    assert on_the_ring.split_by == "vehicle"
    assert score["uninformative"].direction.mean == pytest.approx(0.159, abs=2e-4)
    assert score["uninformative"].direction.mean_log.half_width == pytest.approx(0.0, abs=1e-9)
    assert np.isfinite(score["uninformative"].speed.mean_log.value)  # the range it knows is that of all rows
    without = score["without the map"]
    for name in ("primitive, flat", "primitive, the paper's", "DGM", "GP"):
        assert score[name].direction.mean_log.low > without.direction.mean_log.high + 1.0
    assert score["primitive, flat"].joint.mean_log.low > without.joint.mean_log.high + 1.0
    assert without.joint.behind.low > 1.0
    assert without.joint.behind.n_clusters == 40


def test_no_rival_lies_on_a_bound_and_the_conclusion_says_what_the_map_gains(on_the_ring):
    settings = {row.name: row.settings for row in on_the_ring.methods if row.settings}
    assert set(settings) == {"DGM", "GP"}
    for of_folds in settings.values():
        assert len(of_folds) == 2
        assert all(choice.is_inside for fold in of_folds for choice in fold)
    name = {row.name: row for row in on_the_ring.methods}
    words = conclusion(on_the_ring)
    value, low, high, _ = name["without the map"].joint.behind
    assert words.startswith(f"the map gives held-out motion {value:+.2f} nat ({low:.2f} to {high:.2f}) over the same")
    rival = max((name[of] for of in settings), key=lambda row: row.direction.mean_log.value)
    assert f"in direction alone {rival.direction.behind.value:+.2f} nat" in words
    assert f"the best rival, {rival.name}" in words
    assert words.endswith("(95 % over vehicles)")
    score = name["without the map"]
    unsure = replace(score, joint=replace(score.joint, behind=Interval(0.1, -0.1, 0.3, 40)))
    assert "+0.10 nat (-0.10 to 0.30, not distinguishable)" in conclusion(replace(on_the_ring, methods=(unsure,)))


def test_settings_are_chosen_without_the_held_out_rows():
    seen = []

    def fit(train, values, _rng):
        seen.append(set(train.track_id.tolist()))
        return Constant(1.0 + values[0])

    rows = rows_of(np.linspace(0.1, 2.0, 24), np.ones(24))
    method = Method("greedy", fit, (Axis("factor", 1.0, most=4.0),))
    (row,) = evaluate_density(rows, n_folds=3, methods=[method], rng=np.random.default_rng(5)).methods
    whole = [train for train in seen if len(train) == 16]
    inner = [train for train in seen if len(train) == 12]
    assert (len(whole), len(whole) + len(inner)) == (3, len(seen))
    assert all(any(few < train for train in whole) for few in inner)
    assert [fold[0].chosen for fold in row.settings] == [4.0, 4.0, 4.0]


def test_where_the_place_says_nothing_the_primitive_gains_nothing():  # the negative control of the test above
    rng = np.random.default_rng(5)
    tracks = tracks_of(
        rng.uniform(0, 40, (80, 10, 2)), time_ns=np.arange(10) * 10**9,
        direction=rng.uniform(-np.pi, np.pi, (80, 10)), speed=rng.gamma(9.0, 1.0, (80, 10)),
    )  # fmt: skip
    methods = chosen({"primitive, flat", "uninformative"}, tracks)
    primitive, nothing = evaluate_density(tracks, n_folds=2, methods=methods, rng=rng).methods
    assert primitive.direction.mean_log.value < nothing.direction.mean_log.value + 0.01


@pytest.mark.slow
def test_random_rows_leak_what_held_out_vehicles_do_not():
    rng = np.random.default_rng(6)
    course = rng.uniform(-np.pi, np.pi, (12, 1))  # each through its own square: none says anything of another
    tracks = tracks_of(
        20.0 * np.arange(12)[:, None, None] + rng.uniform(0, 3, (12, 40, 2)), time_ns=np.arange(40) * 10**9,
        direction=course + rng.normal(0, 0.1, (12, 40)), speed=5.0 + rng.random((12, 40)),
    )  # fmt: skip
    methods = chosen({"primitive, the paper's"}, tracks)
    by = {
        split: evaluate_density(tracks, split_by=split, n_folds=2, methods=methods, rng=np.random.default_rng(7))
        for split in ("vehicle", "random")
    }
    random, vehicle = (by[split].methods[0].direction.mean_log.value for split in ("random", "vehicle"))
    assert random > vehicle + 1.0
