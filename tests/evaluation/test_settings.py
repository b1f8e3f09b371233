"""Rivals are fitted as well as they can be: inside what was searched, by the evidence that a plain loop finds."""

import numpy as np
import pytest

from dirprim_filter.config import FilterConfig
from dirprim_filter.detections import Detections
from dirprim_filter.evaluation.rivals import fitted_acceleration, log_evidence
from dirprim_filter.evaluation.settings import LEAST_GAIN, Axis, choose
from dirprim_filter.filtering import ConstantVelocityKalman
from situations import tracks_of

SIZE, SHARE = Axis("size, m", 1.0, 2.0), Axis("share", 1.0, 3.0)


def hill(size, share):
    """Highest at 37 and 0.004, oblique."""
    x, y = np.log(size / 37.0), np.log(share / 0.004)
    return -(x**2) - y**2 - 0.8 * x * y


def test_what_is_chosen_is_the_best_of_a_wide_grid_and_lies_inside_what_was_searched():
    size, share = choose([SIZE, SHARE], lambda values: hill(*values))
    steps = np.arange(-15, 16)
    grid = hill(2.0 ** steps[:, None], 3.0 ** steps[None, :])
    i, j = np.unravel_index(grid.argmax(), grid.shape)
    assert (size.chosen, share.chosen) == (2.0 ** steps[i], pytest.approx(3.0 ** steps[j]))
    for choice, factor in ((size, 2.0), (share, 3.0)):
        assert choice.is_inside
        assert choice.low <= choice.chosen / factor * 1.0001
        assert choice.high >= choice.chosen * factor * 0.9999


def test_the_choice_lies_on_a_bound_that_cannot_widen_and_stays_where_little_is_gained():
    (choice,) = choose([SIZE._replace(most=16.0)], lambda values: -abs(np.log(values[0] / 37.0)))
    assert choice == ("size, m", 1.0, 16.0, 16.0)
    assert not choice.is_inside

    def slope(values):
        return -abs(np.log2(values[0] / 8.0))  # each step gains 1

    assert [choose([SIZE], slope, least_gain=gain)[0].chosen for gain in (0.9, 1.1)] == [8.0, 1.0]


CONFIG = FilterConfig(noise_m=0.4)
DT_S = 0.2


def driven(density, *, n_vehicles, n_rows, rng):
    """Vehicles of white acceleration of this spectral density, m^2/s^3, and what a sensor reports of them."""
    speed = 8.0 + np.cumsum(rng.normal(0, np.sqrt(density * DT_S), (n_vehicles, n_rows, 2)), axis=1)
    position = np.cumsum(speed * DT_S, axis=1)
    time_ns, (east, north) = (np.arange(n_rows) * DT_S * 1e9).round().astype(np.int64), np.moveaxis(speed, -1, 0)
    tracks = tracks_of(position, time_ns=time_ns, direction=np.arctan2(north, east), speed=np.hypot(east, north))
    noisy = tracks.position + CONFIG.noise_m * rng.standard_normal(tracks.position.shape)
    return tracks, Detections(track_id=tracks.track_id, time_ns=tracks.time_ns, position=noisy)


def test_the_evidence_is_the_sum_over_vehicles_one_by_one():
    _, seen = driven(1.0, n_vehicles=3, n_rows=12, rng=np.random.default_rng(0))
    seen = seen[np.flatnonzero((seen.track_id != "1") | (seen.time_ns < 1_000_000_000))]  # vehicles of unequal length

    def model():
        return ConstantVelocityKalman(acceleration_density=1.0, config=CONFIG)

    total = 0.0
    for name in np.unique(seen.track_id):
        own, alone, slot = seen[seen.track_id == name], model(), np.zeros(1, np.int64)
        alone.reserve(1)
        alone.begin(slot, slot, own[[0]])
        for i in range(1, len(own)):
            alone.predict(slot, np.array([DT_S]))
            total += alone.weigh(slot, own[[i]]).log_density[0]
    assert log_evidence(model(), seen) == pytest.approx(total)


@pytest.mark.parametrize("density", [0.05, 5.0])
def test_the_noise_of_constant_velocity_is_found_and_none_beside_it_is_likelier(density):
    """Within a step of the fine grid: over 40 vehicles of 60 rows the estimate's deviation is some 5 %."""
    train, seen = driven(density, n_vehicles=40, n_rows=60, rng=np.random.default_rng(1))
    found = fitted_acceleration(seen, train, CONFIG)
    assert found.is_inside
    assert 0.5 * found.chosen < density < 2.0 * found.chosen
    best, *beside = (
        log_evidence(ConstantVelocityKalman(acceleration_density=times * found.chosen, config=CONFIG), seen)
        for times in (1.0, 0.5, 2.0)
    )
    assert max(beside) <= best + LEAST_GAIN * len(seen)
