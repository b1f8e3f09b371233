import numpy as np
import pytest
from scipy import stats

from dirprim_filter.distributions import Gamma, VonMisesMixture
from dirprim_filter.evaluation.baselines.uninformative import Uninformative
from dirprim_filter.evaluation.density import (
    PRIMITIVE_KINDS,
    MapModel,
    Method,
    MotionModel,
    all_methods,
    evaluate_density,
    rows_to_judge,
)
from dirprim_filter.primitives import PrimitiveMap
from dirprim_filter.tracks import Tracks
from situations import one_cell_map, rows_of


class Constant:
    """Gives each row the density that its direction says."""

    def __init__(self, factor):
        self.factor = factor

    def direction_log_density(self, position, direction):
        return np.log(self.factor * direction)


def constant(name="constant", **settings):
    settings = settings or {"": Constant(1.0)}
    return Method(name, lambda _train, _rng: settings)


@pytest.fixture(scope="module")
def few(ring):
    return ring[ring.track_id < 12]


def test_the_scores_are_the_hand_computed_ones():
    rows = rows_of(np.array([0.5, 1.0, 1.5, 2.0]), np.ones(4))
    table = evaluate_density(rows, n_folds=2, methods=[constant()], rng=np.random.default_rng(1))
    score = table.methods[0].direction
    assert (table.n_rows, table.n_held_out, table.n_folds, table.n_vehicles) == (4, 4, 2, 4)
    assert score.mean == pytest.approx(1.25)
    assert score.std == pytest.approx(np.std([0.5, 1.0, 1.5, 2.0]))
    assert score.mean_log == pytest.approx(np.log([0.5, 1.0, 1.5, 2.0]).mean())
    pairs = [{0.5, 1.0}, {0.5, 1.5}, {0.5, 2.0}]  # whichever pair is held out first, the other one is second
    possible = [abs(sum(pair) / 2 - (5.0 - sum(pair)) / 2) / np.sqrt(2) for pair in pairs]
    assert min(abs(score.fold_std - p) for p in possible) < 1e-12
    assert table.methods[0].speed is None


def test_of_settings_the_best_in_hindsight_is_shown_and_the_densest_beside_it():
    class Bold(Constant):  # dense where it is right, and lost where it is not
        def direction_log_density(self, position, direction):
            return np.where(direction > 1.2, 3.0, -50.0)

    rows = rows_of(np.array([0.5, 1.0, 1.5, 2.0]), np.ones(4))
    method = constant(name="m", low=Constant(0.5), high=Constant(1.0), bold=Bold(1.0))
    shown = evaluate_density(rows, n_folds=2, methods=[method], rng=np.random.default_rng(1)).methods
    assert [(row.name, row.setting) for row in shown] == [("m", "high"), ("m, densest", "bold")]
    assert shown[1].direction.mean > shown[0].direction.mean
    assert shown[1].direction.mean_log < shown[0].direction.mean_log


def test_a_method_draws_the_same_whatever_stands_beside_it(few):
    def drawing(name):
        return Method(name, lambda _train, rng: {"": Constant(0.1 + rng.random())})

    positive = Tracks(
        track_id=few.track_id, time_ns=few.time_ns, position=few.position,
        direction=np.abs(few.direction) + 1e-3, speed=few.speed,
    )  # fmt: skip
    alone = evaluate_density(positive, methods=[drawing("a")], rng=np.random.default_rng(2)).methods[0]
    beside = evaluate_density(positive, methods=[drawing("a"), drawing("b")], rng=np.random.default_rng(2)).methods
    assert beside[0] == alone
    assert beside[1].direction != alone.direction


def test_slow_rows_count_for_nothing(few):
    speed = np.where(few.track_id == 3, 0.5, few.speed)
    tracks = Tracks(
        track_id=few.track_id, time_ns=few.time_ns, position=few.position, direction=few.direction, speed=speed
    )
    assert 3 not in rows_to_judge(tracks, min_speed=0.5, interval_s=None).track_id
    assert len(rows_to_judge(few, min_speed=0.0, interval_s=1.0)) == 12 * 10
    with pytest.raises(ValueError, match=r"faster than 99.0 m/s, got none among 1200"):
        rows_to_judge(few, min_speed=99.0, interval_s=1.0)


def test_the_density_of_speed_is_the_joint_one_with_direction_integrated_out():
    flat = one_cell_map()
    two = PrimitiveMap(
        tessellation=flat.tessellation,
        direction=VonMisesMixture(
            weight=np.tile([0.3, 0.7], (2, 1)), mean_direction=np.tile([0.0, 2.0], (2, 1)),
            concentration=np.tile([4.0, 9.0], (2, 1)),
        ),
        speed=Gamma(shape=np.tile([9.0, 30.0], (2, 1)), rate=np.tile([3.0, 2.5], (2, 1))),
        n_rows=flat.n_rows, n_place_free_modes=0,
    )  # fmt: skip
    model = MapModel(two)
    assert isinstance(model, MotionModel)
    speed = np.array([0.7, 3.0, 12.0])
    theta = np.linspace(-np.pi, np.pi, 401)[:-1]
    place = np.zeros((3, 2))
    expected = 0.3 * stats.gamma.pdf(speed, 9.0, scale=1 / 3.0) + 0.7 * stats.gamma.pdf(speed, 30.0, scale=0.4)
    np.testing.assert_allclose(np.exp(model.speed_log_density(place, speed)), expected, rtol=1e-9)
    joint = np.exp(model.log_density(np.zeros((3, 400, 2)), np.tile(theta, (3, 1)), np.repeat(speed[:, None], 400, 1)))
    np.testing.assert_allclose(joint.sum(axis=1) * (theta[1] - theta[0]), expected, rtol=1e-9)


def test_every_kind_of_primitive_is_a_row_of_the_table():
    names = [method.name for method in all_methods(max_speed=20.0)]
    assert {"flat"} <= set(PRIMITIVE_KINDS)
    assert [f"primitive, {kind}" for kind in PRIMITIVE_KINDS] == names[: len(PRIMITIVE_KINDS)]
    assert names[len(PRIMITIVE_KINDS) :] == ["primitive, the paper's", "DGM", "GP", "place-free", "uninformative"]


def test_on_a_ring_the_primitive_beats_what_does_not_know_the_place(ring):
    shown = {"primitive, flat", "primitive, the paper's", "DGM", "place-free", "uninformative"}
    methods = [method for method in all_methods(max_speed=float(ring.speed.max())) if method.name in shown]
    table = evaluate_density(ring, n_folds=2, interval_s=0.3, methods=methods, rng=np.random.default_rng(4))
    score = {row.name: row for row in table.methods}
    assert table.split_by == "vehicle"
    assert score["uninformative"].direction.mean == pytest.approx(0.159, abs=2e-4)
    assert score["uninformative"].direction.std == pytest.approx(0.0, abs=1e-9)
    assert np.isfinite(score["uninformative"].speed.mean_log)  # the range it knows is that of all rows
    for name in ("primitive, flat", "primitive, the paper's", "DGM"):
        assert score[name].direction.mean_log > score["place-free"].direction.mean_log + 1.0
    assert score["primitive, flat"].joint.mean_log > score["place-free"].joint.mean_log + 1.0
    assert score["primitive, flat"].direction.mean_log > score["DGM"].direction.mean_log


def test_where_the_place_tells_nothing_the_primitive_gains_nothing():  # the negative control of the test above
    rng = np.random.default_rng(5)
    n = 800
    tracks = Tracks(
        track_id=np.repeat(np.arange(80), 10), time_ns=np.tile(np.arange(10) * 10**9, 80),
        position=rng.uniform(0, 40, (n, 2)), direction=rng.uniform(-np.pi, np.pi, n), speed=rng.gamma(9.0, 1.0, n),
    )  # fmt: skip
    methods = [m for m in all_methods(max_speed=30.0) if m.name in ("primitive, flat", "uninformative")]
    primitive, nothing = evaluate_density(tracks, n_folds=2, methods=methods, rng=rng).methods
    assert primitive.direction.mean_log < nothing.direction.mean_log + 0.01


def test_random_rows_leak_what_held_out_vehicles_do_not():
    rng = np.random.default_rng(6)
    course = rng.uniform(-np.pi, np.pi, 12)  # each drives its own way through its own square: nobody tells of another
    tracks = Tracks(
        track_id=np.repeat(np.arange(12), 40), time_ns=np.tile(np.arange(40) * 10**9, 12),
        position=np.repeat(20.0 * np.arange(12), 40)[:, None] + rng.uniform(0, 3, (480, 2)),
        direction=np.repeat(course, 40) + rng.normal(0, 0.1, 480), speed=np.full(480, 5.0) + rng.random(480),
    )  # fmt: skip
    methods = [method for method in all_methods(max_speed=10.0) if method.name == "primitive, the paper's"]
    by = {
        split: evaluate_density(tracks, split_by=split, n_folds=2, methods=methods, rng=np.random.default_rng(7))
        for split in ("vehicle", "random")
    }
    random, vehicle = (by[split].methods[0].direction.mean_log for split in ("random", "vehicle"))
    assert random > vehicle + 1.0


def test_the_uninformative_density_is_no_models_of_a_place():
    assert isinstance(Uninformative(max_speed=1.0), MotionModel)
    assert not isinstance(Constant(1.0), MotionModel)
