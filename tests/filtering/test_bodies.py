"""Two vehicles cannot be in one place: what detections state of bodies and of their own confidence."""

import numpy as np
import pytest

from dirprim_filter.config import FilterConfig, TrackingConfig
from dirprim_filter.detections import Detections
from dirprim_filter.filtering import ConstantVelocityKalman, Tracker, existence

LORRY, CAR = (12.0, 2.5, 3.5), (4.5, 1.8, 1.5)


def tracked(frames, **stated):
    """The names that are reported in each frame, of places (d, 2) in frames of .1 s, by a Kalman filter."""
    config = FilterConfig(noise_m=0.1)
    tracker = Tracker(
        ConstantVelocityKalman(acceleration_density=1.0, config=config), config=config, rng=np.random.default_rng(0)
    )
    names = []
    for i, places in enumerate(frames):
        own = {name: np.asarray(of[i]) for name, of in stated.items()}
        seen = Detections(track_id=[""] * len(places), time_ns=[i * 10**8] * len(places), position=places, **own)
        names.append(set(tracker.step(seen).track_id.tolist()))
    return names


@pytest.mark.parametrize("is_stated", [True, False])
@pytest.mark.parametrize("twice_from", [0, 20])
def test_a_lorry_that_is_detected_twice_is_one_vehicle_and_the_car_beside_it_another(twice_from, is_stated):
    rng, frames, sizes = np.random.default_rng(1), [], []
    for i in range(60):
        places = np.array([[0.8 * i, 0.0], [0.8 * i, 3.5], [0.8 * i + 4.0, 0.0]])[: 2 + (i >= twice_from)]
        frames.append(places + rng.normal(0.0, 0.1, places.shape))
        sizes.append([LORRY, CAR, LORRY][: len(places)])
    names = tracked(frames, **({"size": sizes} if is_stated else {}))
    assert len(set.union(*names)) == (2 if is_stated else 3)
    assert len(names[-1]) == (2 if is_stated else 3)


@pytest.mark.parametrize("is_stated", [True, False])
def test_a_vehicle_that_its_detector_sees_elsewhere_on_its_body_keeps_its_name(is_stated):
    """It stands, and its belief is sure of where; then its box grows, and its middle is off by ten deviations."""
    rng, places = np.random.default_rng(2), np.zeros((80, 1, 2))
    places[50:, 0, 0] = 1.0
    names = tracked(places + rng.normal(0.0, 0.1, places.shape), **({"size": [[CAR]] * 80} if is_stated else {}))
    assert (len(set.union(*names)) == 1) == is_stated


@pytest.mark.parametrize("is_stated", [True, False])
def test_detections_of_low_confidence_continue_a_track_and_begin_none(is_stated):
    rng, frames, stated = np.random.default_rng(3), [], []
    for i in range(60):
        false = rng.uniform(-30.0, 30.0, (20, 2))
        frames.append(np.vstack([rng.normal((0.8 * i - 24.0, 0.0), 0.1), false]))
        stated.append([0.9 if i < 30 else 0.3, *np.full(20, 0.003)])
    names = tracked(frames, **({"confidence": stated} if is_stated else {}))
    assert (len(set.union(*names)) == 1) == is_stated
    assert all(names[5:])


def test_the_density_of_false_detections_of_a_confidence_is_its_odds_to_true_ones():
    config = TrackingConfig(detection_probability=0.8, vehicle_density=1e-3, clutter_density=5e-4)
    density = existence.false_density(np.array([np.nan, 0.5, 0.8, 1.0, 0.0]), config)
    np.testing.assert_allclose(density, [5e-4, 8e-4, 2e-4, 0.0, 5e-4])
