"""A map answers with a proper density at every place, which compiled code finds as slow code does."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from scipy import stats

from dirprim_filter import learn_primitives, read_tracks
from dirprim_filter.config import LearningConfig
from dirprim_filter.primitives._modes import Modes
from dirprim_filter.primitives.primitive_map import PrimitiveMap
from oracles import map_log_densities
from situations import one_cell_map
from tessellation import GridTessellation

JUNCTION = Path(__file__).parents[1] / "data" / "junction.csv"
# A periodic trapezoid errs on a von Mises by 2 I_N(k) / I_0(k) < 2 exp(-N^2 / 2 k): 2e-10 at the bound k = 1e4.
DIRECTIONS = (np.arange(684) - 341.5) * (2 * np.pi / 684)


@pytest.fixture(scope="module")
def junction_map():
    options = {"tessellation": "grid", "cell_size": 7.0, "config": LearningConfig(prior_strength=0.002)}
    return learn_primitives(read_tracks(JUNCTION), rng=np.random.default_rng(0), **options)


@pytest.fixture(params=["ring_map", "junction_map"])
def learned(request):
    return request.getfixturevalue(request.param)


def random_positions(learned, n, rng):
    """Half of them in cells, half anywhere around."""
    centers = learned.tessellation.centers
    inside = centers[rng.integers(len(centers), size=n // 2)] + rng.uniform(-3, 3, (n // 2, 2))
    low, high = centers.min(axis=0) - 30, centers.max(axis=0) + 30
    return np.concatenate([inside, rng.uniform(low, high, (n - n // 2, 2))])


def speed_nodes(own):
    """Nodes and weights over one place's speeds: by log speed six points to panels of two deviations around each mode.

    On such a panel of a normal they err by 1e-9 of its mass; 2e-9 lie beyond six deviations.
    """
    used = own.direction.weight > 0
    u = np.log(own.speed.mean[used]) + np.arange(-6.0, 7.0, 2.0)[:, None] / np.sqrt(own.speed.shape[used])
    low, high = np.log(0.05 * 1e-9), np.log(2e3)
    edges = np.unique(np.concatenate([u[(u > low) & (u < high)], np.linspace(low, high, 40)]))
    (x, w), half = np.polynomial.legendre.leggauss(6), 0.5 * np.diff(edges)[:, None]
    speed = np.exp(edges[:-1, None] + half * (x + 1)).ravel()
    return speed, (half * w).ravel() * speed


def test_log_density_itself_integrates_to_one_over_both_axes_and_is_finite_everywhere(learned):
    """Even that of standing vehicles."""
    rng = np.random.default_rng(2)
    for place in [*random_positions(learned, 4, rng), np.full(2, 1e5)]:
        speed, weight = speed_nodes(learned.primitive_at(place))
        p = np.exp(learned.log_density(place, DIRECTIONS[:, None], speed))
        assert p.mean(axis=0) @ weight * 2 * np.pi == pytest.approx(1.0, abs=1e-6)
        of_direction = np.exp(learned.direction_log_density(place, DIRECTIONS))
        assert of_direction.mean() * 2 * np.pi == pytest.approx(1.0, abs=1e-6)
    position = random_positions(learned, 1000, rng)
    for speed in (0.0, 1e-300, 1e-3, 0.3, 10.0, 300.0):
        log_p = learned.log_density(position, rng.uniform(-np.pi, np.pi, 1000), np.full(1000, speed))
        assert np.isfinite(log_p).all()
    assert np.isfinite(learned.log_density([1e12, -1e12], np.pi, 0.0))


def test_outside_of_every_cell_and_in_one_without_data_the_background_density_answers(learned, ring):
    rng = np.random.default_rng(4)
    direction, speed = rng.uniform(-np.pi, np.pi, 50), rng.gamma(2.0, 4.0, 50)
    everywhere = np.stack(np.meshgrid(*[np.arange(-30.0, 30, 6)] * 2), axis=-1).reshape(-1, 2)
    cells = GridTessellation.covering(everywhere, cell_size=6.0)
    covering = learn_primitives(ring, tessellation=cells, rng=np.random.default_rng(0))
    centre = np.array([1.0, 1.0])  # of the ring, where no vehicle drives
    assert covering.n_rows[int(cells.cell_of(centre))] == 0
    assert cells.cell_of(centre) >= 0
    for of, place in ((learned, np.full(2, 1e5)), (covering, centre)):
        free = of.without_places().log_density(np.zeros(2), direction, speed)
        np.testing.assert_allclose(of.log_density(place, direction, speed), free, rtol=1e-12)
        inside = of.tessellation.centers[of.n_rows[:-1].argmax()]
        assert not np.allclose(of.log_density(inside, direction, speed), free)


def test_a_map_whose_rows_do_not_fit_its_cells_is_refused(ring_map):
    few = ring_map.modes.take(np.s_[:-1])
    for wrong, line in (
        ({"n_rows": ring_map.n_rows[:-1]}, "n_rows: expected"), ({"modes": few}, "direction, speed"),
        ({"n_background_modes": 99}, "n_background_modes: expected 0 to"),
    ):  # fmt: skip
        with pytest.raises(ValueError, match=line):
            replace(ring_map, **wrong)


N_CELLS, N_MODES = 12, 7


def random_map(*, curved, least=1e-9, concentration=1e6, seed=0):
    """A map with cells of one to seven modes, from uniform to the sharpest, and speeds from rest to certainty."""
    rng = np.random.default_rng(seed)
    shape = (N_CELLS + 1, N_MODES)
    weight = rng.gamma(0.5, 1.0, shape) * (np.arange(N_MODES) < rng.integers(1, N_MODES + 1, shape[0])[:, None])
    alpha = 10 ** rng.uniform(0.0, 4.0, shape)
    alpha[:, 0] = 1.0
    kappa = 10 ** rng.uniform(np.log10(least), np.log10(concentration), shape)
    kappa[0] = 0.0
    slope = 0.02 * curved * rng.normal(size=(2, *shape, 2))
    return PrimitiveMap(
        tessellation=GridTessellation(origin=np.zeros(2), cell_size=10.0, n_x=4, n_y=4, square=np.arange(N_CELLS)),
        modes=Modes(
            weight / weight.sum(axis=1, keepdims=True), rng.choice([np.pi, 0.0, -1.5, 3.0], shape), kappa,
            alpha, alpha / rng.uniform(0.5, 20.0, shape), *slope,
        ),
        n_rows=np.ones(shape[0], np.int64), n_background_modes=0,
    )  # fmt: skip


def rows(n, rng):
    """Places in and around the cells, directions of every turn, speeds from 0 on, half of them where modes stand."""
    return (
        rng.uniform(-5.0, 45.0, (n, 2)),
        np.where(rng.random(n) < 0.5, rng.choice([-np.pi, np.pi, 0.0, 3.0 + 4 * np.pi], n), rng.uniform(-9, 9, n)),
        np.where(rng.random(n) < 0.1, rng.choice([0.0, -1.0, 1e-310], n), rng.gamma(1.0, 9.0, n)),
    )  # fmt: skip


@pytest.mark.parametrize("curved", [False, True])
@pytest.mark.parametrize("concentration", [50.0, 1e6])
def test_log_densities_are_those_of_numpy_to_1e_10(curved, concentration):
    """Absolute or relative, whichever is more."""
    learned = random_map(curved=curved, concentration=concentration)
    position, direction, speed = rows(40_000, np.random.default_rng(1))
    with np.errstate(all="ignore"):
        expected = map_log_densities(learned, position, direction, speed)
    of_direction = learned.direction_log_density(position, direction)
    found = of_direction, learned.speed_log_density(position, speed), learned.log_density(position, direction, speed)
    np.testing.assert_allclose(found, expected, atol=1e-10, rtol=1e-10)


def test_leading_axes_broadcast_as_those_of_numpy():
    learned = random_map(curved=True)
    rng = np.random.default_rng(2)
    position, direction, speed = rng.uniform(0, 40, (4, 1, 2)), rng.uniform(-3, 3, 5), rng.gamma(2.0, 4.0, (3, 1, 1))
    found, shape = learned.log_density(position, direction, speed), (3, 4, 5)
    assert found.shape == shape
    at = np.broadcast_to(position, (*shape, 2)), np.broadcast_to(direction, shape), np.broadcast_to(speed, shape)
    np.testing.assert_allclose(found, map_log_densities(learned, *at)[2], atol=1e-10, rtol=1e-10)
    assert learned.log_density(np.empty((0, 2)), np.empty(0), np.empty(0)).shape == (0,)
    assert learned.sample(np.empty((0, 2)), rng=rng)[0].shape == (0,)


@pytest.mark.parametrize("bad", [np.nan, np.inf, -np.inf])
def test_what_is_not_finite_is_refused_by_name_and_place(bad):
    learned, place, one = random_map(curved=False), np.full((3, 2), 5.0), np.ones(3)
    spoilt, nowhere = np.array([1.0, 1.0, bad]), np.array([[5.0, 5.0], [5.0, 5.0], [5.0, bad]])
    for name, at, ask in (
        ("position", r"\(2, 1\)", lambda: learned.direction_log_density(nowhere, one)),
        ("position", r"\(2, 1\)", lambda: learned.sample(nowhere, rng=np.random.default_rng(0))),
        ("direction", r"\(2,\)", lambda: learned.log_density(place, spoilt, one)),
        ("speed", r"\(2,\)", lambda: learned.speed_log_density(place, spoilt)),
    ):
        with pytest.raises(ValueError, match=f"{name}: expected finite numbers, got .* at {at}"):
            ask()
    with pytest.raises(ValueError, match="position: expected shape"):
        learned.sample(np.zeros(3), rng=np.random.default_rng(0))


@pytest.mark.parametrize("curved", [False, True])
def test_samples_follow_their_density(curved):
    """Kolmogorov and Smirnov on the speeds and on the directions of one place; each fails by chance once in 1e4."""
    learned = random_map(curved=curved, least=5.0, concentration=50.0, seed=3)
    place = np.array([13.0, 8.0])
    direction, speed = learned.sample(np.tile(place, (30_000, 1)), rng=np.random.default_rng(5))
    own = learned.primitive_at(place)
    fine = np.linspace(-np.pi, np.pi, 100_001)
    p = np.exp(learned.direction_log_density(place, fine))
    below = np.concatenate([[0.0], np.cumsum(0.5 * (p[1:] + p[:-1])) * (fine[1] - fine[0])])
    of_speed = stats.gamma(own.speed.shape[:, None], scale=1 / own.speed.rate[:, None])
    right = np.interp(direction, fine, below), own.direction.weight @ of_speed.cdf(speed)
    wrong = np.interp(direction + 0.05, fine, below), own.direction.weight @ of_speed.cdf(1.2 * speed)
    assert min(stats.kstest(of, "uniform").pvalue for of in right) > 1e-4
    assert max(stats.kstest(of, "uniform").pvalue for of in wrong) < 1e-4


def test_direction_and_speed_of_a_sample_are_of_one_mode():
    one, course, pace = np.ones((2, 2)), np.array([[0.0, 2.0]] * 2), np.array([[3.0, 12.0]] * 2)
    two = replace(one_cell_map(), motion=None, modes=Modes.flat(0.5 * one, course, 1e5 * one, 1e4 * one, 1e4 / pace))
    direction, speed = two.sample(np.zeros((1000, 2)), rng=np.random.default_rng(0))
    np.testing.assert_array_equal(direction > 1.0, speed > 7.0)
    assert 400 < (direction > 1.0).sum() < 600
