"""What a sensor reports, as it comes and frame by frame."""

from dataclasses import replace

import numpy as np
import pytest

from dirprim_filter.detections import Detections


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
