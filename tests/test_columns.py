"""Tables of columns: what does not fit is refused by name, rows stay together; tracks are in order, frames ascend."""

import logging
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from dirprim_filter import Detections, Estimates, Tracks
from dirprim_filter.columns import CHECKS, column_fields, is_held, known_sizes
from dirprim_filter.estimates import Particles
from dirprim_filter.evaluation.tracked_rows import TrackedRows
from dirprim_filter.track_ids import as_track_ids, qualified_names, vehicle_numbers

N = 5
KINDS = (Tracks, Detections, Estimates, Particles, TrackedRows)
FIELDS = [(kind, f.name) for kind in KINDS for f in column_fields(kind)]
WRONG = {
    "direction": 90.0, "heading": -90.0, "speed": -1.0, "size": 0.0, "covariance": np.array([[1.0, 2.0], [2.0, 1.0]]),
    "cue": -2.0, "confidence": 1.5,
}  # fmt: skip


def columns_of(kind, n=N):
    """Columns of which every number is another, and good."""
    rng, made = np.random.default_rng(0), {}
    for f in column_fields(kind):
        column = rng.uniform(0.1, 1.0, (n, *f.metadata["none"].shape[1:]))
        if f.name == "covariance":
            column = 4.0 * np.eye(2) + column + column.swapaxes(1, 2)
        made[f.name] = np.arange(n) + 3 if f.metadata["none"].dtype == np.int64 else column
    return made


def refused(kind, message, **changes):
    with pytest.raises(ValueError, match=message):
        kind(**columns_of(kind) | changes)


@pytest.mark.parametrize(("kind", "name"), FIELDS)
def test_a_column_that_does_not_fit_is_refused_by_name(kind, name):
    good, about = columns_of(kind)[name], {f.name: f.metadata for f in column_fields(kind)}[name]
    refused(kind, rf"columns: expected one length n, got .*{name} \({N - 1},", **{name: good[:-1]})
    if name == "track_id":
        return
    if about["none"].dtype == np.int64:
        halves = np.array([*range(N - 1), 2.5], object)
        for wrong in (good + 0.0, halves, good.astype(np.uint64) + np.uint64(2**63), [*range(N - 1), 10**30]):
            refused(kind, rf"{name}: expected whole numbers \(int64\), got", **{name: wrong})
        return
    refused(kind, f"{name}: expected shape", **{name: good[..., None]})
    for wrong in (np.inf,) if np.isnan(about["left_out"] or 0.0) else (np.inf, np.nan):
        bad = good.copy()
        bad.flat[-1] = wrong
        refused(kind, f"{name}: expected finite numbers", **{name: bad})
    if about["checked"]:
        bad = good.copy()
        bad[1] = WRONG[name]
        refused(kind, f"{name}: expected .*{CHECKS[name][1][:9]}.* in row 1", **{name: bad})
    bare = columns_of(kind)
    del bare[name]
    if about["left_out"] is None:
        with pytest.raises(TypeError, match=name):
            kind(**bare)
    else:
        np.testing.assert_array_equal(getattr(kind(**bare), name), np.full_like(good, about["left_out"]))


@pytest.mark.parametrize("kind", KINDS)
def test_rows_stay_together_whether_chosen_or_joined(kind):
    table = kind(**columns_of(kind))
    for rows in (np.arange(N) % 2 == 0, np.array([1, 3, 4]), slice(1, 4), slice(0, 0)):
        some = table[rows]
        assert len(some) == len(np.arange(N)[rows])
        for f in column_fields(kind):
            np.testing.assert_array_equal(getattr(some, f.name), getattr(table, f.name)[rows])
    assert kind.concatenate(iter([table[:2], kind.none(), table[2:]])) == table
    assert kind.concatenate([]) == kind.none()
    assert len(kind.none()) == 0


@pytest.mark.parametrize("kind", KINDS)
def test_tables_are_equal_where_every_number_is(kind):
    table = kind(**columns_of(kind))
    assert table == kind(**columns_of(kind))
    assert table != table[:-1]
    assert table != columns_of(kind)
    for f in column_fields(kind):
        other = np.arange(N) + 4 if f.name == "track_id" else getattr(table, f.name).copy()
        other.flat[-1] += 1 if other.dtype == np.int64 else 1e-9
        assert table != replace(table, **{f.name: other})
    with pytest.raises(TypeError, match="unhashable"):
        hash(table)


@pytest.mark.parametrize(("kind", "name"), [of for of in FIELDS if of[1] in ("size", "heading", "cue")])
def test_what_is_known_of_some_rows_stays_with_them_and_of_none_takes_no_memory(kind, name):
    bare = columns_of(kind)
    values = bare.pop(name)
    known = kind(**bare, **{name: values})
    unknown = kind(**bare | {"track_id": np.arange(N) + 90})
    both = kind.concatenate([known, unknown])
    is_new = both.track_id.astype(int) >= 90
    assert np.isnan(getattr(both, name)[is_new]).all()
    np.testing.assert_array_equal(getattr(both, name)[~is_new], values)
    for part in (unknown, unknown[:2], kind(**bare, **{name: values * np.nan})):
        assert not is_held(getattr(part, name))
        assert not any(getattr(part, name).strides)
    of_file = known_sizes(np.array([[0.0, 2.0, -1.0], [np.inf, -np.inf, np.nan]]))  # unknown, not wrong
    np.testing.assert_array_equal(of_file, [[np.nan, 2.0, np.nan], [np.nan] * 3])


def test_numbers_among_names_become_text():
    one, other = (Detections(track_id=ids, time_ns=[1, 2], position=np.zeros((2, 2))) for ids in ([4, 9], ["x", "y"]))
    assert Detections.concatenate([one, other]).track_id.tolist() == ["4", "9", "x", "y"]


def some():
    return Detections(track_id=["b", "a", "c", "a"], time_ns=[20, 10, 20, 30], position=np.arange(8.0).reshape(4, 2))


def test_frames_ascend_in_time_and_hold_every_row_once_in_its_order():
    frames = list(some().frames())
    assert [frame.time_ns.tolist() for frame in frames] == [[10], [20, 20], [30]]
    assert [frame.track_id.tolist() for frame in frames] == [["a"], ["b", "c"], ["a"]]
    assert frames[1].position.tolist() == [[0, 1], [4, 5]]
    before_the_epoch = Detections(track_id=["a", "a"], time_ns=[-5, -9], position=np.zeros((2, 2)))
    assert [int(frame.time_ns[0]) for frame in before_the_epoch.frames()] == [-9, -5]
    assert list(Detections.none().frames()) == []


def test_a_frame_is_of_one_instant_one_group_and_each_id_once():
    frame = Detections(track_id=["a", "b"], time_ns=[5, 5], position=np.zeros((2, 2)))
    assert frame.instant() == 5
    for wrong in (some(), replace(frame, track_id=["a", "a"])):
        with pytest.raises(ValueError, match="one instant and each track id once"):
            wrong.instant()
    with pytest.raises(ValueError, match="rows of one group"):
        replace(frame, group=[0, 1]).instant()


GOOD = {"track_id": [4, 4, 9], "time_ns": [0, 10, 0], "position": np.zeros((3, 2)), "speed": np.ones(3)}
ENDS = [-(2**63), 0, 2**63 - 1]


def test_rows_are_kept_in_order_of_time_and_rows_of_one_time_in_the_order_given():
    columns = columns_of(Tracks, n=4) | {"track_id": np.array(["d", "a", "c", "b"]), "time_ns": np.array([5, 1, 5, 1])}
    tracks = Tracks(**columns)
    for name, column in columns.items():
        np.testing.assert_array_equal(getattr(tracks, name), column[[1, 3, 0, 2]])
    assert tracks.n_tracks == 4


def test_a_body_points_where_its_heading_says_else_where_it_goes():
    tracks = Tracks(**GOOD, direction=np.zeros(3), heading=[1.5 * np.pi, np.nan, 0.5])
    np.testing.assert_allclose(tracks.body_direction, [-0.5 * np.pi, 0.5, 0.0])  # in order of time
    np.testing.assert_array_equal(replace(tracks, heading=np.full(3, np.nan)).body_direction, tracks.direction)


def test_directions_are_wrapped_times_kept_to_the_ends_of_int64_and_groups_zero():
    tracks = Tracks(**GOOD, direction=[1.5 * np.pi, -np.pi, 0.5])
    np.testing.assert_allclose(np.sort(tracks.direction), [-0.5 * np.pi, 0.5, np.pi])
    assert tracks.group.tolist() == [0, 0, 0]
    for times in (ENDS, np.array(ENDS, object), np.array(ENDS), np.array([1, 2, 2**63 - 1], np.uint64)):
        assert replace(tracks, time_ns=times).time_ns.tolist() == list(times)


@pytest.mark.parametrize(("track_id", "time_ns"), [([4, 4, 9], [7, 7, 7]), (["4", 4, "9"], [7, 7, 7])])
def test_a_vehicle_has_one_row_at_a_time(track_id, time_ns):
    with pytest.raises(ValueError, match=r"vehicle 4 has two rows at 7 ns; keep one"):
        Tracks(**GOOD | {"track_id": track_id, "time_ns": time_ns}, direction=np.zeros(3))


ODD = ("07", "-0", "+7", " 7", "٧", "car 7", "", "1" * 5000)
"""Texts that are no canonical numbers: ٧ is a digit."""


@given(st.lists(st.one_of(st.integers(-(2**63) - 9, 2**63 + 9).map(str), st.sampled_from(ODD)), max_size=3))
def test_ids_are_numbers_where_all_are_canonical_int64_and_text_elsewhere(texts):
    fit = all(text not in ODD and -(2**63) <= int(text) < 2**63 for text in texts)
    assert as_track_ids(texts).tolist() == ([int(text) for text in texts] if fit else texts)
    for kind, kept in ((np.uint8, [7, 12]), (np.uint64, [5, 2**63 - 1]), (np.uint64, ["5", str(2**63)])):
        assert as_track_ids(np.array(kept, kind)).tolist() == kept


def test_rows_that_stand_alone_in_time_are_dropped_and_counted(caplog):
    caplog.set_level(logging.INFO)
    rows = {"track_id": [1, 1, 2, 1], "time_ns": [0, 10**9, 0, 10**12], "group": [5, 5, 6, 5]}
    found = Tracks.from_positions(**rows, position=np.eye(4)[:, :2], size=[[4.0, 2.0, np.nan]] * 4)
    np.testing.assert_array_equal(found.size, [[4.0, 2.0, np.nan]] * 2)
    assert found.track_id.tolist() == [1, 1]
    assert found.group.tolist() == [5, 5]
    assert "2 of 4 rows stand alone in time" in caplog.text


def test_joined_tracks_are_in_order_of_time_and_hold_a_vehicle_once_at_a_time(ring):
    whole = Tracks.concatenate(ring[ring.track_id % 2 == i] for i in (1, 0))
    assert (np.diff(whole.time_ns) >= 0).all()
    for vehicle in (3, 4):
        assert whole[whole.track_id == vehicle] == ring[ring.track_id == vehicle]
    with pytest.raises(ValueError, match="vehicle 0 has two rows at 0 ns"):
        Tracks.concatenate([ring, ring[:1]])


def two_groups(ring):
    return Tracks.concatenate([replace(ring, group=np.full(len(ring), group)) for group in (5, -2)])


def test_a_vehicle_is_an_id_in_a_group(ring):
    both = two_groups(ring)
    assert both.n_tracks == 2 * ring.n_tracks
    own = list(zip(both.group.tolist(), both.track_id.tolist(), strict=True))
    assert np.array(sorted(set(own)))[both.vehicle].tolist() == [*map(list, own)]
    assert replace(both, track_id=both.track_id.astype(np.str_)).n_tracks == both.n_tracks
    names = np.array(["b", "a", "b", "c"])
    np.testing.assert_array_equal(vehicle_numbers(names, np.zeros(4, np.int64)), [1, 0, 1, 2])
    np.testing.assert_array_equal(vehicle_numbers(names, np.array([1, 1, 0, 0])), [3, 2, 0, 1])
    np.testing.assert_array_equal(vehicle_numbers(np.array([10**15, 3, -4]), np.zeros(3, np.int64)), [2, 1, 0])
    with pytest.raises(ValueError, match="has two rows at"):
        replace(both, group=np.zeros(len(both), np.int64))


def test_scenes_are_the_groups_and_their_names_each_of_one_vehicle(ring):
    both = two_groups(ring)
    groups = list(both.by_group())
    assert [set(group.group.tolist()) for group in groups] == [{-2}, {5}]
    np.testing.assert_array_equal(groups[0].position, ring.position)
    assert [len(group) for group in ring.by_group()] == [len(ring)]
    names = qualified_names(both.track_id, both.group)
    assert np.unique(names).size == both.n_tracks
    assert set(names.tolist()) == {f"{g}/{i}" for g in (5, -2) for i in np.unique(ring.track_id)}
    assert qualified_names(ring.track_id, ring.group).tolist() == ring.track_id.astype(str).tolist()
    assert qualified_names(names, both.group).tolist() == names.tolist()
