"""Observed motion is checked where it enters, kept in order of time, and differenced as the definition says."""

import logging
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from dirprim_filter.track_ids import as_texts, as_track_ids, qualified_names, vehicle_numbers
from dirprim_filter.tracks import Tracks

GOOD = {
    "track_id": [4, 4, 9], "time_ns": [0, 10, 0], "position": np.zeros((3, 2)),
    "direction": np.zeros(3), "speed": np.ones(3),
}  # fmt: skip


def test_rows_are_kept_in_order_of_time_and_rows_of_one_time_in_the_order_given():
    tracks = Tracks(
        track_id=["d", "a", "c", "b"], time_ns=[5, 1, 5, 1], position=np.arange(8.0).reshape(4, 2),
        direction=[0.1, 0.2, 0.3, 0.4], speed=[1, 2, 3, 4], group=[7, 8, 9, 6],
    )  # fmt: skip
    assert tracks.track_id.tolist() == ["a", "b", "d", "c"]
    assert tracks.time_ns.tolist() == [1, 1, 5, 5]
    assert tracks.speed.tolist() == [2, 4, 1, 3]
    assert tracks.group.tolist() == [8, 6, 7, 9]
    assert tracks.position.tolist() == [[2, 3], [6, 7], [0, 1], [4, 5]]
    assert tracks.n_tracks == 4


def test_a_body_points_where_its_heading_says_else_where_it_goes():
    tracks = Tracks(**GOOD, heading=[1.5 * np.pi, np.nan, 0.5])
    assert tracks.body_direction.tolist() == [
        d if np.isnan(h) else h for d, h in zip(tracks.direction, tracks.heading, strict=True)
    ]
    assert -0.5 * np.pi in tracks.heading
    np.testing.assert_array_equal(Tracks(**GOOD).body_direction, Tracks(**GOOD).direction)


def test_directions_are_wrapped_times_kept_to_the_ends_of_int64_and_groups_zero():
    tracks = Tracks(**GOOD | {"direction": [1.5 * np.pi, -np.pi, 0.5]})
    np.testing.assert_allclose(np.sort(tracks.direction), [-0.5 * np.pi, 0.5, np.pi])
    assert tracks.group.tolist() == [0, 0, 0]
    ends = [-(2**63), 0, 2**63 - 1]
    for given_times in (ends, np.array(ends, object), np.array(ends, np.int64)):
        assert Tracks(**GOOD | {"time_ns": given_times}).time_ns.tolist() == ends
    assert Tracks(**GOOD | {"time_ns": np.array([1, 2, 2**63 - 1], np.uint64)}).time_ns.tolist() == [1, 2, 2**63 - 1]


def test_a_vehicle_has_one_row_at_a_time_and_times_are_whole_numbers():
    for change, message in (
        ({"time_ns": np.array([0, 1, 2.5], object)}, r"time_ns: expected whole numbers \(int64\), got object"),
        ({"time_ns": [0, 0, 0]}, r"vehicle 4 has two rows at 0 ns; keep one"),
        ({"track_id": ["4", 4, "9"], "time_ns": [7, 7, 7]}, r"vehicle 4 has two rows at 7 ns"),
    ):
        with pytest.raises(ValueError, match=message):
            Tracks(**GOOD | change)


ODD = ("07", "-0", "+7", " 7", "٧", "car 7", "", "1" * 5000)
"""Texts that are no canonical numbers: ٧ is a digit."""


@given(st.lists(st.one_of(st.integers(-(2**63) - 9, 2**63 + 9).map(str), st.sampled_from(ODD)), max_size=3))
def test_ids_are_numbers_where_all_are_canonical_int64_and_text_elsewhere(texts):
    fit = all(text not in ODD and -(2**63) <= int(text) < 2**63 for text in texts)
    assert as_track_ids(texts).tolist() == ([int(text) for text in texts] if fit else texts)
    for kind, numbers in ((np.uint8, [7, 12]), (np.uint64, [5, 2**63 - 1]), (np.uint64, [5, 2**63])):
        kept = numbers if numbers[1] < 2**63 else list(map(str, numbers))
        assert as_track_ids(np.array(numbers, kind)).tolist() == kept


@given(st.lists(st.integers(-(2**63), 2**63 - 1), max_size=5))
def test_an_id_is_the_same_as_number_and_as_text(ids):
    numbers = np.array(ids, np.int64)
    np.testing.assert_array_equal(as_track_ids(as_texts(numbers)), numbers)


def test_rows_that_stand_alone_in_time_are_dropped_and_counted(caplog):
    with caplog.at_level(logging.INFO):
        found = Tracks.from_positions(
            track_id=np.array([1, 1, 2, 1]), time_ns=np.array([0, 10**9, 0, 10**12]), position=np.eye(4)[:, :2],
            group=[5, 5, 6, 5], size=[[4.0, 2.0, np.nan]] * 4,
        )  # fmt: skip
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
    pairs = sorted(set(zip(both.group.tolist(), both.track_id.tolist(), strict=True)))
    assert [pairs[number] for number in both.vehicle] == list(
        zip(both.group.tolist(), both.track_id.tolist(), strict=True)
    )
    as_text = replace(both, track_id=both.track_id.astype(np.str_))
    assert as_text.n_tracks == both.n_tracks
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
