"""What a log without ids shows of its sensor: what was put in comes out, over seeds; what is shuffled does not."""

from dataclasses import replace

import numpy as np
import pytest

from dirprim_filter.evaluation.calibration.own_tracks import own_tracks
from dirprim_filter.evaluation.calibration.self_calibration import self_calibrate
from dirprim_filter.sensor import WIDE
from dirprim_filter.simulation.sensor import detect
from evaluation.test_calibration import circling

DRIVEN = circling(12, 60)
AREA = np.prod(np.ptp(DRIVEN.position, axis=0))
NOISE_M, MISSED, FALSE = 0.4, 0.2, 3.0


def reported(seed, noise_m=NOISE_M):
    rng = np.random.default_rng(seed)
    return detect(DRIVEN, noise_m=noise_m, miss_rate=MISSED, false_per_frame=FALSE, rng=rng).without_ids()


def shuffled(seen, share, rng):
    """Some of the detections at the times of others of them."""
    time_ns, some = seen.time_ns.copy(), np.flatnonzero(rng.random(len(seen)) < share)
    time_ns[some] = rng.permutation(time_ns[some])
    return replace(seen, time_ns=time_ns)


@pytest.mark.parametrize(("seed", "noise_m"), [(0, 0.1), (1, NOISE_M), (2, NOISE_M), (3, 1.5)])
def test_what_was_put_in_comes_out_within_its_intervals(seed, noise_m):
    """Those of 99 %; of clutter 5 % more, as the box of what is seen is not quite that of the vehicles."""
    found = own_tracks(reported(seed, noise_m))
    assert found.noise.value == pytest.approx(noise_m, abs=WIDE * found.noise.error)
    assert found.noise.error < 0.1 * noise_m
    probability, clutter = found.detection_probability, found.clutter_density
    assert probability.value == pytest.approx(1.0 - MISSED, abs=WIDE * probability.error)
    assert clutter.value * AREA == pytest.approx(FALSE, abs=WIDE * clutter.error * AREA + 0.05 * FALSE)
    assert found.tracking.vehicle_density * AREA == pytest.approx(12.0, rel=0.15)
    assert found.tracking.birth_density * AREA * 60 < 6.0  # none begins later


def test_half_of_the_detections_shuffled_in_time_are_clutter():
    """The negative control: all that was right is far out of its interval."""
    seen = reported(1)
    found = own_tracks(shuffled(seen, 0.5, np.random.default_rng(0)))
    assert found.detection_probability.value < 1.0 - MISSED - 2.0 * WIDE * found.detection_probability.error
    assert found.clutter_density.value * AREA > FALSE + 2.0 * WIDE * found.clutter_density.error * AREA


def test_what_nothing_can_be_followed_in_is_refused():
    rng = np.random.default_rng(0)
    noise = replace(reported(1), position=rng.uniform(0.0, 300.0, (len(reported(1)), 2)))
    with pytest.raises(ValueError, match="expected detections that go on from frame to frame as vehicles do"):
        self_calibrate(noise, rng=rng)
