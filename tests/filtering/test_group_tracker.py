"""Groups laid over each other in place and time are tracked as if each were alone."""

from dataclasses import fields, replace

import numpy as np
import pytest

from dirprim_filter.detections import Detections
from dirprim_filter.estimates import Estimates
from dirprim_filter.filtering import GroupTracker
from situations import TRUSTING, tracker_of


def tracker(model, tracking=TRUSTING):
    return tracker_of(model, tracking=tracking, with_innovations=True, n_particles=50)


def reported(ring, group, *, ids):
    few = Detections.of(ring[(ring.track_id < 4) & (ring.time_ns < 1_500_000_000)])
    rng = np.random.default_rng(group)
    moved = replace(few, position=few.position + rng.normal(0, 0.3, few.position.shape), group=np.full(len(few), group))
    return moved if ids else moved.without_ids()


def tracked_by(tracker, seen):
    """The estimates of all frames, and the detections with the tracks that they were assigned to."""
    frames = [tracker.track(frame) for frame in seen.frames()]
    tables = [frame.assignments for frame in frames]
    assigned = [(table.group, table.assigned) for table in tables]
    assert all((table.group == frame.detections.group).all() for table, frame in zip(tables, frames, strict=True))
    return Estimates.concatenate([frame.estimates for frame in frames]), np.concatenate(assigned, axis=1)


@pytest.mark.parametrize("ids", [True, False])
def test_each_group_is_tracked_as_if_it_were_alone(ring, either, ids):
    """A detection of no track has no name, in whichever group; at first none without an id has a track with one."""
    parts = {group: reported(ring, group, ids=ids) for group in (0, 2, 5)}
    tracker_of_all = GroupTracker(lambda _: tracker(either, None))
    found, (of, assigned) = tracked_by(tracker_of_all, Detections.concatenate(parts.values()))
    assert tracker_of_all.n_groups == 3
    assert len(found) > 100
    assert (assigned == "").any() != ids
    for group, seen in parts.items():
        theirs, (_, names) = tracked_by(tracker(either, None), seen)
        of_group = np.char.startswith(found.track_id, f"{group}/") if group else np.char.find(found.track_id, "/") < 0
        ours = found[of_group]
        prefix = f"{group}/" if group else ""
        assert ours.track_id.astype(str).tolist() == [f"{prefix}{name}" for name in theirs.track_id]
        assert assigned[of == str(group)].tolist() == [f"{prefix}{name}" if name else "" for name in names]
        for column in fields(Estimates)[1:]:
            np.testing.assert_array_equal(getattr(ours, column.name), getattr(theirs, column.name))
    # What it is about: without groups the vehicles are taken for each other.
    in_one = [replace(seen.without_ids(), group=np.zeros(len(seen), np.int64)) for seen in parts.values()]
    mixed, _ = tracked_by(tracker(either, None), Detections.concatenate(in_one))
    assert np.isin(found.position[:, 0], mixed.position[:, 0]).mean() < 0.5


def test_joined_samples_are_those_of_the_estimates_that_they_are_given_to(ring, ring_map):
    tracker_of_all = GroupTracker(lambda _: tracker(ring_map))
    for seen in Detections.concatenate([reported(ring, group, ids=True) for group in (1, 3)]).frames():
        frame = tracker_of_all.track(seen)
        samples = frame.particles.thinned(1)
        assert len(frame.particles) == len(samples) == 50 * len(frame.estimates) == 400
        for row in range(8):
            own = samples.of(row)
            mean = (own.weight[:, None] * own.position).sum(axis=0)
            np.testing.assert_allclose(mean, frame.estimates.position[row], atol=1e-9)
        assert (frame.innovations.shape, frame.expected.shape) == ((8,), (8, 2))


def test_a_tracker_takes_one_group_at_a_time_also_one_in_which_nothing_is_seen(ring, ring_map):
    both = Detections.concatenate([reported(ring, group, ids=False) for group in (1, 3)])
    with pytest.raises(ValueError, match="rows of one group, for each is tracked by itself"):
        tracker(ring_map).track(next(both.frames()))
    with pytest.raises(ValueError, match="expected a frame of at least one"):
        GroupTracker(lambda _: tracker(ring_map)).track(Detections.none())
    tracker_of_all = GroupTracker(lambda _: tracker(ring_map))
    first, *_ = reported(ring, 3, ids=True).frames()
    tracker_of_all.track(first)
    frame = tracker_of_all.track(Detections.none(), time_ns=100_000_000, groups=[3])
    assert frame.group.tolist() == [3] * 4
    assert frame.estimates.unseen_s.tolist() == pytest.approx([0.1] * 4)
