"""Sizes of bodies: checked at the door, kept beside their rows, and of no cost where none is known."""

import numpy as np
import pytest

from dirprim_filter.columns import chosen, is_held, joined, known_sizes, unknown
from dirprim_filter.detections import Detections
from dirprim_filter.tracks import Tracks

SIZE = np.array([[4.5, 1.9, 1.5], [np.nan, np.nan, 3.0], [12.0, 2.5, np.nan]])
ROWS = {"track_id": ["a", "b", "c"], "time_ns": [20, 10, 20], "position": np.zeros((3, 2))}
KINDS = {
    "tracks": lambda **more: Tracks(**ROWS, direction=np.zeros(3), speed=np.ones(3), **more),
    "positions": lambda **more: Tracks.from_positions(
        **ROWS | {"track_id": ["a", "a", "b"], "time_ns": [20, 10, 20]}, **more
    ),
    "detections": lambda **more: Detections(**ROWS, **more),
}


def test_sizes_stay_with_their_rows():
    tracks = KINDS["tracks"](size=SIZE)
    np.testing.assert_array_equal(tracks.size, SIZE[[1, 0, 2]])  # in order of time
    np.testing.assert_array_equal(tracks[tracks.track_id != "b"].size, SIZE[[0, 2]])
    np.testing.assert_array_equal(tracks[1:].size, SIZE[[0, 2]])
    np.testing.assert_array_equal(KINDS["positions"](size=SIZE).size, SIZE[[1, 0]])  # b stands alone
    seen = KINDS["detections"](size=SIZE)
    np.testing.assert_array_equal(seen.size, SIZE)
    np.testing.assert_array_equal(np.concatenate([frame.size for frame in seen.frames()]), SIZE[[1, 0, 2]])
    np.testing.assert_array_equal(seen.without_ids().size, SIZE)
    both = Detections.concatenate([KINDS["detections"](), seen])
    np.testing.assert_array_equal(both.size, np.concatenate([np.full((3, 3), np.nan), SIZE]))
    later = KINDS["tracks"]()
    joined = Tracks.concatenate([tracks, Tracks(**{**fields_of(later), "time_ns": later.time_ns + 100})])
    np.testing.assert_array_equal(joined.size, np.concatenate([tracks.size, np.full((3, 3), np.nan)]))


def fields_of(tracks):
    return {name: getattr(tracks, name) for name in ("track_id", "time_ns", "position", "direction", "speed", "group")}


@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize("size", [{}, {"size": np.full((3, 3), np.nan)}])
def test_unknown_sizes_take_no_memory(kind, size):
    """One NaN, however many rows: the strides of a column that is held are not 0."""
    rows = KINDS[kind](**size)
    for part in (rows, rows[np.zeros(len(rows), np.int64) == 0], type(rows).concatenate([rows, rows[:0]])):
        assert part.size.shape == (len(part), 3)
        assert np.isnan(part.size).all()
        assert not is_held(part.size)
    assert is_held(KINDS[kind](size=SIZE).size)


@pytest.mark.parametrize("n", [0, 1, 5])
def test_unknown_sizes_are_chosen_and_joined_as_any(n):
    rows = np.arange(n) % 2 == 0
    for some in (rows, np.flatnonzero(rows), slice(0, n, 2)):
        assert chosen(unknown(n, 3), some).shape == (int(rows.sum()), 3)
    assert joined([unknown(n, 3), unknown(2, 3)]).shape == (n + 2, 3)


def test_what_is_no_size_is_refused_by_whoever_gave_it_and_unknown_in_a_file():
    for kind in KINDS.values():
        with pytest.raises(ValueError, match=r"size: expected shape \(3, 3\), got \(3, 2\)"):
            kind(size=np.ones((3, 2)))
        for wrong in (0.0, -1.0, np.inf):
            with pytest.raises(ValueError, match=r"size: expected .*, or NaN where unknown, got"):
                kind(size=[[1, 1, 1], [4.0, wrong, np.nan], [1, 1, 1]])
    reported = known_sizes(np.array([[0.0, 2.0, -1.0], [np.inf, -np.inf, np.nan]]))
    np.testing.assert_array_equal(reported, [[np.nan, 2.0, np.nan], [np.nan] * 3])
