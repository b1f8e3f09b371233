"""The fit of one cell: that it climbs, counts modes rightly, and that modes bend where traffic does."""

import os
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy import stats
from scipy.special import gammaln, i0e, logsumexp

from dirprim_filter import learn_primitives
from dirprim_filter.config import LearningConfig
from dirprim_filter.distributions.angles import difference, wrap
from dirprim_filter.distributions.modes import dbscan
from dirprim_filter.distributions.von_mises import mean_resultant_length
from dirprim_filter.primitives._kernels import ON_CIRCLE, ascend, sort_around, start_evenly
from dirprim_filter.primitives._modes import N_CURVED, WEIGHT, Modes
from dirprim_filter.primitives.fitting import bounds_of, fit_all
from situations import one_cell, one_cell_map, ring_traffic, simulated

# The mixture of the paper's Fig. 2; all modes at one distribution of speed, which says nothing of the mode.
FIG_2 = np.array([[1 / 3, np.deg2rad(course), 20.0, 20.0, 10.0] for course in (-45, 0, 45)])


def log_density(modes, rows):
    """Of each row under one cell's modes, by scipy."""
    used = modes.weight > 0
    weight, mean, k, shape, rate, bend, gain = (column[used] for column in modes)
    cosine, sine, speed, _, _, *place = rows.columns
    turned, gained = (np.stack(place, axis=1) @ slope.T for slope in (bend, gain))
    log_p = stats.vonmises.logpdf(np.arctan2(sine, cosine)[:, None] - turned, k, loc=mean)
    log_p = log_p + stats.gamma.logpdf(speed[:, None], shape, scale=np.exp(gained) / rate)
    return logsumexp(log_p + np.log(weight), axis=1)


def objective(modes, rows, bounds):
    """Log likelihood, scaled to vehicles, and log prior: 0 for uniform directions and the usual spread of speed."""
    weight = rows.columns[WEIGHT]
    likelihood = weight @ log_density(modes, rows) / weight.sum() * rows.n_vehicles[0]
    used = modes.weight > 0
    k, a = modes.concentration[used], modes.shape[used]

    def usual(shape):
        return shape * np.log(shape) - gammaln(shape) - shape * (1 + bounds.speed_spread)

    prior = bounds.prior_strength * (-(np.log(i0e(k)) + k) + usual(a) - usual(np.geomspace(1, 1e4, 20_001)).max())
    for scale, slopes in ((bounds.bend_scale, modes.bend), (bounds.gain_scale, modes.gain)):
        prior = prior - (slopes[used] ** 2).sum(axis=1) / (2 * scale**2)
    return likelihood + prior.sum()


def climbed(rows, bounds, k, *, curved, most, table=None):
    """Modes after some iterations from even quantiles, or from where a table stands, and the objective reported."""
    columns, n = rows.columns, int(rows.start[1])
    if table is None:
        filled, table = np.empty((3, ON_CIRCLE)), np.zeros((k, N_CURVED))
        start_evenly(filled, *sort_around(columns, 0, n, filled), bounds, table)
    bounds = bounds._replace(max_iterations=most)
    reached = ascend(columns, 0, n, float(rows.n_vehicles[0]), curved, -np.inf, 0.0, bounds, table)
    return table, reached


@settings(max_examples=25, deadline=None, derandomize=True)
@given(
    seed=st.integers(0, 10**6),
    n=st.integers(1, 60),
    k=st.integers(1, 4),
    prior=st.sampled_from([2e-4, 0.02, 2.0]),
    vehicles=st.sampled_from([1.0, 0.2]),
    curved=st.booleans(),
    low=st.sampled_from([-5.0, 1.0]),
    sharp=st.booleans(),
)
def test_the_objective_never_falls_and_is_the_one_reported(*, seed, n, k, prior, vehicles, curved, low, sharp):
    rng = np.random.default_rng(seed)
    truth = np.column_stack([
        np.full(3, 1 / 3), rng.uniform(-np.pi, np.pi, 3), 10.0 ** rng.uniform(0, 4 if sharp else 2, 3),
        10.0 ** rng.uniform(0, 3, 3), rng.uniform(1, 20, 3),
    ])  # fmt: skip
    direction, speed = simulated(truth, n, seed)
    place = rng.uniform(low, 5.0, (n, 2))
    direction = wrap(direction + place @ rng.normal(0, 0.1, 2))
    speed = speed * np.exp(place @ rng.normal(0, 0.05, 2))
    weight = rng.choice([0.0, 0.5, 1.0, 3.0], n) if n > 1 else np.ones(1)
    weight[0] = 1.0
    rows = one_cell(direction, speed, weight=weight, n_vehicles=n * vehicles, position=place)
    bounds = bounds_of(LearningConfig(), prior_strength=prior, speed_spread=0.2, curved=curved)
    flat, _ = climbed(rows, bounds, k, curved=False, most=8)
    trace, driven = [], []
    for most in (1, 2, 3, 4, 5, 6, 8, 10, 13, 20, 40):
        table, reached = climbed(rows, bounds, k, curved=curved, most=most, table=flat.copy())
        modes = Modes.of(table)
        assert modes.weight.sum() == pytest.approx(1.0)
        assert reached == pytest.approx(objective(modes, rows, bounds), rel=1e-6, abs=1e-6 * n)
        trace.append(reached)
        driven.append((modes.weight > 0).sum())
    steps = np.diff(trace)[np.diff(driven) == 0]  # a mode that no vehicle drives takes its prior with it
    assert (steps >= -1e-9 * max(n, np.abs(trace).max())).all()


def test_it_has_something_to_climb_and_arrives_where_plain_steps_do_not():
    rows = one_cell(*simulated(FIG_2, 500, 0), n_vehicles=500)
    bounds = bounds_of(LearningConfig(), prior_strength=0.02, speed_spread=0.05)
    trace = [climbed(rows, bounds, 3, curved=False, most=most)[1] for most in (1, 5, 30, 200)]
    assert trace[1] > trace[0] + 3
    assert trace[3] - trace[2] < 1e-3


def fitted(direction, speed, weight=None, *, prior_strength=0.02):
    """The modes of one cell, flat, as many as BIC prefers."""
    rows = one_cell(direction, speed, weight=weight, n_vehicles=speed.size if weight is None else weight.sum())
    spread = max(np.log(np.average(speed, weights=weight)) - np.average(np.log(speed), weights=weight), 1e-3)
    bounds = bounds_of(LearningConfig(), prior_strength=prior_strength, speed_spread=spread)
    return Modes.of(fit_all(rows, bounds)[0])


def test_bic_counts_the_three_modes_of_fig_2_in_99_of_100_draws():
    """Where BIC's chance to fail is a third of a hundredth, less than one seed in a hundred would make this fail."""

    def count(truth, seeds):
        return np.array([(fitted(*simulated(truth, 500, seed)).weight > 0).sum() for seed in range(seeds)])

    assert (count(FIG_2, 100) == 3).sum() >= 99
    assert count(FIG_2[:1] / [1 / 3, 1, 1, 1, 1], 20).max() == 1  # it does not find three everywhere
    clusters = [dbscan(simulated(FIG_2, 500, seed)[0], eps=0.2, min_samples=25).max() + 1 for seed in range(100)]
    assert np.mean(np.array(clusters) == 3) < 0.5  # which is why


def test_a_large_cell_is_fitted_to_some_of_its_rows_and_loses_less_than_chance_allows():
    """Some 17 parameters from 12,500 rows instead of 50,000: half as many over the rows, 7e-4 nat, are expected."""
    direction, speed = simulated(FIG_2, 50_000, 1)
    modes, rows = fitted(direction, speed), one_cell(direction, speed, n_vehicles=50_000)
    *direct, shape, speed = FIG_2.T
    assert (modes.weight > 0).sum() == 3
    assert log_density(modes, rows).mean() > log_density(Modes.flat(*direct, shape, shape / speed), rows).mean() - 3e-3


def test_a_row_of_weight_three_is_three_rows_and_one_of_weight_zero_none():
    direction, speed = simulated(FIG_2, 300, 5)
    weight = np.random.default_rng(6).integers(0, 4, 300)
    one = fitted(direction, speed, weight.astype(float))
    other = fitted(np.repeat(direction, weight), np.repeat(speed, weight))
    for mine, theirs in zip(one, other, strict=True):
        np.testing.assert_allclose(mine, theirs, rtol=1e-3, atol=1e-4)


@pytest.mark.parametrize("at_once", [True, False])
def test_any_number_of_threads_fits_the_identical_modes(at_once, monkeypatch):
    rng = np.random.default_rng(7)
    n_cells, n = 50, 4000
    direction, speed = simulated(FIG_2, n, 8)
    start = np.concatenate([[0], np.sort(rng.integers(0, n, n_cells - 1)), [n]])
    rows = one_cell(direction, speed, n_vehicles=n)._replace(start=start, n_vehicles=np.diff(start).astype(float))
    bounds = bounds_of(LearningConfig(), prior_strength=0.02, speed_spread=0.05, curved=at_once)
    bounds, found = bounds._replace(with_speed=at_once), []
    for n_threads in (1, 2, 5):
        monkeypatch.setattr(os, "cpu_count", lambda n=n_threads: n)
        found.append(fit_all(rows, bounds))
    for other in found[1:]:
        np.testing.assert_array_equal(found[0], other)
    assert (Modes.of(found[0]).weight[np.diff(start) == 0] == 0).all()


SIDE = 10.0  # metres, of the one cell
# weight, mean direction, concentration, shape, mean speed, bend east and north, gain east and north
BENT = np.array([
    [0.6, 3.1, 60.0, 40.0, 12.0, 0.05, -0.08, 0.03, 0.02],  # across the wrap
    [0.4, 0.6, 25.0, 9.0, 5.0, 0.0, 0.1, -0.05, 0.0],
])  # fmt: skip
FLAT = np.hstack([BENT[:, :5], np.zeros((2, 4))])


def bending(truth, seed, *, n, low=-SIDE / 2):
    """Rows of n vehicles that pass anywhere in the cell east and north of `low`, as the kernels take them."""
    rng = np.random.default_rng(seed)
    mode = rng.choice(len(truth), size=n, p=truth[:, 0])
    _, mean, concentration, shape, mean_speed, *_ = truth[mode].T
    offset = rng.uniform(low, SIDE / 2, (n, 2))
    turned, gained = (truth[mode, 5:7] * offset).sum(axis=1), (truth[mode, 7:] * offset).sum(axis=1)
    direction = wrap(mean + turned + rng.vonmises(0.0, concentration))
    speed = mean_speed * np.exp(gained) * rng.standard_gamma(shape) / shape
    return one_cell(direction, speed, n_vehicles=n, position=offset)


def fitted_bends(rows, *, max_modes=3):
    """What BIC prefers, as rows of BENT, heaviest first."""
    bounds = bounds_of(LearningConfig(), max_modes=max_modes, prior_strength=0.02, speed_spread=0.2, curved=True)
    out = Modes.of(fit_all(rows, bounds)[0])
    out = out.take(out.weight > 0)
    found = np.column_stack([*out[:4], out.shape / out.rate, out.bend, out.gain])
    return found[np.argsort(-found[:, 0])]


def slopes_off(found, truth, n):
    """Standard errors of maximum likelihood between each bend and gain and its true value."""
    weight, concentration, shape = truth[:, [0]].T[0], truth[:, 2], truth[:, 3]
    of_place = n * weight * SIDE**2 / 12
    of_bend = 1 / np.sqrt(of_place * concentration * mean_resultant_length(concentration))
    of_gain = 1 / np.sqrt(of_place * shape)
    error = np.column_stack([of_bend, of_bend, of_gain, of_gain])
    return np.abs(found[:, 5:] - truth[:, 5:]) / error


@pytest.mark.parametrize("seed", range(5))
def test_known_bends_and_gains_are_recovered_to_four_standard_errors(seed):
    n = 3000
    found = fitted_bends(bending(BENT, seed, n=n))
    assert found.shape == BENT.shape
    assert slopes_off(found, BENT, n).max() < 4
    assert np.abs(difference(found[:, 1], BENT[:, 1])).max() < 0.03
    np.testing.assert_allclose(found[:, [0, 2, 3, 4]], BENT[:, [0, 2, 3, 4]], rtol=0.2)
    for column in range(5, 9):  # the tolerance separates neighbours
        assert slopes_off(found, BENT + 0.01 * (np.arange(9) == column), n).max() > 4


def test_known_bends_are_recovered_from_one_corner_of_the_cell():
    """There the mean at the centre is extrapolated, and moves with every step of the slope."""
    (found,) = fitted_bends(bending(BENT[:1] / [0.6, *np.ones(8)], 0, n=3000, low=1.0), max_modes=1)
    error = 1 / np.sqrt(3000 * 4.0**2 / 12 * np.array([60.0, 60.0, 40.0, 40.0]))
    np.testing.assert_array_less(np.abs(found[5:] - BENT[0, 5:]), 4 * error)
    away = np.sqrt(2) * 3.0  # from the centre of the cell to that of the corner
    assert np.abs(difference(found[1], BENT[0, 1])) < 4 * away * error[0]
    assert np.abs(np.log(found[4] / BENT[0, 4])) < 4 * away * error[2]


@pytest.mark.parametrize("n", [30, 300])
def test_where_nothing_bends_flat_modes_are_preferred(n):
    flat = [(fitted_bends(bending(FLAT, seed, n=n))[:, 5:] == 0.0).all() for seed in range(100)]
    assert np.mean(flat) >= 0.95


def bent_map(bend=(0.05, -0.08), gain=(0.03, 0.02)):
    """One cell of 10 m around the origin with one curved mode; outside of it a flat one."""
    return one_cell_map(mean=3.1, concentration=60.0, speed=12.0, shape=40.0, side=SIDE, bend=bend, gain=gain)


def test_the_primitive_is_linear_inside_a_cell_and_continuous():
    curved, rng = bent_map(), np.random.default_rng(1)
    (a, b), share = rng.uniform(-SIDE / 2, SIDE / 2, (2, 500, 2)), rng.uniform(size=500)
    at_a, at_b, between = (curved.primitive_at(p) for p in (a, b, a + share[:, None] * (b - a)))

    def columns(primitive):
        return np.stack([primitive.direction.mean_direction[:, 0], np.log(primitive.speed.mean[:, 0])])

    expected = columns(at_a) + share * difference(columns(at_b), columns(at_a))  # the course crosses the wrap
    np.testing.assert_allclose(difference(columns(between), expected), 0.0, atol=1e-12)
    near = curved.primitive_at(a + 1e-7 * np.sign(-a))
    assert np.abs(difference(columns(near), columns(at_a))).max() < 2e-8
    assert np.abs(difference(columns(at_a), columns(at_b))).max() > 0.5
    np.testing.assert_allclose(columns(curved.primitive_at(np.zeros((1, 2))))[:, 0], [3.1, np.log(12.0)])
    np.testing.assert_array_equal(at_a.direction.concentration, 60.0)
    np.testing.assert_array_equal(at_a.speed.shape, 40.0)


def quarter_turn(position):
    return np.stack([-position[..., 1], position[..., 0]], axis=-1)


def test_a_quarter_turn_of_the_traffic_turns_the_map(ring, ring_map):
    """The squares of the grid lie around the origin, so they turn into each other.

    On a circle the course turns by 1 / radius along the way, so that is the length of every bend.
    """
    turned = replace(ring, position=quarter_turn(ring.position), direction=wrap(ring.direction + np.pi / 2))
    other = learn_primitives(turned, tessellation="grid", cell_size=6.0, rng=np.random.default_rng(7))
    busy = ring_map.n_rows[:-1] > np.median(ring_map.n_rows[:-1])
    np.testing.assert_allclose(np.linalg.norm(ring_map.modes.bend[:-1, 0], axis=-1)[busy], 1 / 20.0, rtol=0.1)
    test = ring_traffic(np.random.default_rng(5), n_vehicles=20)
    mine = ring_map.log_density(test.position, test.direction, test.speed)
    theirs = other.log_density(quarter_turn(test.position), wrap(test.direction + np.pi / 2), test.speed)
    np.testing.assert_allclose(theirs, mine, atol=1e-6)
    assert np.abs(ring_map.log_density(quarter_turn(test.position), test.direction, test.speed) - mine).max() > 1.0


def test_a_bend_that_does_not_fit_the_modes_is_refused():
    for name in ("bend", "gain"):
        with pytest.raises(ValueError, match=f"{name}: expected"):
            replace(bent_map(), modes=bent_map().modes._replace(**{name: np.zeros((2, 3, 2))}))
    with pytest.raises(ValueError, match="bend: expected finite"):
        bent_map(bend=(np.nan, 0.0))
