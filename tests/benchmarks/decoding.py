"""Messages to columns: our column plans beside the stock decoders, in one run.

Defends two decisions: wanted fields alone are read, by a program compiled from the log's definition, instead of
objects built by mcap-protobuf-support, mcap-ros2-support or rosbags; and rosbags parses the definitions.
Aims: protobuf at least 5 times the stock decoder, Autoware's TrackedObjects at least 300,000 objects/s.

    python tests/benchmarks/decoding.py
"""

from __future__ import annotations

import sys
import tempfile
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np

try:
    from foxglove_schemas_protobuf.PoseInFrame_pb2 import PoseInFrame
    from mcap.reader import make_reader
    from mcap.writer import Writer
    from mcap_protobuf.decoder import DecoderFactory as ProtobufDecoderFactory
    from mcap_protobuf.schema import build_file_descriptor_set
    from mcap_ros2.decoder import DecoderFactory as Ros2DecoderFactory
    from rosbags.typesys import Stores, get_types_from_msg, get_typestore
except ImportError as error:
    sys.exit(f"{error}: pip install -e '.[test]'")

sys.path.insert(0, str(Path(__file__).parents[1] / "recording"))
from ros_messages import full_definition, header, write_ros2_log

from dirprim_filter.recording.objects.observations import Observations
from dirprim_filter.recording.objects.options import ReadOptions
from dirprim_filter.recording.objects.tracks import rows_of_log
from dirprim_filter.recording.scan import scan
from dirprim_filter.recording.schemas.decoders import Decoders, batches, by_schema

N_POSES, N_FRAMES, N_OBJECTS = 200_000, 1500, 30
TRACKED = "autoware_perception_msgs/msg/TrackedObjects"
ROUNDS = 3


def write_poses(path: Path) -> Path:
    """Small messages of 50 topics."""
    with path.open("wb") as file:
        writer = Writer(file)
        writer.start()
        schema = writer.register_schema(
            "foxglove.PoseInFrame", "protobuf", build_file_descriptor_set(PoseInFrame).SerializeToString()
        )
        channels = [writer.register_channel(f"/pose{i}", "protobuf", schema) for i in range(50)]
        message = PoseInFrame(frame_id="map")
        message.pose.orientation.w = 1.0
        for i in range(N_POSES):
            message.timestamp.FromNanoseconds(1_700_000_000_000_000_000 + i * 1000)
            message.pose.position.x, message.pose.position.y = i * 0.01, -i * 0.02
            writer.add_message(channels[i % 50], i * 1000, message.SerializeToString(), i * 1000)
        writer.finish()
    return path


def xyz(x: float, y: float = 0.0, z: float = 0.0) -> dict[str, float]:
    """A vector."""
    return {"x": x, "y": y, "z": z}


def tracked(k: int, i: int) -> dict[str, Any]:
    """An Autoware object."""
    zeros = [0.0] * 36
    return {
        "object_id": {"uuid": [i] * 16}, "existence_probability": 0.5,
        "classification": [{"label": 1, "probability": 0.9}],
        "kinematics": {
            "pose_with_covariance": {
                "pose": {"position": xyz(i + 0.1 * k, i, 1.0), "orientation": {**xyz(0.0), "w": 1.0}},
                "covariance": zeros,
            },
            "orientation_availability": 2,
            "twist_with_covariance": {"twist": {"linear": xyz(5.0), "angular": xyz(0.0)}, "covariance": zeros},
            "acceleration_with_covariance": {"accel": {"linear": xyz(0.0), "angular": xyz(0.0)}, "covariance": zeros},
            "is_stationary": False,
        },
        "shape": {"type": 0, "footprint": {"points": []}, "dimensions": xyz(4.0, 2.0, 1.5)},
    }  # fmt: skip


def stock_poses(path: Path) -> int:
    """The stock reader and protobuf decoder."""
    rows = []
    with path.open("rb") as file:
        reader = make_reader(file, decoder_factories=[ProtobufDecoderFactory()])
        for _, channel, message, pose in reader.iter_decoded_messages():
            place = pose.pose.position
            rows.append((message.log_time, channel.topic, place.x, place.y))
    return np.array([row[2:] for row in rows]).shape[0]


def stock_tracked(path: Path) -> int:
    """The stock reader and ROS 2 decoder."""
    rows = []
    with path.open("rb") as file:
        for _, _, message, reported in make_reader(
            file, decoder_factories=[Ros2DecoderFactory()]
        ).iter_decoded_messages():
            rows += [_row(message.log_time, one) for one in reported.objects]
    return np.array([row[2:] for row in rows]).shape[0]


def rosbags_tracked(path: Path) -> int:
    """The stock reader and rosbags' decoder."""
    store = get_typestore(Stores.EMPTY)
    store.register(get_types_from_msg(full_definition(TRACKED.replace("/msg/", "/")), TRACKED))
    rows = []
    with path.open("rb") as file:
        for _, _, message in make_reader(file).iter_messages():
            reported: Any = store.deserialize_cdr(message.data, TRACKED)
            rows += [_row(message.log_time, one) for one in reported.objects]
    return np.array([row[2:] for row in rows]).shape[0]


def _row(time_ns: int, one: Any) -> tuple[Any, ...]:
    pose, twist = one.kinematics.pose_with_covariance.pose, one.kinematics.twist_with_covariance.twist
    q = pose.orientation
    return (
        time_ns,
        bytes(one.object_id.uuid),
        pose.position.x,
        pose.position.y,
        q.z,
        q.w,
        twist.linear.x,
        twist.linear.y,
    )


def ours(path: Path) -> int:
    """All that `read_tracks` does up to the columns."""
    with scan(path) as log:
        return int(rows_of_log(Observations(log, ReadOptions())).time_ns.size)


def plans_alone(path: Path) -> Callable[[], int]:
    """Our decoding without the scan: what the plans and the families cost."""
    decoders = Decoders()
    with scan(path) as log:
        groups = [messages for batch in batches(log.columns(), decoders) for _, messages in by_schema(batch)]
    return lambda: sum(len(decoders.rows(messages)[0]) for messages in groups)


def best(run: Callable[[], int]) -> float:
    """Objects a second of processor time: wall time on a busy machine measures the others."""
    run()
    rates = []
    for _ in range(ROUNDS):
        start = time.process_time()
        n = run()
        rates.append(n / (time.process_time() - start))
    return max(rates)


def main() -> None:
    """Print the table."""
    with tempfile.TemporaryDirectory() as folder:
        poses = write_poses(Path(folder) / "poses.mcap")
        frames = (
            {"header": header(k * 10**8), "objects": [tracked(k, i) for i in range(N_OBJECTS)]} for k in range(N_FRAMES)
        )
        reported = (("/objects", k * 10**8, TRACKED, frame) for k, frame in enumerate(frames))
        objects = write_ros2_log(Path(folder) / "objects.mcap", reported)
        table = [
            ("foxglove.PoseInFrame, protobuf", "mcap + mcap-protobuf-support", best(lambda: stock_poses(poses))),
            ("", "column plan, scan and all", best(lambda: ours(poses))),
            ("", "column plan alone", best(plans_alone(poses))),
            ("Autoware TrackedObjects, CDR", "mcap + mcap-ros2-support", best(lambda: stock_tracked(objects))),
            ("", "mcap + rosbags", best(lambda: rosbags_tracked(objects))),
            ("", "column plan, scan and all", best(lambda: ours(objects))),
            ("", "column plan alone", best(plans_alone(objects))),
        ]
    print(f"{'messages':32}{'decoder':32}{'objects/s of processor time':>28}{'x stock':>9}")
    stock = 1.0
    for what, how, rate in table:
        stock = rate if what else stock
        print(f"{what:32}{how:32}{rate:28,.0f}{rate / stock:9.1f}")


if __name__ == "__main__":
    main()
