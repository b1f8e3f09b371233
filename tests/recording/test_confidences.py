"""How sure a detector is comes as it was stated, from every family that states it as a probability."""

import numpy as np
import pytest
from mcap_files import write_log
from test_osi_sensor_data import OSI, sensor_data_class
from test_ros2_schemas import N_TIMES, array_log, detection
from test_stated_errors import detections, json_log, result

from dirprim_filter import read_tracks, write_tracks
from dirprim_filter.cli.exit_codes import DONE
from dirprim_filter.cli.main import run
from dirprim_filter.detections import Detections
from dirprim_filter.recording.errors import TableError
from dirprim_filter.recording.reader import FieldMapping
from dirprim_filter.tracks import Tracks

STATED = np.array([0.25, 1.0, 0.5])
"""Of three objects; exact in 32 bits."""
TABLE = "time_s,{}x_m,y_m,confidence\n0,{}1,2,0.25\n0,{}8,9,\n0.1,{}1,2,0\n0.1,{}8,9,1\n"


@pytest.mark.parametrize("kind", ["Tracked", "Detected"])
@pytest.mark.parametrize("package", ["autoware_perception_msgs", "autoware_auto_perception_msgs"])
def test_autoware_states_how_probably_an_object_exists(tmp_path, kind, package):
    def items(k, make):
        return [make(k, i) | {"existence_probability": float(STATED[i])} for i in range(3)]

    path = array_log(tmp_path, f"{package}/msg/{kind}Objects", items)
    np.testing.assert_array_equal(detections(path).confidence.reshape(N_TIMES, 3), [STATED] * N_TIMES)


def test_of_several_results_that_of_the_likeliest_counts_one_that_is_not_set_is_unknown_and_a_raw_score_is_none(
    tmp_path, caplog
):  # fmt: skip
    scores = [[0.25, 0.75], [0.0], [12.5]]

    def items(k, _):
        return [detection(k, i) | {"results": [result("car", score, 0.04) for score in scores[i]]} for i in range(3)]

    seen = detections(array_log(tmp_path, "vision_msgs/msg/Detection3DArray", items)).confidence
    np.testing.assert_array_equal(seen.reshape(N_TIMES, 3), [[0.75, np.nan, np.nan]] * N_TIMES)
    assert caplog.text.count("confidences beyond 0 to 1 are no probabilities, and count as unknown") == 1


def test_osi_states_it_in_the_header_of_what_a_sensor_perceives(tmp_path, monkeypatch):
    header = OSI["DetectedItemHeader"] | {"existence_probability": (3, "double")}
    monkeypatch.setitem(OSI, "DetectedItemHeader", header)
    kind, definition = sensor_data_class()
    message = kind()
    truth = message.sensor_view.add().global_ground_truth
    truth.host_vehicle_id.value = truth.moving_object.add().id.value = 3
    truth.moving_object[0].base.position.x = 0.0
    for i, share in enumerate([*STATED, None]):
        seen = message.moving_object.add()
        seen.header.tracking_id.value, seen.base.position.x = i, 5.0 * i + 5.0
        if share is not None:
            seen.header.existence_probability = share
    sent = [("/sensor", 10**9, message.SerializeToString())]
    path = write_log(tmp_path / "osi.mcap", sent, ("osi3.SensorData", "protobuf", definition), "protobuf")
    np.testing.assert_array_equal(detections(path).confidence, [*STATED, np.nan])


def test_any_schema_states_it_by_the_path_of_its_field(tmp_path):
    def make(_):
        return {"objects": [{"x": 1.0, "y": float(i), "sure": share} for i, share in enumerate((*STATED, 0.0))]}

    path = json_log(tmp_path / "log.mcap", "acme.Objects", make)
    mapping = FieldMapping.parse("x=.objects[].x,y=.objects[].y,confidence=.objects[].sure")
    seen = detections(path, mapping=mapping).confidence
    np.testing.assert_array_equal(seen.reshape(N_TIMES, 4), [[*STATED, 0.0]] * N_TIMES)


@pytest.mark.parametrize("named", [False, True])
def test_a_table_keeps_it_on_its_way_through_a_log_with_and_without_ids(tmp_path, monkeypatch, named):
    monkeypatch.chdir(tmp_path)
    path = tmp_path / "seen.csv"
    path.write_text(TABLE.format("track_id," * named, *(name * named for name in ("a,", "b,", "a,", "b,"))))
    assert run(["convert", "seen.csv", "-o", "log.mcap"]) == DONE
    for source in (path, tmp_path / "log.mcap"):
        seen = detections(source)
        assert seen.track_id.tolist() == (["a", "b", "a", "b"] if named else [""] * 4)
        np.testing.assert_array_equal(seen.confidence, [0.25, np.nan, 0.0, 1.0])
        assert not named or read_tracks(source).n_tracks == 2


def test_it_stays_with_its_row(tmp_path):
    rng = np.random.default_rng(0)
    share = np.where(rng.random(40) < 0.3, np.nan, rng.random(40))
    seen = Detections(
        track_id=[""] * 40, time_ns=np.arange(40) // 4 * 10**8, position=rng.normal(size=(40, 2)), confidence=share
    )
    write_tracks(Tracks.none(), tmp_path / "log.mcap", detections=seen)
    again = detections(tmp_path / "log.mcap")
    for same in (again, Detections.concatenate(seen.frames()), seen.without_ids(), seen.in_one_group()):
        np.testing.assert_array_equal(same.confidence, share)
    np.testing.assert_array_equal(seen[share > 0.5].confidence, share[share > 0.5])
    table = seen.to_arrow()
    np.testing.assert_array_equal(table["confidence"].to_numpy(), share)
    bare = Detections.concatenate([seen[:3], Detections(track_id=["a"], time_ns=[0], position=np.zeros((1, 2)))])
    assert np.isnan(bare.confidence[3])


@pytest.mark.parametrize("wrong", ["1.5", "-0.1", "87", "inf"])
def test_what_is_no_probability_is_refused_with_the_line(tmp_path, wrong):
    path = tmp_path / "seen.csv"
    path.write_text(f"time_s,x_m,y_m,confidence\n0,1,2,0.5\n0,1,2,{wrong}\n")
    with pytest.raises(TableError, match=f"line 3: expected a probability, 0 to 1, as confidence, got {wrong}"):
        detections(path)
