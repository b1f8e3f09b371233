"""Errors that are biased, correlated and late: weights against drawn errors, beliefs against the truth."""

import numpy as np
import pytest

from dirprim_filter.config import FilterConfig
from dirprim_filter.detections import Detections
from dirprim_filter.filtering import ParticleFilter, Tracker
from dirprim_filter.primitives.learning import learn_primitives
from dirprim_filter.sensor import AxisError, Sensor
from evaluation.test_calibration import circling
from filtering.test_smoothing import smoothed
from sensing import sense
from situations import beside, estimates_by, one_cell_map, seen_at

SENSOR = Sensor(
    along=AxisError(spread_m=0.6, bias_m=0.4, correlated_share=0.7, correlation_s=0.5),
    across=AxisError(spread_m=0.3, bias_m=-0.1, correlated_share=0.5, correlation_s=0.9),
    latency_s=0.2,
)
SLOT = np.array([0])


@pytest.fixture(scope="module")
def learned():
    return learn_primitives(circling(6, 60), tessellation="grid", cell_size=20.0, rng=np.random.default_rng(0))


def test_weights_are_by_the_mean_and_covariance_of_the_particles_own_errors(learned):
    """What is new of errors along and across courses that differ, drawn a million times; against that of one course."""
    made, rng = ParticleFilter(learned, FilterConfig(n_particles=400), SENSOR), np.random.default_rng(0)
    cloud, course, z = made.cloud, 0.8, np.array([31.0, 2.0])
    for spread in (0.02, 0.7):
        turned = spread * rng.standard_normal(200)
        cloud.direction[0], cloud.weight[0] = course + np.concatenate([turned, -turned]), 1.0 / 400
        cloud.position[0] = place = z + rng.normal(0.0, 0.5, (400, 2))
        cloud.since_s[0] = 0.3
        made.weigh(SLOT, seen_at(0.0, [z], ids=["a"]))
        axes = SENSOR.along, SENSOR.across
        spreads = [np.sqrt(axis.new_variance(np.array(0.3))) for axis in axes]
        along, across = (
            axis.bias_m + one * rng.standard_normal((2500, 400)) for axis, one in zip(axes, spreads, strict=True)
        )
        error = ((along + 1j * across) * np.exp(1j * (cloud.direction[0] - course))).ravel()
        off = (z - place) @ np.array([1.0, 1j]) * np.exp(-1j * course) - error.mean()
        log_fit = -0.5 * (off.real**2 / error.real.var() + off.imag**2 / error.imag.var())
        weight = np.exp(log_fit - log_fit.max())
        np.testing.assert_allclose(cloud.weight[0], weight / weight.sum(), rtol=0.04, atol=2e-5)  # outliers: 0.001
        plain = np.exp(-0.5 * ((off.real / spreads[0]) ** 2 + (off.imag / spreads[1]) ** 2))
        assert (np.abs(cloud.weight[0] - plain / plain.sum()).max() < 2e-4) == (spread < 0.1)


def through_a_gap(place, way, *, bias_m, seed):
    """(t, 2) smoothed places in the gap of two to nine seconds, of a vehicle that is measured off along its way."""
    time_ns = 10**8 * np.arange(len(place))
    is_seen = (time_ns < 2e9) | (time_ns > 9e9)
    seen = Detections(track_id=np.full(len(place), "a"), time_ns=time_ns, position=place + bias_m * way)[is_seen]
    sensor = Sensor(along=AxisError(spread_m=0.1, bias_m=bias_m), across=AxisError(spread_m=0.1))
    model, config = one_cell_map(concentration=0.01, shape=4.0), FilterConfig(n_particles=300, max_gap_s=9.0)
    given = {"times": time_ns.tolist(), "config": config, "sensor": sensor, "seed": seed}
    found = smoothed(seen, model=model.without_places(), **given)[1]
    return found.position[(found.time_ns > 2e9) & (found.time_ns < 9e9)]


@pytest.mark.parametrize("turn", [0.0, 0.8, np.pi / 2, np.pi])
def test_in_gaps_a_bias_points_along_the_way_at_both_ends_whatever_turn_the_filter_expected(turn):
    """Ways are those of a sensor without a bias. Taken away along the course that was expected they are 2 m off."""
    time_s, ways = 0.1 * np.arange(130), np.array([[1.0, 0.0], [np.cos(turn), np.sin(turn)]])
    way = ways[(time_s > 5.0).astype(int)]
    place = 8.0 * (time_s - 5.0)[:, None] * way
    right = through_a_gap(place, way, bias_m=0.0, seed=0)
    for seed in range(3):
        np.testing.assert_allclose(through_a_gap(place, way, bias_m=1.0, seed=seed), right, atol=0.03)


def test_in_a_gap_the_bias_of_who_stands_is_along_its_course():
    """Who braked to a stand at 1.5 s, and stands until the end; without a course nothing of a metre would be taken."""
    way = np.tile([0.6, 0.8], (130, 1))
    place = way * -np.square(np.maximum(1.5 - 0.1 * np.arange(130), 0.0))[:, None] * 4.0
    np.testing.assert_allclose(through_a_gap(place, way, bias_m=1.0, seed=0), 0.0, atol=0.4)


@pytest.mark.parametrize(
    "axis", [SENSOR.along, AxisError(spread_m=0.5), AxisError(spread_m=0.5, correlated_share=0.99)]
)
def test_what_is_new_of_an_error_is_its_variance_given_the_one_before(axis):
    """Of the correlated part and the white one; the first detection's is new as a whole."""
    for since_s in (0.1, 1.0):
        kept = np.exp(-since_s / axis.correlation_s)
        joint = axis.correlated_variance * np.array([[1.0, kept], [kept, 1.0]])
        given = joint[1, 1] - joint[1, 0] ** 2 / joint[0, 0] if axis.correlated_share else 0.0
        white = axis.spread_m**2 * (1.0 - axis.correlated_share)
        assert axis.new_variance(np.array(since_s)) == pytest.approx(white + given)
    assert axis.new_variance(np.array(np.inf)) == axis.spread_m**2


def estimates_of(learned, seen, sensor, n_particles, *, seed=0, **given):
    """All estimates of a log, as one table."""
    config = FilterConfig(n_particles=n_particles, noise_m=0.5, **given)
    return estimates_by(Tracker(learned, sensor=sensor, config=config, rng=np.random.default_rng(seed)), seen)


def test_with_white_round_errors_it_is_the_plain_filter(learned):
    """To the last belief of a log, not only in one step: both draw and weigh alike."""
    plainly = {"innovation_outlier_rate": 0.0, "resample_below": 0.0}  # rounding may decide who survives
    seen = sense(circling(3, 20), Sensor.white(0.5), rng=np.random.default_rng(1))
    oblong = Sensor(along=AxisError(spread_m=0.5), across=AxisError(spread_m=0.4))
    plain, sensed, other = (
        estimates_of(learned, seen, sensor, 60, **plainly).position for sensor in (None, Sensor.white(0.5), oblong)
    )
    np.testing.assert_allclose(sensed, plain, atol=1e-6)
    assert not np.allclose(other, plain, atol=1e-6)


def followed(learned, truth, seen, sensor):
    """RMSE and NEES of the filter's and the smoother's estimates."""
    late = truth[truth.time_ns > 1_000_000_000]
    for rows in smoothed(seen, model=learned, config=FilterConfig(n_particles=200), sensor=sensor):
        here, there = beside(rows, late)
        error = rows.position[here] - late.position[there]
        nees = np.einsum("ni,ni->n", error, np.linalg.solve(rows.covariance[here], error[..., None])[..., 0]).mean()
        yield float(np.sqrt((error**2).sum(axis=1).mean())), float(nees)


def test_a_sensor_that_is_known_is_followed_better_and_known_how_well(learned):
    """Late, biased and correlated; the negative control is the filter that takes the errors for round and white."""
    truth = circling(5, 50)
    seen = sense(truth, SENSOR, rng=np.random.default_rng(2))
    (filtered, nees), (later, later_nees) = followed(learned, truth, seen, SENSOR)
    (plain, plain_nees), _ = followed(learned, truth, seen, None)
    assert filtered < 0.75 * plain
    assert later < filtered
    assert nees < 4.0 < plain_nees
    assert later_nees < 8.0


def test_innovations_are_of_what_is_new_of_errors_that_last(learned):
    """A filter that moves with lasting errors is surprised by what is new of them, not by their whole spread."""
    lasting = AxisError(spread_m=1.0, correlated_share=0.98, correlation_s=5.0)
    sensor, truth, config = Sensor(along=lasting, across=lasting), circling(20, 50), FilterConfig(n_particles=200)
    rng = np.random.default_rng(0)
    tracker = Tracker(learned, sensor=sensor, config=config, with_innovations=True, rng=rng)
    frames = [tracker.track(frame).innovations for frame in sense(truth, sensor, rng=rng).frames()]
    assert 1.2 < np.nanmean(np.concatenate(frames[10:])) < 3.5  # 2.5 to 2.8 of four seeds


def test_estimates_are_of_the_frames_time_and_detections_as_they_came(learned):
    tracker = Tracker(learned, sensor=SENSOR, config=FilterConfig(n_particles=50), rng=np.random.default_rng(0))
    for frame in sense(circling(2, 20), SENSOR, rng=np.random.default_rng(2)).frames():
        reported = tracker.track(frame)
        for time_ns in (reported.time_ns, reported.estimates.time_ns, reported.detections.time_ns):
            assert np.all(time_ns == frame.time_ns[0])
