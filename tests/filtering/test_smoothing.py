"""The smoother against filterpy's, against exact regression, and by laws that hold whatever the filter."""

from dataclasses import replace

import numpy as np
import pytest
from scipy import stats

from dirprim_filter.config import FilterConfig, TrackingConfig
from dirprim_filter.detections import Detections
from dirprim_filter.estimates import EstimateList
from dirprim_filter.filtering import ConstantVelocityKalman, GroupTracker, ParticleFilter
from dirprim_filter.filtering.belief import States
from dirprim_filter.filtering.kalman import FIRST_SPEED_STD
from dirprim_filter.filtering.smoother import Smoother
from dirprim_filter.filtering.smoothing.links import Before, links_of, tempered
from dirprim_filter.filtering.smoothing.recorder import Recorder
from dirprim_filter.primitives.motion import PUSH_RATE
from dirprim_filter.replay import Look, follow, replay
from moving import ring_road
from oracles import filterpy_constant_velocity, ring_forward_backward
from situations import beside, one_cell_map, ring_traffic, seen_at

NOISE_M, DENSITY = 0.7, 2.0
CONFIG = FilterConfig(noise_m=NOISE_M, outlier_probability=1e-13, n_particles=200)


def measured(tracks, *, hidden=()):
    noise = np.random.default_rng(3).normal(0, NOISE_M, tracks.position.shape)
    seen = Detections(track_id=tracks.track_id, time_ns=tracks.time_ns, position=tracks.position + noise)
    return seen[~np.isin(np.arange(len(tracks)), hidden)]


def smoothed(seen, *, model=None, lag_s=None, with_ids=True, times=None, config=CONFIG, seed=0, **given):
    """What the filter and what the smoother says of detections; `tracking` and a `sensor` may be given."""
    found, later = EstimateList(), EstimateList()
    smoother = Smoother(lag_s=lag_s, sinks=[later.write])
    model = model or ConstantVelocityKalman(acceleration_density=DENSITY, config=config)
    tracker = smoother.tracker(0, model, config=config, rng=np.random.default_rng(seed), **given)
    frames = {int(frame.time_ns[0]): frame if with_ids else frame.without_ids() for frame in seen.frames()}
    with smoother:
        looks = (Look(at, frames.get(at, Detections.none()), [0]) for at in sorted({*frames, *(times or ())}))
        follow(looks, tracker, [found, smoother])
    return found.all(), later.all()


def same(a, b):
    for name in ("time_ns", "position", "covariance", "direction", "speed", "speed_std", "unseen_s"):
        np.testing.assert_allclose(getattr(a, name), getattr(b, name), rtol=1e-6, atol=1e-6, err_msg=name)
    assert a.track_id.tolist() == b.track_id.tolist()


def same_as_the_filter(found, later):
    np.testing.assert_allclose(later.position, found.position, atol=1e-9)
    np.testing.assert_allclose(later.covariance, found.covariance, atol=1e-9)


def test_of_constant_velocity_it_is_rauchs_tungs_and_striebels_across_a_gap_and_beyond_what_is_kept():
    n = 230
    tracks = ring_traffic(np.random.default_rng(2), n_vehicles=2, n_rows=n, dt_s=0.2)  # 46 s
    hidden = np.flatnonzero((tracks.track_id == 1) & (tracks.time_ns > 32e9) & (tracks.time_ns < 36e9))
    seen = measured(tracks, hidden=hidden)
    found, later = smoothed(seen)
    for name in range(2):
        is_seen = ~np.isin(np.flatnonzero(tracks.track_id == name), hidden)
        z = np.full((n, 2), np.nan)
        z[is_seen] = seen.position[seen.track_id == str(name)]
        given = {"density": DENSITY, "noise_m": NOISE_M, "first_speed_std": FIRST_SPEED_STD}
        mean, covariance = filterpy_constant_velocity(z, 0.2 * np.arange(n), **given)[1]
        own = later[later.track_id == name]
        assert len(own) == n
        np.testing.assert_allclose(own.position, mean[:, :2], atol=5e-6)
        np.testing.assert_allclose(own.covariance, covariance[:, :2, :2], atol=5e-6)
        np.testing.assert_allclose(own.speed, np.hypot(*mean[:, 2:].T), atol=5e-6)
        np.testing.assert_array_equal(own.unseen_s > 0.05, ~is_seen)
    reported = later[np.isin(later.time_ns, found.time_ns) & (later.track_id == 1)]
    assert np.abs(found.position[found.track_id == 1] - reported.position).max() > 0.5  # the filter knows less


RADIUS, BIN_M, DT_S, HIDDEN = 20.0, 0.15, 0.5, np.arange(7, 14)
RING = FilterConfig(
    noise_m=NOISE_M, outlier_probability=1e-13, n_particles=4000, interaction="none", innovation_outlier_rate=0.0,
    own_way_rate=0.0,
)  # fmt: skip
PUSH = 0.5
OFF, WIDER = 0.3, 1.2
"""Standard deviations of a mean, and a factor of a deviation, by which particles may differ from a histogram.

At least 0.3 of 4,000 weigh, and a mean remembers about three frames: its error is 0.05 of a deviation, so that 0.24 is
exceeded at any of the instants once in 10,000 seeds. The rest is for the bins, which spread speeds by 3 %, and for
vehicles that keep to circles of other radii.
"""
IN_GAP = 0.75, (WIDER, 1.25)
"""The same in a gap, whose end is where straight motion sees it: speeds there are 1.2 times as spread, by however many
samples, places are not. The filter's means are 2 off."""


def to_pace(arc, speed):
    """Acceleration on `ring_road`."""
    return 0.5 * (8.0 + 3.0 * np.sin(arc / RADIUS) - speed)


def driven(rng, n_rows=20):
    """(n, 2) positions of a vehicle that crosses the angle 0, pushed as particles are."""
    arc, speed, push, angle = 100.0, 8.0, 0.0, []
    for _ in range(n_rows):
        angle.append(arc / RADIUS)
        for _ in range(50):
            arc, speed = arc + 0.01 * speed, speed + 0.01 * (to_pace(arc, speed) + PUSH * push)
            push += -0.01 * PUSH_RATE * push + np.sqrt(0.02 * PUSH_RATE) * rng.normal()
    return RADIUS * np.column_stack([np.cos(angle), np.sin(angle)])


def agree(found, exact, rows, off_by=OFF, wider_by=WIDER):
    """Whether estimates agree with a histogram's at these instants: along the ring and in speed."""
    instant = np.round(found.time_ns * 1e-9 / DT_S).astype(np.int64)
    rows, exact = np.isin(instant, rows), exact[instant]
    angle = np.arctan2(found.position[:, 1], found.position[:, 0])
    along = np.column_stack([-np.sin(angle), np.cos(angle)])
    arc_std = np.sqrt(np.einsum("ni,nij,nj->n", along, found.covariance, along))
    off_arc = RADIUS * np.angle(np.exp(1j * (angle - exact[:, 0]))) / exact[:, 1]
    off = np.column_stack([off_arc, (found.speed - exact[:, 2]) / exact[:, 3]])[rows]
    wider = np.column_stack([arc_std, found.speed_std])[rows] / exact[rows][:, [1, 3]]
    return bool((np.abs(off) < off_by).all() and (np.abs(np.log(wider)) < np.log(wider_by)).all())


def test_on_a_ring_it_is_forward_backward_over_a_histogram_also_in_a_gap():
    """Speeds that are no linear function of the place; the negative control is the filter, which knows less."""
    places, time_ns = driven(np.random.default_rng(4)), (np.arange(20) * DT_S * 1e9).astype(np.int64)
    is_seen = ~np.isin(np.arange(20), HIDDEN)
    in_sight = np.flatnonzero(is_seen)
    z = np.where(is_seen[:, None], places + np.random.default_rng(5).normal(0, NOISE_M, places.shape), np.nan)
    seen = Detections(track_id=["a"] * is_seen.sum(), time_ns=time_ns[is_seen], position=z[is_seen])
    road = ring_road(RADIUS, pace=8.0, swing=3.0, back=0.5, shape=50.0)
    spread = np.ones(len(road.motion))
    road = replace(road, motion=replace(road.motion, push=PUSH * spread, course_spread=0.01 * spread))
    free = (road.motion.cell < 0) & (road.motion.start_rate == 0)  # the background's vehicles turn as these do
    pace = np.where(free, np.log(8.3), road.motion.log_pace)
    road = replace(road, motion=replace(road.motion, log_pace=pace, curvature=free / RADIUS))
    found, later = smoothed(seen, model=road, times=time_ns.tolist(), config=RING)
    filtered, exact = ring_forward_backward(
        z, DT_S, radius=RADIUS, acceleration=to_pace, push=PUSH, push_rate=PUSH_RATE, noise_m=NOISE_M,
        first_speed=stats.gamma(50.0, scale=8.0 / 50.0).pdf, bin_m=BIN_M, speeds=np.arange(3.0, 13.1, 0.3),
    )  # fmt: skip
    assert agree(later, exact, in_sight)
    assert agree(later, exact, HIDDEN, *IN_GAP)
    assert agree(found, filtered, in_sight)
    assert agree(found, filtered, HIDDEN)
    assert not agree(found, exact, HIDDEN, *IN_GAP)


def test_a_long_lag_is_the_whole_log_a_short_one_is_not_and_none_is_the_filter():
    seen = measured(ring_traffic(np.random.default_rng(2), n_vehicles=1, n_rows=100))
    few, whole = seen[seen.time_ns < 3e9], smoothed(seen)[1]
    same(smoothed(seen, lag_s=8.0)[1], whole)
    assert np.abs(smoothed(few, lag_s=0.3)[1].position - whole[whole.time_ns < 3e9].position).max() > 0.05
    same_as_the_filter(*smoothed(few, lag_s=0.0))


def test_in_a_gap_longer_than_the_lag_it_knows_since_when_a_vehicle_is_unseen():
    tracks = ring_traffic(np.random.default_rng(2), n_vehicles=1, n_rows=60)
    found, later = smoothed(measured(tracks, hidden=np.arange(20, 50)), lag_s=0.5, times=tracks.time_ns.tolist())
    np.testing.assert_allclose(later.unseen_s, [0.0, *found.unseen_s], atol=1e-6)  # confirmed by its second


def test_without_a_lag_it_is_the_filter_also_where_particles_are_moved():
    """A driver who stops dead: innovation outliers move particles to him, and to his last belief in the chain."""
    times = 0.1 * np.arange(45)
    east = np.cumsum(0.1 * np.interp(times, [0.0, 3.0, 3.6], [8.0, 8.0, 0.0]))
    seen = Detections.concatenate([at(t, x) for t, x in zip(times, east, strict=True)])
    for rate in (0.03, 0.0):
        config = replace(CONFIG, innovation_outlier_rate=rate, outlier_probability=1e-3)
        model = one_cell_map(concentration=50.0, shape=60.0)
        same_as_the_filter(*smoothed(seen, model=model, lag_s=0.0, config=config))


def test_frames_come_in_order_each_once_and_hold_the_detections_of_their_time():
    tracks = ring_traffic(np.random.default_rng(2), n_vehicles=2, n_rows=50)
    frames, late, seen = [], [], measured(tracks)
    smoother = Smoother(lag_s=1.0, sinks=[frames.append])
    model = ConstantVelocityKalman(acceleration_density=DENSITY, config=CONFIG)
    given = {"config": CONFIG, "tracking": TrackingConfig(), "rng": np.random.default_rng(0)}
    trackers = GroupTracker(lambda group: smoother.tracker(group, model, **given))
    with smoother:
        for frame in seen.frames():
            replay([frame], trackers, [smoother])
            late.append(len(frames))
    assert late[8:14] == [0, 0, 1, 2, 3, 4]  # a second late, no more
    assert [frame.time_ns for frame in frames] == np.unique(seen.time_ns).tolist()
    for frame in frames:
        assert len(frame.detections) == len(frame.estimates) == 2
        assert (frame.detections.time_ns == frame.time_ns).all()


def test_a_track_without_an_id_begins_at_its_first_detection_and_ends_at_its_last():
    tracks, times = ring_traffic(np.random.default_rng(2), n_vehicles=1, n_rows=40), [i * 10**8 for i in range(60)]
    found, later = smoothed(measured(tracks), with_ids=False, times=times)
    assert found.time_ns.min() > 0
    assert found.time_ns.max() > tracks.time_ns.max()
    assert later.time_ns.tolist() == tracks.time_ns.tolist()
    assert (later.existence >= found.existence.max()).all()


def test_a_vehicle_is_smoothed_the_same_whichever_others_there_are():
    tracks = ring_traffic(np.random.default_rng(2), n_vehicles=3, n_rows=30)
    model = one_cell_map(concentration=5.0, shape=10.0)
    both = smoothed(measured(tracks), model=model)[1]
    rows = np.flatnonzero(tracks.track_id != 1)
    alone = smoothed(measured(tracks, hidden=rows), model=model)[1]
    same(both[both.track_id == 1], alone)


def at(time_s, x):
    return seen_at(time_s, [(x, 0.0)], ids=["a"])


def test_where_a_belief_was_reinitialised_nothing_is_carried_across():
    first, second = ([at(t0 + 0.1 * i, x0 + i) for i in range(20)] for t0, x0 in ((0.0, 0.0), (10.0, 500.0)))
    _, both = smoothed(Detections.concatenate([*first, *second]))
    same(both[both.time_ns < 9e9], smoothed(Detections.concatenate(first))[1])
    same(both[both.time_ns > 9e9], smoothed(Detections.concatenate(second))[1])
    assert (np.diff(both.time_ns) > 0).all()


def test_a_belief_that_was_lost_in_a_gap_is_smoothed_up_to_where_its_vehicle_was_found():
    def halfway(end):
        """Drives at 10 m/s, and is found at `end` after three seconds out of sight: at 50 m it would have been."""
        seen = Detections.concatenate([at(0.1 * i, i) for i in range(20)] + [at(5.0 + 0.1 * i, end) for i in range(5)])
        model, times = one_cell_map(concentration=1e3, shape=100.0), [i * 100_000_000 for i in range(55)]
        later = smoothed(seen, model=model, times=times)[1]
        return float(later.position[later.time_ns == 3_500_000_000, 0][0])

    assert halfway(75.0) > 44.0  # 46.5 of six seeds alike
    assert halfway(200.0) < 36.0  # that is another


def linear_pair(rng, n):
    """Particles and what they became: x' = A x + noise; the gain and spread that follow."""
    a, q = np.eye(5) + 0.3 * rng.normal(size=(5, 5)), np.diag([0.1, 0.2, 0.3, 0.4, 0.5])
    root = rng.normal(size=(5, 5))
    p = root @ root.T
    then = rng.multivariate_normal(np.zeros(5), p, n)
    now = then @ a.T + rng.multivariate_normal(np.zeros(5), q, n)
    later = a @ p @ a.T + q
    gain = p @ a.T @ np.linalg.inv(later)
    return then, now, gain, p - gain @ later @ gain.T


def linked(weight, then, now):
    """The link of particles with weights to what they were: mean, later mean, gain, spread."""
    particles, still = ParticleFilter(one_cell_map(), FilterConfig(n_particles=len(now))), np.zeros(len(now))
    then, now = (
        States(np.vstack([*of.T, still + 1.0, still])[None], weight[None], np.zeros((1, 4, 4))) for of in (then, now)
    )
    link = links_of(particles, [[Before(0, then)]], now, np.array([10**8]), np.zeros((1, 5, 5)))[0][0]
    return link["mean"], link["later"], link["gain"], link["spread"]


def test_links_of_linear_gaussian_particles_are_exact_also_among_those_that_came_near():
    then, now, gain, spread = linear_pair(np.random.default_rng(0), 100_000)
    for near in (np.ones(len(now)), np.exp(-0.5 * ((now[:, :2] - [1.0, -0.5]) ** 2).sum(axis=1))):
        weight = near / near.sum()
        few = 10.0 / np.sqrt(1.0 / (weight**2).sum())
        _, _, found, left = linked(weight, then, now)
        np.testing.assert_allclose(found, gain, atol=few)
        np.testing.assert_allclose(left, spread, atol=few)


def test_at_a_fork_the_way_back_is_on_the_arm_that_was_taken():
    rng, n = np.random.default_rng(0), 2000
    arm, along, still = rng.choice([-1.0, 1.0], n), rng.normal(10.0, 1.0, n), np.zeros(n)
    now = np.column_stack([along, arm * along, still + 10.0, 10.0 * arm, still]) + 0.1 * rng.normal(size=(n, 5))
    then = np.column_stack([0.5 * along, arm * (0.5 * along) ** 3 / 25.0, still + 10.0, still, still])
    place, even = np.array([10.0, 10.0, 10.0, 10.0, 0.0]), np.full(n, 1.0 / n)
    near = np.exp(-0.5 * ((now[:, :2] - place[:2]) ** 2).sum(axis=1) / 0.3**2)
    weight, _ = tempered(even, near / near.sum())
    links = [linked(w, then, now) for w in (even, weight)]
    of_all, of_near = (np.linalg.norm((mean + gain @ (place - later))[:2] - 5.0) for mean, later, gain, _ in links)
    assert of_near < 0.1 < of_all  # one Gaussian for both arms
    assert 1.0 / (weight**2).sum() >= 0.4 * n > 1.0 / ((near / near.sum()) ** 2).sum()


def test_a_filter_that_has_no_smoother_is_refused_and_so_is_a_negative_lag():
    with pytest.raises(ValueError, match="which can be smoothed, got object"):
        Recorder(object())
    with pytest.raises(ValueError, match="lag_s"):
        Smoother(lag_s=-1.0)


def test_of_detections_that_are_smoother_than_the_map_the_sweep_back_stays_with_the_filter(ring_map):
    """The map draws its vehicles together; those of this ring swing by more than their noise."""
    config = replace(CONFIG, noise_m=0.1)
    for seed in range(3):
        tracks = ring_traffic(np.random.default_rng([20, seed]), n_vehicles=3, n_rows=60)
        east, north = tracks.position.T
        out = (1.0 + 0.05 * np.sin(2e-9 * tracks.time_ns))[:, None] * np.column_stack([east, north])
        noise = np.random.default_rng(seed).normal(0, 0.02, out.shape)
        seen = Detections(track_id=tracks.track_id, time_ns=tracks.time_ns, position=out + noise)
        found, later = smoothed(seen, model=ring_map, config=config, seed=seed)
        error = [np.hypot(*(rows.position - out[beside(rows, tracks)[1]]).T) for rows in (found, later)]
        assert np.mean(error[1]) <= 1.2 * np.mean(error[0]), seed
        assert error[1].max() <= 3.0, seed
