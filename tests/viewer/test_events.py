"""What happens to tracks is reported once each, and against the truth exchanges of ids, losses and ghosts."""

from dataclasses import replace

import numpy as np
import pytest

from dirprim_filter.detections import Detections
from dirprim_filter.estimates import Particles, TrackedFrame
from dirprim_filter.viewer.matching import Events, Matcher
from situations import estimates_of, tracks_of


def test_a_life_is_reported_from_its_first_estimate_to_its_end(scene_frames):
    def frame_of(unseen_s, *anew):
        estimates = scene_frames[0].estimates[: len(unseen_s)]
        return replace(
            scene_frames[0], estimates=replace(estimates, unseen_s=np.array(unseen_s)), reinitialised=anew
        )  # fmt: skip

    events = Events()
    lives = [([0.0],), ([0.0],), ([0.1],), ([0.6, 0.0],), ([0.0, 0.0],), ([0.0, 0.0], "7"), ([0.0],), ([],)]
    found = [[(of.level, of.text.split(":")[0]) for of in events.of(frame_of(*life), None)] for life in lives]
    assert found == [
        [("INFO", "7 initialised")], [], [], [("INFO", "8 initialised"), ("INFO", "7 coasts")],
        [("INFO", "7 measured again")], [("WARN", "7 reinitialised")], [("INFO", "8 ended")], [("INFO", "7 ended")],
    ]  # fmt: skip


STEP_NS = 500_000_000


def frames_of(places):
    """A frame for each dictionary of places by track id."""
    for i, of in enumerate(places):
        at = np.array([*of.values()]).reshape(-1, 2)
        estimates = estimates_of([*of], position=at, time_ns=np.full(len(of), i * STEP_NS))
        yield TrackedFrame(
            time_ns=i * STEP_NS, detections=Detections.none(), estimates=estimates, particles=Particles.none()
        )  # fmt: skip


@pytest.fixture
def two_lanes():
    """Two vehicles, a and b, side by side to the east, 8 m apart, 10 m/s, for 5 s."""
    east = 5.0 * np.arange(11)
    way = np.stack([np.column_stack([east, 0 * east]), np.column_stack([east, 0 * east + 8.0])])
    return tracks_of(
        way, track_id=[["a"], ["b"]], time_ns=STEP_NS * np.arange(11), direction=0.0, speed=10.0
    )  # fmt: skip


def test_an_exchange_a_loss_and_a_ghost_are_found_by_place(two_lanes):
    """Tracks 1 and 2 exchange vehicles at frame 4; the one of b ends at frame 7; 9 stands where nobody is."""
    east = 5.0 * np.arange(11)
    places = [
        {(1 if i < 4 else 2): (east[i] + 0.3, 0.0)} | ({(2 if i < 4 else 1): (east[i], 8.4)} if i < 7 else {})
        | ({9: (500.0, 500.0)} if i > 5 else {}) for i in range(11)
    ]  # fmt: skip
    frames, events = [*frames_of(places)], Events()
    matched = Matcher(two_lanes).match(frames)
    assert [of.error.tolist() for of in matched[:7]] == [pytest.approx([0.3, 0.4])] * 7
    assert [np.isnan(of.error).tolist() for of in matched[7:]] == [[False, True]] * 4
    found = [(i, of) for i, pair in enumerate(zip(frames, matched, strict=True)) for of in events.of(*pair)]
    warned = [(i, of.word, of.text.partition(":")[0]) for i, of in found if of.level == "WARN"]
    assert warned == [
        (4, "exchange", "vehicle a"), (4, "exchange", "vehicle b"), (8, "ghost", "9"), (9, "lost", "vehicle b"),
    ]  # fmt: skip
    (text, place) = next((of.text, of.place) for _, of in found if of.word == "exchange")
    assert text.endswith("1 was its track, now 2; 1 now follows b")
    assert place.tolist() == [20.0, 0.0]


def test_known_ids_are_matched_by_name_and_between_two_rows_of_the_truth(two_lanes):
    slow = two_lanes[two_lanes.time_ns % (2 * STEP_NS) == 0]  # a row each second
    frames = [*frames_of([{"a": (5.0 * i, 6.0), "b": (5.0 * i, 8.0)} for i in range(11)])]
    matched = Matcher(slow).match(frames)
    assert [of.error.tolist() for of in matched] == [pytest.approx([6.0, 0.0])] * 11  # nearer to the other one
