"""Each layer of an .rrd holds what it says, where and when it says, to the nanosecond."""

from dataclasses import replace

import numpy as np
import pytest
from rrd_files import rows_of, values_of, write_run

from dirprim_filter.drawing import colors, shapes
from dirprim_filter.estimates import Estimates
from dirprim_filter.evaluation.tracked_rows import TrackedRows
from dirprim_filter.evaluation.tracking_report import report_of
from dirprim_filter.forecasting import Forecasts
from dirprim_filter.origin import Origin
from dirprim_filter.viewer import lanes, marks
from dirprim_filter.viewer.process import ELAPSED
from dirprim_filter.viewer.sink import RerunSink
from dirprim_filter.viewer.stream import FRAME


@pytest.fixture
def tracked(scene_frames):
    """The frames, half a metre off, with innovations; vehicle 8 is out of sight from the second on."""
    frames = []
    for i, frame in enumerate(scene_frames[:-1]):
        off = replace(frame.estimates, position=frame.estimates.position + 0.5, unseen_s=np.array([0.0, 0.6 * i]))
        reported = np.array([4.0, np.nan])
        frames.append(replace(frame, estimates=off, innovations=reported))
    return [*frames, scene_frames[-1]]


def test_every_vehicle_has_an_entity_that_follows_the_frames_and_empties_with_them(tmp_path, scene_map, tracked):
    """Vehicle 8 coasts: it is drawn darker. A frame has its time, its number, and the seconds since the first."""
    path = write_run(tmp_path / "run.rrd", tracked, scene_map, n_particles=25)
    for entity, column, n_each in [
        ("/detections", "Points3D:positions", [2, 2, 2, 2, 2, 0]),
        *[
            (f"/tracks/{name}", column, [n] * 5 + [0])
            for name in "78"
            for column, n in [
                ("Points3D:positions", 2), ("Points3D:labels", 2), ("Arrows3D:vectors", 1),
                ("Ellipsoids3D:half_sizes", 1), ("LineStrips3D:strips", 1),
            ]
        ],
        ("/particles", "Points3D:positions", [50, 50, 50, 50, 50, 0]),
    ]:  # fmt: skip
        rows = rows_of(path, entity, column)
        assert [time_ns for time_ns, _ in rows] == [frame.time_ns for frame in tracked], entity
        assert [len(value) for _, value in rows] == n_each, entity
        since = [frame.time_ns - tracked[0].time_ns for frame in tracked]
        assert [at for at, _ in rows_of(path, entity, column, timeline=ELAPSED)] == since
        assert [at for at, _ in rows_of(path, entity, column, timeline=FRAME)] == [*range(6)]
    place = values_of(path, "/tracks/8", "Points3D:positions")[3][0, :2]
    assert place == pytest.approx(tracked[3].estimates.position[1], rel=1e-6)
    assert values_of(path, "/tracks/8", "Points3D:labels")[0].tolist() == ["", "8"]
    bright, dark = ((packed[0] >> 24) & 255 for packed in values_of(path, "/tracks/8", "Points3D:colors")[:2])
    assert dark == pytest.approx(0.5 * bright, abs=1)
    trail = values_of(path, "/tracks/7", "LineStrips3D:strips")[4][0]
    assert trail[[0, -1], :2] == pytest.approx(np.array([tracked[i].estimates.position[0] for i in (0, 4)]), rel=1e-6)
    cloud, *_ = values_of(path, "/particles", "Points3D:positions")
    assert (cloud[:, :2] == tracked[0].particles.position[::2].astype(np.float32)).all()
    ess = values_of(path, "/samples/all", "Scalars:scalars")
    np.testing.assert_array_equal(ess, [[30, 30]] * 5 + [[np.nan] * 2])
    counts = [values[:4].tolist() for values in values_of(path, "/vehicles/all", "Scalars:scalars")]
    assert counts == [[2, 2, 2, 0]] + [[2, 2, 1, 0]] * 4 + [[0, 0, 0, 0]]
    diary = [str(text) for (text,) in values_of(path, "/events", "TextLog:text")]
    assert diary == ["7 initialised", "8 initialised", "8 coasts", "7 ended", "8 ended"]


def test_ellipses_lie_as_the_covariance_does(tmp_path, tracked):
    """Half axes and angle are of the ellipse that holds 90 %; it may turn to either side of east."""
    spread = np.array([[4.0, 1.5], [1.5, 1.0]])
    wide = replace(tracked[0].estimates, covariance=np.stack([spread, spread * [[1, -1], [-1, 1]]]))
    path = write_run(tmp_path / "e.rrd", [replace(tracked[0], estimates=wide)])
    half_axes, angle = shapes.covariance_axes(wide.covariance, probability=0.9)
    for row, entity in enumerate(("/tracks/7", "/tracks/8")):
        (half,), (turn,) = (values_of(path, entity, f"Ellipsoids3D:{name}") for name in ("half_sizes", "quaternions"))
        assert half[0] == pytest.approx([*half_axes[row], 0.0], rel=1e-6)
        assert turn[0] == pytest.approx([0.0, 0.0, *(of(0.5 * angle[row]) for of in (np.sin, np.cos))], rel=1e-6)


def test_vehicles_after_the_first_share_an_entity_and_no_row_is_lost(monkeypatch):
    monkeypatch.setattr(lanes, "MOST_OWN", 2)
    divided = lanes.Lanes("/tracks")
    frames = [["c", "a", "b", "d/1"], ["a", "d/1"], [], ["b"]]
    names, instant = [n for of in frames for n in of], np.repeat(np.arange(4), [len(of) for of in frames])
    drawn = {lane.path: lane for lane in divided.divided(names, instant, 4)}
    assert set(drawn) == {"/tracks/a", "/tracks/c", "/tracks/all\\ others"}
    assert sorted(np.concatenate([lane.rows for lane in drawn.values()]).tolist()) == [*range(len(names))]
    assert (drawn["/tracks/a"].instants.tolist(), drawn["/tracks/a"].counts.tolist()) == ([0, 1, 2], [1, 1, 0])
    other = drawn["/tracks/all\\ others"]
    assert (other.instants.tolist(), other.counts.tolist()) == ([0, 1, 2, 3], [2, 1, 0, 1])
    (last,) = divided.divided([], np.empty(0, np.int64), 2)  # what was shown is emptied once
    assert (last.path, last.instants.tolist(), last.counts.tolist()) == (other.path, [0], [0])
    assert [*divided.divided([], np.empty(0, np.int64), 2)] == []


def test_nees_and_error_are_the_scores_and_innovations_the_trackers(tmp_path, tracked, scene_tracks):
    path = write_run(tmp_path / "run.rrd", tracked[:-1], truth=scene_tracks)
    kept = Estimates.concatenate([frame.estimates for frame in tracked[:-1]])
    report = report_of(TrackedRows.of(kept), scene_tracks, with_ids=True).report

    def values(entity):
        return [scalars.tolist() for scalars in values_of(path, entity, "Scalars:scalars")]

    assert np.mean([*values("/nees/7"), *values("/nees/8")]) == pytest.approx(report.nees)
    assert np.mean([row[0] for row in values("/nees/all")]) == pytest.approx(report.nees)
    assert values("/error/7") == [[pytest.approx(np.hypot(0.5, 0.5))]] * 5
    assert values("/innovation/all") == [[4.0, 2.0]] * 5
    assert values("/innovation/7") == [[4.0]] * 5


def test_the_map_is_static_and_its_petals_are_those_of_the_shapes(tmp_path, scene_map):
    path = write_run(tmp_path / "map.rrd", [], scene_map)
    ((time_ns, vertices),) = rows_of(path, "/map/roses", "Mesh3D:vertex_positions")
    assert time_ns is None
    assert vertices[:, :2] == pytest.approx(shapes.rose_petals(scene_map).polygon.reshape(-1, 2), rel=1e-6)
    (outlines,) = values_of(path, "/map/cells", "LineStrips3D:strips")
    assert len(outlines) == scene_map.tessellation.n_cells


def test_truth_ends_with_the_last_row(tmp_path, scene_tracks):
    shuffled = scene_tracks[np.random.default_rng(0).permutation(len(scene_tracks))]
    path = write_run(tmp_path / "truth.rrd", [], truth=shuffled)
    times = np.unique(scene_tracks.time_ns).tolist()
    for name in "78":
        rows = [row for row in rows_of(path, f"/truth/{name}", "LineStrips3D:strips") if row[0]]
        assert [time_ns for time_ns, _ in rows] == [*times, times[-1] + 1]
        assert [len(shown) for _, shown in rows] == [2] * 5 + [0]  # an outline and a trail


def test_sensors_have_an_entity_each_and_innovations_lead_to_their_detections(tmp_path, tracked):
    seen = [replace(tracked[0].detections, position=tracked[0].detections.position + east) for east in (1.0, 2.0)]
    expected = tracked[0].estimates.position + np.array([[5.0, 0.0], [0.0, 3.0]])
    frame = replace(tracked[0], assigned=np.array(["8", "none"]), expected=expected)
    with RerunSink(save=(path := tmp_path / "s.rrd")) as shown:
        for name, of in zip(("/front", "/rear"), seen, strict=True):
            shown.log_detections(of, name)
        shown.write(frame)
        shown.write(replace(frame, time_ns=frame.time_ns + 1, expected=None))
    for name, of in zip(("/front", "/rear"), seen, strict=True):
        place, after = values_of(path, f"/detections{name}", "Points3D:positions")
        assert (place[:, :2] == of.position.astype(np.float32)).all()
        assert len(after) == 0
    assert values_of(path, "/detections", "Points3D:positions") == []
    begins, vectors = (values_of(path, "/assigned", f"Arrows3D:{name}") for name in ("origins", "vectors"))
    for begin, vector, at in zip(begins, vectors, (expected, frame.estimates.position), strict=True):
        assert begin[:, :2] == pytest.approx(at[1:], rel=1e-6)
        assert (begin + vector)[:, :2] == pytest.approx(frame.detections.position[:1], rel=1e-6)


def test_where_the_plane_lies_on_the_earth_vehicles_and_petals_do(tmp_path, scene_map, tracked):
    origin = Origin(48.0, 11.0)
    estimates = tracked[0].estimates.on_plane(origin)
    frame, on_earth = replace(tracked[0], estimates=estimates), replace(scene_map, origin=origin)
    path = write_run(tmp_path / "g.rrd", [frame], on_earth)
    (place,) = values_of(path, "/tracks/7", "GeoPoints:positions")
    assert origin.to_plane(place) == pytest.approx(estimates.position[:1], abs=1e-6)
    (petals,) = values_of(path, "/map/earth", "GeoLineStrings:line_strings")
    expected = shapes.rose_petals(scene_map).polygon
    assert origin.to_plane(petals[:, :-1].reshape(-1, 2)) == pytest.approx(expected.reshape(-1, 2), abs=1e-6)


def test_forecasts_are_shown_until_they_are_old_but_of_no_vehicle_that_coasts(tmp_path, tracked):
    rollouts = np.arange(72.0).reshape(3, 12, 2)  # with where the vehicle is, 13 instants, of which seven are shown
    start, at = tracked[1].estimates.position, tracked[1].time_ns
    later = replace(tracked[-1], time_ns=at + 1_300_000_000)
    with RerunSink(save=(path := tmp_path / "f.rrd")) as shown:
        for frame in [*tracked, later]:
            shown.write(frame)
            if frame is tracked[1]:
                shown.write_forecast(Forecasts(at, ["7", "8"], start, np.stack([rollouts, rollouts])))
    first, last = rows_of(path, "/forecasts/paths", "LineStrips3D:strips")
    assert (first[0], last[0]) == (at, later.time_ns)
    assert first[1].shape == (3, 7, 3)  # of vehicle 7 alone
    assert first[1][:, 1:, :2] == pytest.approx(rollouts[:, 1::2])
    assert first[1][:, 0, :2] == pytest.approx(np.tile(start[0], (3, 1)))
    assert last[1].size == 0
    for entity in marks.FANS:
        shown, emptied = values_of(path, entity, "Mesh3D:vertex_positions")
        packed, *_ = values_of(path, entity, "Mesh3D:vertex_colors")
        assert (len(shown) > 0, len(emptied)) == (True, 0)
        red, green, blue, _ = colors.track_color(["7"])[0].tolist()
        assert set((packed >> 8).tolist()) == {red << 16 | green << 8 | blue}
