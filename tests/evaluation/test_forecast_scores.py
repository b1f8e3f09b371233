"""Scores of forecasts: proper, by known laws, and the same cases for every method."""

import numpy as np
import pytest
from scipy import stats

from dirprim_filter.evaluation import _kernels
from dirprim_filter.evaluation.forecast_cases import Cases
from dirprim_filter.evaluation.forecast_methods import by_constant_velocity, by_trajectory_memory
from dirprim_filter.evaluation.forecasting import SCORES, evaluate_forecasts, score_cases, standard_error
from dirprim_filter.tracks import Tracks
from situations import ring_traffic

HORIZONS = (0.5, 1.0, 2.0)


def score_of(name, scores):
    return scores[..., SCORES.index(name)]


def scored(samples, truth):
    """(n, S, 2), (n, 2) -> (n, 7) at one horizon."""
    return score_cases(samples[:, :, None], truth[:, None])[:, 0]


def test_energy_score_is_that_of_a_slow_loop_and_without_bias():
    rng = np.random.default_rng(0)
    samples, truth = rng.normal(size=(5, 30, 2)), rng.normal(size=(5, 2))
    near = np.linalg.norm(samples - truth[:, None], axis=-1).mean(axis=1)
    apart = np.linalg.norm(samples[:, :, None] - samples[:, None], axis=-1).sum(axis=(1, 2)) / (30 * 29)
    np.testing.assert_allclose(score_of("energy", scored(samples, truth)), near - 0.5 * apart, rtol=1e-12)


def test_the_right_spread_has_the_best_energy_and_likelihood_and_covers_as_it_says():
    rng = np.random.default_rng(1)
    n, truth = 600, rng.normal(size=(600, 2))
    mean = {s: scored(s * rng.normal(size=(n, 100, 2)), truth).mean(axis=0) for s in (0.4, 1.0, 2.5)}
    for worse in (0.4, 2.5):
        assert score_of("energy", mean[1.0]) < score_of("energy", mean[worse])
        assert score_of("nll", mean[1.0]) < score_of("nll", mean[worse])
    entropy = 1.0 + np.log(2 * np.pi)
    assert score_of("nll", mean[1.0]) == pytest.approx(entropy, abs=0.15)
    bound = 5 * np.sqrt(0.25 / n)
    assert score_of("coverage_50", mean[1.0]) == pytest.approx(0.5, abs=bound)
    assert score_of("coverage_90", mean[1.0]) == pytest.approx(0.9, abs=bound)
    assert score_of("coverage_90", mean[0.4]) < 0.6
    assert score_of("coverage_90", mean[2.5]) > 0.98


def test_density_is_scipys_kernel_estimate_where_the_least_bandwidth_is_nothing():
    rng = np.random.default_rng(2)
    samples, truth = 100.0 * rng.normal(size=(1, 50, 2)) @ [[1.0, 0.3], [0.0, 2.0]], np.array([[50.0, -30.0]])
    out = np.empty((1, 3))
    _kernels.score_samples(samples, truth, out)
    narrow = stats.gaussian_kde(samples[0].T).pdf(truth[0])[0]
    wide = stats.multivariate_normal(truth[0], _kernels.ASTRAY_M**2).pdf(samples[0]).mean()
    assert out[0, 1] == pytest.approx(-np.log((1 - _kernels.ASTRAY) * narrow + _kernels.ASTRAY * wide), abs=1e-3)


def test_who_is_sure_of_one_point_and_wrong_loses_but_not_without_bound():
    samples, out = np.zeros((2, 50, 2)), np.empty((2, 3))
    _kernels.score_samples(samples, np.array([[0.0, 0.0], [5.0, 0.0]]), out)
    assert out[0, 1] == pytest.approx(np.log(2 * np.pi * _kernels.MIN_BANDWIDTH_M**2), abs=0.02)
    assert 10.0 < out[1, 1] < 15.0
    _kernels.score_samples(samples, np.array([[1e9, 0.0]]), out)
    assert np.isfinite(out).all()


def test_best_of_20_is_the_nearest_of_the_first_20_where_there_are_no_more():
    rng = np.random.default_rng(3)
    samples, truth = rng.normal(size=(4, 20, 2)), rng.normal(size=(4, 2))
    nearest = np.linalg.norm(samples - truth[:, None], axis=-1).min(axis=1)
    np.testing.assert_allclose(score_of("best_of_20", scored(samples, truth)), nearest)


def test_ade_is_the_mean_over_the_horizons_so_far_and_unknown_truths_are_left_out():
    samples, later = np.zeros((2, 20, 3, 2)), np.zeros((2, 3, 2))
    later[:, :, 0] = [1.0, 2.0, 6.0]
    later[1, 2] = np.nan
    scores = score_cases(samples + 1e-3 * np.random.default_rng(0).normal(size=samples.shape), later)
    np.testing.assert_allclose(score_of("ade", scores)[0], [1.0, 1.5, 3.0], atol=0.01)
    np.testing.assert_allclose(score_of("fde", scores)[0], [1.0, 2.0, 6.0], atol=0.01)
    assert np.isnan(scores[1, 2]).all()
    assert np.isfinite(scores[1, :2]).all()


def test_cases_are_where_the_vehicle_was_later():
    ring = ring_traffic(np.random.default_rng(0), n_vehicles=3)
    cases = Cases.of(ring, horizons_s=HORIZONS)
    assert set(cases.vehicle) == {0, 1, 2}
    for i in range(len(cases.vehicle)):
        own = ring[ring.track_id == cases.vehicle[i]]
        at = np.flatnonzero((own.position == cases.position[i]).all(axis=1))[0]
        for h, horizon in enumerate(HORIZONS):
            if at + round(horizon / 0.1) < len(own):
                np.testing.assert_allclose(cases.later[i, h], own.position[at + round(horizon / 0.1)], atol=1e-9)
            else:
                assert np.isnan(cases.later[i, h]).all()


def test_across_a_hole_in_the_log_nobody_knows_where_the_vehicle_was():
    ring = ring_traffic(np.random.default_rng(0), n_vehicles=1)
    holed = ring[(ring.time_ns < 2_000_000_000) | (ring.time_ns > 4_000_000_000)]
    later = Cases.of(holed, horizons_s=(1.0,)).later[:, 0]
    assert np.isnan(later[1]).all()  # from 1 s on
    assert np.isfinite(later[0]).all()


def test_constant_velocity_is_as_wide_as_the_training_vehicles_err():
    rng = np.random.default_rng(0)
    ring = ring_traffic(rng, n_vehicles=200, n_rows=30)
    sample = by_constant_velocity(ring, HORIZONS, rng)["constant velocity"]
    cases = Cases.of(ring, horizons_s=HORIZONS)
    off = sample(cases, 200, rng) - cases.later[:, None]
    seen = np.isfinite(off[:, 0, :, 0])
    for h in range(3):
        rows = seen[:, h]
        error = cases.later[rows, h] - cases.position[rows]
        error -= (
            cases.speed[rows, None]
            * HORIZONS[h]
            * np.column_stack([np.cos(cases.direction[rows]), np.sin(cases.direction[rows])])
        )
        assert np.sqrt((off[rows, :, h] ** 2).mean()) == pytest.approx(np.sqrt(2 * (error**2).mean()), rel=0.1)


def test_on_a_ring_the_prior_beats_constant_velocity_on_the_same_cases():
    ring = ring_traffic(np.random.default_rng(0), n_vehicles=24)
    table = evaluate_forecasts(ring, horizons_s=HORIZONS, n_folds=2, rng=np.random.default_rng(0))
    names = ["prior", "place-free", "one cell", "trajectory memory", "constant velocity"]
    assert [row.name for row in table.methods] == names
    assert len({tuple(score.n_cases for score in row.horizons) for row in table.methods}) == 1
    assert max(table.relative_energy("prior", "constant velocity")) < 0.5
    assert max(table.relative_energy("trajectory memory", "constant velocity")) < 0.5
    assert min(table.relative_energy("one cell", "prior")[1:]) > 1.5  # the control: one cell knows no ring
    assert table.relative_energy("prior", "prior") == (1.0, 1.0, 1.0)
    assert all(0 < score.energy_se < score.energy for row in table.methods for score in row.horizons)
    assert table.n_vehicles == 24


def test_the_same_seed_scores_the_same():
    ring = ring_traffic(np.random.default_rng(0), n_vehicles=24)
    one, again = (
        evaluate_forecasts(
            ring, horizons_s=HORIZONS, n_folds=2, methods=(by_trajectory_memory, by_constant_velocity),
            rng=np.random.default_rng(0),
        )
        for _ in range(2)
    )  # fmt: skip
    assert [row.horizons[0].energy for row in one.methods] == [row.horizons[0].energy for row in again.methods]


@pytest.mark.parametrize(
    ("knobs", "message"),
    [
        ({"horizons_s": (1.0, 1.0)}, "ascending"),
        ({"horizons_s": ()}, "ascending"),
        ({"horizons_s": (-1.0,)}, "ascending"),
        ({"n_samples": 19}, "at least 20"),
        ({"n_seeds": 0}, "at least 20 and 1"),
        ({"horizons_s": (100.0,)}, "held-out forecasts 100 s ahead"),
        ({"n_folds": 1}, "n_folds"),
    ],
)
def test_what_cannot_be_evaluated_is_refused(knobs, message):
    ring = ring_traffic(np.random.default_rng(0), n_vehicles=4, n_rows=30)
    with pytest.raises(ValueError, match=message):
        evaluate_forecasts(ring, **{"methods": (by_constant_velocity,)} | knobs, rng=np.random.default_rng(0))


def test_the_standard_error_is_that_of_the_mean_over_independent_vehicles():
    """In 400 experiments of 60 vehicles whose forecasts err together; the share of plain errors is far too small."""
    rng = np.random.default_rng(5)
    reported, plain, mean = [], [], []
    for _ in range(400):
        n_cases = rng.integers(1, 9, 60)
        vehicle = np.repeat(np.arange(60), n_cases)
        values = rng.normal(size=60)[vehicle] + 0.3 * rng.normal(size=vehicle.size)
        reported.append(standard_error([values], [vehicle]))
        plain.append(standard_error([values], [np.arange(vehicle.size)]))
        mean.append(values.mean())
    assert np.mean(reported) == pytest.approx(np.std(mean), rel=0.15)
    assert np.mean(plain) < 0.6 * np.std(mean)
    np.testing.assert_allclose(plain[-1], values.std(ddof=1) / np.sqrt(values.size))


def test_a_vehicle_that_is_forecast_in_two_seeds_is_still_one():
    rng = np.random.default_rng(6)
    values, vehicle = rng.normal(size=90), np.repeat(np.arange(30), 3)
    once = standard_error([values], [vehicle])
    shuffled = rng.permutation(90)
    assert standard_error([values, values[shuffled]], [vehicle, vehicle[shuffled]]) == pytest.approx(once)
    assert standard_error([values, values], [vehicle, vehicle + 30]) < 0.8 * once
    assert np.isnan(standard_error([values], [np.zeros(90)]))


def test_cases_are_of_vehicles_not_of_ids_and_named_alike_in_every_part():
    ring = ring_traffic(np.random.default_rng(0), n_vehicles=4, n_rows=30)
    twice = Tracks(
        **{name: np.concatenate([getattr(ring, name)] * 2) for name in ("track_id", "time_ns", "position", "direction",
                                                                       "speed")},
        group=np.repeat([0, 1], len(ring)),
    )  # fmt: skip
    cases = Cases.of(twice, horizons_s=HORIZONS)
    assert np.unique(cases.vehicle).tolist() == list(range(8))
    assert len(set(cases.name.tolist())) == 8
    part = Cases.of(twice[twice.group == 1], horizons_s=HORIZONS)
    assert set(part.name.tolist()) == set(cases.name[cases.group == 1].tolist())


def test_vehicles_of_one_row_have_no_case():
    lone = Tracks(
        track_id=np.arange(3), time_ns=np.zeros(3, np.int64), position=np.zeros((3, 2)), direction=np.zeros(3),
        speed=np.ones(3),
    )  # fmt: skip
    assert Cases.of(lone, horizons_s=HORIZONS).speed.size == 0
