"""One belief for each vehicle: its own, whoever else is there, and the truth of a Kalman filter where there is one."""

import os
from dataclasses import fields, replace

import numpy as np
import pytest

from dirprim_filter.config import FilterConfig
from dirprim_filter.detections import Detections
from dirprim_filter.distributions import Gamma
from dirprim_filter.estimates import Estimates
from dirprim_filter.filtering import ConstantVelocityKalman, Tracker
from dirprim_filter.filtering.belief import FIRST_CAPACITY
from dirprim_filter.filtering.measurements import OUTLIER_EXTENT_M
from oracles import kalman_known_velocity
from situations import TRUSTING, one_cell_map, ring_traffic


@pytest.fixture(scope="module")
def traffic():
    """Forty named vehicles, reported with noise of half a metre for three seconds."""
    tracks = ring_traffic(np.random.default_rng(21), n_rows=30)
    noise = np.random.default_rng(22).normal(0, 0.5, tracks.position.shape)
    names = np.char.add("car ", tracks.track_id.astype(str))
    return Detections(track_id=names, time_ns=tracks.time_ns, position=tracks.position + noise)


def one(name, time_s, x, y):
    return Detections(track_id=[name], time_ns=[round(time_s * 1e9)], position=[[x, y]])


def track(primitive_map, frames, *, seed=1, n_particles=100, tracking=TRUSTING, **knobs):
    """Estimates of every frame, and the tracker."""
    config = FilterConfig(n_particles=n_particles, **knobs)
    tracker = Tracker(primitive_map, config=config, tracking=tracking, rng=np.random.default_rng(seed))
    found = []
    for frame in frames:
        tracker.predict(frame)
        tracker.weigh()
        found.append(tracker.estimate())
        tracker.resample()
    return Estimates.concatenate(found), tracker


def of_vehicle(estimates, name, *, but=()):
    """The bytes of everything that was believed of one vehicle, but for some columns."""
    rows = np.asarray(estimates.track_id) == name
    assert rows.any()
    return [getattr(estimates, f.name)[rows].tobytes() for f in fields(estimates)[1:] if f.name not in but]


def test_the_same_seed_gives_identical_estimates_and_another_gives_others(ring_map, traffic):
    first, again = (track(ring_map, traffic.frames())[0] for _ in range(2))
    for f in fields(first):
        assert getattr(first, f.name).tobytes() == getattr(again, f.name).tobytes()
    other = track(ring_map, traffic.frames(), seed=2)[0]
    assert of_vehicle(other, "car 3") != of_vehicle(first, "car 3")


@pytest.fixture(scope="module")
def everybody(ring_map, traffic):
    return track(ring_map, traffic.frames())[0]


def test_a_vehicles_estimates_are_the_same_to_the_byte_without_the_others(ring_map, traffic, everybody):
    for names in (["car 3"], ["car 39", "car 3", "car 17"]):
        rows = np.isin(traffic.track_id, names)
        few = Detections(
            track_id=traffic.track_id[rows], time_ns=traffic.time_ns[rows], position=traffic.position[rows]
        )
        alone, _ = track(ring_map, few.frames())
        for name in names:
            assert of_vehicle(alone, name) == of_vehicle(everybody, name)


def test_a_vehicles_estimates_are_the_same_to_the_byte_in_any_order(ring_map, traffic, everybody):
    rows = np.random.default_rng(0).permutation(len(traffic))
    shuffled = Detections(
        track_id=traffic.track_id[rows], time_ns=traffic.time_ns[rows], position=traffic.position[rows]
    )
    mixed, _ = track(ring_map, shuffled.frames())
    assert mixed.track_id.tolist() != everybody.track_id.tolist()
    for name in np.unique(traffic.track_id):
        assert of_vehicle(mixed, name) == of_vehicle(everybody, name)


def test_a_vehicles_estimates_are_the_same_to_the_byte_on_any_number_of_threads(
    ring_map, traffic, everybody, monkeypatch
):
    for n_threads in (1, 7):
        monkeypatch.setattr(os, "cpu_count", lambda n=n_threads: n)
        found, tracker = track(ring_map, traffic.frames())
        assert tracker._filter._n_threads == n_threads
        for name in ("car 0", "car 20", "car 39"):
            assert of_vehicle(found, name) == of_vehicle(everybody, name)


def test_a_vehicle_unseen_for_longer_than_the_gap_begins_anew(ring_map):
    frames = [one("a", t, 20.0, 0.5) for t in (0.0, 0.1, 0.2, 0.3, 5.3, 10.4)]
    found, _ = track(ring_map, frames, max_gap_s=5.0)
    assert np.flatnonzero(found.log_evidence == 0).tolist() == [0, 5]
    fresh, _ = track(ring_map, frames[5:])
    assert of_vehicle(fresh, "a") == [column[-len(column) // 6 :] for column in of_vehicle(found, "a")]


def on_the_ring(time_s):
    """Where a vehicle is that drives at 8 m/s."""
    return 20.0 * np.array([np.cos(0.4 * time_s), np.sin(0.4 * time_s)])


def test_a_jump_of_a_kilometre_is_begun_anew_and_counted(ring_map):
    times = 0.1 * np.arange(20)
    path = {
        "a": np.array([on_the_ring(t) + np.array([1000.0 * (t > 0.95), 0.0]) for t in times]),
        "b": np.array([on_the_ring(t + 4.0) for t in times]),
    }
    frames = [
        Detections(track_id=["a", "b"], time_ns=np.full(2, round(t * 1e9)), position=[path["a"][i], path["b"][i]])
        for i, t in enumerate(times)
    ]
    found, tracker = track(ring_map, frames)
    assert tracker.recoveries == 1
    for f in fields(found)[1:]:
        assert np.isfinite(getattr(found, f.name)).all()
    error = np.abs(found.position[found.track_id == "a"] - path["a"]).max(axis=1)
    assert error[10] > 900  # the first might be an outlier, the second is not
    assert np.delete(error, 10).max() < 2.0
    calm, tracker = track(ring_map, [one("b", t, *path["b"][i]) for i, t in enumerate(times)])
    assert tracker.recoveries == 0
    assert of_vehicle(calm, "b") == of_vehicle(found, "b")


def test_an_empty_frame_gives_no_estimate_and_changes_nothing(ring_map):
    frames = [one("a", 0.0, 20.0, 0.5), Detections.none(), one("a", 0.1, 20.0, 1.3)]
    found, tracker = track(ring_map, frames)
    assert len(found) == 2
    without, _ = track(ring_map, frames[::2])
    assert of_vehicle(found, "a") == of_vehicle(without, "a")
    tracker.predict(Detections.none())
    assert len(tracker.particles()) == 0


def both(times_s, names=("a", "b")):
    return Detections(
        track_id=list(names), time_ns=[round(t * 1e9) for t in times_s], position=[[20.0, 0.5], [0.0, 20.0]]
    )


@pytest.mark.parametrize("filter_of", ["particles", "kalman"])
@pytest.mark.parametrize(
    ("frame", "message"),
    [
        (both([0.6, 0.6], names=("a", "a")), "each track id once"),
        (both([0.6, 0.7]), "one instant"),
        (both([0.4, 0.4]), "expected times after 500000000 ns, got 400000000"),
        (both([0.5, 0.5]), "expected times after 500000000 ns, got 500000000"),
        (one("b", 0.4, 20.0, 0.0), "expected times after 500000000 ns, got 400000000"),
    ],
)
def test_a_frame_out_of_order_is_refused_and_changes_nothing(ring_map, filter_of, frame, message):
    def followed(bad):
        tracker = (
            Tracker(ring_map, config=FilterConfig(n_particles=50), tracking=TRUSTING, rng=np.random.default_rng(0))
            if filter_of == "particles"
            else Tracker(
                ConstantVelocityKalman(acceleration_density=1.0), tracking=TRUSTING, rng=np.random.default_rng(0)
            )
        )
        tracker.predict(one("a", 0.5, 20.0, 0.0))
        tracker.weigh()
        tracker.resample()
        if bad is not None:
            with pytest.raises(ValueError, match=message):
                tracker.predict(bad)
        tracker.predict(both([0.8, 0.8]))
        tracker.weigh()
        return tracker.estimate()

    before, after = followed(None), followed(frame)
    assert of_vehicle(after, "a") == of_vehicle(before, "a")
    assert of_vehicle(after, "b") == of_vehicle(before, "b")


def test_particles_weigh_one_for_each_vehicle_and_are_copied_before_the_next_step(ring_map, traffic):
    frames = list(traffic.frames())
    _, tracker = track(ring_map, frames[:4])
    tracker.predict(frames[4])
    tracker.weigh()
    estimates, samples = tracker.estimate(), tracker.particles()
    particles = samples.thinned(1)
    weight = particles.weight.reshape(len(estimates), 100)
    np.testing.assert_allclose(weight.sum(axis=1), 1.0, rtol=1e-12)
    np.testing.assert_array_equal(particles.vehicle, np.repeat(np.arange(40), 100))
    mean = np.einsum("vp,vpi->vi", weight, particles.position.reshape(40, 100, 2))
    np.testing.assert_allclose(mean, estimates.position, rtol=1e-9)
    tracker.resample()
    np.testing.assert_allclose(np.einsum("vp,vpi->vi", weight, particles.position.reshape(40, 100, 2)), mean)
    assert (weight.max(axis=1) > 1 / 50).any()  # they were weighed
    assert len(samples) == len(particles)
    for late in (lambda: samples.thinned(7), lambda: samples.of(3)):
        with pytest.raises(RuntimeError, match="moved on: copy what is wanted"):
            late()


def test_some_particles_are_some_of_all(ring_map, traffic):
    _, tracker = track(ring_map, list(traffic.frames())[:4])
    samples, all_of_them = tracker.particles(), tracker.particles().thinned(1)
    odd = np.arange(40) % 2 == 1
    of_odd = np.flatnonzero((np.arange(4000) % 7 == 0) & np.repeat(odd, 100))
    for some, rows in (
        (samples.of(7), slice(700, 800)),
        (samples.thinned(7), slice(None, None, 7)),
        (samples.thinned(7, rows=odd), of_odd),
        (all_of_them.thinned(7, rows=odd), of_odd),
    ):
        for name in ("position", "direction", "speed", "weight", "vehicle", "mode"):
            np.testing.assert_array_equal(getattr(some, name), getattr(all_of_them, name)[rows])


def test_a_thousand_vehicles_one_after_another_need_no_more_memory_than_a_few(ring_map):
    frames = [one(f"car {i}", float(i), 20.0, 0.0) for i in range(1000)]
    _, tracker = track(ring_map, frames, n_particles=5, max_gap_s=5.0)
    assert tracker._filter.belief.n_slots == FIRST_CAPACITY
    _, hoarder = track(ring_map, frames[:50], n_particles=5, max_gap_s=1e6)
    assert hoarder._filter.belief.n_slots > FIRST_CAPACITY


def test_where_motion_is_linear_and_gaussian_the_belief_is_the_kalman_filters_to_monte_carlo_error():
    """Every vehicle goes east at 10 m/s: only where it was first is unknown."""
    n, dt_s, noise_m = 20_000, 0.5, 0.8
    measured = np.array([10.0 * dt_s, 0.0]) * np.arange(12)[:, None]
    measured += np.random.default_rng(5).normal(0, noise_m, measured.shape)
    frames = [one("a", i * dt_s, *place) for i, place in enumerate(measured)]
    found, _ = track(
        one_cell_map(), frames, n_particles=n, noise_m=noise_m, resample_below=0.0,
        outlier_probability=1e-12, innovation_outlier_rate=0.0, own_way_rate=0.0,
    )  # fmt: skip

    def off(**change):
        """The largest error in units of what n particles may be off; their weights are unequal, hence n / 10."""
        known = {"velocity": np.array([10.0, 0.0]), "noise_m": noise_m, "drift": 0.0} | change
        mean, variance, evidence = kalman_known_velocity(measured, dt_s, **known)
        worth = n / 10
        return max(
            np.abs((found.position - mean) / np.sqrt(variance / worth)[:, None]).max(),
            np.abs(np.linalg.det(found.covariance) / variance**2 - 1).max() / np.sqrt(4 / worth),
            np.abs(found.log_evidence - evidence).max() * np.sqrt(worth),
        )

    assert off() < 5
    for change in ({"velocity": np.array([9.5, 0.0])}, {"noise_m": 0.9}, {"drift": 0.05}):
        assert off(**change) > 5


def believed(turn, shift, seed):
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
        [np.mean(column, axis=0) for column in zip(*(believed(turn, shift, seed) for seed in range(6)), strict=True)]
        for turn, shift in ((0.0, np.zeros(2)), (2.0, np.array([300.0, -700.0])))
    )
    deviation = np.sqrt(np.trace(own[1], axis1=1, axis2=2) / 2.0)[:, None]
    assert (np.abs(other[0] - own[0]) / deviation).mean() < 0.1
    assert np.abs(np.log(np.linalg.eigvalsh(other[1]) / np.linalg.eigvalsh(own[1]))).mean() < 0.15
    assert (np.abs(other[1] - own[1]) / deviation[..., None] ** 2).mean() < 0.1
    other = believed(0.3, np.zeros(2), 0)  # a control: not turned back far enough
    assert (
        np.abs(other[0] @ [[np.cos(0.1), -np.sin(0.1)], [np.sin(0.1), np.cos(0.1)]] - own[0]) / deviation
    ).mean() > 0.5


def test_a_measurement_is_unexplained_where_an_outlier_explains_more_than_the_particles(ring_map):
    _, tracker = track(ring_map, [one("a", 0.0, 20.0, 0.0)])
    slot = np.array([tracker._roster.slots_of(["a"])[0]])
    off = np.linspace(0.0, 6.0, 61)
    said = []
    for d in off:
        tracker._filter.copy(slot, slot + 1)
        said.append(tracker._filter.weigh(slot + 1, one("", 0.1, 20.0 + d, 0.0)))
    outlier = tracker.config.outlier_probability / OUTLIER_EXTENT_M**2
    unexplained = np.array([evidence.is_unexplained[0] for evidence in said])
    log_density = np.array([evidence.log_density[0] for evidence in said])
    assert not unexplained[0]
    assert unexplained[-1]
    np.testing.assert_array_equal(unexplained, log_density < np.log(2 * outlier))


def test_time_does_not_go_back_where_nothing_was_seen_either(ring_map):
    _, tracker = track(ring_map, [one("a", 0.0, 20.0, 0.0), one("a", 0.1, 20.0, 0.8)])
    for time_ns in (0, 50_000_000, 100_000_000):
        with pytest.raises(ValueError, match=f"expected times after 100000000 ns, got {time_ns}"):
            tracker.predict(Detections.none(), time_ns=time_ns)
    tracker.predict(Detections.none())  # no frame
    tracker.predict(Detections.none(), time_ns=200_000_000)
    tracker.weigh()
    assert tracker.estimate().unseen_s.tolist() == pytest.approx([0.1])


def test_one_step_is_predict_weigh_estimate_and_resample(ring_map, traffic):
    frames = list(traffic.frames())[:6]
    tracker = Tracker(ring_map, config=FilterConfig(n_particles=100), tracking=TRUSTING, rng=np.random.default_rng(1))
    stepped = Estimates.concatenate([tracker.step(frame) for frame in frames])
    assert stepped == track(ring_map, frames)[0]


@pytest.mark.parametrize(
    ("given", "message"),
    [
        ({"rng": 0}, r"rng: expected a Generator, such as np.random.default_rng\(0\), got 0"),
        ({"config": {"n_particles": 5}}, "config: expected a FilterConfig, got {'n_particles': 5}"),
        ({"tracking": FilterConfig()}, "tracking: expected a TrackingConfig, got FilterConfig"),
        ({"model": "map.mcap"}, "model: expected a map or a filter, got the path 'map.mcap'; load_map reads it"),
    ],
)
def test_what_a_tracker_cannot_be_made_of_is_reported(given, message):
    with pytest.raises(TypeError, match=message):
        Tracker(**{"model": one_cell_map(), "rng": np.random.default_rng(0)} | given)


def test_weighing_twice_is_refused():
    tracker = Tracker(one_cell_map(), config=FilterConfig(n_particles=5), rng=np.random.default_rng(0))
    with pytest.raises(ValueError, match="weigh: expected once for each frame, after predict"):
        tracker.weigh()
    tracker.step(one("a", 0.0, 0.0, 0.0))
    with pytest.raises(ValueError, match="weigh: expected once for each frame, after predict"):
        tracker.weigh()


def test_a_lone_outlier_moves_no_belief_and_is_no_recovery(ring_map):
    times = 0.1 * np.arange(20)
    path = np.array([on_the_ring(t) for t in times])
    seen = path + np.where(np.arange(20)[:, None] == 12, [60.0, -80.0], 0.0)
    found, tracker = track(ring_map, [one("a", t, *place) for t, place in zip(times, seen, strict=True)])
    assert tracker.recoveries == 0
    assert np.abs(found.position - path).max() < 2.0
    hasty = Tracker(
        ring_map, config=FilterConfig(n_particles=100), tracking=replace(TRUSTING, lost_after=1),
        rng=np.random.default_rng(1),
    )  # fmt: skip
    for t, place in zip(times, seen, strict=True):
        hasty.predict(one("a", t, *place))
        hasty.weigh()
        hasty.resample()
    assert hasty.recoveries == 2  # there and back


def test_who_is_back_where_no_belief_reaches_is_begun_anew_at_once(monkeypatch):
    """After three seconds out of sight 100 m farther than expected: a lone outlier in sight begins nothing anew."""
    frames = [*(one("a", 0.1 * i, i, 0.0) for i in range(20)), one("a", 5.0, 150.0, 0.0)]
    road = one_cell_map(concentration=1e3, shape=100.0)
    found, tracker = track(road, frames)
    assert tracker.recoveries == 1
    assert abs(found.position[-1, 0] - 150.0) < 2.0
    monkeypatch.setattr("dirprim_filter.filtering.tracker.AWAY_S", 1e9)
    found, tracker = track(road, frames)
    assert tracker.recoveries == 0  # it may be an outlier
    assert abs(found.position[-1, 0] - 150.0) > 50.0


@pytest.mark.parametrize("filter_of", ["particles", "kalman"])
def test_out_of_sight_a_labelled_vehicle_is_reported_until_it_is_likelier_gone(ring_map, filter_of):
    frames = [one("a", 0.1 * i, *on_the_ring(0.1 * i)) for i in range(15)]
    frames += [one("b", 1.53 + 0.1 * i, *on_the_ring(3.0 + 0.1 * i)) for i in range(60)]
    config = FilterConfig(n_particles=200, max_gap_s=20.0, own_way_rate=0.0)  # off the map a vehicle has left at once
    model = ring_map if filter_of == "particles" else ConstantVelocityKalman(acceleration_density=3.0, config=config)
    tracker = Tracker(model, config=config, rng=np.random.default_rng(0))
    reported = []
    for frame in frames:
        tracker.predict(frame)
        tracker.weigh()
        reported.append(tracker.estimate())
        tracker.resample()
    unseen = Estimates.concatenate(reported)
    unseen = unseen[(unseen.track_id == "a") & (unseen.unseen_s > 0)]
    np.testing.assert_allclose(np.diff(unseen.unseen_s), 0.1, atol=1e-9)
    assert (np.diff(unseen.existence) < 0).all()
    assert (unseen.existence >= 0.5).all()
    assert 3.0 < unseen.unseen_s.max() < 6.0
    spread = np.trace(unseen.covariance, axis1=1, axis2=2)
    assert spread[20] > spread[0]
    assert (unseen.log_evidence == 0).all()


@pytest.mark.parametrize("filter_of", ["particles", "kalman"])
def test_out_of_sight_a_vehicle_is_the_same_whenever_others_are_seen(ring_map, filter_of):
    """Frames at odd times cut the gap in odd pieces; where the vehicle is believed to be must not depend on them.

    Whether it exists does: each is a frame in which it was not seen.
    """

    def at_the_end(others):
        frames = [one("a", 0.1 * i, *on_the_ring(0.1 * i)) for i in range(10)]
        frames += [one("b", t, 0.0, 20.0) for t in others] + [one("a", 3.0, *on_the_ring(3.0))]
        config = FilterConfig(n_particles=100)
        kalman = ConstantVelocityKalman(acceleration_density=3.0, config=config)
        tracker = Tracker(ring_map if filter_of == "particles" else kalman, config=config, rng=np.random.default_rng(1))
        for frame in frames:
            tracker.predict(frame)
            tracker.weigh()
            reported = tracker.estimate()
            tracker.resample()
        return of_vehicle(reported, "a", but=["existence"])

    assert at_the_end([]) == at_the_end([0.93, 1.0, 1.777, 2.95]) == at_the_end([2.999999999])


def test_beliefs_without_any_weight_are_begun_anew_at_once_and_counted(ring_map):
    _, tracker = track(ring_map, [one("a", 0.1 * i, *on_the_ring(0.1 * i)) for i in range(5)])
    tracker._filter.belief.cloud.position[tracker._roster.slots_of(["a"])] = np.inf
    tracker.predict(one("a", 0.5, *on_the_ring(0.5)))
    tracker.weigh()
    assert tracker.recoveries == 1
    found = tracker.estimate()
    for f in fields(found)[1:]:
        assert np.isfinite(getattr(found, f.name)).all()
    assert np.abs(found.position - on_the_ring(0.5)).max() < 1.0


def share_followed(primitive_map, **knobs):
    """Of 40 vehicles that leave a ring straight on, where nobody went, those known to 2 m from 2 s on."""
    names, times = [f"v{i}" for i in range(40)], 0.1 * np.arange(60)
    path = np.column_stack([20.0 + 8.0 * times, 3.0 * times])
    frames = [
        Detections(track_id=names, time_ns=np.full(40, round(t * 1e9)), position=np.tile(place, (40, 1)))
        for t, place in zip(times, path, strict=True)
    ]
    found, tracker = track(primitive_map, frames, **knobs)
    step, vehicle = np.rint(found.time_ns * 1e-8).astype(int), [names.index(name) for name in found.track_id]
    error = np.full((60, 40), np.inf)
    error[step, vehicle] = np.linalg.norm(found.position - path[step], axis=-1)
    return (error[20:].max(axis=0) < 2.0).mean(), tracker.recoveries


def test_vehicles_that_leave_the_map_are_followed(ring_map):
    """Of 240 such vehicles none was lost, and no belief was reinitialised."""
    followed, recoveries = share_followed(ring_map)
    assert followed > 37 / 40
    assert recoveries < 3
    never = replace(TRUSTING, lost_after=10**9)
    followed, _ = share_followed(ring_map, tracking=never, innovation_outlier_rate=0.0)
    assert followed < 0.5  # who neither begins anew nor expects outliers loses them


def test_an_id_reused_elsewhere_is_a_new_belief_after_two_measurements(ring_map):
    here = [one("7", 0.1 * i, *on_the_ring(0.1 * i)) for i in range(10)]
    there = [one("7", 1.0 + 0.1 * i, *on_the_ring(np.pi / 0.4 + 0.1 * i)) for i in range(10)]
    found, tracker = track(ring_map, here + there)
    assert tracker.recoveries == 1
    assert np.linalg.norm(found.position[-1] - on_the_ring(np.pi / 0.4 + 0.9)) < 1.5


def test_an_hour_later_a_belief_begins_anew(ring_map):
    found, _ = track(ring_map, [one("a", 0.0, 20.0, 0.5), one("a", 3600.0, 0.0, 20.0)])
    assert found.log_evidence.tolist() == [0.0, 0.0]
    assert np.abs(found.position[1] - [0.0, 20.0]).max() < 0.2


@pytest.mark.parametrize("filter_of", ["particles", "kalman"])
def test_what_a_sensor_knows_of_motion_and_of_its_errors_sharpens_the_belief(ring_map, filter_of):
    times = 0.1 * np.arange(3)
    path = np.array([on_the_ring(t) for t in times])
    course, n = 0.4 * times + np.pi / 2, times.size

    def spread(**known):
        config = FilterConfig(n_particles=2000)
        kalman = ConstantVelocityKalman(acceleration_density=3.0, config=config)
        tracker = Tracker(
            ring_map if filter_of == "particles" else kalman, config=config, tracking=TRUSTING,
            rng=np.random.default_rng(3),
        )  # fmt: skip
        seen = Detections(track_id=["a"] * n, time_ns=(times * 1e9).astype(int), position=path, **known)
        for frame in seen.frames():
            tracker.predict(frame)
            tracker.weigh()
            reported = tracker.estimate()
            tracker.resample()
        return reported.speed_std[0], np.trace(reported.covariance[0])

    blind = spread()
    knows_motion = spread(direction=course, speed=np.full(n, 8.0))
    knows_errors = spread(covariance=np.tile(0.01 * np.eye(2), (n, 1, 1)))
    assert knows_motion[0] < 0.7 * blind[0]
    assert knows_errors[1] < 0.3 * blind[1]
    turned_round = spread(direction=course + np.pi, speed=np.full(n, 8.0))
    assert np.isfinite(turned_round).all()


def coverage(primitive_map, stated_noise_m, *, n_vehicles, seed):
    """Shares of the true positions in the ellipses that should hold 0.5 and 0.9, from the second second on."""
    rng = np.random.default_rng(seed)
    traffic = ring_traffic(rng, n_vehicles=n_vehicles, n_rows=30)
    seen = traffic.position + rng.normal(0, 0.5, traffic.position.shape)
    frames = Detections(track_id=traffic.track_id.astype(str), time_ns=traffic.time_ns, position=seen).frames()
    found, _ = track(primitive_map, frames, n_particles=500, noise_m=stated_noise_m)
    truth = {(str(i), t): p for i, t, p in zip(traffic.track_id, traffic.time_ns, traffic.position, strict=True)}
    off = found.position - [truth[key] for key in zip(found.track_id.astype(str), found.time_ns, strict=True)]
    squared = np.einsum("ni,nij,nj->n", off, np.linalg.inv(found.covariance[:, :2, :2]), off)
    late = squared[found.time_ns - traffic.time_ns.min() > 1e9]
    return np.array([(late <= -2.0 * np.log(1.0 - share)).mean() for share in (0.5, 0.9)])


@pytest.mark.parametrize("seed", [31, 32])
def test_beliefs_are_as_wide_as_they_err(ring_map, seed):
    """Errors last for half a second, so two seconds of a vehicle are four samples: five standard errors of the shares.

    The mean of the squares is no measure: a few vehicles in a hundred are lost, and rule it.
    """
    n_vehicles, share = 200, np.array([0.5, 0.9])
    allowed = 5.0 * np.sqrt(share * (1.0 - share) / (4 * n_vehicles))
    found = coverage(ring_map, 0.5, n_vehicles=n_vehicles, seed=seed)
    assert (found > share - allowed).all()
    assert (found < share + allowed + 0.05).all()  # a filter grants drivers more than these, who never stray, need
    too_sure = coverage(ring_map, 0.3, n_vehicles=n_vehicles, seed=seed)  # the control: of a sensor of 0.5 m
    assert (share - too_sure > allowed).all()


def test_who_creeps_where_all_others_drove_fast_is_found_after_some_detections():
    rng, fast = np.random.default_rng(3), one_cell_map(concentration=1e3)
    fast = replace(fast, speed=Gamma(shape=np.array([[400.0], [2.0]]), rate=np.array([[20.0], [0.2]])))
    noise = rng.normal(0, 0.3, (40, 2))
    frames = [one("slow", 0.1 * i, 0.2 * i + noise[i, 0], noise[i, 1]) for i in range(40)]
    found, tracker = track(fast, frames, n_particles=1000, noise_m=0.3)
    off = np.linalg.norm(found.position - np.column_stack([2e-9 * found.time_ns, np.zeros(len(found))]), axis=1)
    assert len(found) == 40
    assert off[10:].max() < 0.9
    assert tracker.recoveries < 5
