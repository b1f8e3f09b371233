"""What is learned from tracks of which the truth is known, and from tracks that hold next to nothing."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.special import polygamma

from dirprim_filter import forecast, learn_primitives, load_map, save_map
from dirprim_filter.config import LearningConfig
from dirprim_filter.distributions.angles import difference
from dirprim_filter.distributions.von_mises import mean_resultant_length
from dirprim_filter.primitives.motion import Motion
from dirprim_filter.primitives.rows import TrackRows
from dirprim_filter.recording.errors import RecordingError
from dirprim_filter.tracks import Tracks
from hexagons import Hexagons
from situations import ring_traffic, rows_of, simulated
from tessellation import GridTessellation

# (weight, mean direction, concentration, shape, mean speed) of each mode, of each of two cells
TRUTH = {
    "west": np.array([[0.6, 0.3, 60.0, 40.0, 12.0], [0.4, -1.6, 25.0, 9.0, 5.0]]),
    "east": np.array([[0.5, 3.0, 40.0, 20.0, 8.0], [0.3, 1.2, 80.0, 60.0, 14.0], [0.2, -1.0, 30.0, 12.0, 4.0]]),
}
N_VEHICLES = 3000
FALSE_ALARM_SIGMAS = 5.0  # of 25 parameters, each off by that much once in 1.7e6 draws


@pytest.fixture(scope="module")
def two_cells():
    """Rows in cells west and east of x = 0; no two rows share a vehicle."""
    rng = np.random.default_rng(3)
    west = rows_of(*simulated(TRUTH["west"], N_VEHICLES, rng), position=(-5.0, 5.0))
    east = rows_of(*simulated(TRUTH["east"], N_VEHICLES, rng), position=(5.0, 5.0), first_id=N_VEHICLES)
    return Tracks.concatenate([west, east])


def learned_in_squares(tracks, cell_size, *, seed=0, **options):
    rng = np.random.default_rng(seed)
    return learn_primitives(tracks, tessellation="grid", cell_size=cell_size, rng=rng, **options)


def own_modes(learned, position):
    """Modes that a cell has of its own, without the one for standing: rows as in TRUTH, heaviest first."""
    direction, speed = learned.primitive_at(np.array(position))
    n_own = learned.n_own_modes - 1
    columns = direction.weight, direction.mean_direction, direction.concentration, speed.shape, speed.mean
    found = np.stack(columns, axis=1)[:n_own]
    found = found[found[:, 0] > 0]
    found[:, 0] /= found[:, 0].sum()
    return found


def sigmas_off(found, truth):
    """How many standard errors of maximum likelihood lie between each parameter and its true value."""
    weight, mean, concentration, shape, mean_speed = truth.T
    n = N_VEHICLES * weight
    resultant = mean_resultant_length(concentration)
    of_concentration = 1 - resultant**2 - resultant / concentration
    error = found - truth
    error[:, 1] = difference(found[:, 1], mean)
    standard_error = [
        np.sqrt(weight * (1 - weight) / N_VEHICLES),
        1 / np.sqrt(n * concentration * resultant),
        1 / np.sqrt(n * of_concentration),
        1 / np.sqrt(n * (polygamma(1, shape) - 1 / shape)),
        mean_speed / np.sqrt(n * shape),
    ]
    return np.abs(error / np.stack(standard_error, axis=1)).max()


@pytest.mark.parametrize("modes", ["bic", "dbscan"])  # the latter is the paper's recipe
def test_a_known_mixture_is_recovered_in_each_cell(two_cells, modes):
    learned = learned_in_squares(two_cells, 10.0, modes=modes)
    assert learned.tessellation.n_cells == 2
    for truth, east in ((TRUTH["west"], -5.0), (TRUTH["east"], 5.0)):
        found = own_modes(learned, (east, 5.0))
        assert found.shape == truth.shape  # BIC found the number of modes
        np.testing.assert_allclose(difference(found[:, 1], truth[:, 1]), 0, atol=0.05)
        np.testing.assert_allclose(found[:, [0, 2, 4]], truth[:, [0, 2, 4]], rtol=0.2)
        assert modes == "dbscan" or sigmas_off(found, truth) < FALSE_ALARM_SIGMAS
        for column, change in enumerate((0.05, 0.05, 10.0, 10.0, 0.5)):  # the tolerance separates neighbours
            other = truth.copy()
            other[:, column] += change
            other[:, 0] /= other[:, 0].sum() if column else 1.0
            assert sigmas_off(found, other) > FALSE_ALARM_SIGMAS


def parameters(learned):
    columns = [np.asarray(getattr(learned.motion, name)) for name in Motion.__dataclass_fields__ if name != "leader"]
    return [learned.tessellation.centers, *learned.modes, learned.n_rows, *columns]


def assert_same_map(a, b):
    for mine, theirs in zip(parameters(a), parameters(b), strict=True):
        np.testing.assert_array_equal(mine, theirs)


@pytest.fixture(scope="module")
def most(ring):
    """Three of four of the ring's vehicles, and the map that is learned from them if nothing is said."""
    tracks = ring[ring.track_id % 4 != 0]
    return tracks, learn_primitives(tracks, rng=np.random.default_rng(5))


def test_the_same_tracks_give_the_identical_map_in_any_order_and_parts(most, ring, ring_map):
    tracks, learned = most
    assert_same_map(learn_primitives(tracks, rng=np.random.default_rng(5)), learned)
    shuffled = ring[np.random.default_rng(0).permutation(len(ring))]
    parts = (shuffled[shuffled.track_id % 3 == i] for i in range(3))
    assert_same_map(learned_in_squares(parts, 6.0, seed=7), ring_map)


def test_rows_ten_times_denser_in_time_change_nothing_because_they_are_thinned():
    sparse = ring_traffic(np.random.default_rng(9), n_vehicles=12, dt_s=0.1, n_rows=100)
    dense = ring_traffic(np.random.default_rng(9), n_vehicles=12, dt_s=0.01, n_rows=1000)
    of_both = (parameters(learned_in_squares(tracks, 6.0)) for tracks in (dense, sparse))
    for mine, theirs in zip(*of_both, strict=True):
        np.testing.assert_allclose(mine, theirs, rtol=1e-5, atol=1e-7)  # as near as EM ends
    assert len(TrackRows.thinned(dense, interval_s=1e-3)) == len(dense)  # what would be without


def test_modes_have_tails_of_the_share_asked_for(two_cells):
    """Four deviations off a mode of its own direction the density is that of the tail; without one it is e^-8."""
    at, off = np.array([-5.0, 5.0]), 0.3 + np.array([0.0, 4.0 / np.sqrt(60.0)])
    found = {}
    for share in (0.0, 0.05, 0.2):
        config = LearningConfig(broad_share=share, strengths=(1e-9,))
        learned = learned_in_squares(two_cells, 10.0, config=config)
        found[share] = np.exp(learned.direction_log_density(at, off))
    for share in (0.05, 0.2):
        assert found[share][0] == pytest.approx((1 - 0.75 * share) * found[0.0][0], rel=0.03)
        tail = 0.6 * np.sqrt(60.0 / 16 / (2 * np.pi)) * np.exp(-0.5)
        assert found[share][1] - found[0.0][1] == pytest.approx(share * tail, rel=0.25)


SPREAD = np.linspace(-3, 3, 30), np.linspace(1, 9, 30)


def still(n, speed=0.0):
    return rows_of(np.linspace(-3, 3, n), np.full(n, speed), position=(1.0, 1.0))


@pytest.mark.parametrize("modes", ["bic", "dbscan"])
@pytest.mark.parametrize(
    ("tracks", "n_modes"),
    [
        pytest.param(ring_traffic(np.random.default_rng(0), n_vehicles=1), None, id="one vehicle"),
        pytest.param(rows_of([2.0], [8.0]), 1, id="one row"),
        pytest.param(still(1), 0, id="one row of a standing vehicle"),
        pytest.param(still(30), 0, id="all stand at speed 0"),
        pytest.param(still(30, 0.2), 0, id="all creep below the standing speed"),
        pytest.param(rows_of(np.full(30, 1.0), np.linspace(3, 9, 30)), 1, id="all angles equal"),
        pytest.param(rows_of(np.full(30, np.pi), np.full(30, 8.0)), 1, id="all angles and speeds equal"),
        pytest.param(rows_of(np.full(3000, -np.pi), np.full(3000, 0.301)), 1, id="many rows, all equal"),
        pytest.param(rows_of(np.linspace(-3, 3, 2000), np.geomspace(0.3, 1e6, 2000)), None, id="speeds of all sizes"),
        pytest.param(rows_of(np.tile([0.5, 0.5 - np.pi], 20), np.full(40, 7.0)), 2, id="two opposite directions"),
        pytest.param(rows_of(*SPREAD, position=(2.0, 2.0)), None, id="one point"),
        pytest.param(rows_of(*SPREAD, position=(1e7, -1e7)), None, id="far away"),
    ],
)
def test_little_or_degenerate_data_give_a_finite_proper_map(tracks, n_modes, modes):
    learned = learn_primitives(tracks, modes=modes, rng=np.random.default_rng(0))
    assert learned.tessellation.n_cells >= 1
    assert learned.direction.concentration.max() <= 1e4 * (1 + 1e-12)  # tables hold logarithms
    assert learned.speed.shape.max() <= 1e4 * (1 + 1e-12)
    assert n_modes is None or modes == "dbscan" or len(own_modes(learned, tracks.position[0])) == n_modes
    for place in (tracks.position[0], tracks.position[0] + 1e4):
        direction, speed = np.meshgrid(np.linspace(-np.pi, np.pi, 13), [0.0, 0.1, 1.0, 10.0, 50.0])
        assert np.isfinite(learned.log_density(place, direction, speed)).all()
        fine = np.linspace(-np.pi, np.pi, 2000, endpoint=False)
        assert np.exp(learned.direction_log_density(place, fine)).mean() * 2 * np.pi == pytest.approx(1, abs=1e-9)


def test_one_row_is_the_likeliest_motion_of_its_cell_and_who_stands_a_mode_without_direction():
    learned = learn_primitives(rows_of([2.0], [8.0]), rng=np.random.default_rng(0))
    log_p = learned.log_density(np.zeros(2), np.array([2.0, -1.0]), np.array([8.0, 8.0]))
    assert 2.0 < log_p[0] - log_p[1] < 20.0
    learned = learn_primitives(still(30), rng=np.random.default_rng(0))
    direction, speed = learned.sample(np.tile([1.0, 1.0], (4000, 1)), rng=np.random.default_rng(1))
    assert np.mean(speed < 0.3) > 0.9  # exponential of mean 0.05 m/s
    assert abs(np.exp(1j * direction[speed < 0.3]).mean()) < 5 / np.sqrt(4000)
    assert len(own_modes(learned, (1.0, 1.0))) == 0


def test_no_rows_are_refused(ring):
    for none in (ring[:0], iter(())):
        with pytest.raises(ValueError, match="tracks: expected at least one row, got none"):
            learn_primitives(none, rng=np.random.default_rng(0))


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"tessellation": "hexagons"}, "tessellation: .*'grid'.* got 'hexagons'"),
        ({"modes": "aic"}, "modes: expected 'bic' or 'dbscan', got 'aic'"),
        ({"primitive": "bent"}, "primitive: .*'flat', got 'bent'"),
        ({"cell_size": 5.0, "n_cells": 5}, "at most one of them"),
        ({"cell_size": 5.0, "tessellation": GridTessellation.empty()}, "at most one of them"),
        ({"n_cells": 0}, "n_cells: expected at least 1, got 0"),
        ({"cell_size": 0.0}, "cell_size: expected a positive length"),
        ({"cell_size": np.nan}, "cell_size: expected a positive length"),
        ({"cell_size": 1e-5}, "cell_size: .* choose larger cells"),
        ({"weight": np.ones(3)}, "weight: expected shape .*, got"),
        ({"weight": np.where(np.arange(40) == 2, -1.0, 1.0)}, "weight: .* positive numbers, got -1.0 for track 2"),
        ({"weight": np.zeros(40)}, "weight: expected positive numbers, got 0.0"),
        ({"weight": np.full(40, np.nan)}, "weight: .*finite"),
    ],
)
def test_unknown_or_contradictory_options_are_refused_by_name(ring, options, message):
    with pytest.raises(ValueError, match=message):
        learn_primitives(ring, rng=np.random.default_rng(0), **options)


def test_given_cells_are_kept_and_one_cell_of_a_grid_is_one(ring):
    cells = GridTessellation.covering(np.array([[500.0, 500.0]]), cell_size=10.0)
    learned = learn_primitives(ring, tessellation=cells, rng=np.random.default_rng(0))
    assert learned.tessellation is cells
    np.testing.assert_array_equal(learned.n_rows[:-1], 0)
    assert np.isfinite(learned.log_density([505.0, 505.0], 0.0, 5.0))
    learned = learn_primitives(ring, tessellation="grid", n_cells=1, rng=np.random.default_rng(0))
    assert learned.tessellation.n_cells == 1
    assert (learned.tessellation.cell_of(ring.position) == 0).all()


def test_a_map_lives_in_any_cells_and_its_file_holds_them(ring, ring_map, tmp_path):
    """Hexagons, nothing of which is compiled: the density is as proper as that of squares, and about as high."""
    few, path = ring[ring.track_id < 12], tmp_path / "hexagons.mcap"
    cells = Hexagons.covering(few.position, width=6.0)
    found = learn_primitives(few, tessellation=cells, rng=np.random.default_rng(0))
    rows = few.position, few.direction, few.speed
    assert found.log_density(*rows).mean() == pytest.approx(ring_map.log_density(*rows).mean(), abs=0.3)
    turn = np.linspace(-np.pi, np.pi, 721)[:-1]
    at = np.broadcast_to(few.position[0], (turn.size, 2))
    assert np.exp(found.direction_log_density(at, turn)).mean() * 2 * np.pi == pytest.approx(1.0, rel=1e-3)
    paths = forecast(found, position=few.position[0], direction=few.direction[0], speed=few.speed[0], horizon_s=1.0,
                     n_samples=20, rng=np.random.default_rng(0))  # fmt: skip
    assert np.isfinite(paths).all()
    save_map(found, path)
    loaded = load_map(path, tessellation=Hexagons)
    for name, value in cells.parameters.items():
        np.testing.assert_array_equal(loaded.tessellation.parameters[name], value)
    np.testing.assert_array_equal(loaded.log_density(*rows), found.log_density(*rows))
    for given, line in ((None, r"'Hexagons'; load_map\(path, tessellation=Hexagons\)"), (Blind, "cannot be made of"),
                        (Halved, r"Hexagons.cell_of of shape \(\d+,\), got")):  # fmt: skip
        with pytest.raises(RecordingError, match=line):
            load_map(path, tessellation=given)
    with pytest.raises(TypeError, match=r"expected Hexagons\.parameters, a dict .* makes it again, got none"):
        save_map(replace(found, tessellation=Blind(cells)), path, force=True)


class Blind:
    """Cells that do not state their parameters."""

    def __init__(self, cells):
        self.n_cells, self.centers, self.area = cells.n_cells, cells.centers, cells.area
        self.cell_of, self.polygons = cells.cell_of, cells.polygons


class Halved(Hexagons):
    """Cells that answer for every other position."""

    def cell_of(self, position):
        return super().cell_of(position)[::2]


Blind.__name__ = Halved.__name__ = "Hexagons"


@pytest.mark.parametrize(
    ("wrong", "line"),
    [
        ({"cell_of": lambda at: np.zeros((len(at), 1), np.int64)}, r"Cells\.cell_of of shape \(\d+,\), got \(\d+, 1\)"),
        ({"cell_of": lambda at: np.full(len(at), 7)}, r"Cells\.cell_of int64 from -1 to \d, got int64, 7 to 7"),
        ({"cell_of": lambda at: np.zeros(len(at))}, r"Cells\.cell_of int64 from -1 to \d, got float64, 0\.0 to 0\.0"),
        ({"centers": np.zeros((2, 3))}, r"Cells\.centers of shape \(\d, 2\), got \(2, 3\)"),
        ({"area": 1.0}, r"Cells\.area of shape \(\d,\), got \(\)"),
    ],
)
def test_cells_that_answer_wrongly_are_refused_before_anything_is_learned(ring, wrong, line):
    cells = type("Cells", (Blind,), {})(Hexagons.covering(ring.position[:3], width=200.0))
    for name, value in wrong.items():
        setattr(cells, name, value)
    with pytest.raises(ValueError, match=f"tessellation: expected {line}"):
        learn_primitives(ring, tessellation=cells, rng=np.random.default_rng(0))
