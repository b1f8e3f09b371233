"""What a sensor reports, as it comes and frame by frame."""

from dataclasses import replace

import numpy as np
import pytest

from dirprim_filter.columns import is_held, known_sizes
from dirprim_filter.detections import NO_TIME, Detections


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


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"position": [[0.0, np.nan]]}, r"position: expected finite numbers, got nan at \(0, 1\)"),
        ({"position": [0.0, 1.0]}, r"position: expected shape \(n, 2\)"),
        (
            {"direction": [90.0]},
            r"direction: expected radians, at most a turn .*, got 90.0 in row 0",
        ),
        ({"direction": [np.inf]}, "direction: expected finite numbers, or NaN"),
        ({"speed": [-1.0]}, "speed: expected at least 0 m/s, got -1.0"),
        ({"covariance": np.zeros((1, 2, 2))}, "covariance: expected symmetric positive definite"),
        ({"cue": [[1.0, -2.0]]}, r"cue: expected a concentration of at least 0, got \[1.0, -2.0\] in row 0"),
        ({"time_ns": [0.5]}, "time_ns: expected whole nanoseconds"),
        ({"track_id": ["a", "b"]}, "columns: expected one length n"),
    ],
)
def test_bad_columns_are_refused_by_name(change, message):
    with pytest.raises(ValueError, match=message):
        Detections(**{"track_id": ["a"], "time_ns": [0], "position": [[0.0, 0.0]]} | change)


def test_the_instant_of_a_frame_follows_the_log_and_nothing_else_is_one():
    frame = Detections(track_id=["a", "b"], time_ns=[5, 5], position=np.zeros((2, 2)))
    assert frame.instant(after_ns=NO_TIME) == 5
    assert frame.instant(after_ns=4) == 5
    assert Detections.none().instant(after_ns=4) == 4
    with pytest.raises(ValueError, match="expected times after 5 ns, got 5"):
        frame.instant(after_ns=5)
    with pytest.raises(ValueError, match="one instant and each track id once"):
        some().instant(after_ns=0)


def test_sizes_stay_with_their_rows_and_take_no_memory_where_unknown():
    size = np.array([[4.5, 1.9, 1.5], [np.nan, np.nan, 3.0], [12.0, 2.5, np.nan], [1.0, 1.0, 1.0]])
    seen = replace(some(), size=size)
    np.testing.assert_array_equal(np.concatenate([frame.size for frame in seen.frames()]), size[[1, 0, 2, 3]])
    np.testing.assert_array_equal(seen.without_ids().size, size)
    both = Detections.concatenate([some(), seen])
    np.testing.assert_array_equal(both.size, np.concatenate([np.full((4, 3), np.nan), size]))
    assert is_held(seen.size)
    for part in (some(), some()[:2], Detections.concatenate([some(), some()[:0]])):
        assert part.size.shape == (len(part), 3)
        assert not is_held(part.size)
    reported = known_sizes(np.array([[0.0, 2.0, -1.0], [np.inf, -np.inf, np.nan]]))  # of a file: unknown, not wrong
    np.testing.assert_array_equal(reported, [[np.nan, 2.0, np.nan], [np.nan] * 3])
