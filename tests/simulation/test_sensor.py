"""Laws of the sensor: noise, missed and false detections as promised.

Every bound is a normal approximation at 4.5 standard deviations: a false alarm in about 150,000 runs of each.
"""

import numpy as np
import pytest

from dirprim_filter.simulation.sensor import detect
from situations import tracks_of

Z = 4.5
N_FRAMES, N_VEHICLES = 400, 25
NOISE_M, MISS_RATE, FALSE_PER_FRAME = 0.7, 0.1, 1.5


@pytest.fixture
def rng():
    return np.random.default_rng(20)


@pytest.fixture(scope="module")
def truth():
    source = np.random.default_rng(3)
    place = source.uniform((-50.0, -20.0), (50.0, 20.0), (N_FRAMES, N_VEHICLES, 2))
    return tracks_of(place, track_id=np.arange(N_VEHICLES), time_ns=100_000_000 * np.arange(N_FRAMES)[:, None])


def errors(truth, rng, noise_m):
    seen = detect(truth, noise_m=noise_m, miss_rate=0.0, false_per_frame=0.0, rng=rng)
    np.testing.assert_array_equal(seen.track_id, truth.track_id.astype(str))
    return np.asarray(seen.position - truth.position)


def noise_holds(error):
    """Standard deviation of each axis, their correlation and mean, as for isotropic noise of NOISE_M."""
    n = len(error)
    deviation = np.abs(error.std(axis=0) / NOISE_M - 1) < Z / np.sqrt(2 * n)
    mean = np.abs(error.mean(axis=0)) < Z * NOISE_M / np.sqrt(n)
    return bool(deviation.all() and mean.all() and abs(np.corrcoef(error.T)[0, 1]) < Z / np.sqrt(n))


def misses_hold(truth, rng, miss_rate):
    seen = detect(truth, miss_rate=miss_rate, false_per_frame=0.0, rng=rng)
    n = len(truth)
    return bool(abs(n - len(seen) - n * MISS_RATE) < Z * np.sqrt(n * MISS_RATE * (1 - MISS_RATE)))


def clutter(truth, rng, false_per_frame):
    """Positions of the false detections, whose ids are unique and of their own."""
    seen = detect(truth, false_per_frame=false_per_frame, rng=rng)
    false = np.char.startswith(seen.track_id, "false-")
    assert np.unique(seen.track_id[false]).size == false.sum()
    assert set(seen.track_id[~false]) == set(truth.track_id.astype(str))
    assert np.isin(seen.time_ns[false], truth.time_ns).all()
    return np.asarray(seen.position[false])


def clutter_holds(truth, position):
    """A Poisson number, uniform over the bounding box (by mean and variance of a uniform law)."""
    n, expected = len(position), N_FRAMES * FALSE_PER_FRAME
    low, high = truth.position.min(axis=0), truth.position.max(axis=0)
    unit = (position - low) / (high - low)
    inside = ((unit >= 0) & (unit <= 1)).all()
    centred = np.abs(unit.mean(axis=0) - 0.5) < Z / np.sqrt(12 * n)
    spread = np.abs(unit.var(axis=0) - 1 / 12) < Z / np.sqrt(180 * n)
    return bool(abs(n - expected) < Z * np.sqrt(expected) and inside and centred.all() and spread.all())


@pytest.mark.parametrize(
    ("holds", "stated", "other"),
    [
        (lambda truth, rng, noise_m: noise_holds(errors(truth, rng, noise_m)), NOISE_M, 1.1 * NOISE_M),
        (misses_hold, MISS_RATE, 1.25 * MISS_RATE),
        (lambda truth, rng, n: clutter_holds(truth, clutter(truth, rng, n)), FALSE_PER_FRAME, 1.5 * FALSE_PER_FRAME),
        (lambda truth, rng, box: clutter_holds(truth, box * clutter(truth, rng, FALSE_PER_FRAME)), 1.0, 0.7),
    ],
    ids=["noise", "misses", "false ones", "their box"],
)
def test_what_is_stated_holds_and_a_little_more_does_not(truth, rng, holds, stated, other):
    assert holds(truth, rng, stated)
    assert not holds(truth, rng, other)


def test_a_perfect_sensor_reports_the_truth(truth, rng):
    assert not errors(truth, rng, 0.0).any()
    assert not len(detect(truth[:0], noise_m=0.5, false_per_frame=3.0, rng=rng))


@pytest.mark.parametrize(
    "wrong", [{"noise_m": -1.0}, {"miss_rate": 1.5}, {"false_per_frame": float("nan")}, {"noise_m": float("inf")}]
)
def test_parameters_out_of_range_are_named(truth, rng, wrong):
    with pytest.raises(ValueError, match=next(iter(wrong))):
        detect(truth, rng=rng, **wrong)
