"""The blind scene of the demo: what is left out, what is counted, and what is drawn of it."""

import numpy as np
import pytest

from dirprim_filter import Tracks, read_estimates
from dirprim_filter.cli.blind_demo import (
    FAR_M,
    NEAR_M,
    blind_report,
    departure_rate,
    followers,
    in_ring,
    telling_instant,
    with_blind_ring,
)
from dirprim_filter.cli.main import run
from dirprim_filter.detections import Detections
from dirprim_filter.estimates import Estimates

RING = (NEAR_M, FAR_M)


def through(*, n: int = 12, step_s: float = 0.1) -> Tracks:
    """Vehicles that drive through the middle one after the other, each way in turn, at 10 m/s, every three seconds."""
    times = np.round(np.arange(0.0, 16.0, step_s) * 1e9).astype(np.int64)
    parts = []
    for i in range(n):
        east, way = i % 2 == 0, np.linspace(-80.0, 80.0, times.size)
        aside = np.full(times.size, -2.0)
        parts.append(
            Tracks(
                track_id=np.full(times.size, i), time_ns=times + i * 3_000_000_000,
                position=np.column_stack([way, aside] if east else [aside, way]),
                direction=np.full(times.size, 0.0 if east else np.pi / 2), speed=np.full(times.size, 10.0),
            )
        )  # fmt: skip
    return Tracks.concatenate(parts)


def estimates_of(truth: Tracks, track_id: np.ndarray, *, off_m: np.ndarray) -> Estimates:
    n = len(truth)
    return Estimates(
        track_id=track_id.astype(np.str_), time_ns=truth.time_ns, position=truth.position + off_m,
        covariance=np.tile(0.1 * np.eye(2), (n, 1, 1)), direction=truth.direction, direction_resultant=np.ones(n),
        speed=truth.speed, speed_std=np.ones(n), effective_sample_size=np.ones(n), log_evidence=np.zeros(n),
        existence=np.ones(n), unseen_s=np.zeros(n),
    )  # fmt: skip


@pytest.fixture
def truth():
    return through()


@pytest.fixture
def confused(truth):
    """Estimates of which some lie elsewhere, and whose ids change at random every two seconds."""
    rng = np.random.default_rng(3)
    spell = (truth.time_ns // 2_000_000_000).astype(int)
    name = 10 * truth.vehicle + rng.integers(0, 3, spell.max() + 1)[spell]
    off = rng.normal(0.0, 0.3, truth.position.shape)
    off[rng.random(len(truth)) < 0.1] += 20.0
    return estimates_of(truth, name, off_m=off)


def test_the_ring_is_between_two_squares_and_its_detections_and_all_ids_are_gone():
    position = np.array([[0, 0], [24.9, 0], [25, 0], [0, -45], [45, 45], [45.1, 0], [-30, 10], [-30, 60]], np.float64)
    assert in_ring(position).tolist() == [False, False, True, True, True, False, True, False]
    seen = Detections(track_id=np.arange(8).astype(str), time_ns=np.arange(8), position=position)
    left = with_blind_ring(seen)
    assert left.time_ns.tolist() == [0, 1, 5, 7]
    assert set(left.track_id) == {""}


def test_vehicles_leave_once_each_in_the_time_that_they_are_watched(truth):
    assert departure_rate(truth) == pytest.approx(1.0 / 15.9)


@pytest.mark.parametrize(("turn", "expected"), [(0.5, "1"), (0.0, "0")])
def test_a_vehicle_that_turns_is_shown_before_one_nearer_to_the_middle(turn, expected):
    n = 11
    tracks = Tracks(
        track_id=np.repeat([0, 1], n), time_ns=np.tile(100_000_000 * np.arange(n), 2),
        position=np.repeat([[1.0, 0.0], [20.0, 0.0]], n, axis=0), speed=np.full(2 * n, 8.0),
        direction=np.concatenate([np.full(n, 3.1), np.angle(np.exp(1j * (3.1 + 0.1 * turn * np.arange(n))))]),
    )  # fmt: skip
    assert telling_instant(tracks, is_blind=False)[1] == expected


def test_who_follows_is_as_it_is_scored(truth, confused):
    follower, order = followers(confused, truth), np.lexsort((truth.time_ns, truth.vehicle))
    rows = order[follower[order] != ""]
    same = truth.vehicle[rows[1:]] == truth.vehicle[rows[:-1]]
    changed = (same & (follower[rows[1:]] != follower[rows[:-1]])).sum()
    assert changed == blind_report(confused, truth).switches > 20
    steady = estimates_of(truth, truth.track_id, off_m=np.zeros((len(truth), 2)))
    assert (followers(steady, truth) == truth.track_id.astype(str)).all()


def test_who_is_too_far_off_follows_none(truth, confused):
    off = np.hypot(*(confused.position - truth.position).T)
    assert ((followers(confused, truth) == "") == (off > 2.5)).all()


@pytest.mark.slow
def test_the_demo_of_the_blind_scene(tmp_path, short_recordings, monkeypatch, capsys):
    monkeypatch.setattr("dirprim_filter.cli.demo.recordings_folder", lambda: short_recordings)
    assert run(["demo", "--scene", "blind", "-o", str(tmp_path / "demo")]) == 0
    table = capsys.readouterr().out
    for words in ("HOTA", "changes of track", "with the map", "without the map", "constant velocity"):
        assert words in table
    assert {path.name for path in (tmp_path / "demo").iterdir()} == {
        "map.mcap", "tracks.mcap", "layout.json", "tracks.rrd", "demo.png",
    }  # fmt: skip
    found = read_estimates(tmp_path / "demo" / "tracks.mcap")
    hidden = in_ring(found.position)
    assert hidden.any()
    assert found.unseen_s[hidden].max() > 1.0  # they last where nothing is detected
