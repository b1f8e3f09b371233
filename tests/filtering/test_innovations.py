"""Innovations are chi-squared where the filter is right, and reinitialised beliefs are reported."""

import numpy as np

from dirprim_filter.config import FilterConfig
from dirprim_filter.detections import Detections
from dirprim_filter.filtering import Tracker
from dirprim_filter.replay import replay
from dirprim_filter.sensor import AxisError, Sensor
from situations import TRUSTING, one_cell_map


class Frames(list):
    def write(self, frame):
        self.append(frame)


def tracked(*, noise_m, n_vehicles=40, n_frames=25, jump_at=None, with_innovations=True):
    """Vehicles that drive east at 10 m/s, measured with 0.5 m of noise."""
    rng = np.random.default_rng(1)
    t = np.arange(n_frames) * 0.1
    place = np.stack(np.broadcast_arrays(10.0 * t[:, None], 20.0 * np.arange(n_vehicles)), axis=-1)
    measured = place + rng.normal(0, 0.5, place.shape)
    if jump_at is not None:
        measured[jump_at:, 0] += 60.0
    seen = Detections(
        track_id=np.tile(np.arange(n_vehicles), n_frames).astype(np.str_),
        time_ns=np.repeat((t * 1e9).round().astype(np.int64), n_vehicles),
        position=measured.reshape(-1, 2),
    )
    primitive_map = one_cell_map(speed=10.0, shape=1e4, concentration=1e4)
    config = FilterConfig(n_particles=600, noise_m=noise_m)
    frames = Frames()
    tracker = Tracker(
        primitive_map, config=config, tracking=TRUSTING, with_innovations=with_innovations, rng=np.random.default_rng(2)
    )
    replay(seen.frames(), tracker, [frames])
    return frames


def test_squared_innovations_have_a_mean_of_two_where_the_filter_is_right():
    frames = tracked(noise_m=0.5)
    assert np.isnan(frames[0].innovations).all()  # all were new
    assert np.isnan(frames[0].expected).all()
    squared = np.concatenate([frame.innovations for frame in frames[5:]])
    off = np.concatenate([frame.detections.position - frame.expected for frame in frames[5:]])
    assert 0.5 < np.std(off) < 0.65  # the noise, and what was unknown of where they are
    # 800 of them, chi-squared of two degrees of freedom and nearly independent: deviation of the mean 2 / sqrt(800).
    # Four of these deviations, and 10 % for what the motion model adds: false alarms below one in 10,000.
    assert abs(squared.mean() - 2.0) < 4 * 2.0 / np.sqrt(squared.size) + 0.2
    too_sure = np.concatenate([frame.innovations for frame in tracked(noise_m=0.3)[5:]])
    assert too_sure.mean() > 3.0  # the negative control


def test_a_tracker_goes_by_all_that_its_sensor_states():
    """Bias and spread along and across turn with the vehicle; misses, clutter and outliers are the sensor's."""
    sensor = Sensor(
        along=AxisError(spread_m=1.5, bias_m=-2.0), across=AxisError(spread_m=0.3, bias_m=0.5),
        detection_probability=0.6, clutter_density=1e-12, outlier_share=0.02,
    )  # fmt: skip
    rng, course, squared = np.random.default_rng(3), 0.7, []
    turned = np.array([[np.cos(course), -np.sin(course)], [np.sin(course), np.cos(course)]])
    tracker = Tracker(
        one_cell_map(mean=course, shape=1e4, concentration=1e4), config=FilterConfig(n_particles=600),
        sensor=sensor, with_innovations=True, rng=rng,
    )  # fmt: skip
    assert (tracker.tracking.detection_probability, tracker.tracking.clutter_density) == (0.6, 1e-12)
    assert (tracker.config.outlier_probability, tracker.config.noise_m) == (0.02, sensor.noise_m)
    for i in range(25):
        off = rng.normal([i - 2.0, 0.5], [1.5, 0.3], (40, 2))
        place = off @ turned.T + 30.0 * np.arange(40)[:, None] * turned[:, 1]
        frame = tracker.track(Detections(track_id=np.arange(40), time_ns=np.full(40, i * 10**8), position=place))
        squared += [frame.innovations] if i > 4 else []
    assert abs(np.mean(squared) - 2.0) < 4 * 2.0 / np.sqrt(np.size(squared)) + 0.2  # as above


def test_who_is_reinitialised_is_named_and_none_but_on_request_are_reported():
    frames = tracked(noise_m=0.5, n_vehicles=3, n_frames=12, jump_at=6)
    anew = {i: frame.reinitialised for i, frame in enumerate(frames) if frame.reinitialised}
    assert anew
    assert set(anew[min(anew)]) <= {"0"}
    assert min(anew) >= 6
    quiet = tracked(noise_m=0.5, n_vehicles=3, n_frames=12, jump_at=6, with_innovations=False)
    assert all(frame.innovations is None for frame in quiet)
    assert [frame.reinitialised for frame in quiet] == [frame.reinitialised for frame in frames]
    for a, b in zip(quiet, frames, strict=True):  # asking changes nothing
        assert (a.estimates.position == b.estimates.position).all()
