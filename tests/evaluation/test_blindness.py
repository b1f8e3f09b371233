"""Where a sensor does not see: found where vehicles pass undetected again and again, and nowhere else."""

from dataclasses import replace

import numpy as np
import pytest
from matplotlib.path import Path

from dirprim_filter.evaluation.calibration import blindness, calibrate, self_calibration
from dirprim_filter.evaluation.calibration.blindness import CELL_M, Passages, between_detections, learn_sight
from dirprim_filter.sensor import Sensor
from dirprim_filter.sight import Sight
from dirprim_filter.simulation.sensor import sense
from dirprim_filter.tracks import Tracks

SENSOR = replace(Sensor.white(0.4), detection_probability=0.85)
N_ROWS, STEP_M = 100, 1.0
ROUND = tuple((33.0 * np.cos(a), 33.0 * np.sin(a)) for a in np.linspace(0.0, 2.0 * np.pi, 24, endpoint=False))
RANGE = Sight((ROUND,))
"""A range of 33 m: beyond it vehicles go out of sight and do not come back."""
STRIP = Sight((((-99, -99), (12, -99), (12, 99), (-99, 99)), ((32, -99), (99, -99), (99, 99), (32, 99))))
"""Behind a building 20 m wide."""


def crossing(n_vehicles, rng):
    """Vehicles at 10 m/s on two crossing roads of four lanes."""
    x = STEP_M * np.arange(N_ROWS) - 50.0
    parts = []
    for i in range(n_vehicles):
        lane = np.full(N_ROWS, rng.choice([-6.0, -2.0, 2.0, 6.0]))
        way, turned = np.column_stack([x, lane]), i % 2
        start_ns = 1_000_000_000 * i
        parts.append(
            Tracks(
                track_id=np.full(N_ROWS, f"v{i}"),
                time_ns=start_ns + 100_000_000 * np.arange(N_ROWS),
                position=way[:, ::-1] if turned else way,
                direction=np.full(N_ROWS, 0.5 * np.pi * turned),
                speed=np.full(N_ROWS, 10.0),
            )
        )
    return Tracks.concatenate(parts)


def driven(n_vehicles, rng):
    """The numbers and positions of their rows, vehicle after vehicle."""
    tracks = crossing(n_vehicles, rng)
    order = np.lexsort((tracks.time_ns, tracks.vehicle))
    return tracks.vehicle[order], tracks.position[order]


def missed_in_bursts(n, rng, *, share=0.2, lasts=15.0):
    """Of rows whether they are detected, by a sensor that sees everywhere: two states, as Gilbert has them."""
    is_hit = np.ones(n, np.bool_)
    changes = rng.random(n)
    for i in range(n):
        was_hit = is_hit[i - 1] if i % N_ROWS else rng.random() > share
        is_hit[i] = changes[i] >= share / (1.0 - share) / lasts if was_hit else changes[i] < 1.0 / lasts
    return is_hit


@pytest.mark.parametrize("sight", [RANGE, STRIP], ids=["range", "strip"])
def test_what_is_out_of_sight_is_found_to_two_cells(sight):
    """Every place that is taken for the other is within two cells of the true edge, of 40 vehicles."""
    rng = np.random.default_rng(0)
    vehicle, position = driven(40, rng)
    sees = sight.sees(position)
    found = learn_sight(Passages(vehicle, position, sees & (rng.random(sees.size) < 0.85)))
    wrong = position[found.sees(position) != sees]
    assert len(wrong) < 0.06 * sees.size
    nearest = [Path([*polygon, polygon[0]]).interpolated(200).vertices for polygon in sight.polygons]
    edge = np.concatenate(nearest)
    off = np.hypot(*(wrong[:, None] - edge).transpose(2, 0, 1)).min(axis=1)
    assert off.max() <= 2.0 * CELL_M[0]


def test_a_sensor_that_sees_everything_is_blind_nowhere():
    """Bursts of misses of a second and a half; each of 20 logs is a false alarm once in a hundred times at most."""
    rng = np.random.default_rng(1)
    vehicle, position = driven(40, rng)
    for _ in range(20):
        assert learn_sight(Passages(vehicle, position, missed_in_bursts(vehicle.size, rng))) is None


def test_a_few_vehicles_say_nothing_of_a_place():
    vehicle, position = driven(4, np.random.default_rng(0))
    assert learn_sight(Passages(vehicle, position, STRIP.sees(position))) is None


def test_rectangles_cover_what_is_seen_and_nothing_else():
    rng = np.random.default_rng(2)
    for _ in range(20):
        sees = rng.random((9, 12)) < 0.7
        covered = np.zeros_like(sees)
        for first, last, low, high in blindness._cover(sees):
            covered[first : last + 1, low : high + 1] = True
        np.testing.assert_array_equal(covered, sees)


def test_between_detections_a_vehicle_goes_by_the_cubic_of_both_ends():
    def way(t):
        return np.column_stack([3.0 * t + 0.5 * t**2 - 0.1 * t**3, t**2])

    frame_s = 0.1 * np.arange(60)
    frame = np.array([0, 1, 20, 21, 5, 6, 58])
    t = frame_s[frame]
    velocity = np.column_stack([3.0 + t - 0.3 * t**2, 2.0 * t])
    vehicle = np.array([4, 4, 4, 4, 7, 7, 7])
    found, gap_s = between_detections(vehicle, frame, way(t), velocity, frame_s)
    np.testing.assert_array_equal(found.vehicle, [4] * 22 + [7] * 3)  # five seconds later it may have been anywhere
    np.testing.assert_allclose(found.position[:22], way(frame_s[:22]), atol=1e-9)
    np.testing.assert_array_equal(found.is_hit, [*[True] * 2, *[False] * 18, *[True] * 5])
    np.testing.assert_allclose(gap_s, np.where(found.is_hit, 0.0, 1.9), atol=1e-9)


def test_a_sensor_is_calibrated_in_its_sight():
    """Whoever counts out of sight as missed would say 0.7, and half as many false ones."""
    truth = crossing(60, np.random.default_rng(0))
    sensor = replace(SENSOR, sight=STRIP, clutter_density=1e-4)
    seen = sense(truth, sensor, rng=np.random.default_rng(1))
    found = calibrate(seen, truth).sensor
    assert found.detection_probability == pytest.approx(0.85, abs=0.02)
    assert found.clutter_density == pytest.approx(1e-4, rel=0.3)
    alone = self_calibration._reported(seen)
    assert alone.detection_probability == pytest.approx(0.85, abs=0.02)
    assert alone.clutter_density == pytest.approx(1e-4, rel=0.3)
    sees = STRIP.sees(truth.position)
    for sight in (found.sight, alone.sight):
        said = sight.sees(truth.position)
        assert (said & ~sees).sum() < 0.35 * (~sees).sum()
        assert (~said & sees).sum() < 0.02 * sees.sum()
    everywhere = sense(truth, SENSOR, rng=np.random.default_rng(1))
    assert calibrate(everywhere, truth).sensor.sight is None
    assert self_calibration._reported(everywhere).sight is None
