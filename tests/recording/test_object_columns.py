"""What objects are, how large, how surely they are there, and of which group: read as others wrote it, and kept."""

from functools import partial
from pathlib import Path

import numpy as np
import pytest
from google.protobuf import json_format
from mcap_files import detections, json_log, scene, write_protobuf_log
from ros_messages import point
from test_estimate_log import a_frame
from test_ros2_schemas import N_TIMES, SCENE, array_log, carla, detected, detection, marker, tracked
from test_stated_errors import result

from dirprim_filter.cli.exit_codes import INPUT_LOST
from dirprim_filter.cli.main import run
from dirprim_filter.columns import is_held
from dirprim_filter.recording.reader import FieldMapping, inspect, read_tracks, stream_detections
from dirprim_filter.recording.tables import read_named
from dirprim_filter.recording.writer import EstimateWriter, write_tracks
from situations import tracks_of

NAN = np.nan
L, W, H = 4.25, 1.875, 1.5


def shaped(make, kind):
    """An object of Autoware's of a kind of shape."""
    shape = {"type": kind, "footprint": {"points": [point(1, 2, 3)] * 4}, "dimensions": point(L, W, H)}
    return lambda k, i: make(k, i) | {"shape": shape}


def solid(kind, *dimensions):
    shape = {"type": kind, "dimensions": list(dimensions), "polygon": {"points": []}}
    return lambda k, i: carla(k, i) | {"shape": shape}


def boxed(*size):
    return lambda k, i: detection(k, i) | {"bbox": {"center": SCENE.pose(k, i), "size": point(*size)}}


AUTOWARE = "autoware_perception_msgs/msg/TrackedObjects"
DETECTED = "autoware_auto_perception_msgs/msg/DetectedObjects"
DERIVED = "derived_object_msgs/msg/ObjectArray"
VISION = "vision_msgs/msg/Detection3DArray"
MARKERS = "visualization_msgs/msg/MarkerArray"
SIZES = {
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
    **{f"marker, {name}": (MARKERS, partial(marker, kind=kind), (4, 2, 1))
       for name, kind in (("cube", 1), ("sphere", 2), ("cylinder", 3))},
    "marker, mesh": (MARKERS, partial(marker, kind=10), (NAN, NAN, NAN)),
}  # fmt: skip


@pytest.mark.parametrize("name", SIZES)
def test_sizes_of_ros_2_objects(tmp_path, name):
    schema, make, expected = SIZES[name]
    path = array_log(tmp_path, schema, lambda k, _: [make(k, i) for i in range(3)])
    for read in (read_tracks(path), detections(path)):
        np.testing.assert_array_equal(read.size, [expected] * (3 * N_TIMES))
        assert is_held(read.size) == np.isfinite(expected).any()


def body(entity, kind, *size):
    """The entity's cube becomes another body."""
    made = getattr(entity, kind).add()
    made.pose.CopyFrom(entity.cubes[0].pose)
    entity.ClearField("cubes")
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


AS_FOXGLOVE = {"preserving_proto_field_name": True, "always_print_fields_with_no_presence": True}


@pytest.mark.parametrize("encoding", ["protobuf", "json"])
def test_sizes_of_scenes(tmp_path, caplog, encoding):
    path = tmp_path / "log.mcap"
    if encoding == "json":
        sent = [(k * 10**8, json_format.MessageToDict(mixed(k), **AS_FOXGLOVE)) for k in range(5)]
        json_log(path, "foxglove.SceneUpdate", sent)
    else:
        write_protobuf_log(path, [("/objects", k * 10**8, mixed(k)) for k in range(5)])
    tracks = read_tracks(path)
    expected = {"cube": (L, W, H), "round": (0.5, 0.5, 1.75), "model": (NAN,) * 3, "unset": (NAN,) * 3}
    assert set(tracks.track_id) == set(expected)
    for i, (name, size) in enumerate(expected.items()):
        rows = tracks[tracks.track_id == name]
        np.testing.assert_array_equal(rows.size, [size] * 5)
        np.testing.assert_array_equal(rows.position, [[10.0 * i + k, 0.0] for k in range(5)])
    assert not caplog.messages


def test_cubes_beside_the_first_of_an_entity_are_named(tmp_path, caplog):
    sent = [("/objects", k * 10**8, scene([("all", 0.0, float(k))])) for k in range(5)]
    for *_, update in sent:
        for x in (9.0, 18.0, 27.0):
            update.entities[0].cubes.add().pose.position.x = x
    path = write_protobuf_log(tmp_path / "log.mcap", sent)
    assert read_tracks(path).n_tracks == 1
    (said,) = caplog.messages
    assert "several cubes" in said
    assert len(detections(path, mapping=FieldMapping.parse("pose=.entities[].cubes[].pose"))) == 20


def test_a_box_that_stands_for_an_estimate_is_no_measured_size(tmp_path):
    with EstimateWriter(tmp_path / "out.mcap", metadata={}) as log:
        for k in range(3):
            log.write(a_frame(k * 10**8))
    assert np.isnan(read_tracks(tmp_path / "out.mcap", topics="/dirprim/tracks/scene").size).all()
    former = Path(__file__).parents[2] / "recordings/roundabout_track.mcap"  # of when inputs were drawn too
    assert np.isnan(read_tracks(former, topics="/objects/scene", end_ns=10**9).size).all()


def test_sizes_of_a_table(tmp_path):
    path, expected = tmp_path / "table.csv", [[4.5, 1.9, NAN], [NAN, 1.9, NAN], [NAN, NAN, NAN]]
    rows = "0,a,0,0{0},4.5,1.9,3\n1,a,1,0{0},,1.9,3\n2,a,2,0{0},0,-1,3\n3,a,nan,0{0},7,7,3\n"
    for header, motion in ((",heading_rad,speed_mps", ",0,1"), ("", "")):  # motion is stated, or from positions
        path.write_text(f"time_s,track_id,x_m,y_m{header},length_m,width_m,height\n" + rows.format(motion))
        read = read_named(path)
        np.testing.assert_array_equal(read.tracks.size, expected)
        assert list(read.losses.dropped.values()) == [1]
    assert run(["convert", str(path), "-o", str(tmp_path / "log.mcap"), "--format", "csv"]) == INPUT_LOST
    np.testing.assert_array_equal(read_tracks(tmp_path / "log.mcap").size, expected)


STATED = (0.25, 1.0, 0.5)
"""How surely three objects are there; exact in 32 bits."""


def existing(make):
    return lambda k, i: make(k, i) | {"existence_probability": STATED[i]}


def scored(k, i):
    """The likeliest of several results counts; one that is not set is unknown, and a raw score is none."""
    scores = ([0.25, 0.75], [0.0], [12.5])
    return detection(k, i) | {"results": [result("car", score, 0.04) for score in scores[i]]}


@pytest.mark.parametrize(
    ("schema", "make"),
    [(AUTOWARE, existing(tracked)), (DETECTED, existing(detected)), (VISION, scored),
     (AUTOWARE.replace("ware_", "ware_auto_"), existing(tracked)), (DETECTED.replace("_auto", ""), existing(detected))],
)  # fmt: skip
def test_confidences_of_ros_2_objects(tmp_path, caplog, schema, make):
    seen = detections(array_log(tmp_path, schema, lambda k, _: [make(k, i) for i in range(3)]))
    np.testing.assert_array_equal(seen.confidence, ((0.75, NAN, NAN) if make is scored else STATED) * N_TIMES)
    reported = caplog.text.count("confidences beyond 0 to 1 are no probabilities, and count as unknown")
    assert reported == (make is scored)


def test_any_schema_states_confidence_by_the_path_of_its_field(tmp_path):
    objects = [{"x": 1.0, "y": float(i), "sure": share} for i, share in enumerate((*STATED, 0.0))]
    path = json_log(tmp_path / "log.mcap", "acme.Objects", [(k, {"objects": objects}) for k in range(5)])
    mapping = FieldMapping.parse("x=.objects[].x,y=.objects[].y,confidence=.objects[].sure")
    np.testing.assert_array_equal(detections(path, mapping=mapping).confidence, [*STATED, 0.0] * 5)


@pytest.mark.parametrize("named", [False, True])
def test_a_table_keeps_confidence_on_its_way_through_a_log_with_and_without_ids(tmp_path, named):
    path, names = tmp_path / "seen.csv", [name * named for name in ("a,", "b,", "a,", "b,")]
    rows = "time_s,{}x_m,y_m,confidence\n0,{}1,2,0.25\n0,{}8,9,\n0.1,{}1,2,0\n0.1,{}8,9,1\n"
    path.write_text(rows.format("track_id," * named, *names))
    assert run(["convert", str(path), "-o", str(tmp_path / "log.mcap")]) == 0
    for source in (path, tmp_path / "log.mcap"):
        seen = detections(source)
        assert seen.track_id.tolist() == [name[:-1] for name in names]
        np.testing.assert_array_equal(seen.confidence, [0.25, np.nan, 0.0, 1.0])
        assert not named or read_tracks(source).n_tracks == 2


KINDS = ("car", "pedestrian", "truck")


def guessed(make, k, i):
    """The most probable one neither first nor last, an equal one behind it; numbers of ObjectClassification.msg."""
    shares = ((0, 0.1), ((1, 7, 2)[i], 0.45), (5, 0.45))
    return make(k, i) | {"classification": [{"label": label, "probability": share} for label, share in shares]}


LABELLED = {
    AUTOWARE: partial(guessed, tracked),
    AUTOWARE.replace("Tracked", "Detected"): partial(guessed, detected),
    DERIVED: lambda k, i: carla(k, i) | {"classification": (6, 4, 7)[i]},
    VISION: lambda k, i: detection(k, i) | {"results": [result("cat", 0.2, 0.04), result(KINDS[i], 0.8, 0.04)]},
}  # fmt: skip


@pytest.mark.parametrize("schema", LABELLED)
def test_labels_choose_objects(tmp_path, schema):
    path = array_log(tmp_path, schema, lambda k, _: [LABELLED[schema](k, i) for i in range(3)])
    (counts,) = inspect(path).labels.values()
    assert counts == dict.fromkeys(KINDS, N_TIMES)
    for labels, rows in (("pedestrian", [1]), ("car|truck", [0, 2]), (".*", [0, 1, 2])):
        seen = list(stream_detections(path, labels=labels))
        np.testing.assert_array_equal([frame.position for frame in seen], SCENE.place[:, rows, :2])
    assert len(list(stream_detections(path, labels="bus"))) == 0


def test_scenes_tell_by_their_metadata_and_what_has_no_label_is_matched_by_none(tmp_path):
    sent = [("/markers", k * 10**8, scene([("a", k, 0.0), ("b", k, 5.0), ("c", k, 9.0)])) for k in range(5)]
    for *_, update in sent:
        for entity, category in zip(update.entities, ("vehicle.car", "human.pedestrian.adult"), strict=False):
            entity.metadata.add(key="category", value=category)
    path = write_protobuf_log(tmp_path / "log.mcap", sent)
    assert set(read_tracks(path, labels=r"vehicle\..*").track_id) == {"a"}
    assert inspect(path).labels == {"/markers": {"vehicle.car": 5, "human.pedestrian.adult": 5, "": 5}}
    bare = tracked(0, 1) | {"classification": []}
    path = array_log(tmp_path, AUTOWARE, lambda k, _: [bare, guessed(tracked, k, 0)])
    for labels, n in (("car", 1), ("car|", 2)):
        assert [len(frame) for frame in stream_detections(path, labels=labels)] == [n] * N_TIMES
    with pytest.raises(ValueError, match="labels: expected a name or a regular expression"):
        list(stream_detections(path, labels="("))


def test_one_group_is_played_alone(tmp_path, capsys):
    """Two recordings that begin at the same time: without the word they are one crowd, with it each is itself."""
    both = tracks_of(np.ones((3, 4, 2)), track_id=[["a"], ["b"], ["c"]], group=[[3], [3], [8]])
    write_tracks(both, tmp_path / "both.mcap")
    assert inspect(tmp_path / "both.mcap").groups == {"/objects": {3: 8, 8: 4}}
    for group, ids in ((3, {"a", "b"}), (8, {"c"}), (None, {"a", "b", "c"})):
        assert set(read_tracks(tmp_path / "both.mcap", group=group).track_id) == ids
        seen = list(stream_detections(tmp_path / "both.mcap", group=group))
        assert [set(frame.track_id) for frame in seen] == [ids] * 4
    assert run(["info", str(tmp_path / "both.mcap")]) == 0
    assert "groups in /objects: 2, from 3 to 8" in capsys.readouterr().out
    assert len(read_tracks(tmp_path / "both.mcap", group=4)) == 0


def test_a_detection_whose_box_is_not_filled_in_is_where_its_likeliest_result_is(tmp_path):
    def made(k, i):
        guesses = [(0.2, SCENE.pose(0, 2)), (0.8, SCENE.pose(k, i))]
        results = [{"hypothesis": {"class_id": "car", "score": p}, "pose": {"pose": pose}} for p, pose in guesses]
        empty = {"center": {"position": point(0, 0, 0)}, "size": point(0, 0, 0)}
        return detection(k, i) | {"results": results, "bbox": detection(k, i)["bbox"] if i == 2 else empty}

    seen = read_tracks(array_log(tmp_path, VISION, lambda k, _: [made(k, i) for i in range(3)]))
    boxed = read_tracks(array_log(tmp_path, VISION, lambda k, _: [detection(k, i) for i in range(3)]))
    np.testing.assert_array_equal(seen.position, boxed.position)
    np.testing.assert_array_equal(seen.heading, boxed.heading)
