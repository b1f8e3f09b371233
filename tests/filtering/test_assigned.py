"""A frame says which track each of its detections was assigned to."""

import numpy as np
import pytest

from dirprim_filter.config import FilterConfig
from dirprim_filter.detections import Detections
from dirprim_filter.filtering import ConstantVelocityKalman, GroupTracker, Tracker
from situations import on_the_ring

CONFIG = FilterConfig(noise_m=0.3)


def tracker():
    model = ConstantVelocityKalman(acceleration_density=3.0, config=CONFIG)
    return Tracker(model, config=CONFIG, rng=np.random.default_rng(0))


def frame_of(i, *, clutter=0.0, group=0, ids=("", "")):
    """Two vehicles at 8 m/s opposite each other on the ring, and what is false far away."""
    rng = np.random.default_rng([group, i])
    places = [on_the_ring(0.1 * i, from_=turn) + rng.normal(0.0, 0.3, 2) for turn in (0.0, np.pi)]
    places += [rng.uniform(100.0, 1000.0, 2) for _ in range(int(clutter))]
    n = len(places)
    return Detections(
        track_id=[*ids, *[""] * (n - 2)], time_ns=[i * 10**8] * n, position=np.array(places), group=[group] * n
    )


def test_detections_are_of_the_track_that_is_estimated_near_them_and_false_ones_of_none():
    tracked, names = tracker(), set()
    for i in range(40):
        frame = tracked.track(frame_of(i, clutter=2))
        assert frame.assigned.shape == (4,)
        assert (frame.assigned[2:] == "").all()
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
    tracked = tracker()
    for i in range(6):
        assert tracked.track(frame_of(i, clutter=1, ids=("b", "a"))).assigned.tolist() == ["b", "a", ""]
    frame = tracked.track(Detections.none(), time_ns=600_000_000)
    assert (len(frame.estimates), frame.assigned.size) == (2, 0)


@pytest.mark.parametrize("ids", [("", ""), ("b", "a")])
def test_groups_keep_theirs_apart_and_a_detection_of_no_track_keeps_its_group(ids):
    together = GroupTracker(lambda _: tracker())
    alone = {group: tracker() for group in (0, 2)}
    for i in range(20):
        frames = {group: frame_of(i, clutter=1, group=group, ids=ids) for group in alone}
        frame = together.track(Detections.concatenate(frames.values()))
        assert frame.detections.group.tolist() == [0, 0, 0, 2, 2, 2]
        for group, seen in frames.items():
            names = [f"{group}/{name}" if group and name else name for name in alone[group].track(seen).assigned]
            assert frame.assigned[frame.detections.group == group].tolist() == names
        table = frame.assignments
        assert table.assigned.tolist() == frame.assigned.tolist()
        assert table.group.tolist() == frame.detections.group.tolist()
