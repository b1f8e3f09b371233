"""What the map is judged beside: rivals' densities, scores of densities, and vehicles that go on as one seen here."""

from dataclasses import replace

import numpy as np
import pytest
from scipy import integrate, stats

from dirprim_filter.distributions.angles import wrap
from dirprim_filter.evaluation import density
from dirprim_filter.evaluation.baselines import gaussian_process
from dirprim_filter.evaluation.baselines.directional_grid_map import DirectionalGridMap
from dirprim_filter.evaluation.baselines.trajectory_memory import States, TrajectoryMemory
from dirprim_filter.evaluation.density import Method, Uninformative, all_methods, conclusion, evaluate_density
from dirprim_filter.evaluation.forecast_cases import Cases
from dirprim_filter.evaluation.intervals import Interval
from dirprim_filter.evaluation.settings import Axis
from situations import ring_traffic, rows_of, tracks_of

CIRCLE = np.linspace(-np.pi, np.pi, 2001)[:-1]
STEP = CIRCLE[1] - CIRCLE[0]
PLACE = np.full(2, 5.0)


def density_at(model, place):
    """Of the directions of a circle."""
    return np.exp(model.direction_log_density(np.tile(place, (CIRCLE.size, 1)), CIRCLE))


def one_cell(direction, *, pseudo_count=1e-9):
    position, given = np.tile(PLACE, (len(direction), 1)), {"cell_size": 10.0, "max_concentration": 1e4}
    return DirectionalGridMap.fit(position, direction, pseudo_count=pseudo_count, **given)


def test_uninformative_densities_are_those_of_the_uniform_law():
    model = Uninformative(max_speed=20.0)
    place, speed = np.zeros((3, 2)), np.array([0.0, 20.0, 20.1])
    np.testing.assert_allclose(np.exp(model.direction_log_density(place, np.zeros(3))), 0.159, atol=2e-4)
    np.testing.assert_allclose(np.exp(model.speed_log_density(place, speed)), [0.05, 0.05, 0.0], rtol=1e-12)
    assert model.log_density(place, np.zeros(3), speed)[0] == pytest.approx(-np.log(2 * np.pi * 20))


def test_a_grid_map_of_one_mode_is_scipys_maximum_likelihood_fit():
    direction = stats.vonmises.rvs(30.0, loc=3.0, size=400, random_state=1)  # across the wrap
    kappa, mean, _ = stats.vonmises.fit(direction, fscale=1)
    found = one_cell(direction).direction
    assert found.concentration[0, 0] == pytest.approx(kappa, rel=1e-4)
    assert np.cos(found.mean_direction[0, 0] - mean) == pytest.approx(1.0, abs=1e-9)


def test_a_grid_map_finds_both_ways_of_a_street_and_beats_one_mode():
    rng = np.random.default_rng(2)
    direction = np.concatenate([rng.vonmises(0.5, 60, 300), rng.vonmises(0.5 - np.pi, 25, 100)])
    model = one_cell(direction)
    used = model.direction.weight[0] > 1e-6
    np.testing.assert_allclose(np.sort(model.direction.weight[0, used]), [0.25, 0.75], atol=0.02)
    np.testing.assert_allclose(np.sort(model.direction.concentration[0, used]), [25, 60], rtol=0.3)
    kappa, mean, _ = stats.vonmises.fit(direction, fscale=1)
    alone = stats.vonmises.logpdf(direction, kappa, loc=mean).mean()
    assert model.direction_log_density(np.tile(PLACE, (400, 1)), direction).mean() > alone + 1.0


def test_a_uniform_direction_counts_as_so_many_rows_of_a_square_and_repeated_angles_are_bounded():
    direction = np.random.default_rng(4).vonmises(0.0, 80, 6)
    own, mixed = (density_at(one_cell(direction, pseudo_count=n), PLACE) for n in (1e-9, 2.0))
    np.testing.assert_allclose(mixed, 0.75 * own + 0.25 / (2 * np.pi), atol=1e-8)
    assert mixed.sum() * STEP == pytest.approx(1.0, abs=1e-6)
    model = one_cell(np.full(50, -np.pi))
    assert model.direction.concentration.max() == 1e4
    log_p = model.direction_log_density(np.tile(PLACE, (2, 1)), np.array([np.pi, 0.0]))
    assert np.isfinite(log_p).all()
    assert log_p[0] == pytest.approx(0.5 * np.log(1e4 / (2 * np.pi)), abs=1e-3)


def test_projected_normal_is_the_planes_normal_density_along_the_ray_and_finite_however_sure_it_is():
    def along_ray(r, turn):
        return r * stats.multivariate_normal.pdf([r * np.cos(turn), r * np.sin(turn)], mean=[2.5, 0.0])

    turns = np.array([0.0, 0.4, 2.0, -3.0])
    expected = [integrate.quad(along_ray, 0.0, np.inf, args=(turn,))[0] for turn in turns]
    found = gaussian_process.projected_normal_log_density(turns, np.full(4, 2.5))
    np.testing.assert_allclose(np.exp(found), expected, rtol=1e-6)
    log_p = gaussian_process.projected_normal_log_density(np.array([0.0, np.pi / 2, np.pi]), np.full(3, 1e6))
    assert np.isfinite(log_p).all()
    assert log_p[0] == pytest.approx(np.log(1e6) - 0.5 * np.log(2 * np.pi), abs=1e-6)


def test_a_gaussian_process_learns_a_bend_and_knows_nothing_far_away(ring, monkeypatch):
    monkeypatch.setattr(gaussian_process, "MAX_ROWS", 150)
    rows = np.random.default_rng(7).permutation(len(ring))
    train, test = ring[rows[:600]], ring[rows[600:900]]
    given = {"length": 15.0, "noise": 0.1, "rng": np.random.default_rng(8)}
    model = gaussian_process.DirectionalGaussianProcess.fit(train.position, train.direction, **given)
    assert model.process.X_train_.shape == (150, 2)
    assert model.direction_log_density(test.position, test.direction).mean() > 0.5
    assert model.direction_log_density(test.position, test.direction + np.pi).mean() < -2.0
    assert density_at(model, test.position[0]).sum() * STEP == pytest.approx(1.0, abs=1e-6)
    far = np.full((4, 2), 1e4)
    np.testing.assert_allclose(model.direction_log_density(far, np.arange(4.0)), -np.log(2 * np.pi), atol=1e-6)


class Constant:
    """Gives each row the density that its direction says."""

    def __init__(self, factor):
        self.factor = factor

    def direction_log_density(self, position, direction):
        return np.log(self.factor * direction)


def constant(name="constant", factor=1.0):
    return Method(name, lambda _train, _values, _rng: Constant(factor))


def test_the_scores_are_the_hand_computed_ones():
    rows = rows_of(np.array([0.5, 1.0, 1.5, 2.0]), np.ones(4))
    table = evaluate_density(rows, n_folds=2, methods=[constant()], rng=np.random.default_rng(1))
    score = table.methods[0].direction
    assert (table.n_rows, table.n_held_out, table.n_folds, table.n_vehicles) == (4, 4, 2, 4)
    assert score.mean == pytest.approx(1.25)
    log = np.log([0.5, 1.0, 1.5, 2.0])
    half = stats.t.ppf(0.975, 3) * log.std(ddof=1) / 2  # a vehicle for each row
    assert score.mean_log == pytest.approx((log.mean(), log.mean() - half, log.mean() + half, 4))
    assert (table.methods[0].speed, table.methods[0].settings) == (None, ())


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


def test_slow_rows_count_for_nothing(ring):
    few = ring[ring.track_id < 12]
    tracks = replace(few, speed=np.where(few.track_id == 3, 0.5, few.speed))
    assert 3 not in density.rows_to_judge(tracks, interval_s=None).track_id
    assert len(density.rows_to_judge(few, interval_s=1.0)) == 12 * 10
    with pytest.raises(ValueError, match=r"faster than 0.5 m/s, got none among 100"):
        density.rows_to_judge(tracks[tracks.track_id == 3], interval_s=1.0)


def test_on_a_ring_all_that_knows_the_place_beats_what_does_not_and_no_rival_lies_on_a_bound(monkeypatch):
    monkeypatch.setattr(gaussian_process, "MAX_ROWS", 150)
    rng = np.random.default_rng(4)
    ring = ring_traffic(rng, n_vehicles=40, radius=6.0, speed=3.0)
    course = wrap(ring.direction + 0.05 * rng.standard_normal(len(ring)))  # of exact ones no noise is too small
    methods = [method for method in all_methods(max_speed=20.0) if method.name != "primitive, curved"]
    found = evaluate_density(replace(ring, direction=course), n_folds=2, interval_s=1.2, methods=methods, rng=rng)
    score = {row.name: row for row in found.methods}
    assert found.split_by == "vehicle"
    assert score["uninformative"].direction.mean == pytest.approx(0.159, abs=2e-4)
    assert score["uninformative"].direction.mean_log.half_width == pytest.approx(0.0, abs=1e-9)
    assert np.isfinite(score["uninformative"].speed.mean_log.value)  # the range it knows is that of all rows
    without = score["without the map"]
    for name in ("primitive, flat", "primitive, the paper's", "DGM", "GP"):
        assert score[name].direction.mean_log.low > without.direction.mean_log.high + 1.0
    assert score["primitive, flat"].joint.mean_log.low > without.joint.mean_log.high + 1.0
    assert without.joint.behind.low > 1.0
    assert without.joint.behind.n_clusters == 40
    settings = {row.name: row.settings for row in found.methods if row.settings}
    assert set(settings) == {"DGM", "GP"}
    for of_folds in settings.values():
        assert len(of_folds) == 2
        assert all(choice.low < choice.chosen < choice.high for fold in of_folds for choice in fold)
    words, (value, low, high, _) = conclusion(found), without.joint.behind
    assert words.startswith(f"the map gives held-out motion {value:+.2f} nat ({low:.2f} to {high:.2f}) over the same")
    rival = max((score[of] for of in settings), key=lambda row: row.direction.mean_log.value)
    assert f"in direction alone {rival.direction.behind.value:+.2f} nat" in words
    assert f"the best rival, {rival.name}" in words
    assert words.endswith("(95 % over vehicles)")
    unsure = replace(without, joint=replace(without.joint, behind=Interval(0.1, -0.1, 0.3, 40)))
    assert "+0.10 nat (-0.10 to 0.30, not distinguishable)" in conclusion(replace(found, methods=(unsure,)))


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
    methods = [method for method in all_methods(max_speed=50.0) if method.name in ("primitive, flat", "uninformative")]
    primitive, nothing = evaluate_density(tracks, n_folds=2, methods=methods, rng=rng).methods
    assert primitive.direction.mean_log.value < nothing.direction.mean_log.value + 0.01


RADIUS, SPEED = 20.0, 8.0


def on_ring(angle, *, radius=RADIUS, speed=SPEED):
    angle = np.atleast_1d(angle)
    place = radius * np.column_stack([np.cos(angle), np.sin(angle)])
    return States(place, angle + np.pi / 2, np.full(angle.size, speed))


def drawn(memory, start, time_s, *, n_samples=200, but=None):
    return memory.sample(start, time_s=np.array(time_s), n_samples=n_samples, but=but, rng=np.random.default_rng(0))


@pytest.fixture(scope="module")
def memory():
    return TrajectoryMemory.of(ring_traffic(np.random.default_rng(0), n_vehicles=40))


def test_on_a_ring_it_goes_along_the_ring_and_off_it_straight_on(memory):
    path = drawn(memory, on_ring([0.3, 2.0]), (1.0, 3.0))
    radius = np.linalg.norm(path, axis=-1)
    angle = np.arctan2(path[..., 1], path[..., 0]) - np.array([0.3, 2.0])[:, None, None]
    assert np.median(np.abs(radius - RADIUS)) < 1.0
    np.testing.assert_allclose(np.median(angle % (2 * np.pi), axis=1), [[0.4, 1.2]] * 2, rtol=0.1)
    beside = States(np.array([[200.0, 0.0]]), np.array([0.0]), np.array([SPEED]))  # the control: no vehicle was there
    assert drawn(memory, on_ring([]), (3.0,)).shape == (0, 200, 1, 2)
    unfamiliar = drawn(memory, beside, (3.0,))
    bend = np.linalg.norm(unfamiliar - [200.0, 0.0], axis=-1)
    assert np.median(np.abs(np.linalg.norm(unfamiliar, axis=-1) - RADIUS)) > 100.0
    assert (bend < 1.7 * 3.0 * SPEED).all()


def test_a_vehicle_never_follows_itself():
    alone = ring_traffic(np.random.default_rng(0), n_vehicles=1)
    memory = TrajectoryMemory.of(alone)
    start = States(alone.position[:1], alone.direction[:1], alone.speed[:1])
    radius = {but: np.linalg.norm(drawn(memory, start, (3.0,), but=np.array([but])), axis=-1) for but in (-1, 0)}
    own = np.linalg.norm(alone.position[0])
    assert np.median(np.abs(radius[-1] - own)) < 1.0
    assert (radius[0] > own + 5.0).all()  # straight on: there is no other


def test_of_tracks_of_one_row_there_is_nothing_to_remember_and_all_go_straight_on():
    lone = tracks_of(np.zeros((3, 1, 2)))
    memory = TrajectoryMemory.of(lone)
    memory, found = memory.chosen(Cases.of(lone, horizons_s=(2.0,)), (2.0,), rng=np.random.default_rng(0))
    assert not found
    path = drawn(memory, States(np.zeros((1, 2)), np.zeros(1), np.full(1, 10.0)), (2.0,))
    np.testing.assert_allclose(path[0, :, 0], np.tile([20.0, 0.0], (200, 1)), atol=1.0)
