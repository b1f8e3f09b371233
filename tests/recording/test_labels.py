"""What objects are, and of which group: read as others wrote it, chosen by name or number, and reported by `info`."""

import numpy as np
import pytest
from mcap_files import scene, write_protobuf_log
from test_ros2_schemas import N_TIMES, SCENE, array_log, carla, detected, detection, tracked

from dirprim_filter.cli.main import run
from dirprim_filter.recording.reader import inspect, read_tracks, stream_detections
from dirprim_filter.recording.writer import write_tracks
from dirprim_filter.tracks import Tracks

AUTOWARE = (1, 7, 2)  # car, pedestrian, truck: ObjectClassification.msg


def guesses(i):
    """The most probable one neither first nor last, an equal one behind it."""
    unknown = {"label": 0, "probability": 0.1}
    return [unknown, {"label": AUTOWARE[i], "probability": 0.45}, {"label": 5, "probability": 0.45}]


LOGS = {
    "autoware_perception_msgs/msg/TrackedObjects": lambda k, i: tracked(k, i) | {"classification": guesses(i)},
    "autoware_perception_msgs/msg/DetectedObjects": lambda k, i: detected(k, i) | {"classification": guesses(i)},
    "derived_object_msgs/msg/ObjectArray": lambda k, i: carla(k, i) | {"classification": (6, 4, 7)[i]},
    "vision_msgs/msg/Detection3DArray": lambda k, i: detection(k, i) | {"results": [
        {"hypothesis": {"class_id": name, "score": score}, "pose": detection(1, i)["results"][0]["pose"]}
        for name, score in (("cat", 0.2), (("car", "pedestrian", "truck")[i], 0.8))
    ]},
}  # fmt: skip


@pytest.mark.parametrize("schema", LOGS)
def test_labels_choose_objects(tmp_path, schema):
    path = array_log(tmp_path, schema, lambda k, _: [LOGS[schema](k, i) for i in range(3)])
    (counts,) = inspect(path).labels.values()
    assert counts == {"car": N_TIMES, "pedestrian": N_TIMES, "truck": N_TIMES}
    for labels, rows in (("pedestrian", [1]), ("car|truck", [0, 2]), (".*", [0, 1, 2])):
        seen = list(stream_detections(path, labels=labels))
        np.testing.assert_array_equal([frame.position for frame in seen], SCENE.place[:, rows, :2])
    assert len(list(stream_detections(path, labels="bus"))) == 0


def test_scenes_tell_by_their_metadata_and_what_has_no_label_is_matched_by_none(tmp_path):
    messages = []
    for k in range(5):
        update = scene([("a", k, 0.0), ("b", k, 5.0), ("c", k, 9.0)])
        update.entities[0].metadata.add(key="category", value="vehicle.car")
        update.entities[1].metadata.add(key="category", value="human.pedestrian.adult")
        messages.append(("/markers", k * 100_000_000, update))
    path = write_protobuf_log(tmp_path / "log.mcap", messages)
    assert set(read_tracks(path, labels=r"vehicle\..*").track_id) == {"a"}
    assert inspect(path).labels == {"/markers": {"vehicle.car": 5, "human.pedestrian.adult": 5, "": 5}}
    path = array_log(
        tmp_path, "autoware_perception_msgs/msg/TrackedObjects",
        lambda k, _: [tracked(k, 0) | {"classification": []}, tracked(k, 1) | {"classification": guesses(0)}],
    )  # fmt: skip
    assert [len(frame) for frame in stream_detections(path, labels="car")] == [1] * N_TIMES
    assert [len(frame) for frame in stream_detections(path, labels="car|")] == [2] * N_TIMES
    with pytest.raises(ValueError, match="labels: expected a name or a regular expression"):
        list(stream_detections(path, labels="("))


def test_one_group_is_played_alone(tmp_path, capsys):
    """Two recordings that begin at the same time: without the word they are one crowd, with it each is itself."""
    both = Tracks(
        track_id=np.repeat(["a", "b", "c"], 4), time_ns=np.tile(np.arange(4) * 10**8, 3), position=np.ones((12, 2)),
        direction=np.zeros(12), speed=np.ones(12), group=np.repeat([3, 3, 8], 4),
    )  # fmt: skip
    write_tracks(both, tmp_path / "both.mcap")
    assert inspect(tmp_path / "both.mcap").groups == {"/objects": {3: 8, 8: 4}}
    for group, ids in ((3, {"a", "b"}), (8, {"c"}), (None, {"a", "b", "c"})):
        assert set(read_tracks(tmp_path / "both.mcap", group=group).track_id) == ids
        seen = list(stream_detections(tmp_path / "both.mcap", group=group))
        assert [set(frame.track_id) for frame in seen] == [ids] * 4
    assert run(["info", str(tmp_path / "both.mcap")]) == 0
    assert "groups in /objects: 2, from 3 to 8" in capsys.readouterr().out
    assert len(read_tracks(tmp_path / "both.mcap", group=4)) == 0
