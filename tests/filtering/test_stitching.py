"""Pieces of unlabelled tracks: joined, trimmed, or left alone."""

from dataclasses import replace

import numpy as np
import pytest
from scipy import stats

from dirprim_filter.config import FilterConfig, TrackingConfig
from dirprim_filter.detections import Detections
from dirprim_filter.filtering import ConstantVelocityKalman, ParticleFilter
from dirprim_filter.filtering.smoothing import bridge
from dirprim_filter.filtering.smoothing.bridge import Ends, Gaussian
from filtering.test_smoothing import smoothed
from situations import gaussian_belief, one_cell_map

CONFIG = FilterConfig(n_particles=500)
N_FRAMES, SIDE_M = 80, 12.0


def side_by_side(*, ahead_m):
    """Two vehicles at 8 m/s, out of sight from 2 to 5 s, then so far ahead of where they would have been."""
    seen = []
    for i in [*range(20), *range(50, N_FRAMES)]:
        x = 0.8 * i + (ahead_m if i >= 50 else 0.0)
        seen.append(Detections(track_id=["a", "b"], time_ns=[i * 100_000_000] * 2, position=[[x, 0.0], [x, SIDE_M]]))
    return seen


def tracked(seen, *, lag_s=None, scale=1.0):
    """What the filter says without ids, and what the smoother says; of a scene so many times as large."""
    seen, config = Detections.concatenate(seen), replace(CONFIG, noise_m=scale * CONFIG.noise_m)
    tracking = TrackingConfig(
        **{f"{what}_density": getattr(TrackingConfig(), f"{what}_density") / scale**2
           for what in ("clutter", "birth", "vehicle")}
    )  # fmt: skip
    return smoothed(
        replace(seen, position=scale * seen.position),
        model=ConstantVelocityKalman(acceleration_density=0.2 * scale**2, config=config),
        with_ids=False, times=[i * 100_000_000 for i in range(N_FRAMES)], config=config, tracking=tracking, lag_s=lag_s,
    )  # fmt: skip


def test_pieces_of_a_vehicle_become_one_track_that_leads_through_the_gap():
    found, later = tracked(side_by_side(ahead_m=6.0))
    assert np.unique(found.track_id).size == 4  # the tracker lost both
    assert sorted(set(later.track_id.tolist())) == ["track-1", "track-2"]
    assert len(later) == 2 * N_FRAMES
    for name in ("track-1", "track-2"):
        way = later[later.track_id == name].position
        assert np.ptp(way[:, 1]) < 1.0  # neither took up the other's
        assert (np.diff(way[:, 0]) > 0.5).all()


@pytest.mark.parametrize(("ahead_m", "n_tracks"), [(6.0, 2), (7.5, 4)])
def test_people_are_joined_as_cars_are(ahead_m, n_tracks):
    """In a scene a fifth as large, with everything that has a length, what appears is a fifth as fast."""
    for scale in (1.0, 0.2):
        assert np.unique(tracked(side_by_side(ahead_m=ahead_m), scale=scale)[1].track_id).size == n_tracks


@pytest.mark.parametrize(("ahead_m", "lag_s"), [(25.0, None), (6.0, 1.0)])
def test_what_is_too_far_away_is_another_vehicle_and_with_a_lag_nothing_is_joined(ahead_m, lag_s):
    later = tracked(side_by_side(ahead_m=ahead_m), lag_s=lag_s)[1]
    assert np.unique(later.track_id).size == 4


def test_a_false_detection_long_after_the_last_is_cut_off_and_a_vehicle_seen_again_is_not():
    def times(again):
        seen = [Detections(track_id=["a"], time_ns=[i * 100_000_000], position=[[0.8 * i, 0.0]]) for i in again]
        return tracked(seen)[1].time_ns // 100_000_000

    assert times([*range(20), 30]).max() == 19
    assert times([*range(20), *range(30, 35)]).max() == 34


@pytest.mark.parametrize("interval_s", [0.1, 0.5, 2.0])
def test_of_a_vehicle_without_a_name_all_rows_are_kept_however_seldom_the_sensor_looks(interval_s):
    times = [round(1e9 * interval_s * i) for i in range(40)]
    seen = Detections.concatenate([
        Detections(track_id=["a"], time_ns=[ns], position=[[8e-9 * ns, 0.0]])
        for i, ns in enumerate(times) if i % 5 != 4
    ])  # fmt: skip
    model = ConstantVelocityKalman(acceleration_density=0.2, config=CONFIG)
    later = smoothed(seen, model=model, with_ids=False, times=times, config=CONFIG)[1]
    assert later.time_ns.tolist() == times[:-1]


def ends_of(model, off):
    """A gap of a second, after which a vehicle is so far ahead of what straight motion expects."""
    start = Gaussian(np.array([5.0, 1.0, 8.0, 0.5]), np.diag([0.2, 0.1, 0.3, 0.3]))
    return Ends.of(model, 0, start, 10**9, Gaussian(np.array([13.0 + off, 1.5, 8.0, 0.5]), 0.1 * np.eye(4)))


def test_the_evidence_of_a_gap_is_exact_for_constant_velocity_and_of_particles_that_move_alike_the_same():
    kalman = ConstantVelocityKalman(acceleration_density=0.5, config=CONFIG)
    f = np.eye(4)
    f[0, 2] = f[1, 3] = 1.0
    for off in (0.0, 2.0):
        ends = ends_of(kalman, off)
        q = np.kron([[1 / 3, 1 / 2], [1 / 2, 1.0]], 0.5 * np.eye(2))
        p = f @ ends.start.covariance @ f.T + q + 0.1 * np.eye(4)
        exact = stats.multivariate_normal(cov=p).logpdf([off, 0.0, 0.0, 0.0])
        assert bridge.log_evidence(ends) == pytest.approx(exact, abs=1e-6)
    road = one_cell_map(mean=0.06, concentration=300.0, speed=8.0, shape=60.0)
    particles = gaussian_belief(ParticleFilter(road, CONFIG), 0, *ends_of(kalman, 0.0).start)
    start = particles.states(np.zeros(1, np.int64))
    near, far = (
        bridge.log_density(particles, particles.straight(), ends_of(kalman, off), start, key=1) for off in (0.0, 2.0)
    )
    assert near > far + 1.0
