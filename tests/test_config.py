"""Settings that make no sense are refused by name."""

from dataclasses import fields, replace
from typing import Any

import numpy as np
import pytest

from dirprim_filter.config import FilterConfig, LearningConfig, TrackingConfig
from dirprim_filter.detections import Detections
from dirprim_filter.filtering import Tracker
from dirprim_filter.sensor import AxisError, Sensor
from situations import estimates_by, ring_traffic

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
