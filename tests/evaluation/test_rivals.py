"""Rivals are fitted as well as they can be: the evidence against a plain loop, the search against brute force."""

import numpy as np
import pytest

from dirprim_filter.config import FilterConfig
from dirprim_filter.detections import Detections
from dirprim_filter.evaluation.rivals import RIVALS, fitted, log_evidence
from dirprim_filter.evaluation.search import FACTORS, best_settings
from dirprim_filter.filtering import ConstantVelocityKalman
from dirprim_filter.tracks import Tracks

CONFIG = FilterConfig(noise_m=0.4)
DT_S = 0.2


def driven(density, *, n_vehicles, n_rows, rng):
    """Vehicles of white acceleration of this spectral density, m^2/s^3, and what a sensor reports of them."""
    speed = 8.0 + np.cumsum(rng.normal(0, np.sqrt(density * DT_S), (n_vehicles, n_rows, 2)), axis=1)
    position = np.cumsum(speed * DT_S, axis=1)
    time_ns = np.tile((np.arange(n_rows) * DT_S * 1e9).round().astype(np.int64), n_vehicles)
    tracks = Tracks(
        track_id=np.repeat(np.arange(n_vehicles), n_rows), time_ns=time_ns, position=position.reshape(-1, 2),
        direction=np.arctan2(speed[..., 1], speed[..., 0]).ravel(), speed=np.hypot(*np.moveaxis(speed, -1, 0)).ravel(),
    )  # fmt: skip
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
def test_the_noise_of_constant_velocity_is_found(density):
    """Within a step of the fine grid: over 40 vehicles of 60 rows the estimate's deviation is some 5 %."""
    train, seen = driven(density, n_vehicles=40, n_rows=60, rng=np.random.default_rng(1))
    found = fitted("constant velocity", seen, train, CONFIG).settings["acceleration_density"]
    assert found.low < density < found.high


def test_no_rival_lies_on_a_bound_and_none_beside_it_is_likelier():
    train, seen = driven(1.0, n_vehicles=4, n_rows=25, rng=np.random.default_rng(2))
    for name in RIVALS:
        rival = fitted(name, seen, train, CONFIG)
        assert all(found.low < found.value < found.high for found in rival.settings.values())
    velocity = fitted("constant velocity", seen, train, CONFIG)
    best = log_evidence(velocity(), seen)
    found = velocity.settings["acceleration_density"]
    for other in (found.low, found.high):
        assert log_evidence(ConstantVelocityKalman(acceleration_density=other, config=CONFIG), seen) <= best + 0.01


def test_the_search_widens_until_the_best_is_inside():
    asked = []

    def score(of):
        asked.append((of["a"], of["b"]))
        return -((np.log10(of["a"]) - 3.1) ** 2) - (np.log10(of["b"]) + 2.0 + 0.2 * np.log10(of["a"])) ** 2

    found = best_settings(score, {"a": 1.0, "b": 1.0}, tolerance=1e-9)
    step = np.log10(FACTORS[-1])
    assert np.log10(found["a"].value) == pytest.approx(3.1, abs=step)
    assert np.log10(found["b"].value) == pytest.approx(-2.6, abs=2 * step)
    assert len(asked) == len(set(asked)), "a point is asked once"
    for name in "ab":
        assert found[name].low < found[name].value < found[name].high


def test_a_score_that_rises_for_ever_is_refused_by_name():
    with pytest.raises(ValueError, match="a: expected a best value within eight powers of ten of 2"):
        best_settings(lambda of: np.log(of["a"]), {"a": 2.0})
