"""What a sensor reports, as it comes and frame by frame."""

import numpy as np
import pytest

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


def test_the_instant_of_a_frame_follows_the_log_and_nothing_else_is_one():
    frame = Detections(track_id=["a", "b"], time_ns=[5, 5], position=np.zeros((2, 2)))
    assert frame.instant(after_ns=NO_TIME) == 5
    assert frame.instant(after_ns=4) == 5
    assert Detections.none().instant(after_ns=4) == 4
    with pytest.raises(ValueError, match="expected times after 5 ns, got 5"):
        frame.instant(after_ns=5)
    with pytest.raises(ValueError, match="one instant and each track id once"):
        some().instant(after_ns=0)
