"""Each layer of an .rrd holds what it says, where and when it says, to the nanosecond."""

from dataclasses import replace

import numpy as np
import pytest
from rrd_files import rows_of, write_run

from dirprim_filter.drawing import colors, shapes
from dirprim_filter.estimates import EstimateList
from dirprim_filter.evaluation.tracked_rows import TrackedRows
from dirprim_filter.evaluation.tracking_report import report_of
from dirprim_filter.forecasting import Forecasts
from dirprim_filter.viewer import marks
from dirprim_filter.viewer.sink import RerunSink


@pytest.fixture
def tracked(scene_frames):
    """The frames, half a metre off, with innovations; vehicle 8 is out of sight from the second on."""
    frames = []
    for i, frame in enumerate(scene_frames[:-1]):
        off = replace(frame.estimates, position=frame.estimates.position + 0.5, unseen_s=np.array([0.0, 0.6 * i]))
        reported = np.array([4.0, np.nan])
        frames.append(replace(frame, estimates=off, innovations=reported))
    return [*frames, scene_frames[-1]]


def test_every_layer_follows_the_frames_and_empties_with_them(tmp_path, scene_map, tracked):
    """Rows of each frame; vehicle 8 coasts: it is drawn darker, and its ellipse in a layer of its own."""
    path = write_run(tmp_path / "run.rrd", tracked, scene_map, focus="8")
    for entity, column, n_each in [
        ("/detections", "Points3D:positions", [2, 2, 2, 2, 2, 0]),
        ("/tracks/estimates", "Points3D:positions", [2, 2, 2, 2, 2, 0]),
        ("/tracks/trails", "Points3D:positions", [2, 2, 2, 2, 2, 0]),
        ("/tracks/ids", "Points3D:labels", [2, 2, 2, 2, 2, 0]),
        ("/tracks/motion", "Arrows3D:vectors", [2, 2, 2, 2, 2, 0]),
        ("/tracks/covariance", "Ellipsoids3D:half_sizes", [2, 1, 1, 1, 1, 0]),
        ("/tracks/unseen", "Ellipsoids3D:half_sizes", [0, 1, 1, 1, 1, 0]),
        ("/tracks/particles", "Points3D:positions", [50, 50, 50, 50, 50, 0]),
        ("/focus/ring", "LineStrips3D:strips", [1, 1, 1, 1, 1, 0]),
        ("/polar/posterior", "LineStrips2D:strips", [1, 1, 1, 1, 1, 0]),
    ]:
        rows = rows_of(path, entity, column)
        assert [time_ns for time_ns, _ in rows] == [frame.time_ns for frame in tracked], entity
        assert [len(value) for _, value in rows] == n_each, entity
    places = [v for _, v in rows_of(path, "/tracks/estimates", "Points3D:positions")]
    assert places[3][:, :2] == pytest.approx(tracked[3].estimates.position, rel=1e-6)
    packed = [v for _, v in rows_of(path, "/tracks/estimates", "Points3D:colors")]
    bright, dark = ((packed[i][1] >> 24) & 255 for i in (0, 1))
    assert dark == pytest.approx(0.5 * bright, abs=1)
    for (_, ring), frame in zip(rows_of(path, "/focus/ring", "LineStrips3D:strips"), tracked[:-1], strict=False):
        assert ring[0, :-1, :2].mean(axis=0) == pytest.approx(frame.estimates.position[1], abs=1e-3)
    (_, cloud), *_ = rows_of(path, "/tracks/particles", "Points3D:positions")
    assert (cloud[:, :2] == tracked[0].particles.of(1).position.astype(np.float32)).all()
    ess = [v.tolist() for _, v in rows_of(path, "/metrics/ess", "Scalars:scalars")]
    assert ess[:5] == [[30, 30]] * 5
    assert np.isnan(ess[5]).all()
    existence = [v.tolist() for _, v in rows_of(path, "/metrics/existence", "Scalars:scalars")]
    assert existence == [[2, 2, 2, 0]] + [[2, 2, 1, 0]] * 4 + [[0, 0, 0, 0]]
    diary = [str(v[0]) for _, v in rows_of(path, "/events", "TextLog:text")]
    assert diary == ["7 initialised", "8 initialised", "8 coasts", "7 ended", "8 ended"]


def test_nees_is_the_scores_and_nis_the_trackers(tmp_path, tracked, scene_tracks):
    kept = EstimateList()
    with RerunSink(save=tmp_path / "run.rrd") as shown:
        shown.log_truth(scene_tracks)
        for frame in tracked[:-1]:
            shown.write(frame)
            kept.write(frame)
    rows = [v for _, v in rows_of(tmp_path / "run.rrd", "/metrics/consistency", "Scalars:scalars")]
    report = report_of(TrackedRows.of(kept.all()), scene_tracks, with_ids=True).report
    assert np.mean([row[0] for row in rows]) == pytest.approx(report.nees)
    assert [row[1:].tolist() for row in rows] == [[4.0, 2.0]] * 5


def test_the_map_is_static_and_its_petals_are_those_of_the_shapes(tmp_path, scene_map):
    path = write_run(tmp_path / "map.rrd", [], scene_map)
    ((time_ns, vertices),) = rows_of(path, "/map/roses", "Mesh3D:vertex_positions")
    assert time_ns is None
    assert vertices[:, :2] == pytest.approx(shapes.rose_petals(scene_map).polygon.reshape(-1, 2), rel=1e-6)
    ((_, outlines),) = rows_of(path, "/map/cells", "LineStrips3D:strips")
    assert len(outlines) == scene_map.tessellation.n_cells


def test_truth_ends_with_the_last_row(tmp_path, scene_tracks):
    rng = np.random.default_rng(0)
    with RerunSink(save=tmp_path / "truth.rrd") as shown:
        shown.log_truth(scene_tracks[rng.permutation(len(scene_tracks))])
    times = np.unique(scene_tracks.time_ns).tolist()
    for entity, column in (("/truth", "LineStrips3D:strips"), ("/truth/trails", "Points3D:positions")):
        rows = [row for row in rows_of(tmp_path / "truth.rrd", entity, column) if row[0] is not None]
        assert [time_ns for time_ns, _ in rows] == [*times, times[-1] + 100_000_000]
        assert [len(shown) for _, shown in rows] == [2] * 5 + [0]


def test_forecasts_are_shown_until_they_are_old_but_of_no_vehicle_that_coasts(tmp_path, tracked):
    rollouts = np.arange(72.0).reshape(3, 12, 2)  # with where the vehicle is, 13 instants, of which seven are shown
    start, at = tracked[1].estimates.position, tracked[1].time_ns
    later = replace(tracked[-1], time_ns=at + 1_300_000_000)
    with RerunSink(save=tmp_path / "f.rrd") as shown:
        for frame in [*tracked, later]:
            shown.write(frame)
            if frame is tracked[1]:
                shown.write_forecast(Forecasts(at, ["7", "8"], start, np.stack([rollouts, rollouts])))
    first, last = rows_of(tmp_path / "f.rrd", "/forecasts/paths", "LineStrips3D:strips")
    assert (first[0], last[0]) == (at, later.time_ns)
    assert first[1].shape == (3, 7, 3)  # of vehicle 7 alone
    assert first[1][:, 1:, :2] == pytest.approx(rollouts[:, 1::2])
    assert first[1][:, 0, :2] == pytest.approx(np.tile(start[0], (3, 1)))
    assert last[1].size == 0
    for entity in marks.FANS:
        corners = rows_of(tmp_path / "f.rrd", entity, "Mesh3D:vertex_positions")
        (_, packed), *_ = rows_of(tmp_path / "f.rrd", entity, "Mesh3D:vertex_colors")
        assert (len(corners[0][1]) > 0, len(corners[1][1])) == (True, 0)
        red, green, blue, _ = colors.track_color(["7"])[0].tolist()
        assert set((packed >> 8).tolist()) == {red << 16 | green << 8 | blue}
