"""Births, sights lost, recoveries and deaths are reported once each, in lanes that no two vehicles share."""

from itertools import pairwise

import numpy as np

from dirprim_filter.detections import Detections
from dirprim_filter.estimates import Estimates, Particles, TrackedFrame
from dirprim_filter.viewer.lifetimes import N_LANES, Lifetimes

STEP_NS = 100_000_000
NO_PARTICLES = Particles(
    position=np.empty((0, 2)), direction=np.empty(0), speed=np.empty(0), weight=np.empty(0), vehicle=np.empty(0, int)
)


def frame_of(step: int, unseen_s: dict[str, float], *, anew: tuple[str, ...] = ()) -> TrackedFrame:
    n = len(unseen_s)
    believed = Estimates(
        track_id=np.array(list(unseen_s), dtype=np.str_), time_ns=np.full(n, step * STEP_NS),
        position=np.zeros((n, 2)), covariance=np.tile(np.eye(2), (n, 1, 1)),
        **{name: np.ones(n) for name in ("direction", "direction_resultant", "speed", "speed_std",
                                         "effective_sample_size", "log_evidence", "existence")},
        unseen_s=np.array(list(unseen_s.values())),
    )  # fmt: skip
    return TrackedFrame(
        time_ns=step * STEP_NS, detections=Detections.none(), estimates=believed, particles=NO_PARTICLES,
        begun_anew=anew,
    )  # fmt: skip


def test_a_life_is_reported_from_its_first_estimate_to_its_end() -> None:
    lines = Lifetimes()
    for frame in [
        frame_of(0, {"a": 0.0}), frame_of(1, {"a": 0.0}), frame_of(2, {"a": 0.1}), frame_of(3, {"a": 0.6}),
        frame_of(4, {"a": 0.0}), frame_of(5, {"a": 0.0}, anew=("a",)), frame_of(6, {"a": 0.0}), frame_of(7, {}),
    ]:  # fmt: skip
        lines.see(frame)
    reported = [(time_ns // STEP_NS, state) for time_ns, state in lines.changes[0]]
    assert reported == [(0, "a"), (3, "a coasting"), (4, "a"), (5, "a reinitialised"), (6, "a"), (7, "")]
    assert [text.split(":")[0] for _, _, text in lines.entries] == [
        "a initialised", "a coasts", "a measured again", "a reinitialised", "a explained again", "a ended",
    ]  # fmt: skip
    assert [level for _, level, _ in lines.entries].count("WARN") == 1
    assert set(lines.states[0]) == {"a", "a coasting", "a reinitialised"}


def test_no_two_vehicles_share_a_lane_and_lanes_are_used_again() -> None:
    rng = np.random.default_rng(1)
    lines, here = Lifetimes(), {}
    for step in range(400):
        here = {name: 0.0 for name in here if rng.random() > 0.05}
        if rng.random() < 0.4:
            here[f"v{step}"] = 0.0
        lines.see(frame_of(step, here))
    assert 1 < len(lines.changes) <= N_LANES
    for changes in lines.changes.values():
        times = [time_ns for time_ns, _ in changes]
        assert times == sorted(times)
        states = [state for _, state in changes]
        assert all(bool(a) != bool(b) for a, b in pairwise(states))  # one ends, the next begins
    assert sum(len(states) for states in lines.states.values()) > 2 * N_LANES


def test_whoever_finds_no_lane_stands_in_the_diary() -> None:
    lines = Lifetimes()
    crowd = {f"v{i}": 0.0 for i in range(N_LANES + 3)}
    for step in range(2):
        lines.see(frame_of(step, crowd))
    assert len(lines.changes) == N_LANES
    assert len(lines.entries) == N_LANES + 3
