"""ASAM OSI: objects are those that the stock decoder finds; what a moving sensor perceives arrives in the world."""

from collections import Counter
from pathlib import Path

import numpy as np
import pytest
from google.protobuf import descriptor_pb2, message_factory
from mcap.reader import make_reader
from mcap_files import DATA, detections, stock, write_log
from mcap_protobuf.decoder import DecoderFactory
from scipy.spatial.transform import Rotation

from dirprim_filter.recording.losses import UNDECODABLE
from dirprim_filter.recording.reader import inspect, read_track_logs, read_tracks

F = descriptor_pb2.FieldDescriptorProto
# What OSI 3.7 has of a sensor: message -> field -> (number, message or else a double, repeated).
PERCEIVED = {
    "DetectedItemHeader": {"tracking_id": (2, "Identifier"), "existence_probability": (3, "")},
    "DetectedMovingObject": {
        "header": (1, "DetectedItemHeader"), "base": (2, "BaseMoving"), "base_rmse": (3, "BaseMoving"),
    },
    "SensorData": {
        "timestamp": (2, "Timestamp"), "mounting_position": (6, "MountingPosition"),
        "sensor_view": (8, "SensorView", True), "last_measurement_time": (9, "Timestamp"),
        "moving_object": (13, "DetectedMovingObject", True),
    },
}  # fmt: skip
N, STEP_NS = 20, 100_000_000
HEADING = 2.5


def sensor_data_class():
    """And its definition, with those of all that it has of the world from a real log."""
    files = descriptor_pb2.FileDescriptorSet.FromString(stock(LOGS[0])[0][0].data)
    own = files.file.add(
        name="osi_sensordata.proto", package="osi3", dependency=["osi_common.proto", "osi_sensorview.proto"]
    )
    for name, fields in PERCEIVED.items():
        message = own.message_type.add(name=name)
        for field, (number, kind, *repeated) in fields.items():
            label = F.LABEL_REPEATED if repeated else F.LABEL_OPTIONAL
            of = {"type_name": f".osi3.{kind}"} if kind else {"type": F.TYPE_DOUBLE}
            message.field.add(name=field, number=number, label=label, **of)
    return message_factory.GetMessages(files.file)["osi3.SensorData"], files.SerializeToString()


def put(message, values, names=("x", "y", "z")):
    for name, value in zip(names, values, strict=True):
        setattr(message, name, value)


TURNS, SIDES = ("yaw", "pitch", "roll"), ("length", "width", "height")


def homogeneous(place, angles):
    matrix = np.eye(4)
    matrix[:3, :3] = Rotation.from_euler("ZYX"[: np.size(angles)], angles).as_matrix()
    matrix[:3, 3] = place
    return matrix


def test_what_a_moving_sensor_perceives_arrives_in_the_world(tmp_path):
    kind, definition = sensor_data_class()
    rear, mount, mounted = [-1.4, 0.0, -0.3], [3.6, 0.5, 0.4], [0.3, 0.02, -0.01]
    cars = np.array([[50.0, 5.0, 0.5], [-20.0, 8.0, 0.5]])
    velocity = np.array([[-6.0, 2.0, 0.0], [0.0, 9.0, 0.0]])
    sent = []
    for k in range(N):
        message = kind()
        message.timestamp.seconds, message.last_measurement_time.nanos = 1000 + k, k * STEP_NS % 10**9
        message.last_measurement_time.seconds = k * STEP_NS // 10**9
        put(message.mounting_position.position, mount)
        put(message.mounting_position.orientation, mounted, TURNS)
        place, angles = [10.0 + k, 0.1 * k * k, 0.7], [0.2 * k, 0.03, -0.02]
        truth = message.sensor_view.add().global_ground_truth
        truth.host_vehicle_id.value = 77
        other, host = truth.moving_object.add(), truth.moving_object.add()
        other.id.value, host.id.value = 3, 77
        put(host.base.position, place)
        put(host.base.orientation, angles, TURNS)
        put(host.vehicle_attributes.bbcenter_to_rear, rear)
        vehicle = homogeneous(place, angles) @ homogeneous(rear, 0.0)
        back = np.linalg.inv(vehicle @ homogeneous(mount, mounted))
        body = Rotation.from_matrix(back[:3, :3]) * Rotation.from_euler("Z", HEADING)
        for i in range(2):
            seen = message.moving_object.add()
            seen.header.tracking_id.value = i
            put(seen.base.position, (back @ [*(cars[i] + velocity[i] * k * 0.1), 1.0])[:3])
        first = message.moving_object[0].base
        put(first.orientation, body.as_euler("ZYX"), TURNS)  # the other's is not set, nor is its size
        put(message.moving_object[0].base_rmse.position, [0.5, 0.2, 0.1])
        message.moving_object[0].header.existence_probability = 0.25
        put(first.dimension, [4.25, 1.875, 1.5], SIDES)
        message.moving_object.add().header.tracking_id.value = 9  # not placed, so no object
        if k == 4:
            truth.host_vehicle_id.value = 5
        sent.append(("/sensor", k * STEP_NS, message.SerializeToString()))
    write_log(tmp_path / "log.mcap", sent, ("osi3.SensorData", "protobuf", definition), "protobuf")
    log = read_track_logs(tmp_path / "log.mcap", time_source="header")
    assert log.losses.dropped[UNDECODABLE] == 1
    assert "without the host vehicle" in str(log.losses)
    np.testing.assert_allclose(log.tracks.heading[log.tracks.track_id == 0], HEADING, atol=1e-9)
    assert np.isnan(log.tracks.heading[log.tracks.track_id == 1]).all()
    for i, size in enumerate(([4.25, 1.875, 1.5], [np.nan] * 3)):
        np.testing.assert_array_equal(log.tracks.size[log.tracks.track_id == i], [size] * (N - 1))
    when = np.delete(np.arange(N), 4)
    seen = detections(tmp_path / "log.mcap", time_source="header")
    assert np.isnan(seen.covariance[seen.track_id != "0"]).all()
    np.testing.assert_array_equal(seen.confidence, np.where(seen.track_id == "0", 0.25, np.nan))
    for k, covariance in zip(when, seen.covariance[seen.track_id == "0"], strict=True):
        turned = Rotation.from_euler("ZYX", [0.2 * k, 0.03, -0.02]) * Rotation.from_euler("ZYX", mounted)
        world = turned.as_matrix() @ np.diag([0.5, 0.2, 0.1]) ** 2 @ turned.as_matrix().T
        np.testing.assert_allclose(covariance, world[:2, :2])
    for i in range(2):
        track = log.tracks[log.tracks.track_id == i]
        assert track.time_ns.tolist() == (when * STEP_NS).tolist()
        np.testing.assert_allclose(track.position, (cars[i] + velocity[i] * when[:, None] * 0.1)[:, :2], atol=1e-9)
        np.testing.assert_allclose(track.speed, np.hypot(*velocity[i, :2]))


LOGS = [
    Path(__file__).parents[1] / "data" / "indicator_lights.mcap",
    *(DATA / "mcap_osi" / f"{name}.mcap" for name in (
        "testBrakeAndIndicatorLights", "MovingHostWithStopLine", "MovingHostWith3DModel", "disappearingVehicle",
        "omega_prime/osi_centerline_example")),
]  # fmt: skip
TURN = {"INDICATOR_STATE_LEFT": np.pi / 2, "INDICATOR_STATE_RIGHT": -np.pi / 2}


def name_of(message, field):
    """Of an enum's value."""
    return message.DESCRIPTOR.fields_by_name[field].enum_type.values_by_number[getattr(message, field)].name


@pytest.mark.parametrize("path", LOGS, ids=lambda path: path.stem)
def test_rows_labels_sizes_and_signals_are_what_the_stock_decoder_finds(path):
    if not path.exists():
        pytest.skip(f"real logs are not at {path.parent}")
    expected, place, velocity, labels = {}, {}, {}, Counter()
    with path.open("rb") as file:
        for schema, _, message, view in make_reader(file, decoder_factories=[DecoderFactory()]).iter_decoded_messages():
            truth = view if schema.name == "osi3.GroundTruth" else view.global_ground_truth
            for mover in truth.moving_object:
                of, base, name = mover.vehicle_classification, mover.base, mover.id.value
                kind = name_of(mover, "type")
                if kind == "TYPE_VEHICLE" and name_of(of, "type") not in ("TYPE_UNKNOWN", "TYPE_OTHER"):
                    kind = name_of(of, "type")
                labels[{"medium_car": "car"}.get(*[kind.removeprefix("TYPE_").lower()] * 2)] += 1
                size = [getattr(base.dimension, side) or np.nan for side in SIDES]
                turn = TURN.get(name_of(of.light_state, "indicator_state"), np.nan)
                at = truth.timestamp.seconds * 10**9 + truth.timestamp.nanos
                expected[at, str(name)] = [*size, turn, 2.5 + 0 * turn]
                place[message.log_time, name] = base.position.x, base.position.y
                moves = base.velocity if base.HasField("velocity") else None
                velocity[message.log_time, name] = (moves.x, moves.y) if moves else (np.nan, np.nan)
    summary = inspect(path)
    assert summary.labels == {summary.topics[0].name: labels}
    assert summary.topics[0].tracks == len({name for _, name in place})
    seen = detections(path)
    found = np.column_stack([np.broadcast_to(seen.size, (len(seen), 3)), np.broadcast_to(seen.cue, (len(seen), 2))])
    for time_ns, name, row in zip(seen.time_ns.tolist(), seen.track_id.tolist(), found, strict=True):
        np.testing.assert_array_equal(row, expected[time_ns, name])
    tracks = read_tracks(path, time_source="log")
    keys = list(zip(tracks.time_ns.tolist(), tracks.track_id.tolist(), strict=True))
    assert sorted(keys) == sorted(place)
    np.testing.assert_array_equal(tracks.position, [place[key] for key in keys])
    reported = np.array([velocity[key] for key in keys])
    if np.isfinite(reported).all():
        own = tracks.speed[:, None] * np.stack([np.cos(tracks.direction), np.sin(tracks.direction)], -1)
        np.testing.assert_allclose(own, reported, atol=1e-2)
