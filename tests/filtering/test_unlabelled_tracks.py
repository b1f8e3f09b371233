"""Vehicles without ids: found, kept apart, kept through gaps, and not made up."""

import numpy as np
import pytest

from dirprim_filter.config import FilterConfig, TrackingConfig
from dirprim_filter.detections import Detections
from dirprim_filter.estimates import Estimates
from dirprim_filter.filtering import ConstantVelocityKalman, Tracker
from situations import on_the_ring

SETTINGS = TrackingConfig(detection_probability=0.9, clutter_density=5e-4)


def made(ring_map, filter_of, *, tracking=SETTINGS, seed=1):
    config = FilterConfig(n_particles=200)
    model = ring_map if filter_of == "particles" else ConstantVelocityKalman(acceleration_density=3.0, config=config)
    return Tracker(model, config=config, tracking=tracking, rng=np.random.default_rng(seed))


def followed(tracker, frames):
    """Estimates of every frame: (seconds, positions), with nothing seen in some."""
    found = []
    for time_s, places in frames:
        time_ns = round(time_s * 1e9)
        seen = Detections(
            track_id=[""] * len(places), time_ns=[time_ns] * len(places), position=np.reshape(places, (-1, 2))
        )
        found.append(tracker.step(seen, time_ns=time_ns))
    return found


def two_vehicles(n_frames=60, *, rng, hide=lambda i: False, clutter=0.0):
    """Opposite each other on the ring at 8 m/s, in clutter; the first is hidden in some frames."""
    frames = []
    for i in range(n_frames):
        places = [on_the_ring(0.1 * i, from_=turn) + rng.normal(0, 0.3, 2) for turn in (0.0, np.pi)]
        places = places[1:] if hide(i) else places
        places += list(rng.uniform(-30, 30, (rng.poisson(clutter), 2)))
        frames.append((0.1 * i, rng.permutation(np.array(places))))
    return frames


@pytest.mark.parametrize("filter_of", ["particles", "kalman"])
def test_two_vehicles_in_clutter_are_two_tracks_that_keep_their_names(ring_map, filter_of):
    frames = two_vehicles(rng=np.random.default_rng(0), clutter=1.0)
    found = followed(made(ring_map, filter_of), frames)
    late = found[15:]
    assert all(len(estimates) == 2 for estimates in late)
    for turn in (0.0, np.pi):
        names = set()
        for i, estimates in enumerate(late, start=15):
            off = np.linalg.norm(estimates.position - on_the_ring(0.1 * i, from_=turn), axis=1)
            assert off.min() < 1.5
            names.add(str(estimates.track_id[off.argmin()]))
        assert len(names) == 1


def test_a_thousand_false_detections_in_a_frame_begin_nothing(ring_map):
    rng = np.random.default_rng(4)
    frames = two_vehicles(40, rng=rng)
    time_s, places = frames[25]
    frames[25] = (time_s, np.concatenate([places, rng.uniform(-200, 200, (1000, 2))]))
    tracker = made(ring_map, "particles")
    followed(tracker, frames[:25])
    found = followed(tracker, frames[25:])
    assert all(len(estimates) == 2 for estimates in found[5:])
    assert len(tracker._roster) < 20


def test_unlabelled_tracks_are_the_same_each_time_and_keep_out_of_the_way_of_labelled_ones(ring_map):
    frames = two_vehicles(30, rng=np.random.default_rng(5))
    once, again = (Estimates.concatenate(followed(made(ring_map, "particles"), frames)) for _ in range(2))
    assert once.position.tobytes() == again.position.tobytes()
    assert once.track_id.tolist() == again.track_id.tolist()

    def of_label(found):
        return found.position[found.track_id == "track-1"].tobytes()

    named = made(ring_map, "particles")
    alone = made(ring_map, "particles")
    for time_s, places in frames:
        time_ns = round(time_s * 1e9)
        mixed = Detections(
            track_id=["track-1", *[""] * len(places)], time_ns=[time_ns] * (len(places) + 1),
            position=np.vstack([on_the_ring(time_s, from_=1.0), places]),
        )  # fmt: skip
        for tracker, frame in ((named, mixed), (alone, mixed[np.array([0])])):
            found = tracker.step(frame)
            if tracker is named:
                first, n_tracks = of_label(found), np.unique(found.track_id).size
        assert of_label(found) == first
    assert len(first) > 0
    assert n_tracks == 3


def test_a_sensor_that_later_calls_a_vehicle_as_we_call_another_has_the_name(ring_map):
    tracker = made(ring_map, "kalman")
    for i in range(20):
        seen = Detections(track_id=[""], time_ns=[i * 10**8], position=[[0.8 * i, 0.0]])
        if i > 9:
            other = Detections(track_id=["track-1"], time_ns=[i * 10**8], position=[[0.8 * i, 50.0]])
            seen = Detections.concatenate([seen, other])
        found = tracker.step(seen)
        if i == 9:
            assert found.track_id.tolist() == ["track-1"]
    north = found.position[:, 1].round(-1)
    assert dict(zip(found.track_id.tolist(), north, strict=True)) == {"track-1": 50, "track-2": 0}


def kept_apart(found, ways):
    """Names of the tracks nearest to each of the ways (frames, 2) in the latter half of the frames."""
    names = []
    for way in ways:
        half = range(len(found) // 2, len(found))
        off = [np.linalg.norm(found[i].position - way[i], axis=1) for i in half]
        assert max(of.min() for of in off) < 1.5
        names.append({str(found[i].track_id[of.argmin()]) for i, of in zip(half, off, strict=True)})
    return names


def seen_on(ways, *, noise_m=0.2, hide=lambda i, v: False, seed=0):
    rng = np.random.default_rng(seed)
    return [
        (0.1 * i, [way[i] + rng.normal(0, noise_m, 2) for v, way in enumerate(ways) if not hide(i, v)])
        for i in range(len(ways[0]))
    ]


def straight(start, velocity, n=60):
    return np.asarray(start) + 0.1 * np.arange(n)[:, None] * np.asarray(velocity)


SITUATIONS = {
    "near": [straight((-30, 0), (8, 0)), straight((-30, 3), (8, 0))],
    "crossing": [straight((-24, 0), (8, 0)), straight((0, -27), (0, 8))],
    "queueing": [straight((6.0 * k, 0), (0, 0)) for k in range(5)],
    "overtaking": [straight((-30, 0), (6, 0)), straight((-42, 3), (11, 0))],
}


@pytest.mark.parametrize("situation", SITUATIONS)
def test_vehicles_that_are_near_cross_queue_or_overtake_keep_their_names(ring_map, situation):
    ways = SITUATIONS[situation]
    found = followed(made(ring_map, "kalman"), seen_on(ways))
    names = kept_apart(found, ways)
    assert all(len(of) == 1 for of in names)
    assert len(set.union(*names)) == len(ways) == len(found[-1])


def test_what_no_position_can_tell_apart_is_not_told_apart(ring_map):
    """The control: two vehicles 0.3 m apart in noise of 1 m change names, or are one."""
    ways = [straight((-30, 0), (8, 0)), straight((-30, 0.3), (8, 0))]
    found = followed(made(ring_map, "kalman"), seen_on(ways, noise_m=1.0))
    names = {tuple(np.sort(estimates.track_id)) for estimates in found[10:]}
    order = {np.argsort(estimates.position[:, 1]).tolist()[0] for estimates in found[10:] if len(estimates) == 2}
    assert len(names) > 1 or len(order) > 1


@pytest.mark.parametrize(("n_missed", "is_kept"), [(1, True), (2, False)])
def test_a_tentative_track_waits_for_a_vehicle_missed_once_and_no_longer(ring_map, n_missed, is_kept):
    sees_all = straight((-30, 30), (8, 0))  # by which the tracker knows how often the sensor reports
    ways = [sees_all, straight((-30, -30), (8, 0))]
    tracker = made(ring_map, "kalman")
    found = followed(
        tracker, seen_on(ways, hide=lambda i, v: v == 1 and not (i == 20 or i > 20 + n_missed))[: 20 + n_missed + 2]
    )
    assert len(found[20]) == 1
    assert len(tracker._roster) == 2
    assert is_kept == (tracker._roster._n_tentative == 2)
