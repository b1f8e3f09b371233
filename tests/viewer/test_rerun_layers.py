"""Each layer of an .rrd holds what it says, where it says; and what is reported the whole run."""

from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import rerun as rr
from rrd_files import rows_of

from dirprim_filter.detections import Detections
from dirprim_filter.drawing import colors
from dirprim_filter.estimates import EstimateList, Innovations, TrackedFrame
from dirprim_filter.evaluation.tracked_rows import TrackedRows
from dirprim_filter.evaluation.tracking_report import Scales, TrackingReport
from dirprim_filter.forecasting import Forecasts
from dirprim_filter.primitives.primitive_map import PrimitiveMap
from dirprim_filter.recording.playback import Playback
from dirprim_filter.recording.writer import EstimateWriter
from dirprim_filter.tracks import Tracks
from dirprim_filter.viewer import marks
from dirprim_filter.viewer.focus import CROWD, DRAWN_IN_FULL, STILL_CROWD, Focus
from dirprim_filter.viewer.sink import RerunSink, open_stream
from dirprim_filter.viewer.texts import run_report


@pytest.fixture(autouse=True)
def strict() -> Iterator[None]:
    rr.set_strict_mode(True)
    yield
    rr.set_strict_mode(False)


@pytest.fixture
def believed(scene_frames: list[TrackedFrame]) -> list[TrackedFrame]:
    """The frames, half a metre off, with innovations; vehicle 8 is out of sight from the second on."""
    frames = []
    for i, frame in enumerate(scene_frames[:-1]):
        off = replace(frame.estimates, position=frame.estimates.position + 0.5,
                      unseen_s=np.array([0.0, 0.6 * i]))  # fmt: skip
        reported = Innovations(distance=np.array([1.0, np.nan]), squared=np.array([4.0, np.nan]))
        frames.append(replace(frame, estimates=off, innovations=reported))
    return frames


def write(path: Path, frames: list[TrackedFrame], primitives: PrimitiveMap, **options: object) -> RerunSink:
    with open_stream(save=path, **options) as sink:  # type: ignore[arg-type]
        sink.log_map(primitives)
        for frame in frames:
            sink.write(frame)
    return sink


def test_nees_is_the_scores_and_nis_the_trackers(
    tmp_path: Path, scene_map: PrimitiveMap, believed: list[TrackedFrame], scene_tracks: Tracks
) -> None:
    kept = EstimateList()
    with open_stream(save=tmp_path / "run.rrd") as sink:
        sink.log_truth(scene_tracks)
        for frame in believed:
            sink.write(frame)
            kept.write(frame)
        sink.log_run({"command": "track", "config": '{"n_particles": 50}'}, {"frames": "5"})
    rows = [v for _, v in rows_of(tmp_path / "run.rrd", "/metrics/consistency", "Scalars:scalars")]
    report = TrackingReport.of(TrackedRows.of(kept.all()), scene_tracks, is_hidden=None, with_ids=True, scales=Scales())
    assert np.mean([row[0] for row in rows]) == pytest.approx(report.nees)
    assert [row[1:].tolist() for row in rows] == [[4.0, 2.0]] * 5
    innovation = [v.tolist() for _, v in rows_of(tmp_path / "run.rrd", "/metrics/innovation", "Scalars:scalars")]
    assert innovation == [[1.0, 1.0]] * 5
    ((_, text),) = rows_of(tmp_path / "run.rrd", "/report", "TextDocument:text")
    for reported in ("| mean NEES (2 is right) | 1.02 |", "| frames | 5 |", "| config: n_particles | 50 |"):
        assert reported in str(text[0])


def test_vehicles_out_of_sight_are_darker_and_in_a_layer_of_their_own(
    tmp_path: Path, scene_map: PrimitiveMap, believed: list[TrackedFrame]
) -> None:
    write(tmp_path / "run.rrd", believed, scene_map)
    seen = [len(v) for _, v in rows_of(tmp_path / "run.rrd", "/tracks/covariance", "Ellipsoids3D:half_sizes")]
    unseen = [len(v) for _, v in rows_of(tmp_path / "run.rrd", "/tracks/unseen", "Ellipsoids3D:half_sizes")]
    assert seen == [2, 1, 1, 1, 1]
    assert unseen == [0, 1, 1, 1, 1]
    packed = [v for _, v in rows_of(tmp_path / "run.rrd", "/tracks/estimates", "Points3D:colors")]
    bright, dark = ((packed[i][1] >> 24) & 255 for i in (0, 1))
    assert dark == pytest.approx(0.5 * bright, abs=1)


def test_an_ellipse_has_the_half_axes_of_its_covariance(
    tmp_path: Path, scene_map: PrimitiveMap, scene_frames: list[TrackedFrame]
) -> None:
    matrix = np.array([[4.0, 1.5], [1.5, 1.0]])
    frame = replace(scene_frames[0], estimates=replace(scene_frames[0].estimates, covariance=np.stack([matrix] * 2)))
    write(tmp_path / "run.rrd", [frame], scene_map)
    ((_, half),) = rows_of(tmp_path / "run.rrd", "/tracks/covariance", "Ellipsoids3D:half_sizes")
    ((_, turn),) = rows_of(tmp_path / "run.rrd", "/tracks/covariance", "Ellipsoids3D:quaternions")
    angle = 2.0 * np.arctan2(turn[0, 2], turn[0, 3])
    axis = np.array([[np.cos(angle), -np.sin(angle)], [np.sin(angle), np.cos(angle)]])
    rebuilt = axis @ np.diag(half[0, :2].astype(float) ** 2) @ axis.T / (-2.0 * np.log(0.1))
    assert rebuilt == pytest.approx(matrix, rel=1e-5)


def test_the_ring_is_around_the_vehicle_asked_for(
    tmp_path: Path, scene_map: PrimitiveMap, believed: list[TrackedFrame], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("dirprim_filter.drawing.names.LONGEST", 0)  # labels of longer names are shortened
    write(tmp_path / "run.rrd", believed, scene_map, focus="8")
    rings = [v for _, v in rows_of(tmp_path / "run.rrd", "/focus/ring", "LineStrips3D:strips")]
    for ring, frame in zip(rings, believed, strict=True):
        assert ring[0, :-1, :2].mean(axis=0) == pytest.approx(frame.estimates.position[1], abs=1e-3)
    speeds = [v[0] for _, v in rows_of(tmp_path / "run.rrd", "/focus/speed", "Scalars:scalars")]
    assert speeds == [10.0] * 5
    names = [v[0] for _, v in rows_of(tmp_path / "run.rrd", "/polar/vehicle", "Points2D:labels")]
    assert names == ["8…8"] * 5
    assert len(rows_of(tmp_path / "run.rrd", "/polar/posterior", "LineStrips2D:strips")) == 5


def test_forecasts_of_a_vehicle_nobody_sees_are_not_drawn_and_fans_hold_the_others(
    tmp_path: Path, scene_map: PrimitiveMap, believed: list[TrackedFrame]
) -> None:
    futures = believed[2].estimates.position[0] + np.cumsum(np.ones((12, 6, 2)), axis=1)
    with open_stream(save=tmp_path / "run.rrd") as sink:
        sink.log_map(scene_map)
        for frame in believed[:3]:
            sink.write(frame)
        start = believed[2].estimates.position
        sink.write_forecast(Forecasts.of(believed[2].time_ns, ["7", "8"], start, np.stack([futures, futures])))
    ((time_ns, lines),) = rows_of(tmp_path / "run.rrd", "/forecasts/paths", "LineStrips3D:strips")
    assert time_ns == believed[2].time_ns
    assert len(lines) == marks.PATHS_DRAWN
    for entity in marks.FANS:
        ((_, corners),) = rows_of(tmp_path / "run.rrd", entity, "Mesh3D:vertex_positions")
        ((_, packed),) = rows_of(tmp_path / "run.rrd", entity, "Mesh3D:vertex_colors")
        assert corners[:, :2].min(axis=0) == pytest.approx(futures.min(axis=(0, 1)) - 1.0, abs=2.5)
        red, green, blue, _ = colors.track_color(["7"])[0].tolist()
        assert set((packed >> 8).tolist()) == {red << 16 | green << 8 | blue}


def test_particles_have_the_colour_of_their_direction(
    tmp_path: Path, scene_map: PrimitiveMap, scene_frames: list[TrackedFrame]
) -> None:
    write(tmp_path / "run.rrd", scene_frames[:1], scene_map, n_particles=50)
    ((_, packed),) = rows_of(tmp_path / "run.rrd", "/tracks/particles", "Points3D:colors")
    expected = colors.direction_color(scene_frames[0].particles.direction)
    assert packed.tolist() == (expected.astype(np.int64) @ np.array([1 << 24, 1 << 16, 1 << 8, 1])).tolist()


def test_without_particles_asked_for_those_of_the_vehicle_in_focus_are_shown(
    tmp_path: Path, scene_map: PrimitiveMap, scene_frames: list[TrackedFrame]
) -> None:
    write(tmp_path / "run.rrd", scene_frames[:1], scene_map, focus="8")
    ((_, place),) = rows_of(tmp_path / "run.rrd", "/tracks/particles", "Points3D:positions")
    assert (place[:, :2] == scene_frames[0].particles.of(1).position.astype(np.float32)).all()


def test_lanes_and_diary_tell_when_a_vehicle_comes_and_goes(
    tmp_path: Path, scene_map: PrimitiveMap, scene_frames: list[TrackedFrame]
) -> None:
    write(tmp_path / "run.rrd", scene_frames, scene_map)
    states = rows_of(tmp_path / "run.rrd", "/vehicles/01", "StateChange:state")
    assert [(time_ns, value.tolist()) for time_ns, value in states] == [
        (scene_frames[0].time_ns, ["7"]), (scene_frames[-1].time_ns, []),
    ]  # fmt: skip
    diary = [str(v[0]) for _, v in rows_of(tmp_path / "run.rrd", "/events", "TextLog:text")]
    assert diary == ["7 initialised", "8 initialised", "7 ended", "8 ended"]


def test_true_trails_join_the_rows_of_one_vehicle(tmp_path: Path, scene_tracks: Tracks) -> None:
    with open_stream(save=tmp_path / "truth.rrd") as sink:
        sink.log_truth(scene_tracks)
    rows = rows_of(tmp_path / "truth.rrd", "/truth/trails", "LineStrips3D:strips")
    times = np.unique(scene_tracks.time_ns)
    steps = [(time_ns, value) for time_ns, value in rows if time_ns is not None]
    assert [time_ns for time_ns, _ in steps] == times[1:].tolist()
    for _, step in steps:
        assert np.linalg.norm(np.diff(step[..., :2], axis=1), axis=-1) == pytest.approx(1.0, rel=1e-3)


def test_a_run_that_was_written_down_comes_back_frame_by_frame(
    tmp_path: Path, scene_frames: list[TrackedFrame]
) -> None:
    with EstimateWriter(tmp_path / "run.mcap", metadata={}) as log:
        for frame in scene_frames:
            log.write(frame)
    seen = Detections.concatenate([frame.detections for frame in scene_frames])
    back = list(Playback(tmp_path / "run.mcap", seen=seen))
    assert [frame.time_ns for frame in back] == [frame.time_ns for frame in scene_frames]
    for a, b in zip(back, scene_frames, strict=True):
        assert (a.estimates.position == b.estimates.position).all()
        assert (a.detections.position == b.detections.position).all()


def test_a_report_is_a_table_whatever_stands_in_it() -> None:
    text = run_report({"a|b": "x\ny", "long": "z" * 200, "broken": "{no json"}, {})
    assert "| a\\|b | x y |" in text
    assert max(map(len, text.splitlines())) < 90
    assert "{no json" in text


@pytest.mark.parametrize("n", [3, CROWD + 1])
@pytest.mark.parametrize("worst_first", [True, False])
def test_of_a_crowd_the_few_understood_least_are_drawn_in_full(
    tmp_path: Path, scene_frames: list[TrackedFrame], n: int, worst_first: bool
) -> None:
    evidence = np.arange(n) - float(n)
    names = [str(i) for i in range(n)]
    with open_stream(save=tmp_path / "run.rrd", n_particles=50) as sink:
        for frame in scene_frames[:3]:
            many = replace(
                frame.estimates[np.zeros(n, np.int64)],
                track_id=np.arange(n), log_evidence=evidence if worst_first else evidence[::-1],
            )  # fmt: skip
            sink.write(replace(frame, estimates=many))
        futures = many.position[:, None, None] + np.cumsum(np.ones((n, 12, 6, 2)), axis=2)
        sink.write_forecast(Forecasts.of(frame.time_ns, names, many.position, futures))
    few = (names if worst_first else names[::-1])[: n if n <= CROWD else DRAWN_IN_FULL]
    labels = [set(v) for _, v in rows_of(tmp_path / "run.rrd", "/tracks/ids", "Points3D:labels")]
    assert labels[1:] == [set(few)] * 2
    sizes = [v for _, v in rows_of(tmp_path / "run.rrd", "/tracks/estimates", "Points3D:radii")]
    assert all((np.unique(v).size == 2) == (n > CROWD) for v in sizes[1:])
    assert all(
        {names[i] for i in np.flatnonzero(v == v.min())} == set(few) for v in sizes[1:]
    )  # on the screen: negative
    dots = [v for _, v in rows_of(tmp_path / "run.rrd", "/tracks/particles", "Points3D:positions")]
    assert [len(v) for v in dots[1:]] == [len(frame.particles.weight) // 2 * len({"0", "1"} & set(few))] * 2
    ((_, lines),) = rows_of(tmp_path / "run.rrd", "/forecasts/paths", "LineStrips3D:strips")
    assert len(lines) == marks.PATHS_DRAWN * len(few)


def test_a_crowd_is_one_until_it_is_clearly_none(scene_frames: list[TrackedFrame]) -> None:
    focus, everywhere = Focus(None), np.array([[-1e3, -1e3], [1e3, 1e3]])
    drawn = []
    for n in (CROWD, CROWD + 1, STILL_CROWD + 1, STILL_CROWD, CROWD):
        many = replace(scene_frames[0].estimates[np.zeros(n, np.int64)], track_id=np.arange(n))
        frame = replace(scene_frames[0], estimates=many)
        focus.see(frame, box=everywhere)
        drawn.append(int(focus.see(frame, box=everywhere)[1].sum()))
    assert drawn == [CROWD, DRAWN_IN_FULL, DRAWN_IN_FULL, STILL_CROWD, CROWD]


def test_marks_of_a_crowd_cover_more_ground_the_more_they_are_but_less_each() -> None:
    n = np.array([0, 1, CROWD, CROWD + 1, 100, 1000])
    share = marks.in_crowd(n)
    np.testing.assert_array_equal(share[:3], 1.0)
    assert (np.diff(share[2:]) < 0).all()
    assert (np.diff(n[2:] * share[2:] ** 2) > 0).all()
