"""How large objects are: read as independent writers wrote it, and kept through our own logs."""

from pathlib import Path

import numpy as np
import pytest
from google.protobuf import json_format
from mcap_files import json_log, scene, write_protobuf_log
from test_estimate_log import a_frame
from test_ros2_schemas import N_TIMES, array_log, carla, detected, detection, marker, point, tracked

from dirprim_filter.cli.main import run
from dirprim_filter.columns import is_held
from dirprim_filter.recording import read_tracks
from dirprim_filter.recording.reader import stream_detections
from dirprim_filter.recording.tables import read_named
from dirprim_filter.recording.writer import EstimateWriter

NAN = np.nan
L, W, H = 4.25, 1.875, 1.5


def shaped(make, kind):
    """An object of Autoware's of a kind of shape."""
    footprint = {"points": [point(1, 2, 3)] * 4}
    return lambda k, i: make(k, i) | {"shape": {"type": kind, "footprint": footprint, "dimensions": point(L, W, H)}}


def solid(kind, *dimensions):
    shape = {"type": kind, "dimensions": list(dimensions), "polygon": {"points": []}}
    return lambda k, i: carla(k, i) | {"shape": shape}


def drawn(kind):
    return lambda k, i: marker(k, i, kind=kind) | {"scale": point(L, W, H)}


def boxed(*size):
    return lambda k, i: detection(k, i) | {"bbox": detection(k, i)["bbox"] | {"size": point(*size)}}


AUTOWARE = "autoware_perception_msgs/msg/TrackedObjects"
DETECTED = "autoware_auto_perception_msgs/msg/DetectedObjects"
DERIVED = "derived_object_msgs/msg/ObjectArray"
VISION = "vision_msgs/msg/Detection3DArray"
MARKERS = "visualization_msgs/msg/MarkerArray"
ROS = {
    "Autoware, box": (AUTOWARE, shaped(tracked, 0), (L, W, H)),
    "Autoware, cylinder": (AUTOWARE, shaped(tracked, 1), (L, L, H)),
    "Autoware, polygon": (AUTOWARE, shaped(tracked, 2), (NAN, NAN, H)),
    "Autoware, of a later kind": (AUTOWARE, shaped(tracked, 3), (NAN, NAN, NAN)),
    "Autoware, detected": (DETECTED, shaped(detected, 0), (L, W, H)),
    "derived, box": (DERIVED, solid(1, L, W, H), (L, W, H)),
    "derived, sphere": (DERIVED, solid(2, 0.5), (1.0, 1.0, 1.0)),
    "derived, cylinder": (DERIVED, solid(3, H, 0.5), (1.0, 1.0, H)),
    "derived, cone": (DERIVED, solid(4, H, 0.5), (1.0, 1.0, H)),
    "derived, unset": (DERIVED, solid(0), (NAN, NAN, NAN)),
    "derived, too short": (DERIVED, solid(1, L), (L, NAN, NAN)),
    "vision": (VISION, boxed(L, W, H), (L, W, H)),
    "vision, flat": (VISION, boxed(L, W, 0), (L, W, NAN)),
    "vision, unset": (VISION, boxed(0, 0, 0), (NAN, NAN, NAN)),
    "marker, cube": (MARKERS, drawn(1), (L, W, H)),
    "marker, sphere": (MARKERS, drawn(2), (L, W, H)),
    "marker, cylinder": (MARKERS, drawn(3), (L, W, H)),
    "marker, mesh": (MARKERS, drawn(10), (NAN, NAN, NAN)),
}


@pytest.mark.parametrize("name", ROS)
def test_sizes_of_ros_2_objects(tmp_path, name):
    schema, make, expected = ROS[name]
    path = array_log(tmp_path, schema, lambda k, _: [make(k, i) for i in range(3)])
    tracks = read_tracks(path)
    np.testing.assert_array_equal(tracks.size, [expected] * len(tracks))
    assert len(tracks) == 3 * N_TIMES
    assert is_held(tracks.size) == np.isfinite(expected).any()
    for frame in stream_detections(path):
        np.testing.assert_array_equal(frame.size, [expected] * len(frame))


def body(entity, kind, *size):
    """The entity's cube becomes another body."""
    pose = type(entity.cubes[0].pose)()
    pose.CopyFrom(entity.cubes[0].pose)
    entity.ClearField("cubes")
    made = getattr(entity, kind).add()
    made.pose.CopyFrom(pose)
    for axis, metres in zip("xyz", size, strict=False):
        setattr(made.size, axis, metres)


def mixed(k):
    """A cube, a cylinder, a model, a cube whose size is not set, and a line."""
    update = scene([(name, 10.0 * i + k, 0.0) for i, name in enumerate(("cube", "round", "model", "unset", "line"))])
    cube = update.entities[0].cubes[0]
    cube.size.x, cube.size.y, cube.size.z = L, W, H
    body(update.entities[1], "cylinders", 0.5, 0.5, 1.75)
    body(update.entities[2], "models")
    update.entities[2].models[0].scale.x = 7.0
    update.entities[4].ClearField("cubes")
    update.entities[4].lines.add()
    return update


def as_json(update):
    """By protobuf's own rules, but for times, which Foxglove writes as numbers."""
    reported = json_format.MessageToDict(
        update, preserving_proto_field_name=True, always_print_fields_with_no_presence=True
    )  # fmt: skip
    for entity in reported["entities"]:
        entity["timestamp"] = {"sec": 0, "nsec": 0}
    return reported


@pytest.mark.parametrize("encoding", ["protobuf", "json"])
def test_sizes_of_scenes(tmp_path, encoding):
    path = tmp_path / "log.mcap"
    if encoding == "json":
        reported = [(k * 10**8, as_json(mixed(k))) for k in range(5)]
        json_log(path, "foxglove.SceneUpdate", reported)
    else:
        write_protobuf_log(path, [("/objects", k * 10**8, mixed(k)) for k in range(5)])
    tracks = read_tracks(path)
    expected = {"cube": (L, W, H), "round": (0.5, 0.5, 1.75), "model": (NAN,) * 3, "unset": (NAN,) * 3}
    assert set(tracks.track_id) == set(expected)
    for i, (name, size) in enumerate(expected.items()):
        rows = tracks[tracks.track_id == name]
        np.testing.assert_array_equal(rows.size, [size] * 5)
        np.testing.assert_array_equal(rows.position, [[10.0 * i + k, 0.0] for k in range(5)])


def test_a_box_that_stands_for_an_estimate_is_no_measured_size(tmp_path):
    with EstimateWriter(tmp_path / "out.mcap", metadata={}) as log:
        for k in range(3):
            log.write(a_frame(k * 10**8))
    assert np.isnan(read_tracks(tmp_path / "out.mcap", topics="/dirprim/tracks/scene").size).all()
    former = Path(__file__).parents[2] / "recordings/roundabout_track.mcap"  # of when inputs were drawn too
    assert np.isnan(read_tracks(former, topics="/objects/scene", end_ns=10**9).size).all()


def test_sizes_of_a_table(tmp_path):
    path = tmp_path / "table.csv"
    path.write_text(
        "time_s,track_id,x_m,y_m,heading_rad,speed_mps,length_m,width_m,height\n"
        "0,a,0,0,0,1,4.5,1.9,3\n1,a,1,0,0,1,,1.9,3\n2,a,2,0,0,1,0,-1,3\n3,a,nan,0,0,1,7,7,3\n"
    )
    expected = [[4.5, 1.9, NAN], [NAN, 1.9, NAN], [NAN, NAN, NAN]]
    read = read_named(path)
    np.testing.assert_array_equal(read.tracks.size, expected)
    assert list(read.losses.dropped.values()) == [1]
    lines = [line.split(",") for line in path.read_text().splitlines()[:-1]]
    path.write_text("\n".join(",".join(cells[:4] + cells[6:]) for cells in lines))
    np.testing.assert_array_equal(read_named(path).tracks.size, expected)  # motion from positions
    assert run(["convert", str(path), "-o", str(tmp_path / "log.mcap"), "--format", "csv"]) == 0
    np.testing.assert_array_equal(read_tracks(tmp_path / "log.mcap").size, expected)
