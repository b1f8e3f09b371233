"""Units, placeholders, outliers and ids of several vehicles are found; honest motion of any scale is not doubted."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.signal import lfilter

from dirprim_filter.distributions.angles import wrap
from dirprim_filter.faults import find_faults, wrong_scale
from dirprim_filter.jumps import Jumps, Scale
from dirprim_filter.tracks import Tracks
from situations import tracks_of


def driven(i, n_rows=120):
    """Eastward, with accelerations of the driver's own, as every driver has them: 1 m/s2, correlated over a second."""
    acceleration = lfilter([0.44], [1.0, -0.9], np.random.default_rng(i).standard_normal(n_rows))
    pace = np.maximum(10.0 + 0.1 * np.cumsum(acceleration - acceleration.mean()), 0.0)
    place = np.column_stack([np.cumsum(0.1 * pace), np.zeros(n_rows)])
    return tracks_of([place], track_id=f"v{i}", time_ns=10**8 * (20 * i + np.arange(n_rows)), speed=pace)


def bent(**changes):
    """A vehicle on a circle of 30 m at 10 m/s beside the traffic, all with positions that err by half a metre."""
    rng = np.random.default_rng(8)
    angle = np.arange(120) / 30.0
    way = 30.0 * np.column_stack([np.cos(angle), np.sin(angle)])
    circle = tracks_of(way[None], track_id="bent", direction=angle + np.pi / 2, speed=10.0)
    parts = [replace(part, position=part.position + rng.normal(0, 0.5, part.position.shape))
             for part in map(driven, range(3))]  # fmt: skip
    whole = Tracks.concatenate([*parts, circle])
    return faults_of(replace(whole, **{name: change(whole) for name, change in changes.items()}))


def faults_of(tracks):
    order = np.lexsort((tracks.time_ns, tracks.vehicle))
    columns = [column[order] for column in (tracks.vehicle, tracks.time_ns, tracks.position)]
    scale = Scale.of(*columns)
    found = find_faults(*columns, direction=tracks.direction[order], speed=tracks.speed[order], scale=scale)
    return list(found.values()) or [wrong for wrong in [wrong_scale(scale)] if wrong]


def latitudes(of, apart=0.0):
    return [10.39, 63.43] + 9e-6 * of.position + apart * of.vehicle[:, None]


UNITS = {
    "are they in km/h in place of m/s?": {"speed": lambda of: 3.6 * of.speed},
    "are they in mph in place of m/s?": {"speed": lambda of: 2.237 * of.speed},
    "are they in knots in place of m/s?": {"speed": lambda of: 1.944 * of.speed},
    "speeds are 0 where positions move": {"speed": lambda of: 0.0 * of.speed},
    "are they in another unit in place of m/s?": {"speed": lambda of: 0.1 * of.speed},
    "are courses in degrees, or from north? They are not used": {
        "direction": lambda of: wrap(np.rad2deg(of.direction) + 20.0)},
    "are courses from north, clockwise?": {"direction": lambda of: np.pi / 2 - of.direction},
    "all positions lie within 0.5 m: are they degrees?": {"position": latitudes},
    "speeds lead thousands": {"position": lambda of: latitudes(of, apart=9.0)},
    "m: are they degrees?": {"position": latitudes, "speed": lambda of: 1e-5 * of.speed},
}  # fmt: skip


@pytest.mark.parametrize("said", UNITS)
def test_columns_in_another_unit_are_reported_and_right_ones_are_not(said):
    (line,) = bent(**UNITS[said])
    assert said in line
    assert bent() == faults_of(driven(0)) == faults_of(driven(0)[:0]) == []


N_ROWS = 100


def circling(*, dt_s=0.1, speed=10.0, noise=0.0, jitter=0.0, radius_s=6.0, n_vehicles=10, seed=0):
    """Vehicles on circles, a turn in some six times `radius_s`; in order of vehicle and time."""
    rng = np.random.default_rng(seed)
    shape = (n_vehicles, N_ROWS)
    time_s = np.arange(N_ROWS) * dt_s + jitter * dt_s * rng.random(shape) + 3.0 * dt_s * rng.random((n_vehicles, 1))
    pace = speed * np.exp(0.3 * rng.standard_normal((n_vehicles, 1)))
    angle = time_s / radius_s + 6.0 * rng.random((n_vehicles, 1))
    way = pace[..., None] * radius_s * np.stack([np.cos(angle), np.sin(angle)], axis=-1)
    way += 300.0 * rng.uniform(-1, 1, (n_vehicles, 1, 2)) + noise * rng.standard_normal((*shape, 2))
    time_ns = np.round(time_s * 1e9).astype(np.int64).ravel()
    return np.repeat(np.arange(n_vehicles), N_ROWS), time_ns, way.reshape(-1, 2)


def jumps_of(vehicle, time_ns, position):
    order = np.lexsort((time_ns, vehicle))
    rows = vehicle[order], time_ns[order], position[order]
    return order, Jumps.of(*rows, Scale.of(*rows))


HONEST = {
    "cars": {}, "people": {"speed": 1.4, "noise": 0.3}, "a detector of 5 m": {"noise": 5.0},
    "GPS each second": {"dt_s": 1.0, "noise": 5.0},
    "buses each 5 min": {"dt_s": 300.0, "radius_s": 900.0, "noise": 20.0},
    "aircraft each 10 s": {"dt_s": 10.0, "speed": 250.0, "radius_s": 80.0}, "jets": {"speed": 500.0, "radius_s": 20.0},
    "aircraft each 10 min": {"dt_s": 600.0, "speed": 250.0, "radius_s": 3000.0}, "race": {"dt_s": 0.02, "speed": 70.0},
    "stamps by arrival": {"jitter": 0.95}, "parked": {"speed": 1e-4, "noise": 0.02}, "simulated": {"dt_s": 0.001},
}  # fmt: skip


@pytest.mark.parametrize("name", HONEST)
def test_honest_motion_of_any_scale_has_no_jumps_and_a_right_scale(name):
    rows = circling(**HONEST[name])
    assert not jumps_of(*rows)[1].at.size
    assert wrong_scale(Scale.of(*rows)) == ""


@pytest.mark.parametrize("name", ["cars", "people", "GPS each second", "aircraft each 10 s"])
@pytest.mark.parametrize("share", [0.02, 0.2])
def test_rows_at_placeholders_are_left_out_and_no_other(name, share):
    vehicle, time_ns, position = circling(**HONEST[name])
    wrong = np.random.default_rng(1).random(vehicle.size) < share
    position[wrong] = -9e5
    order, found = jumps_of(vehicle, time_ns, position)
    assert not found.part.any()
    np.testing.assert_array_equal(found.left_out, wrong[order])


def test_placeholders_at_an_end_and_outliers_are_left_out():
    vehicle, time_ns, position = circling()
    row = np.arange(vehicle.size) % N_ROWS
    position[row >= 70] = 0.0
    position[row == 30] += np.random.default_rng(2).normal(0.0, 400.0, (10, 2))
    order, found = jumps_of(vehicle, time_ns, position)
    np.testing.assert_array_equal(found.left_out, ((row >= 70) | (row == 30))[order])


def test_an_id_that_is_given_again_or_to_two_at_once_is_taken_apart():
    vehicle, time_ns, position = circling()
    again = np.arange(vehicle.size) % N_ROWS >= 50
    order, found = jumps_of(vehicle, time_ns, position + 388.0 * again[:, None])
    np.testing.assert_array_equal(found.part, again[order])
    both = np.tile(vehicle, 2), np.append(time_ns, time_ns + 33_000_000), np.append(position, position + 300.0, axis=0)
    order, found = jumps_of(*both)
    second = order >= vehicle.size
    for part, is_second in zip(found.part.reshape(10, -1), second.reshape(10, -1), strict=True):
        assert (part == (is_second ^ is_second[0])).all()  # which of the two is first is by time
    assert not found.left_out.any()


TIMES = {1e3: "ms in place of s", 1e-3: "us in place of ns", 1e-6: "ms in place of ns", 1e-9: "s in place of ns"}


@pytest.mark.parametrize(("factor", "said"), TIMES.items())
def test_times_in_another_unit_are_named(factor, said):
    vehicle, time_ns, position = circling()
    time_ns = (time_ns * factor).astype(np.int64)
    kept = (np.diff(time_ns, prepend=-1) != 0) | (np.diff(vehicle, prepend=-1) != 0)
    assert f"times in {said}" in wrong_scale(Scale.of(vehicle[kept], time_ns[kept], position[kept]))
    assert "degrees" in wrong_scale(Scale.of(*circling()[:2], 1e-5 * position))


def test_a_town_in_centimetres_is_asked_about_and_no_jet_is():
    for factor, speed in ((100.0, 8.0), (1.0, 500.0)):
        vehicle, time_ns, position = circling(speed=speed, radius_s=5.0 if factor > 1 else 20.0)
        scale = Scale.of(vehicle, time_ns, factor * position)
        unknown = np.full(vehicle.size, np.nan)
        asked = find_faults(vehicle, time_ns, factor * position, direction=unknown, speed=unknown, scale=scale)
        assert ("centimetres" in "".join(asked.values())) == (factor > 1)
        assert wrong_scale(scale) == "" or factor > 1
