"""Vehicles without ids: found, kept apart and through gaps, not made up, and each detection assigned to its own.

Gates are those of a loop over all pairs, assignments those of a dense solver.
"""

from itertools import product

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.optimize import linear_sum_assignment

from dirprim_filter.config import TrackingConfig
from dirprim_filter.detections import Detections
from dirprim_filter.estimates import Estimates
from dirprim_filter.filtering import existence
from dirprim_filter.filtering.association import MOST_NEAR, best_pairs, gated
from situations import TRUSTING, on_the_ring, one_cell_map, seen_at, tracker_of

SETTINGS = TrackingConfig(detection_probability=0.9, clutter_density=5e-4)


def made(model):
    return tracker_of(model, tracking=SETTINGS, seed=1, n_particles=200)


def followed(tracker, frames):
    """Estimates of every frame: (seconds, positions), with nothing seen in some."""
    return [tracker.step(seen_at(time_s, places), time_ns=round(time_s * 1e9)) for time_s, places in frames]


def two_vehicles(n_frames=60, *, rng, clutter=0.0):
    """Opposite each other on the ring at 8 m/s, in clutter."""
    frames = []
    for i in range(n_frames):
        places = [on_the_ring(0.1 * i, from_=turn) + rng.normal(0, 0.3, 2) for turn in (0.0, np.pi)]
        places += list(rng.uniform(-30, 30, (rng.poisson(clutter), 2)))
        frames.append((0.1 * i, rng.permutation(np.array(places))))
    return frames


def test_two_vehicles_in_clutter_are_two_tracks_that_keep_their_names(either):
    frames = two_vehicles(rng=np.random.default_rng(0), clutter=1.0)
    found = followed(made(either), frames)
    assert all(len(estimates) == 2 for estimates in found[15:])
    ways = [[on_the_ring(0.1 * i, from_=turn) for i in range(len(frames))] for turn in (0.0, np.pi)]
    assert [len(names) for names in kept_apart(found, ways, late=15)] == [1, 1]


def test_a_thousand_false_detections_in_a_frame_begin_nothing(ring_map):
    rng = np.random.default_rng(4)
    frames = two_vehicles(40, rng=rng)
    time_s, places = frames[25]
    frames[25] = (time_s, np.concatenate([places, rng.uniform(-200, 200, (1000, 2))]))
    tracker = made(ring_map)
    followed(tracker, frames[:25])
    found = followed(tracker, frames[25:])
    assert all(len(estimates) == 2 for estimates in found[5:])
    assert len(tracker._roster) < 20


def test_unlabelled_tracks_are_the_same_each_time_and_keep_out_of_the_way_of_labelled_ones(ring_map):
    frames = two_vehicles(30, rng=np.random.default_rng(5))
    once, again = (Estimates.concatenate(followed(made(ring_map), frames)) for _ in range(2))
    assert once.position.tobytes() == again.position.tobytes()
    assert once.track_id.tolist() == again.track_id.tolist()
    mixed, alone = made(ring_map), made(ring_map)
    for time_s, places in frames:
        seen = seen_at(time_s, [on_the_ring(time_s, from_=1.0), *places], ids=["track-1", *[""] * len(places)])
        of_all, of_one = mixed.step(seen), alone.step(seen[:1])
        assert of_all.position[of_all.track_id == "track-1"].tobytes() == of_one.position.tobytes()
    assert np.unique(of_all.track_id).size == 3
    assert len(of_one) == 1


def test_a_sensor_that_later_calls_a_vehicle_as_we_call_another_has_the_name(either):
    tracker = made(either)
    for i in range(20):
        n = 1 if i < 10 else 2
        found = tracker.step(seen_at(0.1 * i, [(0.8 * i, 0.0), (0.8 * i, 50.0)][:n], ids=["", "track-1"][:n]))
        assert np.unique(found.track_id).size == len(found)
        if i == 9:
            assert found.track_id.tolist() == ["track-1"]
    north = found.position[:, 1].round(-1)
    assert dict(zip(found.track_id.tolist(), north, strict=True)) == {"track-1": 50, "track-2": 0}


def kept_apart(found, ways, *, late=30):
    """Names of the tracks nearest to each of the ways (frames, 2) in the late frames."""
    names = []
    for way in ways:
        rows = range(late, len(found))
        off = [np.linalg.norm(found[i].position - way[i], axis=1) for i in rows]
        assert max(of.min() for of in off) < 1.5
        names.append({str(found[i].track_id[of.argmin()]) for i, of in zip(rows, off, strict=True)})
    return names


def seen_on(ways, *, noise_m=0.2, hide=lambda i, v: False):
    rng = np.random.default_rng(0)
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
def test_vehicles_that_are_near_cross_queue_or_overtake_keep_their_names(situation):
    ways = SITUATIONS[situation]
    found = followed(made(None), seen_on(ways))
    names = kept_apart(found, ways)
    assert all(len(of) == 1 for of in names)
    assert len(set.union(*names)) == len(ways) == len(found[-1])


def test_what_no_position_can_tell_apart_is_not_told_apart():
    """The control: two vehicles 0.3 m apart in noise of 1 m change names, or are one."""
    ways = [straight((-30, 0), (8, 0)), straight((-30, 0.3), (8, 0))]
    found = followed(made(None), seen_on(ways, noise_m=1.0))
    names = {tuple(np.sort(estimates.track_id)) for estimates in found[10:]}
    order = {np.argsort(estimates.position[:, 1]).tolist()[0] for estimates in found[10:] if len(estimates) == 2}
    assert len(names) > 1 or len(order) > 1


@pytest.mark.parametrize(("n_missed", "is_kept"), [(1, True), (2, False)])
def test_a_tentative_track_waits_for_a_vehicle_missed_once_and_no_longer(n_missed, is_kept):
    sees_all = straight((-30, 30), (8, 0))  # by which the tracker knows how often the sensor reports
    ways = [sees_all, straight((-30, -30), (8, 0))]
    tracker = made(None)
    frames = seen_on(ways, hide=lambda i, v: v == 1 and not (i == 20 or i > 20 + n_missed))
    assert len(followed(tracker, frames[: 20 + n_missed + 2])[20]) == 1
    assert len(tracker._roster) == 2
    assert is_kept == (tracker._roster._n_tentative == 2)


def frame_of(i, ids=("", "")):
    """Two vehicles at 8 m/s opposite each other on the ring, and what is false far away."""
    rng = np.random.default_rng([0, i])
    places = [on_the_ring(0.1 * i, from_=turn) + rng.normal(0.0, 0.3, 2) for turn in (0.0, np.pi)]
    return seen_at(0.1 * i, [*places, *rng.uniform(100.0, 1000.0, (2, 2))], ids=[*ids, "", ""])


def test_detections_are_of_the_track_that_is_estimated_near_them_and_false_ones_of_none():
    tracked, names = tracker_of(None, noise_m=0.3), set()
    for i in range(40):
        frame = tracked.track(frame_of(i))
        assert frame.assigned[2:].tolist() == ["", ""]
        if i == 0:
            assert (frame.assigned == "").all()  # no track has a name yet
        if i < 20:
            continue
        for place, name in zip(frame.detections.position[:2], frame.assigned[:2], strict=True):
            own = frame.estimates[frame.estimates.track_id.astype(str) == name]
            assert np.linalg.norm(own.position[0] - place) < 1.5
            names.add(name)
    assert len(names) == 2


def test_an_id_is_its_track_and_a_frame_without_detections_has_none():
    tracked = tracker_of(None, noise_m=0.3)
    for i in range(6):
        assert tracked.track(frame_of(i, ids=("b", "a"))).assigned.tolist() == ["b", "a", "", ""]
    frame = tracked.track(Detections.none(), time_ns=600_000_000)
    assert (len(frame.estimates), frame.assigned.size) == (2, 0)


LORRY, CAR = (12.0, 2.5, 3.5), (4.5, 1.8, 1.5)


def names_of(frames, **stated):
    """The names that are reported in each frame, of places (d, 2) in frames of .1 s, by a Kalman filter."""
    tracker, names = tracker_of(None, density=1.0, noise_m=0.1), []
    for i, places in enumerate(frames):
        own = {name: np.asarray(of[i]) for name, of in stated.items()}
        names.append(set(tracker.step(seen_at(0.1 * i, places, **own)).track_id.tolist()))
    return names


@pytest.mark.parametrize("is_stated", [True, False])
@pytest.mark.parametrize("twice_from", [0, 20])
def test_a_lorry_that_is_detected_twice_is_one_vehicle_and_the_car_beside_it_another(twice_from, is_stated):
    rng, frames, sizes = np.random.default_rng(1), [], []
    for i in range(60):
        places = np.array([[0.8 * i, 0.0], [0.8 * i, 3.5], [0.8 * i + 4.0, 0.0]])[: 2 + (i >= twice_from)]
        frames.append(places + rng.normal(0.0, 0.1, places.shape))
        sizes.append([LORRY, CAR, LORRY][: len(places)])
    names = names_of(frames, **({"size": sizes} if is_stated else {}))
    assert len(set.union(*names)) == (2 if is_stated else 3)
    assert len(names[-1]) == (2 if is_stated else 3)


@pytest.mark.parametrize("is_stated", [True, False])
def test_a_vehicle_that_its_detector_sees_elsewhere_on_its_body_keeps_its_name(is_stated):
    """It stands, and its belief is sure of where; then its box grows, and its middle is off by ten deviations."""
    rng, places = np.random.default_rng(2), np.zeros((80, 1, 2))
    places[50:, 0, 0] = 1.0
    names = names_of(places + rng.normal(0.0, 0.1, places.shape), **({"size": [[CAR]] * 80} if is_stated else {}))
    assert (len(set.union(*names)) == 1) == is_stated


@pytest.mark.parametrize("is_stated", [True, False])
def test_detections_of_low_confidence_continue_a_track_and_begin_none(is_stated):
    rng, frames, stated = np.random.default_rng(3), [], []
    for i in range(60):
        false = rng.uniform(-30.0, 30.0, (20, 2))
        frames.append(np.vstack([rng.normal((0.8 * i - 24.0, 0.0), 0.1), false]))
        stated.append([0.9 if i < 30 else 0.3, *np.full(20, 0.003)])
    names = names_of(frames, **({"confidence": stated} if is_stated else {}))
    assert (len(set.union(*names)) == 1) == is_stated
    assert all(names[5:])


def test_the_density_of_false_detections_of_a_confidence_is_its_odds_to_true_ones():
    config = TrackingConfig(detection_probability=0.8, vehicle_density=1e-3, clutter_density=5e-4)
    density = existence.false_density(np.array([np.nan, 0.5, 0.8, 1.0, 0.0]), config)
    np.testing.assert_allclose(density, [5e-4, 8e-4, 2e-4, 0.0, 5e-4])


@settings(max_examples=150, deadline=None)
@given(data=st.data())
def test_the_assignment_is_the_best_of_all(data):
    n, m = data.draw(st.integers(0, 4)), data.draw(st.integers(0, 4))
    cells = st.one_of(st.none(), st.floats(-5, 5))
    table = [[data.draw(cells) for _ in range(m)] for _ in range(n)]
    listed = [(i, j, table[i][j]) for i in range(n) for j in range(m) if table[i][j] is not None]
    one, other = (np.array([row[k] for row in listed], dtype=np.int64) for k in (0, 1))
    gain = np.array([row[2] for row in listed], dtype=float)
    found = best_pairs(one, other, gain)
    assert np.unique(one[found]).size == np.unique(other[found]).size == found.size
    full = np.full((n, m), -np.inf)
    full[one, other] = gain
    assert (gain[found] > 0).all()
    worth = full.clip(min=0.0)
    assert gain[found].sum() == pytest.approx(worth[linear_sum_assignment(worth, maximize=True)].sum(), abs=1e-9)
    apart = np.arange(33)[:, None] * 10  # many that have nothing to do with each other are assigned as each by itself
    gains = np.tile(gain, apart.size)
    repeated = best_pairs((one + apart).ravel(), (other + apart).ravel(), gains)
    assert gains[repeated].sum() == pytest.approx(apart.size * gain[found].sum())


def test_gates_hold_what_a_loop_over_all_pairs_finds():
    rng = np.random.default_rng(0)
    mean, position = rng.uniform(0, 30, (20, 2)), rng.uniform(0, 30, (50, 2))
    root = rng.normal(0, 1.5, (20, 2, 2))
    covariance = root @ root.swapaxes(1, 2) + 0.1 * np.eye(2)
    noise = np.broadcast_to(0.25 * np.eye(2), (50, 2, 2)).copy()
    noise[::3] *= 4
    found = gated(mean, covariance, position, noise, gate=9.0)
    expected = set()
    for t, d in product(range(20), range(50)):
        off = position[d] - mean[t]
        if off @ np.linalg.inv(covariance[t] + noise[d]) @ off <= 9.0:
            expected.add((t, d))
    assert set(zip(found.one.tolist(), found.other.tolist(), strict=True)) == expected
    assert 20 < len(expected) < 500


def test_of_a_crowd_each_track_is_compared_with_the_nearest_alone():
    rng = np.random.default_rng(0)
    mean, position = rng.normal(0, 0.1, (2, 600, 2))
    one = np.tile(np.eye(2), (600, 1, 1))
    found = gated(mean, one, position, one, gate=9.0)
    away = np.linalg.norm(mean[:, None] - position, axis=-1)
    nearest = np.argsort(away, axis=1)[:, :MOST_NEAR]
    assert set(zip(found.one.tolist(), found.other.tolist(), strict=True)) == {
        (t, d) for t, of in enumerate(nearest.tolist()) for d in of
    }


def test_of_two_that_pass_each_other_the_course_says_which_is_which():
    """Each is seen nearer to where the other was expected; the control, without courses, takes them for the other."""

    def across(**known):
        """How far each comes across in the last frame, in which they have changed sides."""
        tracker = tracker_of(one_cell_map(concentration=0.0, shape=20.0).without_places(), tracking=TRUSTING)
        sides = [[1.0, 1.0 if i < 10 else -1.0] for i in range(11)]
        places = [np.array([[-10.0 + i, 0.4], [10.0 - i, -0.4]]) * side for i, side in enumerate(sides)]
        found = [tracker.step(seen_at(0.1 * i, place, **known)) for i, place in enumerate(places)]
        return np.abs(found[-1].position[:, 1] - found[-2].position[:, 1])

    assert (across(direction=[0.0, np.pi], speed=[10.0, 10.0]) > 0.1).all()
    assert (across() < 0.05).all()
