"""What people give by mistake, to functions and as settings, ends in a line that says what was expected."""

import re
from dataclasses import fields, replace
from typing import Any

import numpy as np
import pytest

from dirprim_filter import Detections, FilterConfig, Tracker, Tracks, forecast, learn_primitives, save_map, write_tracks
from dirprim_filter.config import LearningConfig, TrackingConfig
from dirprim_filter.distributions import Gamma
from dirprim_filter.recording.tables.datasets import read_sdd
from dirprim_filter.recording.writer import EstimateWriter
from dirprim_filter.sensor import AxisError, Sensor
from situations import estimates_by, one_cell_map, ring_traffic

RNG = np.random.default_rng(0)
STATE = {"position": (0.0, 0.0), "direction": 0.0, "speed": 5.0, "rng": RNG}
GENERATOR = "rng: expected a Generator, such as np.random.default_rng(0), got 0"
DEGREES = "direction: expected radians, at most a turn (np.deg2rad converts degrees), got 90.0 in row 1"


@pytest.fixture
def a_map():
    return one_cell_map()


def tracks(**changes):
    known = {"track_id": [0, 0], "time_ns": [0, 10**8], "position": np.zeros((2, 2)), "direction": [0.0, 0.1]}
    return Tracks(**known | {"speed": [1.0, 1.0]} | changes)


def seen(**changes):
    known = {"track_id": np.array(["a"]), "time_ns": np.array([0]), "position": np.zeros((1, 2))}
    return Detections(**known | changes)


def tracker(model, **given):
    return Tracker(model, **{"rng": RNG, "config": FilterConfig(n_particles=5)} | given)


CALLS = {
    "learn, rng": (lambda _: learn_primitives(tracks(), rng=0), GENERATOR),
    "learn, config": (lambda _: learn_primitives(tracks(), config={}, rng=RNG), "config: expected a Learning"),
    "learn, path": (lambda _: learn_primitives("log.mcap", rng=RNG), "tracks: expected a Tracks, as read_tra"),
    "learn, paths": (lambda _: learn_primitives(["log.mcap"], rng=RNG), "tracks: expected a Tracks, as read"),
    "tracker, rng": (lambda m: tracker(m, rng=0), GENERATOR),
    "tracker, config": (lambda m: tracker(m, config={}), "config: expected a FilterConfig, got {}"),
    "tracker, tracking": (lambda m: tracker(m, tracking=FilterConfig()), "tracking: expected a TrackingCon"),
    "tracker, path": (lambda _: tracker("m.mcap"), "model: expected a map or a filter, got the path 'm.mcap'"),
    "tracker, sensor": (lambda m: tracker(m, sensor="s.toml"), "sensor: expected a Sensor, as load_sensor rea"),
    "step, tracks": (lambda m: tracker(m).step(tracks()), "detections: expected a Detections, got Tracks("),
    "step, instants": (lambda m: tracker(m).step(Detections.of(tracks())), "see Detections.frames"),
    "tracks, degrees": (lambda _: tracks(direction=[0.0, 90.0]), DEGREES),
    "tracks, heading": (lambda _: tracks(heading=[0.0, 90.0]), DEGREES.replace("direction", "heading")),
    "forecast, path": (lambda _: forecast("m.mcap", **STATE), "expected a PrimitiveMap, as load_map reads it"),
    "forecast, rng": (lambda m: forecast(m, **STATE | {"rng": 0}), GENERATOR),
    "forecast, config": (lambda m: forecast(m, config={}, **STATE), "config: expected a FilterConfig, got {}"),
    "forecast, degrees": (lambda m: forecast(m, **STATE | {"direction": 90.0}), DEGREES.replace("row 1", "row 0")),
    "sample, rng": (lambda m: m.sample(np.zeros((1, 2)), rng=0), GENERATOR),
    "gamma": (lambda _: Gamma(shape=np.zeros(1), rate=np.ones(1)), "shape, rate: expected positive numbers"),
    "draw, fewer than none": (lambda m: m.direction.sample(n_samples=-1, rng=RNG), "n_samples: expected no negative"),
    "write, stride": (lambda _: EstimateWriter("x", metadata={}, particle_stride=0), "particle_stride: expected at"),
    "read, scale": (lambda _: read_sdd("x", metres_per_pixel=0.0), "metres_per_pixel: expected a positive number"),
    "write, swapped": (lambda _: write_tracks("t.mcap", tracks()), "tracks: expected a Tracks, as read_tracks"),
    "save, swapped": (lambda m: save_map("m.mcap", m), "primitive_map: expected a PrimitiveMap, as load_map"),
}

NO_FORECAST = {
    ("speed", -1.0): "at least 0 m/s", ("speed", np.nan): "speed: expected finite", ("n_samples", 0): "one sample",
    ("direction", np.inf): "direction: expected finite", ("position", (0.0, np.nan)): "position: expected finite",
    ("position", (0.0, 0.0, 0.0)): "position: expected shape (2)", ("horizon_s", 0.1): "at least one step",
    ("horizon_s", np.inf): "horizon_s: expected finite", ("dt_s", -0.5): "at least one step",
    ("dt_s", np.nan): "dt_s: expected finite",
}  # fmt: skip
CALLS |= {
    f"forecast, {name} {value}": (lambda m, c={name: value}: forecast(m, **STATE | c), said)
    for (name, value), said in NO_FORECAST.items()
}


@pytest.mark.parametrize("call", CALLS)
def test_a_wrong_argument_is_one_line(call, a_map):
    made, said = CALLS[call]
    with pytest.raises((TypeError, ValueError), match=re.escape(said)) as error:
        made(a_map)
    assert call == "step, tracks" or "\n" not in str(error.value)


def test_unsorted_rows_are_put_in_order():
    assert tracks(time_ns=[10**8, 0], direction=[0.1, 0.0]) == tracks()
    assert [int(f.time_ns[0]) for f in Detections.of(tracks(time_ns=[10**8, 0])).frames()] == [0, 10**8]


LASTING = AxisError(spread_m=0.5, correlated_share=0.5)
SERIES = ("cell_sizes", "rows_per_cell")
MAY_BE_OFF = (
    "outlier_probability", "motion_outlier_probability", "resample_below", "innovation_outlier_rate", "own_way_rate",
)  # fmt: skip
MAY_BE_0 = (*MAY_BE_OFF, "broad_share", "occlusion_rate", "departure_rate")
SETTINGS = [
    (kind, f.name) for kind in (FilterConfig, LearningConfig, TrackingConfig) for f in fields(kind)
    if f.name != "interaction"
]  # fmt: skip


@pytest.mark.parametrize(("kind", "name"), SETTINGS)
@pytest.mark.parametrize("value", [0, -1.0, np.nan, 1e10])
def test_a_setting_out_of_range_is_refused_by_name(kind, name, value):
    if value == 0 and name in MAY_BE_0:
        assert getattr(kind(**{name: value}), name) == 0
        return
    for given in ((3.0, value), (value,), ()) if name in SERIES else (value,):
        expected = "a positive number|at least 0|at most 1e.09|a share below 1"
        with pytest.raises(ValueError, match=f"{name}: expected ({expected}), got"):
            kind(**{name: given})


@pytest.mark.parametrize("name", [*MAY_BE_OFF, "interaction"])
@pytest.mark.parametrize("sensor", [None, Sensor(along=LASTING, across=LASTING)])
def test_every_mechanism_can_be_off_and_vehicles_are_tracked_nonetheless(ring_map, name, sensor):
    off: dict[str, Any] = {name: "none" if name == "interaction" else 0.0}
    config = FilterConfig(n_particles=200, **off)
    truth = ring_traffic(np.random.default_rng(0), n_vehicles=3, n_rows=40)
    rng = np.random.default_rng(1)
    noisy = truth.position + 0.5 * rng.standard_normal(truth.position.shape)
    seen = replace(Detections.of(truth), position=noisy, direction=truth.direction, speed=truth.speed)
    found = estimates_by(Tracker(ring_map, config=config, sensor=sensor, rng=rng), seen)
    last = found[found.time_ns == truth.time_ns.max()]
    assert len(last) == 3
    true = truth.position[truth.time_ns == truth.time_ns.max()]
    assert np.hypot(*(last.position - true).T).max() < 3.0  # six standard deviations of a detection


@pytest.mark.parametrize(
    ("kind", "given", "message"),
    [
        (FilterConfig, {"outlier_probability": 1.5}, "outlier_probability: expected a share below 1, got 1.5"),
        (FilterConfig, {"motion_outlier_probability": 1.5}, "expected a share below 1, got 1.5"),
        (FilterConfig, {"resample_below": 1.5}, "resample_below: expected a share of the particles, got 1.5"),
        (FilterConfig, {"step_s": 1e-300}, "step_s: expected at least 0.001 s, got 1e-300"),
        (FilterConfig, {"interaction": "all"}, "interaction: expected 'none' or 'leader', got 'all'"),
        (TrackingConfig, {"report_above": 0.95}, "report_above: expected at most confirm_above, 0.9, got 0.95"),
    ],
)
def test_what_a_number_alone_does_not_show_is_refused_by_name(kind, given, message):
    with pytest.raises(ValueError, match=message):
        kind(**given)
