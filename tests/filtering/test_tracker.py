"""One belief for each vehicle: its own, whoever else is there, and the truth of a Kalman filter where there is one."""

import os
from dataclasses import replace

import numpy as np
import pytest
from scipy import stats

from dirprim_filter.columns import column_fields
from dirprim_filter.config import FilterConfig, TrackingConfig
from dirprim_filter.detections import Detections
from dirprim_filter.estimates import Estimates
from dirprim_filter.filtering import ParticleFilter, Tracker
from dirprim_filter.filtering.belief import FIRST_CAPACITY
from dirprim_filter.origin import Origin
from oracles import filterpy_constant_velocity
from situations import TRUSTING, beside, on_the_ring, one_cell_map, ring_traffic, seen_at, tracker_of


@pytest.fixture(scope="module")
def traffic():
    """Forty named vehicles, reported with noise of half a metre for three seconds."""
    tracks = ring_traffic(np.random.default_rng(21), n_rows=30)
    noise = np.random.default_rng(22).normal(0, 0.5, tracks.position.shape)
    names = np.char.add("car ", tracks.track_id.astype(str))
    return Detections(track_id=names, time_ns=tracks.time_ns, position=tracks.position + noise)


def one(name, time_s, x, y):
    return seen_at(time_s, [(x, y)], ids=[name])


def round_the_ring(times_s):
    return [one("a", t, *on_the_ring(t)) for t in times_s]


def track(model, frames, *, seed=1, n_particles=100, tracking=TRUSTING, **settings):
    """Estimates of every frame, and the tracker: on a map, or by a Kalman filter."""
    tracker = tracker_of(model, tracking=tracking, seed=seed, n_particles=n_particles, **settings)
    return Estimates.concatenate([tracker.step(frame) for frame in frames]), tracker


def of_vehicle(estimates, name, *, but=()):
    """The bytes of everything that was estimated of one vehicle, but for some columns."""
    rows = np.asarray(estimates.track_id) == name
    assert rows.any()
    return [getattr(estimates, f.name)[rows].tobytes() for f in column_fields(Estimates)[1:] if f.name not in but]


def test_a_vehicles_estimates_are_the_same_to_the_byte(ring_map, traffic, monkeypatch):
    """Without the others, in any order, on any number of threads; with another seed they are not."""
    of_all, _ = track(ring_map, traffic.frames())
    shuffled = traffic[np.random.default_rng(0).permutation(len(traffic))]
    three = traffic[np.isin(traffic.track_id, ["car 39", "car 3", "car 17"])]
    alone = traffic[traffic.track_id == "car 3"]
    for n_threads, some in ((1, shuffled), (7, traffic), (2, three), (1, alone)):
        monkeypatch.setattr(os, "cpu_count", lambda n=n_threads: n)
        found, tracker = track(ring_map, some.frames())
        assert tracker._filter._n_threads == n_threads
        for name in np.unique(some.track_id):
            assert of_vehicle(found, name) == of_vehicle(of_all, name)
    assert of_vehicle(track(ring_map, alone.frames(), seed=2)[0], "car 3") != of_vehicle(of_all, "car 3")


@pytest.mark.parametrize("late_s", [10.4, 3600.0])
def test_a_vehicle_unseen_for_longer_than_the_gap_is_reinitialised(either, late_s):
    frames = [one("a", t, 20.0, 0.5) for t in (0.0, 0.1, 0.2, 0.3, 5.3, late_s)]
    found, _ = track(either, frames, max_gap_s=5.0)
    assert np.flatnonzero(found.log_evidence == 0).tolist() == [0, 5]
    fresh, _ = track(either, frames[5:])
    assert of_vehicle(fresh, "a") == [column[-len(column) // 6 :] for column in of_vehicle(found, "a")]


def both(time_s, names=("a", "b")):
    return seen_at(time_s, [(20.0, 0.5), (0.0, 20.0)], ids=names)


@pytest.mark.parametrize(
    ("frame", "how", "message"),
    [
        (both(0.6, names=("a", "a")), {}, "each track id once"),
        (replace(both(0.6), time_ns=[600_000_000, 700_000_000]), {}, "one instant"),
        (replace(both(0.4), origin=Origin(47.0, 8.0)), {}, "expected times after 500000000 ns, got 400000000"),
        (both(0.6), {"time_ns": 700_000_000}, "time_ns: expected 600000000, that of the detections, got 700000000"),
        (Detections.none(), {"time_ns": 500_000_000}, "expected times after 500000000 ns, got 500000000"),
        (Detections.none(), {}, "expected the time of a frame without detections"),
        (both(0.6), {"is_scan": False}, "expected none where the sensor did not look, got 2"),
    ],
)
def test_a_frame_out_of_order_is_refused_and_changes_nothing(either, frame, how, message):
    def followed(*, bad):
        _, tracker = track(either, [one("a", 0.5, 20.0, 0.0)])
        if bad:
            with pytest.raises(ValueError, match=message):
                tracker.track(frame, **how)
        return tracker.step(both(0.8))

    assert followed(bad=True) == followed(bad=False)


def test_particles_weigh_one_for_each_vehicle_and_are_copied_before_the_next_step(ring_map, traffic):
    frames = list(traffic.frames())
    _, tracker = track(ring_map, frames[:4])
    frame = tracker.track(frames[4])
    estimates, samples = frame.estimates, frame.particles
    particles = samples.thinned(1)
    weight = particles.weight.reshape(len(estimates), 100)
    np.testing.assert_allclose(weight.sum(axis=1), 1.0, rtol=1e-12)
    np.testing.assert_array_equal(particles.vehicle, np.repeat(np.arange(40), 100))
    mean = np.einsum("vp,vpi->vi", weight, particles.position.reshape(40, 100, 2))
    np.testing.assert_allclose(mean, estimates.position, rtol=1e-9)
    for some, rows in (
        (particles.of(7), slice(700, 800)),
        (samples.thinned(7), slice(None, None, 7)),
        (particles.thinned(7), slice(None, None, 7)),
    ):
        for name in ("position", "direction", "speed", "weight", "vehicle", "manoeuvre"):
            np.testing.assert_array_equal(getattr(some, name), getattr(particles, name)[rows])
    tracker.step(frames[5])
    np.testing.assert_allclose(np.einsum("vp,vpi->vi", weight, particles.position.reshape(40, 100, 2)), mean)
    assert (weight.max(axis=1) > 1 / 50).any()  # they were weighed
    assert len(samples) == len(particles)
    with pytest.raises(RuntimeError, match="moved on: copy what is wanted"):
        samples.thinned(7)


def test_many_vehicles_one_after_another_need_no_more_memory_than_a_few(ring_map):
    frames = [one(f"car {i}", float(i), 20.0, 0.0) for i in range(50)]
    _, tracker = track(ring_map, frames, n_particles=5, max_gap_s=5.0)
    assert len(tracker._filter.cloud.speed) == FIRST_CAPACITY
    _, hoarder = track(ring_map, frames, n_particles=5, max_gap_s=1e6)
    assert len(hoarder._filter.cloud.speed) > FIRST_CAPACITY


def test_where_motion_is_linear_and_gaussian_the_belief_is_the_kalman_filters_to_monte_carlo_error():
    """Every vehicle goes east at 10 m/s: only where it was first is unknown."""
    n, dt_s, noise_m = 20_000, 0.5, 0.8
    time_s, east = dt_s * np.arange(12), np.array([10.0, 0.0])
    measured = time_s[:, None] * east + np.random.default_rng(5).normal(0, noise_m, (12, 2))
    frames = [one("a", t, *place) for t, place in zip(time_s, measured, strict=True)]
    found, _ = track(
        one_cell_map(), frames, n_particles=n, noise_m=noise_m, resample_below=0.0,
        outlier_probability=1e-12, innovation_outlier_rate=0.0, own_way_rate=0.0,
    )  # fmt: skip

    def off(*, velocity=east, **change):
        """The largest error in units of what n particles may be off; their weights are unequal, hence n / 10."""
        known, way = {"noise_m": noise_m, "density": 0.0, "first_speed_std": 1e-4} | change, time_s[:, None] * velocity
        (mean, covariance), _ = filterpy_constant_velocity(measured - way, time_s, **known)
        mean, variance, worth = mean[:, :2] + way, covariance[:, 0, 0], n / 10
        expected, spread = mean[:-1] + dt_s * velocity, np.sqrt(variance[:-1, None] + known["noise_m"] ** 2)
        evidence = np.append(0.0, stats.norm.logpdf(measured[1:], expected, spread).sum(axis=1))
        return max(
            np.abs((found.position - mean) / np.sqrt(variance / worth)[:, None]).max(),
            np.abs(np.linalg.det(found.covariance) / variance**2 - 1).max() / np.sqrt(4 / worth),
            np.abs(found.log_evidence - evidence).max() * np.sqrt(worth),
        )

    assert off() < 5
    for change in ({"velocity": np.array([9.5, 0.0])}, {"noise_m": 0.9}, {"density": 0.5}):
        assert off(**change) > 5


def estimated(turn, shift, seed):
    """Places and covariances of a vehicle on a slow bend in a world that is turned and shifted, turned back."""
    c, s = np.cos(turn), np.sin(turn)
    there = np.array([[c, s], [-s, c]])
    times = 0.1 * np.arange(30)
    path = np.column_stack([10.0 * times, 0.3 * times**2]) + np.random.default_rng(0).normal(0, 0.5, (30, 2))
    spread = there.T @ np.diag([0.4, 0.1]) @ there
    frames = [
        replace(one("a", t, *(place @ there + shift)), covariance=spread[None])
        for t, place in zip(times, path, strict=True)
    ]
    world = one_cell_map(mean=turn, concentration=50.0, shape=20.0)
    found, _ = track(world, frames, n_particles=1000, seed=seed, innovation_outlier_rate=0.1)
    return (found.position - shift) @ there.T, there @ found.covariance @ there.T


def test_turn_and_shift_the_world_and_estimates_turn_and_shift_with_it():
    """The mean of six seeds of a thousand particles is known to some 3 % of a deviation."""
    own, other = (
        [np.mean(column, axis=0) for column in zip(*(estimated(turn, shift, seed) for seed in range(6)), strict=True)]
        for turn, shift in ((0.0, np.zeros(2)), (2.0, np.array([300.0, -700.0])))
    )
    deviation = np.sqrt(np.trace(own[1], axis1=1, axis2=2) / 2.0)[:, None]
    assert (np.abs(other[0] - own[0]) / deviation).mean() < 0.1
    assert np.abs(np.log(np.linalg.eigvalsh(other[1]) / np.linalg.eigvalsh(own[1]))).mean() < 0.15
    assert (np.abs(other[1] - own[1]) / deviation[..., None] ** 2).mean() < 0.1
    c, s = np.cos(0.1), np.sin(0.1)  # a control: turned back too far
    assert (np.abs(other[0] @ np.array([[c, -s], [s, c]]) - own[0]) / deviation).mean() > 0.5


def test_a_lone_outlier_in_sight_reinitialises_nothing_and_who_is_back_out_of_reach_does(ring_map):
    times = 0.1 * np.arange(20)
    path = np.array([on_the_ring(t) for t in times])
    seen = path + np.where(np.arange(20)[:, None] == 12, [60.0, -80.0], 0.0)
    frames = [one("a", t, *place) for t, place in zip(times, seen, strict=True)]
    found, tracker = track(ring_map, frames)
    assert tracker.recoveries == 0
    assert np.abs(found.position - path).max() < 2.0
    _, hasty = track(ring_map, frames, tracking=replace(TRUSTING, lost_after=1))
    assert hasty.recoveries == 2  # there and back
    frames = [*(one("a", 0.1 * i, i, 0.0) for i in range(20)), one("a", 5.0, 150.0, 0.0)]
    found, tracker = track(one_cell_map(concentration=1e3, shape=100.0), frames)
    assert tracker.recoveries == 1
    assert abs(found.position[-1, 0] - 150.0) < 2.0


def test_out_of_sight_a_vehicle_is_the_same_whenever_others_are_seen(either):
    """Frames at odd times cut the gap in odd pieces; its estimate must not depend on them.

    Whether it exists does: each is a frame in which it was not seen.
    """

    def at_the_end(others):
        frames = [*round_the_ring(0.1 * np.arange(10)), *(one("b", t, 0.0, 20.0) for t in others)]
        frames += round_the_ring([3.0])
        found, _ = track(either, frames, tracking=TrackingConfig())
        return of_vehicle(found[found.time_ns == 3_000_000_000], "a", but=["existence"])

    assert at_the_end([]) == at_the_end([0.93, 1.0, 1.777, 2.95]) == at_the_end([2.999999999])


class CountedSteps(ParticleFilter):
    """Counts the steps of its particles' motion."""

    n_steps = 0

    def predict(self, slot, dt_s, *under):
        step_s = under[1] if len(under) > 1 else self.config.step_s
        self.n_steps += int(np.ceil(dt_s / step_s - 1e-9).sum())
        super().predict(slot, dt_s, *under)


def test_a_vehicle_measured_seldom_moves_in_longer_steps_that_are_its_own():
    """Others cut its time in odd pieces; of one measured often steps stay short. Frames may leave out who is unseen."""
    config, road = FilterConfig(n_particles=200, max_gap_s=60.0), one_cell_map(side=1e5, concentration=1e3, shape=100.0)

    def at_the_end(every_s, others, **settings):
        times = every_s * np.arange(8)
        seen = [*(one("a", t, 10.0 * t, 0.0) for t in times), *(one("b", t, 0.0, 90.0) for t in others)]
        counted = CountedSteps(road, config)
        tracker = Tracker(counted, config=config, tracking=TRUSTING, rng=np.random.default_rng(1), **settings)
        frames = sorted(seen, key=lambda frame: frame.time_ns[0])
        found = Estimates.concatenate([tracker.step(frame) for frame in frames])
        return of_vehicle(found[found.time_ns == int(times[-1] * 1e9)], "a", but=["existence"]), counted.n_steps

    alone, n_steps = at_the_end(10.0, [])
    assert n_steps <= 100 + 6 * 21  # until two intervals are known, in tenths of a second
    odd = [60.93, 61.0, 63.777, 69.5]
    assert at_the_end(10.0, odd)[0] == alone == at_the_end(10.0, odd, unseen_s=0.0)[0]
    assert at_the_end(10.0, odd, unseen_s=0.0)[1] < at_the_end(10.0, odd)[1]
    assert at_the_end(1.0, [])[1] == 7 * 10


def coverage(primitive_map, stated_noise_m, *, n_vehicles, seed):
    """Shares of the true positions in the ellipses that should hold 0.5 and 0.9, from the second second on."""
    rng = np.random.default_rng(seed)
    traffic = ring_traffic(rng, n_vehicles=n_vehicles, n_rows=30)
    seen = traffic.position + rng.normal(0, 0.5, traffic.position.shape)
    frames = Detections(track_id=traffic.track_id.astype(str), time_ns=traffic.time_ns, position=seen).frames()
    found, _ = track(primitive_map, frames, n_particles=500, noise_m=stated_noise_m)
    off = found.position - traffic.position[beside(found, traffic)[1]]
    squared = np.einsum("ni,nij,nj->n", off, np.linalg.inv(found.covariance[:, :2, :2]), off)
    late = squared[found.time_ns - traffic.time_ns.min() > 1e9]
    return np.array([(late <= -2.0 * np.log(1.0 - share)).mean() for share in (0.5, 0.9)])


def test_beliefs_are_as_wide_as_they_err(ring_map):
    """Errors last for half a second, so two seconds of a vehicle are four samples: five standard errors of the shares.

    The mean of the squares is no measure: a few vehicles in a hundred are lost, and rule it.
    """
    n_vehicles, share = 200, np.array([0.5, 0.9])
    allowed = 5.0 * np.sqrt(share * (1.0 - share) / (4 * n_vehicles))
    found = coverage(ring_map, 0.5, n_vehicles=n_vehicles, seed=31)
    assert (found > share - allowed).all()
    assert (found < share + allowed + 0.05).all()  # a filter grants drivers more than these, who never stray, need
    too_sure = coverage(ring_map, 0.3, n_vehicles=n_vehicles, seed=31)  # the control: of a sensor of 0.5 m
    assert (share - too_sure > allowed).all()


def test_who_creeps_where_all_others_drove_fast_is_found_after_some_detections():
    rng, fast = np.random.default_rng(3), one_cell_map(concentration=1e3)
    modes = fast.modes._replace(shape=np.array([[400.0], [2.0]]), rate=np.array([[20.0], [0.2]]))
    fast = replace(fast, modes=modes)
    noise = rng.normal(0, 0.3, (40, 2))
    frames = [one("slow", 0.1 * i, 0.2 * i + noise[i, 0], noise[i, 1]) for i in range(40)]
    found, tracker = track(fast, frames, n_particles=1000, noise_m=0.3)
    off = np.linalg.norm(found.position - np.column_stack([2e-9 * found.time_ns, np.zeros(len(found))]), axis=1)
    assert len(found) == 40
    assert off[10:].max() < 0.9
    assert tracker.recoveries < 5


@pytest.mark.parametrize("turn", [0.0, 1.0, np.pi])
def test_who_is_seen_seldom_and_drives_against_all_others_is_followed(turn):
    """By the map alone each row that it does not explain would have the vehicle go back once more."""
    east = one_cell_map(concentration=1e3, speed=10.0, shape=25.0)
    course, rng = np.array([np.cos(turn), np.sin(turn)]), np.random.default_rng(6)
    frames = [one("a", 3.0 * i, *(27.0 * i * course + rng.normal(0.0, 0.2, 2))) for i in range(9)]
    found, tracker = track(east, frames, n_particles=500, noise_m=0.2)
    assert tracker.recoveries <= 4
    assert (np.cos(found.direction[5:] - turn) > 0.9).all()
    assert (np.abs(found.speed[5:] - 9.0) < 3.0).all()


@pytest.mark.parametrize("off_m", [60.0, 300.0])
def test_a_single_wrong_row_turns_no_vehicle_round(off_m):
    """It makes two that are not explained, there and back; no vehicle drove the way between them."""
    east = one_cell_map(concentration=50.0, speed=10.0, shape=9.0)
    for seed in range(6):
        rng = np.random.default_rng(seed)
        angle = rng.uniform(-np.pi, np.pi)
        put_off = np.where(np.arange(12)[:, None] == 7, off_m * np.array([np.cos(angle), np.sin(angle)]), 0.0)
        place = np.column_stack([28.0 * np.arange(12), np.zeros(12)]) + rng.normal(0.0, 0.5, (12, 2)) + put_off
        found, tracker = track(east, [one("a", 3.0 * i, *at) for i, at in enumerate(place)], noise_m=0.5, seed=seed)
        assert tracker.recoveries == 2
        assert (np.cos(found.direction[9:]) > 0.9).all()
