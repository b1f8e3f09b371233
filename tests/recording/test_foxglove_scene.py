"""What Foxglove draws of estimates, particles, forecasts and maps: the same as the numbers say, none hides another."""

import json
import re
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from foxglove_schemas_protobuf.FrameTransform_pb2 import FrameTransform
from foxglove_schemas_protobuf.GeoJSON_pb2 import GeoJSON
from foxglove_schemas_protobuf.LocationFix_pb2 import LocationFix
from foxglove_schemas_protobuf.PointCloud_pb2 import PointCloud
from foxglove_schemas_protobuf.SceneUpdate_pb2 import SceneUpdate
from matplotlib.path import Path as Outline
from scipy.stats import chi2
from test_estimate_log import STEP, a_frame, messages, rollouts

from dirprim_filter.detections import Detections
from dirprim_filter.drawing import shapes
from dirprim_filter.drawing.vehicles import TRAIL_POINTS
from dirprim_filter.forecasting import Forecasts
from dirprim_filter.origin import Origin
from dirprim_filter.recording import topic_names
from dirprim_filter.recording.foxglove import scenes
from dirprim_filter.recording.foxglove.elements import SCENE_FRAME
from dirprim_filter.recording.foxglove.scenes import (
    VEHICLE_SIZE,
    EstimatesScene,
    forecast_scene,
    map_scenes,
    particle_cloud,
)
from dirprim_filter.recording.scan import scan
from dirprim_filter.recording.schemas import dirprim_pb2
from dirprim_filter.recording.writer import EstimateWriter

FAR = np.array([680_123.4, 4_100_567.8])
"""Metres: a place in UTM."""
HERE = np.zeros(2)


def drawn(frame, scene=None):
    scene = scene or EstimatesScene()
    return SceneUpdate.FromString(scene.update(frame.estimates, frame.detections, frame.time_ns, HERE))


def as_read(update):
    """By another reader: the schemas that protoc compiled."""
    return SceneUpdate.FromString(update.encode())


def moved(frame, way):
    """The same frame elsewhere."""
    estimates = replace(frame.estimates, position=frame.estimates.position + way)
    return replace(frame, estimates=estimates, detections=replace(frame.detections, position=estimates.position))


def yaw(pose):
    return 2 * np.arctan2(pose.orientation.z, pose.orientation.w)


def test_the_scene_draws_the_estimates():
    frame = a_frame(3 * STEP)
    sent = frame.estimates
    update = drawn(frame)
    assert update.deletions[0].type == update.deletions[0].ALL
    assert [e.id for e in update.entities] == sent.track_id.astype(str).tolist()
    for i, entity in enumerate(update.entities):
        body, arrow, region = entity.cubes[0], entity.arrows[0], entity.cylinders[0]
        assert arrow.shaft_length + arrow.head_length == pytest.approx(sent.speed[i])
        for primitive in (body, arrow):
            assert np.cos(yaw(primitive.pose) - sent.direction[i]) == pytest.approx(1.0)
            assert (primitive.pose.position.x, primitive.pose.position.y) == tuple(sent.position[i])
        if i == 0:
            assert region.size.x == region.size.y > 0
            continue
        # A point of the region's rim has the Mahalanobis distance of the 90 % quantile, in every direction.
        turn, t = yaw(region.pose), np.linspace(0, 2 * np.pi, 9)
        along = np.column_stack([region.size.x / 2 * np.cos(t), region.size.y / 2 * np.sin(t)])
        rim = along @ np.array([[np.cos(turn), np.sin(turn)], [-np.sin(turn), np.cos(turn)]])
        distance = np.einsum("ni,ij,nj->n", rim, np.linalg.inv(sent.covariance[i]), rim)
        np.testing.assert_allclose(distance, chi2.ppf(0.9, 2), rtol=1e-6)


def test_who_is_out_of_sight_is_fainter_and_of_who_may_be_anywhere_no_region_is_drawn():
    frame = a_frame(STEP)
    wide = np.broadcast_to(400.0 * np.eye(2), (4, 2, 2))
    estimates = replace(
        frame.estimates, unseen_s=np.array([0.0, 0.4, 2.0, 2.0]), covariance=wide * [[[1]], [[1]], [[0.01]], [[1]]]
    )
    kinds = ("cubes", "arrows", "cylinders", "lines", "texts")
    entities = drawn(replace(frame, estimates=estimates)).entities
    alpha = np.array([[getattr(entity, kind)[0].color.a for kind in kinds] for entity in entities])
    np.testing.assert_array_equal(alpha[0], alpha[1])
    np.testing.assert_allclose(alpha[2], 0.35 * alpha[0])
    region = kinds.index("cylinders")
    assert alpha[3, region] == 0.0 < alpha[2, region]
    np.testing.assert_array_equal(np.delete(alpha[3], region), np.delete(alpha[2], region))


def test_bodies_are_as_large_as_was_last_reported_of_them():
    frame, scene = a_frame(STEP), EstimatesScene()
    frame = replace(frame, estimates=replace(frame.estimates, direction_resultant=np.ones(4)))
    unknown = drawn(frame, scene=scene).entities[1].cubes[0].size
    assert (unknown.x, unknown.y, unknown.z) == VEHICLE_SIZE
    size = np.array([[np.nan] * 3, [12.0, 2.5, 3.2], [np.nan] * 3, [0.6, 0.5, np.nan]])
    drawn(replace(frame, detections=replace(frame.detections, size=size)), scene=scene)
    later = drawn(replace(frame, detections=Detections.none()), scene=scene)
    bodies = [entity.cubes[0] for entity in later.entities]
    reported = [(b.size.x, b.size.y, b.size.z) for b in bodies]
    assert reported == [VEHICLE_SIZE, (12.0, 2.5, 3.2), VEHICLE_SIZE, (0.6, 0.5, VEHICLE_SIZE[2])]
    assert [b.pose.position.z for b in bodies] == [size[2] / 2 for size in reported]  # on the ground


def test_trails_lead_from_where_the_vehicles_were_to_where_they_are():
    scene, frame = EstimatesScene(), a_frame(0)
    velocity = np.array([3.0, -4.0])
    for k in range(101):
        frame = moved(replace(a_frame(0), time_ns=k * STEP), velocity * k * 0.1)
        update = drawn(replace(frame, estimates=frame.estimates[np.arange(4 if k > 80 else 3)]), scene=scene)
    for i, entity in enumerate(update.entities):
        trail = np.array([(p.x, p.y) for p in entity.lines[0].points])
        assert len(trail) <= TRAIL_POINTS + 2
        np.testing.assert_array_equal(trail[-1], frame.estimates.position[i])
        off = (trail - trail[-1]) @ np.array([velocity[1], -velocity[0]])
        np.testing.assert_allclose(off, 0.0, atol=1e-9)
        length = np.hypot(*(trail[0] - trail[-1]))
        if i < 3:
            assert length == pytest.approx(5.0 * 5.0, rel=0.1)
            assert np.hypot(*np.diff(trail, axis=0)[:-1].T) == pytest.approx(5.0 * 5.0 / TRAIL_POINTS, rel=0.4)
        else:
            assert length == pytest.approx(5.0 * 1.9)  # no farther than it was followed


def test_far_from_the_origin_all_is_drawn_in_a_frame_near_by(tmp_path):
    """Viewers compute in single precision: half a metre at 4,000 km."""
    with EstimateWriter(tmp_path / "far.mcap", metadata={}) as log:
        frame = moved(a_frame(STEP), FAR)
        log.write(frame)
        log.write_forecast(Forecasts(STEP, ["a", "b"], FAR + np.zeros((2, 2)), FAR + rollouts()))
    (sent,) = messages(tmp_path / "far.mcap", "/tf")
    transform = FrameTransform.FromString(sent.data)
    assert (transform.parent_frame_id, transform.child_frame_id) == ("map", "scene")
    origin = np.array([transform.translation.x, transform.translation.y])
    assert np.abs(origin - FAR).max() < 2000
    (scene,) = messages(tmp_path / "far.mcap", "/dirprim/tracks/scene")
    entities = SceneUpdate.FromString(scene.data).entities
    assert {entity.frame_id for entity in entities} == {"scene"}
    bodies = np.array([(e.cubes[0].pose.position.x, e.cubes[0].pose.position.y) for e in entities])
    np.testing.assert_allclose(bodies.astype(np.float32) + origin, frame.estimates.position, atol=1e-4, rtol=0)
    (forecast,) = messages(tmp_path / "far.mcap", "/dirprim/forecast")
    points = [(p.x, p.y) for e in SceneUpdate.FromString(forecast.data).entities for p in e.lines[0].points]
    np.testing.assert_allclose(np.float32(points) + origin, (FAR + rollouts()).reshape(-1, 2), atol=1e-4, rtol=0)


def test_the_cloud_holds_the_particles_to_the_micrometre_and_their_directions_as_colours():
    sent = a_frame(STEP).particles
    cloud = PointCloud.FromString(particle_cloud(sent, STEP, HERE).encode())
    kinds = {7: "<f4", 1: "u1"}
    fields = np.dtype([(f.name, kinds[f.type]) for f in cloud.fields])
    assert cloud.point_stride == fields.itemsize == 16
    assert [f.offset for f in cloud.fields] == [0, 4, 8, 12, 13, 14, 15]
    points = np.frombuffer(cloud.data, fields)
    from_middle = np.column_stack([points["x"], points["y"]]).astype(np.float64)
    at = from_middle + np.array([cloud.pose.position.x, cloud.pose.position.y])
    np.testing.assert_allclose(at, sent.position, atol=1e-6, rtol=0)
    np.testing.assert_allclose(points["weight"], sent.weight, rtol=1e-6)
    assert 0 < points["alpha"].max() < 255
    north, south = (np.abs(sent.direction - d) < 0.3 for d in (np.pi / 2, -np.pi / 2))
    assert points["green"][north].min() > points["green"][south].max()


def test_petals_are_those_of_the_other_pictures(ring_map):
    origin = np.array([3.0, 4.0])
    area = as_read(next(map_scenes(ring_map, 0, origin))).entities[1].triangles[0]
    points = np.array([(p.x, p.y) for p in area.points]) + origin
    polygons = shapes.rose_petals(ring_map).polygon
    np.testing.assert_allclose(points, polygons.reshape(-1, 2), atol=6e-4, rtol=0)  # half of FINEST_M, on each axis
    assert 0 < min(c.a for c in area.colors) <= max(c.a for c in area.colors) < 1


def test_a_map_is_drawn_some_cells_at_a_time_and_each_once(ring_map, monkeypatch):
    (whole,) = map(as_read, map_scenes(ring_map, 0, HERE))
    monkeypatch.setattr(scenes, "CELLS_AT_ONCE", ring_map.tessellation.n_cells // 2 - 1)
    parts = [*map(as_read, map_scenes(ring_map, 0, HERE))]
    assert len(parts) > 2
    assert [len(part.deletions) for part in parts] == [1] + [0] * (len(parts) - 1)
    names = [entity.id for part in parts for entity in part.entities]
    assert len({*names}) == len(names)
    for i, kind in ((0, "lines"), (1, "triangles")):
        drawn = [[getattr(part.entities[i], kind)[0] for part in of] for of in ([whole], parts)]
        points = [sorted((p.x, p.y) for one in of for p in one.points) for of in drawn]
        assert points[0] == points[1]
        assert len(points[0]) == sum(1 + max(one.indices) for one in drawn[1])


def test_regions_of_forecasts_hold_their_share_of_the_paths():
    """Judged by matplotlib: at every instant, and not much more than the share."""
    update = as_read(forecast_scene(Forecasts(STEP, ["a", "b"], np.zeros((2, 2)), rollouts()), HERE))
    for entity, paths in zip(update.entities, rollouts(), strict=True):
        assert {note.key: float(note.value) for note in entity.metadata} == {
            "triangles_0_share": 0.9, "triangles_1_share": 0.5,
        }  # fmt: skip
        areas, held = [], []
        for k, (region, share) in enumerate(zip(entity.triangles, (0.9, 0.5), strict=True)):
            corner = np.array([(p.x, p.y) for p in region.points])[np.array(region.indices).reshape(-1, 3)]
            within = [[Outline(c).contains_points(at, radius=1e-6) for c in corner] for at in paths.swapaxes(0, 1)]
            held.append(np.any(within, axis=1).mean(axis=1))
            assert min(held[k]) >= share - 0.05  # straight edges between nodes cost a sample or two
            (ax, ay), (bx, by) = (corner[:, 1] - corner[:, 0]).T, (corner[:, 2] - corner[:, 0]).T
            areas.append(0.5 * (ax * by - ay * bx).sum())
        assert held[1][-1] < 0.75  # at the last instant the narrow one leaves out what the wide one holds
        assert 0 < areas[1] < 0.7 * areas[0]
        assert entity.triangles[0].pose.position.z < entity.triangles[1].pose.position.z


def test_of_vehicles_that_are_out_of_sight_no_forecast_is_drawn(tmp_path):
    frame = a_frame(STEP)
    estimates = replace(
        frame.estimates, track_id=np.array(["a", "b", "c", "d"]), unseen_s=np.array([0.0, 3.0, 0.0, 0.0]),
        direction_resultant=np.array([0.9, 0.9, 0.1, 0.9]),
    )  # fmt: skip
    with EstimateWriter(tmp_path / "a.mcap", metadata={}) as log:
        log.write(replace(frame, estimates=estimates))
        paths = np.concatenate([rollouts(), rollouts()])
        log.write_forecast(Forecasts(STEP, ["a", "b", "c", "d"], np.zeros((4, 2)), paths))
    (message,) = messages(tmp_path / "a.mcap", "/dirprim/forecast")
    assert [entity.id for entity in SceneUpdate.FromString(message.data).entities] == ["a", "d"]


PANELS = json.loads((Path(__file__).parents[2] / "docs/guides/foxglove_layout.json").read_text())["configById"]


def test_each_state_has_a_topic_to_be_plotted_and_where_the_plane_is_on_the_earth_all_is_there_too(tmp_path, ring_map):
    frame, origin = a_frame(STEP), Origin(48.0, 11.0)
    estimates = replace(frame.estimates, unseen_s=np.array([0.0, 0.6, 0.0, 3.0])).on_plane(origin)
    with EstimateWriter(tmp_path / "a.mcap", metadata={}) as log:
        log.write_map_scene(replace(ring_map, origin=origin))
        log.write(replace(frame, estimates=estimates))
    with scan(tmp_path / "a.mcap") as log:  # Foxglove shows an error for each topic in an encoding that it knows not
        assert {channel.message_encoding for channel in log.channels()} == {"protobuf"}
    for topic, rows in ((topic_names.MEASURED, [0, 2]), (topic_names.COASTING, [1, 3])):
        (message,) = messages(tmp_path / "a.mcap", topic)
        assert [*dirprim_pb2.TrackEstimates.FromString(message.data).x] == estimates.position[rows, 0].tolist()
    drawn = {}
    for topic in (topic_names.ESTIMATES_GLOBE, topic_names.MAP_GLOBE):
        (message,) = messages(tmp_path / "a.mcap", topic)
        drawn[topic] = json.loads(GeoJSON.FromString(message.data).geojson)["features"]
    points = [feature["geometry"]["coordinates"][::-1] for feature in drawn[topic_names.ESTIMATES_GLOBE]]
    np.testing.assert_allclose(origin.to_plane(np.array(points)), estimates.position, atol=0.02)
    petals = np.array([feature["geometry"]["coordinates"][0] for feature in drawn[topic_names.MAP_GLOBE]])
    corners, expected = petals[:, :-1, ::-1].reshape(-1, 2), shapes.rose_petals(ring_map).polygon.reshape(-1, 2)
    np.testing.assert_allclose(origin.to_plane(corners), expected, atol=0.02)
    (message,) = messages(tmp_path / "a.mcap", topic_names.LOCATION)
    fix = LocationFix.FromString(message.data)
    middle = shapes.map_extent(ring_map, share=shapes.BUSY_SHARE).mean(axis=0)
    np.testing.assert_allclose(origin.to_plane(np.array([[fix.latitude, fix.longitude]])), [middle], atol=0.6)


WRITTEN = {value for name, value in vars(topic_names).items() if name.isupper() and isinstance(value, str)}


def test_the_layout_shows_topics_and_fields_that_are_written():
    panel = PANELS["3D!map"]
    assert (panel["followTf"], panel["followMode"]) == (SCENE_FRAME, "follow-pose")
    assert panel["cameraState"]["perspective"] is False
    assert set(panel["topics"]) <= WRITTEN
    drawn = {topic_names.MAP_SCENE, topic_names.ESTIMATES_SCENE, topic_names.PARTICLES, topic_names.FORECAST}
    assert drawn <= {name for name, topic in panel["topics"].items() if topic["visible"]}
    fields = dirprim_pb2.TrackEstimates.DESCRIPTOR.fields_by_name
    for panel in (panel for name, panel in PANELS.items() if name.startswith("Plot!")):
        for path in panel["paths"]:
            topic, field = re.fullmatch(r"([^.]+)\.(\w+)\[:\]", path["value"]).groups()
            assert topic == f"{topic_names.ESTIMATES}/{path['label']}"
            assert field in fields
        assert len({path["color"] for path in panel["paths"]}) == len(panel["paths"]) == 2
