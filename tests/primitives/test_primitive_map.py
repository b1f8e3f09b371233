"""A map answers with a proper density at every place."""

from dataclasses import fields
from pathlib import Path

import numpy as np
import pytest

from dirprim_filter import learn_primitives, read_tracks
from dirprim_filter.config import LearningConfig
from dirprim_filter.distributions.angles import wrap
from tessellation import GridTessellation

JUNCTION = Path(__file__).parents[1] / "data" / "junction.csv"
# A periodic trapezoid errs on a von Mises by 2 I_N(k) / I_0(k) < 2 exp(-N^2 / 2 k): 2e-10 at the bound k = 1e4.
DIRECTIONS = (np.arange(684) - 341.5) * (2 * np.pi / 684)


@pytest.fixture(scope="module")
def junction_map():
    tracks = read_tracks(JUNCTION)
    config = LearningConfig(prior_strength=0.002)
    return learn_primitives(tracks, tessellation="grid", cell_size=7.0, config=config, rng=np.random.default_rng(0))


@pytest.fixture(params=["ring_map", "junction_map"])
def learned(request):
    return request.getfixturevalue(request.param)


def random_positions(learned, n, rng):
    """Half of them in cells, half anywhere around."""
    centers = learned.tessellation.centers
    inside = centers[rng.integers(len(centers), size=n // 2)] + rng.uniform(-3, 3, (n // 2, 2))
    low, high = centers.min(axis=0) - 30, centers.max(axis=0) + 30
    return np.concatenate([inside, rng.uniform(low, high, (n - n // 2, 2))])


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
    position = np.concatenate([random_positions(learned, 30, rng), [[1e5, 1e5]]])
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
    centre = np.array([1.0, 1.0])  # of the ring, where no vehicle drives
    cell = int(cells.cell_of(centre))
    assert cell >= 0
    assert learned.n_rows[cell] == 0
    direction, speed = np.meshgrid(np.linspace(-3, 3, 13), np.linspace(0, 20, 11))
    np.testing.assert_allclose(
        learned.log_density(centre, direction, speed),
        learned.without_places().log_density(centre, direction, speed),
        rtol=1e-12,
    )


def test_a_map_whose_rows_do_not_fit_its_cells_is_refused(ring_map):
    parts = {f.name: getattr(ring_map, f.name) for f in fields(ring_map) if f.init}
    with pytest.raises(ValueError, match="n_rows: expected"):
        type(ring_map)(**parts | {"n_rows": ring_map.n_rows[:-1]})
    with pytest.raises(ValueError, match="direction, speed"):
        type(ring_map)(**parts | {"modes": ring_map.modes.take(np.s_[:-1])})
    with pytest.raises(ValueError, match="n_background_modes: expected 0 to"):
        type(ring_map)(**parts | {"n_background_modes": 99})
