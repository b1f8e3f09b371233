"""Vehicles that pass where their sensor does not see: kept behind a blind strip, and expected at the edge of sight."""

from dataclasses import replace

import numpy as np
import pytest

from dirprim_filter.config import FilterConfig, TrackingConfig
from dirprim_filter.filtering import ConstantVelocityKalman, Tracker, existence
from dirprim_filter.filtering.undetected import Undetected
from dirprim_filter.primitives.traffic import Traffic
from dirprim_filter.sensor import Sensor
from dirprim_filter.sight import Sight
from dirprim_filter.simulation.sensor import sense
from dirprim_filter.tracks import Tracks

N_FRAMES, SPEED, GAP_M, RADIUS = 110, 8.0, 14.0, 20.0
BLIND = Sight((((-40.0, -40.0), (-GAP_M, -40.0), (-GAP_M, 40.0), (-40.0, 40.0)),
               ((GAP_M, -40.0), (40.0, -40.0), (40.0, 40.0), (GAP_M, 40.0))))  # fmt: skip
"""Two half planes: between them the ring's vehicles are hidden for about four seconds."""
KNOBS = TrackingConfig(detection_probability=0.95, clutter_density=1e-5, occlusion_rate=0.002)
"""Nothing hides vehicles but that the sensor does not see everywhere."""
EAST = Sight((((0.0, -40.0), (40.0, -40.0), (40.0, 40.0), (0.0, 40.0)),))


def one_vehicle():
    """Once round the ring and on."""
    time_s = 0.1 * np.arange(N_FRAMES)
    angle = SPEED / RADIUS * time_s
    return Tracks(
        track_id=np.full(N_FRAMES, "a"), time_ns=np.round(time_s * 1e9).astype(np.int64),
        position=RADIUS * np.column_stack([np.cos(angle), np.sin(angle)]),
        direction=np.angle(np.exp(1j * (angle + np.pi / 2))), speed=np.full(N_FRAMES, SPEED),
    )  # fmt: skip


def names_while(model, sensor, *, sight):
    """Of the sensor's detections without ids, tracked by a sensor of that sight: estimates of all frames."""
    truth = one_vehicle()
    seen = sense(truth, sensor, rng=np.random.default_rng(0))
    seen = replace(seen, track_id=np.full(len(seen), ""))
    tracker = Tracker(
        model, config=FilterConfig(n_particles=300, noise_m=0.3), tracking=KNOBS, sensor=replace(sensor, sight=sight),
        rng=np.random.default_rng(1),
    )  # fmt: skip
    found = []
    for time_ns in truth.time_ns.tolist():
        tracker.predict(seen[seen.time_ns == time_ns], time_ns=time_ns)
        tracker.weigh()
        found.append(tracker.estimate())
        tracker.resample()
    return found


def test_a_vehicle_behind_a_blind_strip_keeps_its_name_and_without_the_sight_it_is_given_up(ring_map):
    sensor = replace(Sensor.white(0.3), sight=BLIND)
    hidden = np.flatnonzero(~BLIND.sees(one_vehicle().position))
    passed = hidden[:30]
    named, given_up = {}, {}
    for sight in (BLIND, None):
        found = names_while(ring_map, sensor, sight=sight)
        named[sight] = {str(name) for estimates in found for name in estimates.track_id}
        given_up[sight] = sum(len(found[i]) == 0 for i in passed)
    assert len(named[BLIND]) == 1
    assert given_up[BLIND] == 0
    assert given_up[None] > 0


def test_a_simulated_sensor_reports_what_is_in_sight_alone():
    truth, sensor = one_vehicle(), replace(Sensor.white(0.3), clutter_density=1e-3, detection_probability=0.999)
    everywhere, some = (
        sense(truth, replace(sensor, sight=sight), rng=np.random.default_rng(0)) for sight in (None, BLIND)
    )
    is_false = np.char.startswith(some.track_id, "false-")
    assert is_false.any()
    assert BLIND.sees(some.position[is_false]).all()
    seen_ns = truth.time_ns[BLIND.sees(truth.position)]
    assert np.isin(some.time_ns[~is_false], seen_ns).all()
    assert not BLIND.sees(everywhere.position).all()
    assert len(everywhere) > len(some)


def test_misses_say_nothing_out_of_sight_and_the_more_the_likelier_it_is_in_sight():
    believed = np.array([[0.8, 0.1, 0.1]] * 3)
    after = existence.after_miss(believed, KNOBS, np.array([0.0, 0.5, 1.0]))
    np.testing.assert_allclose(after[0], believed[0])
    np.testing.assert_allclose(after[2:], existence.after_miss(believed[2:], KNOBS))
    p = 0.5 * KNOBS.detection_probability  # a miss by a sensor that sees half as much
    np.testing.assert_allclose(after[1], existence.after_miss(believed[:1], replace(KNOBS, detection_probability=p))[0])


def test_who_is_out_of_sight_and_of_the_map_has_left():
    believed = np.array([[0.9, 0.05, 0.05]])
    gone, stays = np.ones(1), np.zeros(1)
    assert existence.probability(believed, gone, 0.0) == pytest.approx(0.0)
    assert existence.probability(believed, stays, 0.0) == pytest.approx(0.95)
    assert existence.probability(believed, gone) == pytest.approx(0.9)  # visible


def test_first_detections_are_expected_where_vehicles_come_into_sight(ring_map):
    traffic = Traffic.of(ring_map.tessellation, ring_map.motion)
    places = RADIUS * np.array([[np.cos(a), np.sin(a)] for a in np.radians([-80.0, 0.0, 80.0])])
    expected = {}
    for sight in (EAST, None):
        undetected = Undetected(traffic, KNOBS, FilterConfig(), sight=sight)
        for _ in range(100):
            undetected.see(np.empty((0, 2)), np.empty(0, np.bool_))
            undetected.advance(0.1, 5.0)
        expected[sight] = undetected.first_detections(places)
    enters, within = expected[EAST][0], expected[EAST][1:]
    assert enters > 4.0 * expected[None][0]  # who is seen everywhere has been found before
    np.testing.assert_allclose(within, expected[None][1:], rtol=1e-6)  # behind the edge all have been found


def test_a_kalman_filter_goes_by_the_sight_as_well():
    config = FilterConfig(noise_m=0.3)
    model = ConstantVelocityKalman(acceleration_density=3.0, config=config)
    sensor = replace(Sensor.white(0.3), sight=EAST)
    believed = {}
    for sight in (EAST, None):
        found = names_while(model, sensor, sight=sight)
        hidden = np.flatnonzero(~EAST.sees(one_vehicle().position))[:15]
        believed[sight] = sum(len(found[i]) for i in hidden)
    assert believed[EAST] == 15
    assert believed[None] < 15
