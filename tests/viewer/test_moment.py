"""The instant of a picture: sure and moving vehicles alone; company first, then a bend, then the middle."""

import numpy as np
import pytest

from dirprim_filter.detections import Detections
from dirprim_filter.estimates import Estimates, Particles, TrackedFrame
from dirprim_filter.viewer.moment import COMPANY, Moment

NONE = np.empty(0)


def frame_at(time_s: float, vehicles: dict[str, tuple[float, float]], **values: float) -> TrackedFrame:
    """Vehicles by name, each so far east of the centre, in metres, and heading so, in radians."""
    n = len(vehicles)
    column = {"speed": 8.0, "direction_resultant": 0.99, "log_evidence": -1.5} | values
    place, heading = np.array(list(vehicles.values())).reshape(-1, 2).T
    time_ns = np.full(n, round(time_s * 1e9))
    believed = Estimates(
        track_id=np.array(list(vehicles), dtype=np.str_), time_ns=time_ns,
        position=np.stack([place, np.zeros(n)], axis=1), covariance=np.tile(np.eye(2), (n, 1, 1)),
        direction=heading, direction_resultant=np.full(n, column["direction_resultant"]),
        speed=np.full(n, column["speed"]), speed_std=np.ones(n),
        effective_sample_size=np.ones(n), log_evidence=np.full(n, column["log_evidence"]),
    )  # fmt: skip
    none = Particles(position=np.empty((0, 2)), direction=NONE, speed=NONE, weight=NONE, vehicle=np.empty(0, np.int64))
    return TrackedFrame(time_ns=round(time_s * 1e9), detections=Detections.none(), estimates=believed, particles=none)


def chosen(*frames: TrackedFrame) -> tuple[float | None, str]:
    moment = Moment(np.zeros(2))
    for frame in frames:
        moment.write(frame)
    return (None if moment.frame is None else moment.frame.time_ns / 1e9, moment.focus)


def test_nearer_to_the_centre_is_better_and_the_first_of_equals_stays() -> None:
    straight = [frame_at(t, {"a": (d, 0.0), "b": (-30.0, 0.0)}) for t, d in [(0.0, 9.0), (0.1, 5.0), (0.2, -5.0)]]
    assert chosen(*straight) == (0.1, "a")


def test_a_bend_is_better_than_the_middle_of_a_straight_way() -> None:
    def turning(time_s: float) -> TrackedFrame:
        return frame_at(time_s, {"straight": (1.0, 3.1), "left": (20.0, 3.1 + 0.3 * time_s)})  # across +-pi

    frames = [turning(t) for t in np.arange(0.0, 1.01, 0.1)]
    assert chosen(*frames)[1] == "left"
    # The test can fail: without the turn of more than 10 degrees the middle wins.
    assert chosen(*frames[:5])[1] == "straight"


def test_a_turn_long_ago_is_no_bend() -> None:
    before = frame_at(0.0, {"a": (90.0, 0.0), "b": (90.0, 0.0)}, speed=0.0)
    after = [frame_at(t, {"a": (1.0, 0.0), "b": (9.0, 1.0)}) for t in (2.0, 2.1)]
    assert chosen(before, *after) == (2.0, "a")


def test_a_turn_through_pi_is_small() -> None:
    wrapped = [frame_at(t, {"a": (1.0, 0.0), "b": (9.0, h)}) for t, h in [(0.0, 3.14), (0.1, -3.14)]]
    assert chosen(*wrapped)[1] == "a"


def test_company_is_better_than_all_else_up_to_a_number() -> None:
    def crowd(time_s: float, n: int, distance: float) -> TrackedFrame:
        return frame_at(time_s, {f"{n}-{i}": (distance + i, 0.0) for i in range(n)})

    assert chosen(crowd(0.0, 1, 0.0), crowd(0.1, 3, 10.0)) == (0.1, "3-0")
    assert chosen(crowd(0.0, COMPANY, 0.0), crowd(0.1, COMPANY + 3, 10.0)) == (0.0, f"{COMPANY}-0")
    far = frame_at(0.1, {"near": (5.0, 0.0)} | {f"far-{i}": (90.0 + i, 0.0) for i in range(5)})
    assert chosen(crowd(0.0, 2, 10.0), far) == (0.0, "2-0")  # who is out of the picture is no company


@pytest.mark.parametrize(
    "unfit", [{"speed": 1.0}, {"direction_resultant": 0.5}, {"log_evidence": -6.0}], ids=lambda value: next(iter(value))
)
def test_vehicles_that_stand_are_unsure_or_surprise_are_not_shown(unfit: dict[str, float]) -> None:
    poor = frame_at(0.0, {"a": (0.0, 0.0), "b": (1.0, 0.0)}, **unfit)
    assert chosen(poor) == (None, "")
    assert chosen(poor, frame_at(0.1, {"c": (30.0, 0.0)})) == (0.1, "c")


def test_a_frame_without_vehicles_is_passed_over() -> None:
    assert chosen(frame_at(0.0, {}), frame_at(0.1, {"a": (3.0, 0.0)}), frame_at(0.2, {})) == (0.1, "a")
