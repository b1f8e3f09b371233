"""Scores of forecasts: proper, by known laws, and the same cases, seen by no later row, for every method."""

from dataclasses import replace

import numpy as np
import pytest
from scipy import stats

from dirprim_filter.course import motion_of
from dirprim_filter.evaluation import belief_forecasts, forecasting
from dirprim_filter.evaluation.forecast_cases import SCORES, Cases, score_cases, seen_so_far
from dirprim_filter.evaluation.forecasting import METHODS, Forecaster, by_constant_velocity, evaluate_forecasts
from dirprim_filter.primitives.learning import learn_primitives
from situations import ring_traffic, tracks_of

HORIZONS = (0.5, 1.0, 2.0)


def ring_of(n_vehicles, **options):
    return ring_traffic(np.random.default_rng(0), n_vehicles=n_vehicles, **options)


def score_of(name, scores):
    return scores[..., SCORES.index(name)]


def scored(samples, truth):
    """(n, S, 2), (n, 2) -> (n, 5) at one horizon."""
    return score_cases(samples[:, :, None], truth[:, None])[:, 0]


def test_energy_and_regions_are_those_of_slow_loops():
    rng = np.random.default_rng(3)
    samples, truth = rng.normal(size=(40, 30, 2)), 1.5 * rng.normal(size=(40, 2))
    near = np.linalg.norm(samples - truth[:, None], axis=-1).mean(axis=1)
    apart = np.linalg.norm(samples[:, :, None] - samples[:, None], axis=-1).sum(axis=(1, 2)) / (30 * 29)
    np.testing.assert_allclose(score_of("energy", scored(samples, truth)), near - 0.5 * apart, rtol=1e-12)
    points = np.concatenate([samples, truth[:, None]], axis=1)
    apart = np.sort(np.linalg.norm(points[:, :, None] - points[:, None], axis=-1), axis=2)[:, :, 5]
    rank = (apart[:, :-1] < apart[:, -1:]).mean(axis=1)
    for name, share in (("coverage_50", 0.5), ("coverage_90", 0.9)):
        assert 0 < (rank < share).sum() < 40
        np.testing.assert_array_equal(score_of(name, scored(samples, truth)), rank < share)


def test_regions_are_where_samples_are_dense_and_hold_their_share_of_any_distribution():
    """A fork: two narrow arms far apart. Counts in 400 cases are binomial, 5 deviations: 1 false alarm in 10^6."""
    rng = np.random.default_rng(2)

    def fork(*shape):
        arm = rng.choice([-10.0, 10.0], size=shape)
        return np.stack([arm, np.zeros(shape)], axis=-1) + rng.normal(size=(*shape, 2)) * [0.1, 3.0]

    samples = fork(400, 50)
    drawn = scored(samples, fork(400))
    for name, share in (("coverage_50", 25 / 51), ("coverage_90", 45 / 51)):  # one in 51 ranks each
        n_inside = int(score_of(name, drawn).sum())
        assert 1e-6 < stats.binom.cdf(n_inside, 400, share) < 1 - 1e-6
    between = scored(samples, np.zeros((400, 2)))  # the mean of the samples, where none is
    assert score_of("coverage_90", between).sum() == 0


def test_cases_are_where_the_vehicle_was_later():
    ring = ring_of(3)
    cases = Cases.of(ring, horizons_s=HORIZONS)
    assert set(cases.vehicle) == {0, 1, 2}
    for i in range(len(cases.vehicle)):
        own = ring[ring.track_id == cases.vehicle[i]]
        at = np.flatnonzero((own.position == cases.position[i]).all(axis=1))[0]
        for h, horizon in enumerate(HORIZONS):
            then = at + round(horizon / 0.1)
            expected = own.position[then] if then < len(own) else [np.nan, np.nan]
            np.testing.assert_allclose(cases.later[i, h], expected, atol=1e-9)


def test_a_vehicle_is_forecast_alike_whichever_others_are_forecast_with_it(monkeypatch):
    """However many are tracked together, and whenever they came. The control: by another seed it is not."""
    monkeypatch.setattr(belief_forecasts, "AT_ONCE", 2)
    log = ring_of(6, n_rows=60)
    log = replace(log, time_ns=log.time_ns + 10**9 * log.vehicle)
    learned, cases = learn_primitives(log, rng=np.random.default_rng(1)), Cases.of(log, horizons_s=(1.0, 2.0))
    own = cases.vehicle == 2
    assert 0 < own.sum() < own.size
    sample = forecasting.rollouts_of(learned, (1.0, 2.0))
    together, alone = (sample(of, 20, np.random.default_rng(2)) for of in (cases, cases.some(own)))
    np.testing.assert_array_equal(together[own], alone)
    assert (sample(cases.some(own), 20, np.random.default_rng(3)) != alone).all()


@pytest.mark.parametrize("dt_s", [0.1, 0.5, 1.0])
def test_what_comes_after_an_instant_changes_no_start(dt_s):
    """Neither of the vehicle nor of those around it; the control: central differences do change."""
    log = ring_of(6, n_rows=60, dt_s=dt_s)
    until = int(30 * dt_s * 1e9)
    is_later = log.time_ns > until
    rng = np.random.default_rng(1)
    other = replace(
        log, position=np.where(is_later[:, None], rng.normal(size=(len(log), 2)), log.position),
        direction=np.where(is_later, rng.uniform(-3, 3, len(log)), log.direction),
        speed=np.where(is_later, 50.0, log.speed),
    )  # fmt: skip
    now, then = (Cases.of(tracks[tracks.track_id < 3], horizons_s=(1.0,), among=tracks) for tracks in (log, other))
    early = np.flatnonzero(log.time_ns[now.row] <= until)
    assert 8 < early.size < now.speed.size
    np.testing.assert_array_equal(now.row, then.row)
    for column in ("position", "direction", "speed"):
        np.testing.assert_array_equal(getattr(now, column)[early], getattr(then, column)[early])
    learned = learn_primitives(log, tessellation="grid", cell_size=10.0, rng=rng)
    for leaders in (False, True):
        sample = forecasting.rollouts_of(learned, (1.0, 2.0), leaders=leaders)
        mine, theirs = (sample(cases, 20, np.random.default_rng(2)) for cases in (now, then))
        np.testing.assert_array_equal(mine[early], theirs[early])
        assert (mine != theirs).any()
    central, changed = (motion_of(t.vehicle, t.time_ns, t.position) for t in (log, other))
    assert (central.speed != changed.speed)[log.time_ns == until].all()


def test_starts_are_exact_on_arcs_of_rows_far_apart_and_at_most_an_eighth_of_a_second_old_else():
    for dt_s, old_s in ((0.5, 0.0), (1.0, 0.0), (0.1, 0.1), (0.25, 0.125), (0.04, 0.12)):
        ring = ring_of(5, dt_s=dt_s)
        seen, is_known = seen_so_far(ring)
        rate = ring.speed / np.linalg.norm(ring.position, axis=1)
        off = (ring.direction - seen.direction + np.pi) % (2 * np.pi) - np.pi
        np.testing.assert_allclose(off[is_known], old_s * rate[is_known], atol=1e-6)
        np.testing.assert_allclose(seen.speed[is_known], ring.speed[is_known], rtol=0.02)
        assert ring.time_ns[~is_known].max() == pytest.approx(dt_s * 1e9 if dt_s > 0.25 else 0.24e9, abs=0.24e9)


def test_who_brakes_at_rows_far_apart_is_as_slow_as_it_is_now_and_who_stands_keeps_its_course():
    time_s = np.arange(12) * 0.5
    along = np.where(time_s < 3.0, 9.0 * time_s - 1.5 * time_s**2, 13.5)
    way = np.column_stack([0 * along, along])
    braking = tracks_of([way], time_ns=(time_s * 1e9).astype(np.int64), speed=0.0, heading=1.0)
    seen, is_known = seen_so_far(braking)
    np.testing.assert_allclose(seen.speed[is_known], np.maximum(9.0 - 3.0 * time_s, 0.0)[2:], atol=1e-9)
    np.testing.assert_allclose(seen.direction[is_known], np.pi / 2)
    waiting = replace(braking, position=np.zeros((12, 2)))
    np.testing.assert_array_equal(seen_so_far(waiting)[0].direction, 1.0)


def test_between_two_rows_the_place_is_known_at_a_sensors_usual_interval_and_across_no_longer_hole():
    often, seldom = ring_of(1), ring_of(3, dt_s=3.0, n_rows=40)
    holed = often[(often.time_ns < 2_000_000_000) | (often.time_ns > 4_000_000_000)]
    later = Cases.of(holed, horizons_s=(1.0,)).later[:2, 0]  # of 0 s and of 1 s
    np.testing.assert_array_equal(np.isfinite(later), [[True, True], [False, False]])
    assert np.isfinite(Cases.of(seldom, horizons_s=(5.0,)).later).all()
    holed = seldom[(seldom.time_ns < 40_000_000_000) | (seldom.time_ns > 80_000_000_000)]
    assert np.isnan(Cases.of(holed, horizons_s=(20.0,)).later).any()


def test_constant_velocity_is_as_wide_as_the_training_vehicles_err():
    rng = np.random.default_rng(0)
    ring = ring_traffic(rng, n_vehicles=200, n_rows=30)
    sample = by_constant_velocity(ring, HORIZONS, rng)["constant velocity"].sample
    cases = Cases.of(ring, horizons_s=HORIZONS)
    off = sample(cases, 200, rng) - cases.later[:, None]
    seen = np.isfinite(off[:, 0, :, 0])
    for h in range(3):
        rows = seen[:, h]
        heading = np.column_stack([np.cos(cases.direction[rows]), np.sin(cases.direction[rows])])
        error = cases.later[rows, h] - cases.position[rows] - cases.speed[rows, None] * HORIZONS[h] * heading
        assert np.sqrt((off[rows, :, h] ** 2).mean()) == pytest.approx(np.sqrt(2 * (error**2).mean()), rel=0.1)


def test_on_a_ring_the_prior_beats_constant_velocity_on_the_same_cases():
    ring = ring_of(12, n_rows=40, dt_s=0.25)
    table = evaluate_forecasts(ring, horizons_s=HORIZONS, n_folds=2, n_samples=40, rng=np.random.default_rng(0))
    rows = {row.name: row.horizons for row in table.methods}
    assert list(rows) == ["prior", "place-free", "prior, leaders", "one cell", "trajectory memory", "constant velocity"]
    assert len({tuple(score.n_cases for score in scores) for scores in rows.values()}) == 1
    assert all(score.gain.low > 0.5 for score in rows["constant velocity"])
    assert all(score.gain.low > 0.3 for score in rows["one cell"][1:])  # the control: one cell knows no ring
    assert [score.gain[:3] for score in rows["prior"]] == [(0.0, 0.0, 0.0)] * 3
    assert {score.gain.n_clusters for scores in rows.values() for score in scores} == {12}
    assert table.n_vehicles == 12
    settings = {row.name: row.settings for row in table.methods}
    searched = {key: ["noise_m"] for key in ("prior", "place-free", "prior, leaders", "one cell")}
    for name, names in (searched | {"trajectory memory": ["nearness", "strength"]}).items():
        assert len(settings[name]) == 2  # one for each fold, none of them on a bound of what was searched
        for fold in settings[name]:
            assert [found.name for found in fold] == names
            assert all(found.low < found.chosen < found.high for found in fold)


def shifted(name, metres):
    """A method whose samples lie so far from the truth at every horizon, (n,) by vehicle."""

    def sample(cases, n_samples, rng):
        off = np.zeros((cases.speed.size, n_samples, *cases.later.shape[1:]))
        off[..., 0] = metres[cases.vehicle][:, None, None]
        return np.nan_to_num(cases.later)[:, None] + off

    return lambda _train, _horizons_s, _rng: {name: Forecaster(sample)}


def test_the_gain_is_paired_over_vehicles():
    """Of point forecasts the energy is the distance: 1 and 2 % less with vehicles a hundredfold apart in difficulty."""
    ring = ring_of(24)
    metres = np.geomspace(0.1, 10.0, 24)
    less = np.random.default_rng(1).permutation(np.repeat([0.99, 0.98], 12))
    methods = (shifted("a", metres * less), shifted("b", metres))
    table = evaluate_forecasts(ring, horizons_s=(1.0,), n_folds=2, methods=methods, rng=np.random.default_rng(0))
    score = table.methods[1].horizons[0]
    assert score.energy == pytest.approx(metres.mean())
    assert score.gain.value == pytest.approx(1.0 - (metres * less).sum() / metres.sum())
    assert 0.0 < score.gain.half_width < 0.01
    assert (score.gain.n_clusters, score.n_cases, table.n_vehicles) == (24, 192, 24)


@pytest.mark.parametrize(
    ("given", "message"),
    [
        ({"horizons_s": (1.0, 1.0)}, "ascending"),
        ({"horizons_s": ()}, "ascending"),
        ({"horizons_s": (-1.0,)}, "ascending"),
        ({"n_samples": 19}, "at least 20"),
        ({"horizons_s": (100.0,)}, "held-out forecasts 100 s ahead"),
        ({"horizons_s": (100.0,), "methods": METHODS}, "held-out forecasts 100 s ahead"),
        ({"n_folds": 1}, "n_folds"),
    ],
)
def test_what_cannot_be_evaluated_is_refused(given, message):
    ring = ring_of(4, n_rows=30)
    with pytest.raises(ValueError, match=message):
        evaluate_forecasts(ring, **{"methods": (by_constant_velocity,)} | given, rng=np.random.default_rng(0))
