"""Misbehaviour: each kind does what it is said to do, courses and speeds are those of the positions, others stay."""

import numpy as np
import pytest

from dirprim_filter.distributions.angles import difference
from dirprim_filter.simulation.misbehaviour import BRAKING, CREEPING, JUMP_M, KINDS, LEAST_S, misbehaving
from dirprim_filter.tracks import Tracks

DT_S = 0.1


def driver(name, way, *, n, bend=0.0, heading=0.3):
    """A vehicle whose distance at each time is `way(t)`, on a path of constant curvature to the left."""
    time_s = DT_S * np.arange(n)
    s = way(time_s)
    angle = heading + bend * s
    place = np.column_stack([np.cos(heading) * s, np.sin(heading) * s])
    if bend:
        place = np.column_stack([np.sin(angle) - np.sin(heading), np.cos(heading) - np.cos(angle)]) / bend
    return Tracks.from_positions(
        track_id=np.full(n, name), time_ns=np.round(1e9 * time_s).astype(np.int64), position=place,
        size=np.tile([4.5, 1.8, 1.5], (n, 1)),
    )  # fmt: skip


def ways():
    """Of steady, faster and slower vehicles, on straight and bent paths, and one too short to misbehave."""
    parts = [driver("short", lambda t: 9.0 * t, n=100)]
    for i, bend in enumerate((0.0, 0.0, 0.02, -0.015)):
        parts += [
            driver(f"steady{i}", lambda t, v=6.0 + 3.0 * i: v * t, n=240, bend=bend, heading=float(i)),
            driver(f"uneven{i}", lambda t: 9.0 * t + 10.0 * np.sin(0.4 * t), n=300, bend=bend, heading=-float(i)),
        ]
    return Tracks.concatenate(parts)


WAYS = ways()


def pairs(kind, seed=1):
    """Name, track before and after of each vehicle that is long enough."""
    done = misbehaving(WAYS, kind=kind, rng=np.random.default_rng(seed))
    for name in np.unique(WAYS.track_id):
        before, after = WAYS[WAYS.track_id == name], done[done.track_id == name]
        if before.time_ns[-1] >= LEAST_S * 1e9:
            yield name, before, after


def first_changed(before, after):
    return int(np.argmax(np.hypot(*(before.position[: len(after)] - after.position).T) > 1e-6))


def pace(track):
    return np.hypot(*np.diff(track.position, axis=0).T) / DT_S


@pytest.mark.parametrize("kind", KINDS)
def test_courses_and_speeds_are_those_of_the_displacements_and_times_are_kept(kind):
    """By central differences over half a second, in which a braking vehicle's speed changes by 3 m/s."""
    for name, before, after in pairs(kind):
        np.testing.assert_array_equal(after.time_ns, before.time_ns[: len(after)])
        np.testing.assert_array_equal(after.size, before.size[: len(after)])
        moved = np.diff(after.position, axis=0)
        steps = np.flatnonzero((pace(after) > 1.0) & (pace(after) < 19.0))  # a jump is no motion
        speed = 0.5 * (after.speed[steps] + after.speed[steps + 1])
        assert np.abs(speed - pace(after)[steps]).max() < 1.0, name
        course = np.arctan2(moved[steps, 1], moved[steps, 0])
        assert np.abs(difference(course, after.direction[steps])).max() < 0.3, name
        assert (pace(after) > 19.0).sum() == (kind == "jump"), name


@pytest.mark.parametrize("kind", KINDS)
def test_all_that_are_long_enough_misbehave_in_their_middle_and_others_stay(kind):
    done = misbehaving(WAYS, kind=kind, rng=np.random.default_rng(1))
    for name in ("position", "direction", "speed"):
        short = getattr(done, name)[done.track_id == "short"]
        np.testing.assert_array_equal(short, getattr(WAYS, name)[WAYS.track_id == "short"])
    starts = set()
    for name, before, after in pairs(kind):
        start = first_changed(before, after)
        assert np.hypot(*(before.position[: len(after)] - after.position)[-1]) > 1.5, name
        assert start == 0 if kind == "against" else 0.3 * len(before) - 1 <= start <= 0.6 * len(before) + 2, name
        starts.add(start / len(before))
    assert kind == "against" or len(starts) > 4  # each at a moment of its own
    again = misbehaving(WAYS, kind=kind, rng=np.random.default_rng(1))
    np.testing.assert_array_equal(done.position, again.position)


def test_what_a_vehicle_does_depends_on_no_other():
    others = WAYS[~np.isin(WAYS.track_id, ["short", "steady0"])]
    changed = driver("short", lambda t: 9.0 * t, n=300), driver("steady0", lambda t: t, n=20)
    longer = Tracks.concatenate([*changed, others])
    one, two = (misbehaving(of, kind="turn", rng=np.random.default_rng(4)) for of in (WAYS, longer))
    for name in np.unique(others.track_id):
        np.testing.assert_array_equal(one.position[one.track_id == name], two.position[two.track_id == name])


def off_path(track, path):
    """(n,) metres from the nearest point of the polyline of `path`."""
    a, b = path.position[:-1], path.position[1:]
    along = ((track.position[:, None] - a) * (b - a)).sum(-1) / ((b - a) ** 2).sum(-1)
    nearest = a + np.clip(along, 0.0, 1.0)[..., None] * (b - a)
    return np.hypot(*(track.position[:, None] - nearest).transpose(2, 0, 1)).min(axis=1)


@pytest.mark.parametrize(("kind", "share"), [("stop", 0.0), ("creep", CREEPING)])
def test_who_stops_or_creeps_brakes_to_that_share_of_its_speed_on_its_own_path(kind, share):
    for name, before, after in pairs(kind):
        assert off_path(after, before).max() < 0.02, name
        start, own, driven = first_changed(before, after), pace(before), pace(after)
        assert np.diff(driven).min() > -1.2 * BRAKING * DT_S, name
        settled = start + 2 + int(np.ceil(own[start] / BRAKING / DT_S))
        np.testing.assert_allclose(driven[settled:], share * own[settled:], atol=0.02, err_msg=name)
        gone = driven[start - 1 : settled].sum() * DT_S
        if kind == "stop":
            assert gone == pytest.approx(own[start] ** 2 / 2.0 / BRAKING, rel=0.25), name
            assert (after.speed[settled + 3 :] == 0.0).sum() > 20, name


def test_who_turns_round_drives_back_beside_its_path():
    for name, before, after in pairs("turn"):
        driven = pace(after)
        assert np.abs(np.diff(driven)).max() < 1.2 * BRAKING * DT_S, name
        turning = np.diff(np.unwrap(after.direction))[20:-5] / DT_S
        assert np.abs(turning).max() < 1.2 * 4.0 / 5.0, name  # 4 m/s on 5 m of radius
        back = after[-1:]
        nearest = int(np.argmin(np.hypot(*(before.position - back.position).T)))
        if "0" in name or "1" in name:  # straight
            assert off_path(back, before)[0] == pytest.approx(10.0, abs=0.1), name
        assert np.abs(difference(back.direction, before.direction[nearest] + np.pi))[0] < 0.1, name
        left = -np.sin(before.direction[nearest]), np.cos(before.direction[nearest])
        assert (back.position - before.position[nearest])[0] @ left > 9.0, name


def test_who_drives_against_the_traffic_is_at_each_place_as_long_before_the_end():
    for name, before, after in pairs("against"):
        np.testing.assert_allclose(after.position, before.position[::-1], atol=1e-6, err_msg=name)
        off = np.abs(difference(after.direction[::-1], before.direction + np.pi))
        assert off.max() < 0.05, name


def test_who_jumps_goes_on_two_metres_beside_its_path():
    for name, before, after in pairs("jump"):
        start = first_changed(before, after)
        off = after.position - before.position
        left = np.column_stack([-np.sin(before.direction), np.cos(before.direction)])
        np.testing.assert_allclose(np.abs((off * left).sum(axis=1)[start:]), JUMP_M, atol=1e-6, err_msg=name)
        np.testing.assert_array_equal(off[:start], 0.0)
        assert np.abs(difference(after.direction, before.direction)).max() < 0.02, name


def test_no_traffic_stays_none_and_another_kind_is_refused():
    assert len(misbehaving(WAYS[:0], kind="stop", rng=np.random.default_rng(0))) == 0
    with pytest.raises(ValueError, match="kind: expected one of stop, creep, turn, against, jump, got 'fly'"):
        misbehaving(WAYS, kind="fly", rng=np.random.default_rng(0))
