"""Errors that are biased, correlated and late: weights against the joint Gaussian, beliefs against the truth."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.stats import multivariate_normal

from dirprim_filter.config import FilterConfig, TrackingConfig
from dirprim_filter.detections import Detections
from dirprim_filter.estimates import EstimateList, Estimates
from dirprim_filter.filtering import ParticleFilter, Tracker
from dirprim_filter.filtering.smoothing.smoother import Smoother
from dirprim_filter.primitives.learning import learn_primitives
from dirprim_filter.replay import replay
from dirprim_filter.sensor import AxisError, Sensor
from evaluation.test_calibration import circling
from sensing import sense
from situations import beside

SENSOR = Sensor(
    along=AxisError(spread_m=0.6, bias_m=0.4, correlated_share=0.7, correlation_s=0.5),
    across=AxisError(spread_m=0.3, bias_m=-0.1, correlated_share=0.5, correlation_s=0.9),
    latency_s=0.2,
)
SLOT = np.array([0])


@pytest.fixture(scope="module")
def learned():
    return learn_primitives(circling(6, 60), tessellation="grid", cell_size=20.0, rng=np.random.default_rng(0))


def seen_at(position, time_s=0.0):
    return Detections(track_id=np.array(["a"]), time_ns=np.array([round(time_s * 1e9)]), position=np.array([position]))


def begun(learned, sensor):
    made = ParticleFilter(learned, FilterConfig(n_particles=40), sensor)
    made.begin(SLOT, np.array([7], np.uint64), seen_at([31.0, 2.0]))
    return made


def test_weights_and_evidence_are_those_of_the_joint_gaussian(learned):
    """Of three detections given each particle's way, of which the oracle knows the errors' whole covariance."""
    made = begun(learned, SENSOR)
    cloud, carried = made.cloud, made.carried
    cloud.weight[0] = 1.0 / 40
    carried.mean[0], carried.variance[0], carried.since_s[0] = (
        0.0, [SENSOR.along.correlated_variance, SENSOR.across.correlated_variance], 0.0,
    )  # fmt: skip
    course = np.column_stack([np.cos(cloud.direction[0]), np.sin(cloud.direction[0])])
    gaps, ways, reported = [0.0, 0.3, 0.1], [], []
    for gap, step in zip(gaps, ([0.0, 0.0], [0.4, 0.3], [0.1, 0.2]), strict=True):
        carried.since_s[0] += gap
        cloud.position[0] += np.array(step)  # a way that is known; the direction stays
        z = cloud.position[0].mean(axis=0) + np.array([0.3, -0.2])
        ways.append(z - cloud.position[0])
        reported.append(made.weigh(SLOT, seen_at(z)).log_density[0])
    time_s = np.cumsum(gaps)
    log_fit = np.zeros(40)
    across = np.column_stack([-course[:, 1], course[:, 0]])
    for axis, unit in ((SENSOR.along, course), (SENSOR.across, across)):
        kernel = np.exp(-np.abs(time_s[:, None] - time_s) / axis.correlation_s)
        covariance = axis.spread_m**2 * (axis.correlated_share * kernel + (1.0 - axis.correlated_share) * np.eye(3))
        errors = np.array([(way * unit).sum(axis=1) for way in ways]).T
        log_fit += multivariate_normal(np.full(3, axis.bias_m), covariance).logpdf(errors)
    weight = np.exp(log_fit - log_fit.max())
    np.testing.assert_allclose(cloud.weight[0], weight / weight.sum(), atol=2e-3)  # outliers have a share of 0.001
    assert sum(reported) == pytest.approx(np.log(np.exp(log_fit).mean()), abs=0.01)


def estimates_of(learned, seen, sensor, n_particles, *, seed=0, **given):
    """All estimates of a log, as one table."""
    kept, config = EstimateList(), FilterConfig(n_particles=n_particles, noise_m=0.5, **given)
    replay(seen.frames(), Tracker(learned, sensor=sensor, config=config, rng=np.random.default_rng(seed)), [kept])
    return kept.all()


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


def test_a_bias_moves_no_estimate(learned):
    """Detections that lie ahead by what the sensor's model says are followed as those that do not.

    Particles whose directions differ must not differ in where the bias puts them for good: they would run ahead. The
    median of the last two seconds lies at 0.02 m, with a standard deviation of 0.05 among five seeds; where each
    particle has the bias in its own axes at 0.18 m, however many particles there are.
    """
    axes = {
        name: AxisError(spread_m=0.3, correlated_share=0.99, correlation_s=time_s)
        for name, time_s in (("along", 2.5), ("across", 20.0))
    }
    truth = circling(24, 40)
    seen = sense(truth, Sensor(**axes), rng=np.random.default_rng(0))
    course = np.column_stack([np.cos(truth.direction), np.sin(truth.direction)])
    _, row = beside(seen, truth)
    ahead = replace(seen, position=seen.position + 2.0 * course[row])
    biased = Sensor(along=replace(axes["along"], bias_m=2.0), across=axes["across"])
    medians = []
    for seed in range(4):
        own = estimates_of(learned, seen, Sensor(**axes), 200, seed=seed)
        other = estimates_of(learned, ahead, biased, 200, seed=seed)
        here, there = beside(own, other)
        assert here.size > 0.97 * len(own)  # a belief that is lost is reinitialised and misses a frame
        late = own.time_ns[here] >= seen.time_ns.max() - 2_000_000_000
        here, there = here[late], there[late]
        off = (other.position[there] - own.position[here]) @ np.array([1.0, 1j]) * np.exp(-1j * own.direction[here])
        medians.append(np.median(off.real))
    assert abs(np.mean(medians)) < 0.09


@pytest.mark.parametrize("evenness", [0.2, 0.02])  # a sixth of the particles weigh, or a fiftieth
def test_a_copy_carries_the_error_that_leaves_the_detection_where_it_was(learned, evenness):
    """Place and carried error of each particle still meet where its survivor foresaw a detection: both are spread."""
    lasting = AxisError(spread_m=0.5, correlated_share=0.99, correlation_s=5.0)
    made = ParticleFilter(learned, FilterConfig(n_particles=2000), Sensor(along=lasting, across=lasting))
    made.begin(SLOT, np.array([7], np.uint64), seen_at([31.0, 2.0]))
    cloud, mean = made.cloud, made.carried.mean
    cloud.direction[0] = 0.4 + 0.6 * np.random.default_rng(1).standard_normal(2000)

    def carried():
        error = mean[0] @ np.array([1.0, 1j]) * np.exp(1j * cloud.direction[0])
        return np.column_stack([error.real, error.imag])

    cloud.position[0] = [31.0, 2.0] - carried()
    places, spread = cloud.position[0].std(axis=0), mean[0].std(axis=0)
    cloud.weight[0] = np.random.default_rng(0).dirichlet(np.full(2000, evenness))
    made.resample(SLOT)
    assert np.abs(cloud.position[0] + carried() - [31.0, 2.0]).max() < 1e-4
    assert len(np.unique(cloud.position[0], axis=0)) == 2000
    np.testing.assert_allclose(mean[0].std(axis=0), spread, rtol=0.25)
    np.testing.assert_allclose(cloud.position[0].std(axis=0), places, rtol=0.25)


def followed(learned, truth, seen, sensor):
    """RMSE and NEES of the filter's and the smoother's estimates."""
    filtered, smoothed = EstimateList(), []
    config = FilterConfig(n_particles=200, **({"noise_m": sensor.noise_m} if sensor else {}))
    smoother = Smoother(max_gap_s=5.0, sinks=[lambda frame: smoothed.append(frame.estimates)])
    rng = np.random.default_rng(0)
    tracker = smoother.tracker(0, learned, config=config, tracking=TrackingConfig(), sensor=sensor, rng=rng)
    with smoother:
        replay(seen.frames(), tracker, [filtered, smoother])
    for found in (filtered.all(), Estimates.concatenate(smoothed)):
        here, there = beside(found, truth[truth.time_ns > 1_000_000_000])
        error = found.position[here] - truth[truth.time_ns > 1_000_000_000].position[there]
        nees = np.einsum("ni,ni->n", error, np.linalg.solve(found.covariance[here], error[..., None])[..., 0]).mean()
        yield float(np.sqrt((error**2).sum(axis=1).mean())), float(nees)


def test_a_sensor_that_is_known_is_followed_better_and_known_how_well(learned):
    """Late, biased and correlated; the negative control is the filter that takes the errors for round and white."""
    truth = circling(5, 50)
    seen = sense(truth, SENSOR, rng=np.random.default_rng(2))
    (filtered, nees), (smoothed, smoothed_nees) = followed(learned, truth, seen, SENSOR)
    (plain, plain_nees), _ = followed(learned, truth, seen, None)
    assert filtered < 0.75 * plain
    assert smoothed < filtered
    assert nees < 4.0 < plain_nees
    assert smoothed_nees < 8.0


def test_estimates_are_of_the_frames_time_and_detections_as_they_came(learned):
    truth = circling(2, 20)
    tracker = Tracker(learned, sensor=SENSOR, config=FilterConfig(n_particles=50), rng=np.random.default_rng(0))
    for frame in sense(truth, SENSOR, rng=np.random.default_rng(2)).frames():
        reported = tracker.track(frame)
        assert reported.time_ns == frame.time_ns[0]
        assert (reported.estimates.time_ns == reported.time_ns).all()
        assert (reported.detections.time_ns == reported.time_ns).all()
