"""A map by hour: trackers and forecasters move by the hour of what they see, and go on to the next with it."""

from dataclasses import replace

import numpy as np
import pytest

from dirprim_filter.config import FilterConfig
from dirprim_filter.detections import Detections
from dirprim_filter.filtering import Tracker
from dirprim_filter.forecasting import Forecaster
from dirprim_filter.primitives.schedule import HOUR_NS, Schedule
from dirprim_filter.sensor import AxisError, Sensor
from situations import TRUSTING

FEW = FilterConfig(n_particles=20)
SENSOR = Sensor(along=AxisError(spread_m=0.3), across=AxisError(spread_m=0.3))


@pytest.fixture(scope="module")
def by_hour(ring_map):
    """At half the pace in the first hour."""
    own = ring_map.n_own_modes
    pace = np.ones((24, ring_map.tessellation.n_cells, own))
    pace[0] = 0.5
    return replace(ring_map, schedule=Schedule(by="hour", zone="UTC", flow=np.ones(pace.shape), pace=pace))


def tracked(model, begin_ns, sensor=None):
    """Means and rollouts of a vehicle on the ring, frame by frame, 0.5 s apart."""
    tracker = Tracker(model, config=FEW, tracking=TRUSTING, sensor=sensor, rng=np.random.default_rng(0))
    forecaster, said, path = Forecaster(model, [], config=FEW, rng=np.random.default_rng(0)), [], []
    for i in range(5):
        angle = 0.2 * i
        position = 20.0 * np.array([[np.cos(angle), np.sin(angle)]])
        tracker.predict(Detections(track_id=np.array(["a"]), time_ns=[begin_ns + i * 5 * 10**8], position=position))
        tracker.weigh()
        frame = tracker.frame()
        said.append(np.append(frame.estimates.position[0], frame.estimates.speed[0]))
        forecaster.write(frame)
        path.append(forecaster.paths(frame))
        tracker.resample()
    return np.array(said), np.array(path)


@pytest.mark.parametrize("sensor", [None, SENSOR])
def test_the_hour_of_the_log_decides(by_hour, ring_map, sensor):
    jam, noon = 10**9, 5 * HOUR_NS
    for time_ns, fixed, other in ((jam, by_hour.at_time(jam), ring_map), (noon, ring_map, by_hour.at_time(jam))):
        for ours, same, wrong in zip(*(tracked(of, time_ns, sensor) for of in (by_hour, fixed, other)), strict=True):
            np.testing.assert_allclose(ours, same, rtol=1e-9)
            assert not np.allclose(ours, wrong)


def test_over_the_hour_it_goes_on_by_the_next(by_hour, ring_map):
    begin_ns = HOUR_NS - 13 * 10**8  # three frames before
    crossing, slow, usual = (tracked(of, begin_ns) for of in (by_hour, by_hour.at_time(0), ring_map))
    np.testing.assert_allclose(crossing[0][:3], slow[0][:3], rtol=1e-9)
    assert not np.allclose(crossing[0][-1], slow[0][-1], rtol=1e-7)
    assert not np.allclose(crossing[0][-1], usual[0][-1], rtol=1e-7)
