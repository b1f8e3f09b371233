"""A sensor's model without a truth: its likelihood against the dense normal density; what was put in comes out."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.linalg import null_space
from scipy.stats import multivariate_normal

from dirprim_filter.evaluation.calibration import self_calibrate, self_calibration
from dirprim_filter.evaluation.calibration.evidence import N_SHARED, Evidence
from dirprim_filter.evaluation.calibration.windows import Windows, without_strays
from dirprim_filter.sensor import AxisError, Sensor
from dirprim_filter.simulation.sensor import sense
from evaluation.test_calibration import circling

SENSOR = Sensor(
    along=AxisError(spread_m=0.5), across=AxisError(spread_m=0.25), detection_probability=0.85, clutter_density=1e-4
)
DRIVEN = circling(12, 40)


@pytest.fixture(autouse=True)
def _few_steps(monkeypatch):
    """Enough for so few windows."""
    monkeypatch.setattr(self_calibration, "MOST_STEPS", 25)


def two_windows():
    """Of 9 and 6 detections at uneven times, the second padded."""
    rng, n = np.random.default_rng(2), 9
    time_s = np.cumsum(rng.uniform(0.1, 0.3, (2, n)), axis=1)
    angle = np.cumsum(rng.normal(0, 0.2, (2, n)), axis=1)
    known = np.arange(n) < np.array([[9], [6]])
    return Windows(
        (time_s - time_s[:, :1]) * known, rng.normal(size=(2, n, 2)) * known[..., None],
        np.stack([np.cos(angle), np.sin(angle)], axis=-1) * known[..., None], known,
    )  # fmt: skip


def minus_log_density(windows, parameters):
    """One window at a time, by the whole covariance of what is orthogonal to a start and a velocity."""
    (s, share, lasts), (s2, share2, lasts2), (a, t, a2, t2) = np.split(parameters[:N_SHARED], [3, 6])
    differ = parameters[N_SHARED:].reshape(2, -1)
    total = 0.0
    for w, known in enumerate(windows.known):
        time_s, z, u = windows.time_s[w][known], windows.position[w][known], windows.along[w][known]
        lag, n = np.abs(time_s[:, None] - time_s), time_s.size
        fine = np.linspace(0.0, time_s[-1], 20_001)
        hats = np.array([np.interp(fine, time_s, unit) for unit in np.eye(n)])
        step = fine[1]
        velocity = step * (np.cumsum(hats, axis=1) - 0.5 * hats - 0.5 * hats[:, :1])
        place = step * (np.cumsum(velocity, axis=1) - 0.5 * velocity)
        integral = np.array([np.interp(time_s, fine, of) for of in place]).T
        covariance = np.zeros((2 * n, 2 * n))
        for unit, spread, logit, seconds, size, time in (
            (u, s, share, lasts, a + differ[0, w], t),
            (np.column_stack([-u[:, 1], u[:, 0]]), s2, share2, lasts2, a2 + differ[1, w], t2),
        ):
            part = 1.0 / (1.0 + np.exp(-logit))
            error = np.exp(2 * spread) * (part * np.exp(-lag / np.exp(seconds)) + (1 - part) * np.eye(n))
            motion = np.exp(2 * size) * np.exp(-lag / np.exp(time))
            for i in range(2):
                for j in range(2):
                    both = np.outer(unit[:, i], unit[:, j])
                    covariance[i * n : i * n + n, j * n : j * n + n] += both * error
                    covariance[i * n : i * n + n, j * n : j * n + n] += integral @ (both * motion) @ integral.T
        left = null_space(np.kron(np.eye(2), np.column_stack([np.ones(n), time_s]).T))
        total -= multivariate_normal(cov=left.T @ covariance @ left).logpdf(left.T @ z.T.ravel())
    return total + 0.5 * (differ**2).sum()


def test_the_evidence_is_that_of_the_whole_covariance_and_its_gradient_is_its_slope():
    windows = two_windows()
    evidence, rng = Evidence(windows), np.random.default_rng(4)
    one, other = rng.normal(0, 0.4, (2, N_SHARED + 4))
    expected = minus_log_density(windows, one) - minus_log_density(windows, other)
    assert abs(expected) > 1.0
    assert evidence(one)[0] - evidence(other)[0] == pytest.approx(expected, abs=1e-4)
    slope = [(evidence(one + h)[0] - evidence(one - h)[0]) / 2e-5 for h in 1e-5 * np.eye(one.size)]
    np.testing.assert_allclose(evidence(one)[1], slope, atol=1e-5)


def test_white_errors_are_found_and_larger_ones_are_larger():
    found = self_calibrate(sense(DRIVEN, SENSOR, rng=np.random.default_rng(1)), rng=np.random.default_rng(0))
    assert found.sensor.along.spread_m == pytest.approx(0.5, rel=0.15)
    assert found.sensor.across.spread_m == pytest.approx(0.25, rel=0.15)
    assert found.sensor.detection_probability == pytest.approx(0.85, abs=0.03)
    assert found.sensor.clutter_density == pytest.approx(1e-4, rel=0.15)
    assert (found.sensor.latency_s, found.sensor.along.bias_m) == (0.0, 0.0)
    assert found.unknown[0].startswith("latency_s, along.bias_m, across.bias_m: ")


def test_errors_that_last_are_not_taken_for_white():
    lasting = AxisError(spread_m=0.5, correlated_share=0.9, correlation_s=0.4)
    seen = sense(DRIVEN, replace(SENSOR, along=lasting), rng=np.random.default_rng(1))
    found = self_calibrate(seen, rng=np.random.default_rng(0)).sensor
    assert found.along.correlated_share > 0.6
    assert found.across.correlated_share < 0.3
    assert found.along.spread_m == pytest.approx(0.5, rel=0.3)  # what lasts is partly taken for the way


def test_strays_are_found_and_nothing_else():
    seen = sense(DRIVEN, replace(SENSOR, clutter_density=None), rng=np.random.default_rng(1))
    order = np.argsort(seen.time_ns, kind="stable")
    rows = order[40 : len(seen) - 40 : 90]
    moved = seen.position.copy()
    moved[rows] += 12.0
    kept, n_stray, n_judged = without_strays(replace(seen, position=moved))
    assert n_stray == rows.size
    assert len(seen) - 4 * DRIVEN.n_tracks < n_judged < len(seen)
    np.testing.assert_array_equal(kept.position, np.delete(moved, rows, axis=0))


def test_what_tells_nothing_of_a_sensor_is_refused(monkeypatch):
    seen = sense(DRIVEN, SENSOR, rng=np.random.default_rng(1))
    with pytest.raises(ValueError, match="expected detections with ids"):
        self_calibrate(seen.without_ids(), rng=np.random.default_rng(0))
    few = seen[np.isin(seen.track_id, ["v1", "v2", "v3", "v4"])]
    with pytest.raises(ValueError, match="at least 8 pieces of track of moving vehicles, got 4: state the noise"):
        self_calibrate(few, rng=np.random.default_rng(0))
    lasting = AxisError(spread_m=0.3, correlated_share=0.999, correlation_s=1.0)
    smooth = sense(DRIVEN, Sensor(along=lasting, across=lasting), rng=np.random.default_rng(1))
    monkeypatch.setattr(self_calibration, "MOST_STEPS", 60)
    with pytest.raises(ValueError, match="as smooth as ways are"):
        self_calibrate(smooth, rng=np.random.default_rng(0))
    monkeypatch.setattr(self_calibration, "MOST_STEPS", 1)  # what is found of errors is not looked at
    each = np.argsort(np.argsort(seen.time_ns, kind="stable"), kind="stable")
    apart = replace(seen, time_ns=seen.time_ns + each)  # each vehicle reports at times of its own
    found = self_calibrate(apart, rng=np.random.default_rng(0))
    assert found.sensor.detection_probability is None
    assert any(line.startswith("detection_probability, clutter_density: frames") for line in found.unknown)
