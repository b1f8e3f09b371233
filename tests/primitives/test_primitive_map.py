"""A map answers with a proper density at every place."""

from dataclasses import fields

import numpy as np
import pytest
from scipy import stats
from scipy.special import logsumexp

from dirprim_filter import learn_primitives
from dirprim_filter.config import LearningConfig
from dirprim_filter.distributions.angles import wrap
from dirprim_filter.tracks import Tracks
from tessellation import GridTessellation

FALSE_ALARM = 1e-4  # of each statistical test below; seeds are fixed

# A periodic trapezoid errs on a von Mises by 2 I_N(k) / I_0(k) < 2 exp(-N^2 / 2 k): 2e-10 at the bound k = 1e4.
DIRECTIONS = (np.arange(684) - 341.5) * (2 * np.pi / 684)
# Over u = log speed a gamma has the characteristic function G(a + i w) / G(a), so a trapezoid of step h errs by about
# 2 exp(-(2 pi / h)^2 / 2 a): 1e-9 at the bound a = 1e4; below the lowest node lie 1e-9 of the standing mode.
LOG_SPEED_STEP = 0.0096
SPEEDS = np.exp(np.arange(np.log(0.05 * 1e-9), np.log(2e3), LOG_SPEED_STEP))
SPEED_WEIGHTS = LOG_SPEED_STEP * SPEEDS


@pytest.fixture(scope="module")
def lankershim_map(real_data):
    columns = np.loadtxt(real_data / "lankershim" / "lankershim.csv", delimiter=",", skiprows=1)
    group, number, time_s, x, y, heading, speed = columns.T
    tracks = Tracks(
        track_id=(group * 10_000 + number).astype(np.int64),
        time_ns=(time_s * 1e9).round().astype(np.int64),
        position=np.column_stack([x, y]),
        direction=heading,
        speed=speed,
    )
    config = LearningConfig(prior_strengths=(0.002,))
    return learn_primitives(tracks, tessellation="grid", cell_size=7.0, config=config, rng=np.random.default_rng(0))


@pytest.fixture(params=["ring_map", "lankershim_map"])
def learned(request):
    return request.getfixturevalue(request.param)


def random_positions(learned, n, rng):
    """Half of them in cells, half anywhere around."""
    centers = learned.tessellation.centers
    inside = centers[rng.integers(len(centers), size=n // 2)] + rng.uniform(-3, 3, (n // 2, 2))
    low, high = centers.min(axis=0) - 30, centers.max(axis=0) + 30
    return np.concatenate([inside, rng.uniform(low, high, (n - n // 2, 2))])


def test_the_density_integrates_to_one_at_a_thousand_places(learned):
    rng = np.random.default_rng(1)
    position = random_positions(learned, 1000, rng)
    cell = learned.tessellation.cell_of(position)
    assert (cell >= 0).sum() > 400
    assert (cell < 0).sum() > 100
    own = learned.primitive_at(position)
    assert own.direction.concentration.max() <= 1e4
    assert own.speed.shape.max() <= 1e4
    # Modes factorise: sum_m w_m (integral over direction) (integral over speed), by scipy's densities at the nodes.
    mu, kappa = own.direction.mean_direction, own.direction.concentration
    rows, where = np.unique(
        np.stack([mu, kappa, own.speed.shape, own.speed.rate], -1).reshape(-1, 4), axis=0, return_inverse=True
    )
    of_direction = stats.vonmises.pdf(DIRECTIONS[:, None], rows[:, 1], loc=rows[:, 0]).sum(axis=0) * (2 * np.pi / 684)
    of_speed = SPEED_WEIGHTS @ stats.gamma.pdf(SPEEDS[:, None], rows[:, 2], scale=1 / rows[:, 3])
    mass = (own.direction.weight * (of_direction * of_speed)[where.ravel()].reshape(mu.shape)).sum(axis=-1)
    np.testing.assert_allclose(mass, 1.0, atol=1e-6)
    # That the map's own density is this sum, at nodes where it matters and at nodes anywhere.
    d, s = learned.sample(np.repeat(position[:, None], 100, axis=1), rng=rng)
    d = np.concatenate([d, rng.choice(DIRECTIONS, (1000, 30))], axis=1)
    s = np.concatenate([s, rng.choice(SPEEDS[SPEEDS < 60], (1000, 30))], axis=1)
    terms = np.log(np.maximum(own.direction.weight, 1e-300))[:, None]
    terms = terms + stats.vonmises.logpdf(d[..., None], kappa[:, None], loc=mu[:, None])
    terms = terms + stats.gamma.logpdf(s[..., None], own.speed.shape[:, None], scale=1 / own.speed.rate[:, None])
    np.testing.assert_allclose(
        learned.log_density(position[:, None], d, s), logsumexp(terms, axis=-1), rtol=1e-9, atol=1e-8
    )


def panels(edges):
    """Nodes and weights of Gauss and Legendre's six points between each two edges."""
    x, w = np.polynomial.legendre.leggauss(6)
    edges = np.unique(edges)
    half = 0.5 * np.diff(edges)[:, None]
    return (edges[:-1, None] + half * (x + 1)).ravel(), (half * w).ravel()


def fine_nodes(own):
    """Quadrature of one place's density over direction and log speed: panels of two deviations around every mode.

    On a panel of two deviations of a normal, six points err by 1e-9 of its mass; 2e-9 lie beyond six deviations.
    """
    used = own.direction.weight > 0
    around = np.arange(-6.0, 7.0, 2.0)[:, None]
    turn = around / np.sqrt(np.maximum(own.direction.concentration[used], 1.0))
    mode = wrap(own.direction.mean_direction[used] + turn).ravel()
    u = np.log(own.speed.mean[used]) + around / np.sqrt(own.speed.shape[used])
    low, high = np.log(0.05 * 1e-9), np.log(2e3)
    log_speed, weight = panels(np.concatenate([u[(u > low) & (u < high)], np.linspace(low, high, 40)]))
    return (
        *panels(np.concatenate([mode, np.linspace(-np.pi, np.pi, 17)])),
        np.exp(log_speed),
        weight * np.exp(log_speed),
    )


def test_log_density_itself_integrates_to_one_over_both_axes(learned):
    rng = np.random.default_rng(2)
    position = np.concatenate([random_positions(learned, 12, rng), [[1e5, 1e5]]])
    for place in position:
        direction, direction_weight, speed, speed_weight = fine_nodes(learned.primitive_at(place))
        p = np.exp(learned.log_density(place, direction[:, None], speed))
        assert direction_weight @ p @ speed_weight == pytest.approx(1.0, abs=1e-6)
        assert np.exp(learned.direction_log_density(place, DIRECTIONS)).mean() * 2 * np.pi == pytest.approx(
            1.0, abs=1e-6
        )


def test_the_density_is_finite_everywhere_even_of_standing_vehicles(learned):
    rng = np.random.default_rng(3)
    position = random_positions(learned, 1000, rng)
    for speed in (0.0, 1e-300, 1e-3, 0.3, 10.0, 300.0):
        log_p = learned.log_density(position, rng.uniform(-np.pi, np.pi, 1000), np.full(1000, speed))
        assert np.isfinite(log_p).all()
    assert np.isfinite(learned.log_density([1e12, -1e12], np.pi, 0.0))


def test_outside_of_every_cell_the_background_density_answers(learned):
    rng = np.random.default_rng(4)
    free = learned.without_places()
    direction, speed = rng.uniform(-np.pi, np.pi, 50), rng.gamma(2.0, 4.0, 50)
    outside = np.full((50, 2), 1e5)
    np.testing.assert_allclose(
        learned.log_density(outside, direction, speed), free.log_density(outside * 0, direction, speed), rtol=1e-12
    )
    inside = learned.tessellation.centers[rng.integers(learned.tessellation.n_cells, size=50)]
    assert not np.allclose(learned.log_density(inside, direction, speed), free.log_density(inside, direction, speed))


def test_a_cell_without_data_has_the_background_density(ring):
    everywhere = np.stack(np.meshgrid(np.arange(-30.0, 30, 6), np.arange(-30.0, 30, 6)), axis=-1).reshape(-1, 2)
    cells = GridTessellation.covering(everywhere, cell_size=6.0)
    learned = learn_primitives(ring, tessellation=cells, rng=np.random.default_rng(0))
    centre = np.array([1.0, 1.0])  # of the ring, where nobody drives
    cell = int(cells.cell_of(centre))
    assert cell >= 0
    assert learned.n_rows[cell] == 0
    direction, speed = np.meshgrid(np.linspace(-3, 3, 13), np.linspace(0, 20, 11))
    np.testing.assert_allclose(
        learned.log_density(centre, direction, speed),
        learned.without_places().log_density(centre, direction, speed),
        rtol=1e-12,
    )


def probability_transform(learned, place, direction, speed):
    """Uniform on the square if (direction, speed) follow the density at the place (Rosenblatt 1952)."""
    fine = np.linspace(-np.pi, np.pi, 200_001)
    p = np.exp(learned.direction_log_density(place, fine))
    below = np.concatenate([[0.0], np.cumsum(0.5 * (p[1:] + p[:-1])) * (fine[1] - fine[0])])
    own = learned.primitive_at(place)
    of_mode = own.direction.mode_log_density(direction)
    share = np.exp(of_mode - logsumexp(of_mode, axis=-1, keepdims=True))
    of_speed = stats.gamma.cdf(speed[:, None], own.speed.shape, scale=1 / own.speed.rate)
    return np.interp(direction, fine, below), (share * of_speed).sum(axis=-1)


def test_samples_follow_the_density_of_their_place_and_no_neighbouring_one(learned):
    place = learned.tessellation.centers[np.argmax(learned.n_rows[:-1])]
    direction, speed = learned.sample(np.tile(place, (10_000, 1)), rng=np.random.default_rng(5))
    of_direction, of_speed = probability_transform(learned, place, direction, speed)
    assert stats.kstest(of_direction, "uniform").pvalue > FALSE_ALARM
    assert stats.kstest(of_speed, "uniform").pvalue > FALSE_ALARM
    turned, _ = probability_transform(learned, place, wrap(direction + 0.1), speed)
    _, faster = probability_transform(learned, place, direction, 1.1 * speed)
    assert stats.kstest(turned, "uniform").pvalue < FALSE_ALARM
    assert stats.kstest(faster, "uniform").pvalue < FALSE_ALARM


def test_primitive_at_unpacks_into_mixture_and_gammas_with_the_modes_last(ring_map):
    m = ring_map.direction.weight.shape[1]
    for leading in ((), (3,), (2, 5)):
        direction, speed = ring_map.primitive_at(np.full((*leading, 2), 14.0))
        for column in (direction.weight, direction.mean_direction, direction.concentration, speed.shape, speed.rate):
            assert column.shape == (*leading, m)
        d, s = ring_map.sample(np.full((*leading, 2), 14.0), rng=np.random.default_rng(0))
        assert d.shape == s.shape == leading
        assert ring_map.log_density(np.full((*leading, 2), 14.0), d, s).shape == leading


def test_bad_places_and_angles_are_refused_by_name(ring_map):
    with pytest.raises(ValueError, match="position"):
        ring_map.primitive_at(np.zeros(3))
    with pytest.raises(ValueError, match="position"):
        ring_map.log_density([np.nan, 0.0], 0.0, 1.0)
    with pytest.raises(ValueError, match="speed"):
        ring_map.log_density([0.0, 0.0], 0.0, np.inf)


def test_a_map_whose_rows_do_not_fit_its_cells_is_refused(ring_map):
    parts = {f.name: getattr(ring_map, f.name) for f in fields(ring_map) if f.init}
    with pytest.raises(ValueError, match="n_rows: expected"):
        type(ring_map)(**parts | {"n_rows": ring_map.n_rows[:-1]})
    with pytest.raises(ValueError, match="direction, speed"):
        type(ring_map)(**parts | {"direction": ring_map.direction[:-1], "speed": ring_map.speed[:-1]})
    with pytest.raises(ValueError, match="n_background_modes: expected 0 to"):
        type(ring_map)(**parts | {"n_background_modes": 99})
