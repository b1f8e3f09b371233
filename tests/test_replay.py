"""The main loop hands every frame to every sink, in order, and asks the log for no more than it needs."""

from dataclasses import fields, replace
from types import SimpleNamespace

import numpy as np
import pytest

from dirprim_filter.config import FilterConfig
from dirprim_filter.detections import Detections
from dirprim_filter.estimates import EstimateList, Estimates
from dirprim_filter.filtering import GroupTracker
from dirprim_filter.filtering.smoother import Smoother
from dirprim_filter.replay import replay
from situations import TRUSTING, tracker_of


@pytest.fixture
def detections(ring):
    return Detections.of(ring[ring.time_ns < 1_000_000_000])


def test_sinks_see_every_frame_in_order_of_a_stream_that_is_read_one_at_a_time(ring_map, detections):
    seen = []

    def stream():
        for i, frame in enumerate(detections.frames()):
            assert len(seen) == 2 * i  # all before it have been dealt with
            yield frame

    tracker = tracker_of(ring_map, tracking=TRUSTING, n_particles=20)
    sinks = [SimpleNamespace(write=lambda frame, name=name: seen.append((name, frame))) for name in ("first", "second")]
    assert replay(stream(), tracker, sinks) == 10
    assert [name for name, _ in seen] == ["first", "second"] * 10
    assert [frame.time_ns for _, frame in seen[::2]] == sorted(set(detections.time_ns.tolist()))
    for (_, frame), (_, again), reported in zip(seen[::2], seen[1::2], detections.frames(), strict=True):
        assert frame is again
        np.testing.assert_array_equal(frame.detections.position, reported.position)
        assert frame.estimates.track_id.astype(str).tolist() == reported.track_id.tolist()
        assert (frame.estimates.time_ns == frame.time_ns).all()


def of_group(seen, group):
    """The same, as of a recording of its own that begins a little later."""
    return replace(seen, group=np.full(len(seen), group), time_ns=seen.time_ns + 10_000_000 * (group // 4))


@pytest.mark.parametrize("smooth", [False, True])
def test_at_a_rate_each_group_has_estimates_in_its_own_gaps_as_if_it_were_alone(ring_map, ring, smooth):
    """The gaps of the first and the second overlap, that of the third begins and ends between their frames."""
    few = Detections.of(ring[(ring.track_id < 2) & (ring.time_ns < 5e9)])
    gaps = {1: (1.0, 3.0), 4: (2.0, 4.05), 7: (0.35, 0.65)}
    parts = {
        group: of_group(few[(few.time_ns < low * 1e9) | (few.time_ns > high * 1e9)], group)
        for group, (low, high) in gaps.items()
    }

    def tracked(seen, rate_hz=5.0):
        kept, options = EstimateList(), {"config": FilterConfig(n_particles=50), "tracking": TRUSTING}
        smoother = Smoother(sinks=[kept.write])
        tracker = GroupTracker(lambda group: smoother.tracker(group, ring_map, **options, rng=np.random.default_rng(0)))
        with smoother:
            n_frames = replay(seen.frames(), tracker, [smoother] if smooth else [kept], rate_hz=rate_hz)
        assert n_frames == np.unique(seen.time_ns).size
        return kept.all()

    together = tracked(Detections.concatenate(parts.values()))
    assert (np.diff(together.time_ns) >= 0).all()
    for group, seen in parts.items():
        alone = tracked(seen)
        ours = together[np.char.startswith(together.track_id, f"{group}/")]
        own = ours[ours.time_ns <= seen.time_ns.max()]
        for column in fields(Estimates):
            np.testing.assert_array_equal(getattr(own, column.name), getattr(alone, column.name))
        of_frame, plain = np.isin(alone.time_ns, seen.time_ns), tracked(seen, rate_hz=None)
        between = np.unique(alone.time_ns[~of_frame]) * 1e-9
        low, high = gaps[group]
        last = seen.time_ns[seen.time_ns < low * 1e9].max() * 1e-9
        expected = np.arange(last + 0.2, high - 0.05, 0.2)
        np.testing.assert_allclose(between, expected)
        if not smooth:  # estimates of frames stay, but for existence, which ages by another number of steps
            assert (alone.unseen_s[~of_frame] > 0).all()
            np.testing.assert_allclose(alone.existence[of_frame], plain.existence, rtol=1e-12)
            assert replace(alone[of_frame], existence=plain.existence) == plain
