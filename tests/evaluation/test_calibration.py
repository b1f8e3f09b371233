"""A sensor's model measured against the truth: what was put in comes out, within what is said to be uncertain."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.stats import multivariate_normal

from dirprim_filter.detections import Detections
from dirprim_filter.distributions.angles import wrap
from dirprim_filter.evaluation.calibration.calibrating import calibrate
from dirprim_filter.evaluation.calibration.gauss_markov import Profile
from dirprim_filter.sensor import AxisError, Sensor, without_bias
from dirprim_filter.tracks import Tracks
from sensing import sense
from situations import tracks_of

WHITE = Sensor(
    along=AxisError(spread_m=0.5), across=AxisError(spread_m=0.3), detection_probability=0.9, clutter_density=2e-5
)
CORRELATED = Sensor(
    along=AxisError(spread_m=0.6, correlated_share=0.8, correlation_s=0.5),
    across=AxisError(spread_m=0.3, correlated_share=0.6, correlation_s=0.8),
    detection_probability=0.8, outlier_share=0.02,
)  # fmt: skip
BIASED = replace(
    CORRELATED, latency_s=0.3, along=replace(CORRELATED.along, bias_m=0.8),
    across=replace(CORRELATED.across, bias_m=-0.2), outlier_share=None,
)  # fmt: skip


def circling(n_vehicles=15, n_rows=100, speeds=(2.0, 12.0)):
    """Vehicles on circles about places of their own, each faster and slower again."""
    turns = np.random.default_rng(5)
    time_s = 0.1 * np.arange(n_rows)
    parts = []
    for i in range(n_vehicles):
        low, high = np.sort(turns.uniform(*speeds, 2))
        speed = low + (high - low) * (0.5 + 0.5 * np.sin(0.7 * time_s + i))
        angle = np.cumsum(speed) * 0.1 / 30.0 + i
        place = 30.0 * np.column_stack([np.cos(angle), np.sin(angle)]) + 80.0 * np.array([i % 4, i // 4])
        parts.append(tracks_of([place], track_id=f"v{i}", direction=wrap(angle + 0.5 * np.pi), speed=speed))
    return Tracks.concatenate(parts)


TRUTH = circling()


@pytest.mark.parametrize("sensor", [WHITE, CORRELATED, BIASED], ids=["white", "correlated", "biased"])
def test_what_was_put_in_comes_out(sensor):
    found = calibrate(sense(TRUTH, sensor, rng=np.random.default_rng(1)), TRUTH).sensor
    reported = found.numbers()
    for name, value in sensor.numbers().items():
        if name in found.uncertainty and value is not None:
            assert abs(reported[name] - value) <= found.uncertainty[name], name
    for axis in ("along", "across"):
        assert getattr(found, axis).correlated_share > 0 or sensor is WHITE
    assert found.latency_s == pytest.approx(sensor.latency_s, abs=0.05)


def test_no_interval_is_wide_enough_for_another_sensor():
    """The negative control: the biased sensor is none of the intervals of the white one."""
    found = calibrate(sense(TRUTH, BIASED, rng=np.random.default_rng(1)), TRUTH).sensor
    for name in ("latency_s", "along.bias_m", "across.bias_m", "along.spread_m", "detection_probability"):
        assert abs(found.numbers()[name] - WHITE.numbers()[name]) > found.uncertainty[name], name


def test_what_the_detections_do_not_show_is_said():
    late = sense(TRUTH, WHITE, rng=np.random.default_rng(1))
    found = calibrate(replace(late, time_ns=late.time_ns + 7_300_000_000), TRUTH)
    assert found.clock_offset_s == pytest.approx(7.3, abs=0.05)
    assert found.sensor.latency_s == 0.0
    assert "latency_s" not in found.sensor.uncertainty
    assert any(line.startswith("latency_s: the clocks differ") for line in found.unknown)
    some = TRUTH[np.isin(TRUTH.track_id, ["v0", "v3", "v7", "v9"])]
    found = calibrate(sense(TRUTH, WHITE, rng=np.random.default_rng(1)).without_ids(), some)
    assert {line.partition(":")[0] for line in found.unknown} == {"outlier_share", "clutter_density"}
    assert found.sensor.clutter_density is None
    assert abs(found.sensor.along.spread_m - WHITE.along.spread_m) <= found.sensor.uncertainty["along.spread_m"]
    alike = circling(n_vehicles=4, speeds=(8.0, 8.0001))
    found = calibrate(sense(alike, replace(WHITE, latency_s=0.2), rng=np.random.default_rng(1)), alike)
    assert any(line.startswith("latency_s: vehicles drive too alike") for line in found.unknown)


@pytest.mark.parametrize(
    ("moved", "says"),
    [
        (lambda d: replace(d, time_ns=d.time_ns + 7_200_000_000_000), "are the clocks hours apart"),
        (lambda d: replace(d, position=d.position + 1e5), "expected vehicles that the detections show"),
        (lambda d: Detections.none(), "expected detections and a truth"),
    ],
)
def test_what_has_nothing_in_common_is_refused(moved, says):
    seen = sense(TRUTH, WHITE, rng=np.random.default_rng(1))
    with pytest.raises(ValueError, match=says):
        calibrate(moved(seen), TRUTH)


def test_the_likelihood_of_errors_is_that_of_their_covariance():
    """Against the dense normal density, of two series at uneven times."""
    rng, share, seconds = np.random.default_rng(3), 0.7, 0.4
    time_s, is_first = np.array([0.0, 0.1, 0.25, 0.5, 0.0, 0.1, 0.4]), np.array([1, 0, 0, 0, 1, 0, 0], bool)
    y, gap_s = rng.normal(size=7), np.where(is_first, np.inf, np.diff(time_s, prepend=0.0))
    found = Profile(y, np.ones((7, 1)), gap_s, share, seconds)
    series = np.cumsum(is_first)
    kernel = np.exp(-np.abs(time_s[:, None] - time_s) / seconds) * (series[:, None] == series)
    covariance = found.spread**2 * (share * kernel + (1 - share) * np.eye(7))
    assert found.log_likelihood == pytest.approx(multivariate_normal(np.full(7, found.mean[0]), covariance).logpdf(y))
    weight = np.linalg.solve(covariance, np.ones(7))
    assert found.mean[0] == pytest.approx(weight @ y / weight.sum())
    assert found.mean_se[0] == pytest.approx(weight.sum() ** -0.5)


def test_tracks_without_bias_are_of_where_vehicles_were():
    """What a sensor with a bias and nothing else reports, moved back: the truth itself."""
    exact = Sensor(along=AxisError(spread_m=1e-9, bias_m=0.8), across=AxisError(spread_m=1e-9, bias_m=-0.2))
    seen = sense(TRUTH, exact, rng=np.random.default_rng(1))
    order = np.lexsort((seen.track_id, seen.time_ns)), np.lexsort((TRUTH.track_id, TRUTH.time_ns))
    biased = replace(TRUTH[order[1]], position=seen.position[order[0]])
    assert np.abs(biased.position - TRUTH[order[1]].position).max() > 0.5
    np.testing.assert_allclose(without_bias(biased, exact).position, TRUTH[order[1]].position, atol=1e-6)
