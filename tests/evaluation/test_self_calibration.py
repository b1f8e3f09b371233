"""A sensor's model without a truth: its likelihood against the dense normal density; what was put in comes out."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.linalg import null_space
from scipy.stats import multivariate_normal

from dirprim_filter.evaluation.calibration import evidence, self_calibrate, self_calibration
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


def log_density(windows, parameters):
    """One window and one size of acceleration at a time, by the whole covariance of what is orthogonal to a start and a
    velocity; accelerations are held from one detection to the next."""
    (s, share, lasts), (s2, share2, lasts2), (a, t, a2, t2) = np.split(parameters[:10], [3, 6])
    total = 0.0
    for w, known in enumerate(windows.known):
        time_s, z, u = windows.time_s[w][known], windows.position[w][known], windows.along[w][known]
        lag, n, step = np.abs(time_s[:, None] - time_s), time_s.size, np.append(np.diff(time_s), 0.0)
        since_end = time_s[:, None] - (time_s + step)
        integral = np.where(since_end >= -1e-9, step * since_end + 0.5 * step**2, 0.0) * (step > 0)
        left = null_space(np.kron(np.eye(2), np.column_stack([np.ones(n), time_s]).T))
        each = []
        for node in evidence.NODES:
            covariance = np.zeros((2 * n, 2 * n))
            for unit, spread, logit, seconds, size, time in (
                (u, s, share, lasts, a, t), (np.column_stack([-u[:, 1], u[:, 0]]), s2, share2, lasts2, a2, t2),
            ):  # fmt: skip
                part = 1.0 / (1.0 + np.exp(-logit))
                error = np.exp(2 * spread) * (part * np.exp(-lag / np.exp(seconds)) + (1 - part) * np.eye(n))
                motion = np.exp(2 * (size + parameters[10] * node)) * np.exp(-lag / np.exp(time))
                for i in range(2):
                    for j in range(2):
                        both = np.outer(unit[:, i], unit[:, j])
                        covariance[i * n : i * n + n, j * n : j * n + n] += both * error
                        covariance[i * n : i * n + n, j * n : j * n + n] += integral @ (both * motion) @ integral.T
            each.append(multivariate_normal(cov=left.T @ covariance @ left).logpdf(left.T @ z.T.ravel()))
        total += np.log(np.exp(each) @ evidence.WEIGHTS / evidence.WEIGHTS.sum())
    return total


def test_the_evidence_is_that_of_the_whole_covariance():
    windows, rng = two_windows(), np.random.default_rng(4)
    one, other = rng.normal(0, 0.4, (2, evidence.N_PARAMETERS))
    expected = log_density(windows, one) - log_density(windows, other)
    assert abs(expected) > 1.0
    assert evidence.log_evidence(windows, one) - evidence.log_evidence(windows, other) == pytest.approx(
        expected, abs=1e-2
    )  # a place and a velocity that are not known have a large variance there, and an infinite one here


def driven(rng, n_windows, n=40, dt_s=0.1, differ=0.7):
    """Windows of the model itself: straight ways, acceleration and error Gauss-Markov processes."""

    def process(time_s):
        x, kept = rng.standard_normal((n, n_windows)), np.exp(-dt_s / time_s)
        for i in range(1, n):
            x[i] = kept * x[i - 1] + np.sqrt(1 - kept**2) * x[i]
        return x.T

    time_s, position = np.arange(n) * dt_s, np.zeros((n_windows, n, 2))
    size = np.exp(differ * rng.standard_normal(n_windows))[:, None]
    for axis, (spread, share, lasts) in enumerate(((0.6, 0.8, 0.5), (0.3, 0.6, 0.5))):
        velocity = np.cumsum(size * process(2.0) * dt_s, axis=1)
        error = np.sqrt(share) * process(lasts) + np.sqrt(1 - share) * rng.standard_normal((n_windows, n))
        position[..., axis] = np.cumsum(velocity, axis=1) * dt_s + spread * error
    along = np.broadcast_to([1.0, 0.0], position.shape).copy()
    known = np.ones((n_windows, n), np.bool_)
    return Windows(np.tile(time_s, (n_windows, 1)), position, along, known)


def test_motion_takes_no_part_of_errors_that_last(monkeypatch):
    """What is found is hardly likelier than the truth: twice the gain is chi-squared of 11 degrees of freedom, above 31
    once in a thousand times. If each window took the acceleration that suits it best the gain would be 74 nat.
    """
    monkeypatch.setattr(self_calibration, "MOST_STEPS", 80)
    windows = driven(np.random.default_rng(0), 60)
    motion = (0.0, np.log(2.0))
    truth = np.array([*error(0.6, 0.8, 0.5), *error(0.3, 0.6, 0.5), *motion, *motion, 0.7])
    found, log_p = self_calibration._likeliest(windows, truth)
    assert 0.0 <= 2.0 * (log_p - evidence.log_evidence(windows, truth)) < 31.3
    white, log_p_white = self_calibration._likeliest(windows, found, white=evidence.SHARE)
    assert log_p - log_p_white > 10.0 * self_calibration.LEAST_GAIN  # the control: these errors do last
    assert white[evidence.SHARE] == -5.0


def error(spread_m, share, lasts_s):
    return np.log(spread_m), np.log(share / (1.0 - share)), np.log(lasts_s)


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
    assert any(line.startswith("detection_probability, clutter_density, sight: frames") for line in found.unknown)
