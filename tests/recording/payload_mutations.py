"""Messages, their definitions, transforms and tables, broken at random: nothing but what is broken is lost."""

from __future__ import annotations

import csv
import json
import re
from dataclasses import replace
from functools import cache
from typing import NamedTuple

import numpy as np
import pyarrow as pa
import pyarrow.parquet
import pytest
from foxglove_schemas_protobuf.FrameTransforms_pb2 import FrameTransforms
from foxglove_schemas_protobuf.SceneUpdate_pb2 import SceneUpdate
from google.protobuf.json_format import MessageToDict
from mcap_files import columns_of, protobuf_schema, scene, transform, write_log
from ros_messages import header, ros_transform, tf, write_ros2_log
from test_ros2_schemas import marker, tracked

from dirprim_filter.recording.container.log import Log
from dirprim_filter.recording.container.records import Channel, Schema
from dirprim_filter.recording.errors import RecordingError
from dirprim_filter.recording.losses import ALONE, UNDECODABLE
from dirprim_filter.recording.scan import scan
from dirprim_filter.recording.schemas.decoders import Decoders
from dirprim_filter.recording.tables import READERS
from dirprim_filter.recording.transforms.transform_tree import TransformTree

TAGS = (
    b"\xff" * 10, b"\x00" * 8, b"\x7f\xff\xff\xff", b"[" * 500, b'{"a":', b"1e999", b"-0", b'"\\ud800"', b"null", b"[]",
)  # fmt: skip
NUMBERS = tuple(b"%d" % n for n in (0, 1, 1 << 16, 1 << 24, (1 << 24) + 1, (1 << 32) - 1, (1 << 63) - 1, (1 << 64) + 1))
"""Lengths and bounds for a definition in text: at the edges of what is allowed, and beyond."""
TIMES = np.arange(0, 10**10, 10**9)


class Subject(NamedTuple):
    name: str
    channel: Channel
    payload: bytes


def subjects(folder):
    """A message of each encoding, and what it is read by."""
    update = a_scene()
    scenes, transforms = (
        Channel(topic="/t", message_encoding="protobuf", schema=schema_of(kind), metadata=())
        for kind in (SceneUpdate, FrameTransforms)
    )
    text = json.dumps(MessageToDict(update, preserving_proto_field_name=True)).encode()
    made = [
        Subject("protobuf", scenes, update.SerializeToString()),
        Subject("protobuf transforms", transforms, some_transforms().SerializeToString()),
        Subject("json", replace(scenes, message_encoding="json"), text),
    ]
    objects = {"header": header(0), "objects": [tracked(1, 0)] * 2}
    messages = [
        tf(0, *[ros_transform(10**9, "map", "car", (1, 2, 3), yaw=1.3)] * 3),
        ("/markers", 1, "visualization_msgs/msg/MarkerArray", {"markers": [marker(1, 1)] * 3}),
        ("/objects", 2, "autoware_perception_msgs/msg/TrackedObjects", objects),
    ]
    with scan(write_ros2_log(folder / "ros.mcap", messages)) as log:
        made += [Subject(f"cdr {m.topic}", m.channel, m.data) for m in log]
    return made


def schema_of(kind):
    name, encoding, definition = protobuf_schema(kind)
    return Schema(name=name, encoding=encoding, data=definition)


def a_scene():
    update = scene([(f"car {k}", float(k), -1.5) for k in range(3)], stamp_s=1)
    for entity in update.entities:
        entity.metadata.add(key="speed_mps", value="3.5")
        entity.cubes[0].size.x = 4.5
    return update


def some_transforms():
    frames = FrameTransforms()
    for k, (parent, child) in enumerate((("map", "car"), ("car", "lidar"), ("map", "pole"))):
        frames.transforms.append(transform(parent, child, time_ns=(k + 1) * 10**9, place=(float(k), 0.0, 0.0)))
    return frames


def broken(data, rng):
    """The bytes with one to four places broken."""
    data = bytearray(data)
    for _ in range(int(rng.integers(1, 5))):
        at, kind = int(rng.integers(0, len(data) + 1)), int(rng.integers(0, 6))
        if kind == 0:
            del data[at:]
        elif kind == 1 and at < len(data):
            data[at] ^= 1 << int(rng.integers(0, 8))
        elif kind == 2:
            data[at : at + int(rng.integers(1, 9))] = rng.bytes(int(rng.integers(0, 9)))
        elif kind == 3:
            data[at:at] = data[at : at + int(rng.integers(1, 200))]
        elif kind == 4:
            data[at : at + int(rng.integers(0, 5))] = TAGS[int(rng.integers(0, len(TAGS)))]
        else:
            del data[at : at + int(rng.integers(1, 40))]
    return bytes(data)


def renumbered(definition, rng):
    """A ROS 2 definition of which some fields are arrays, or arrays of other lengths."""

    def other(match):
        length = NUMBERS[int(rng.integers(len(NUMBERS)))]
        how = [b"%b", b"%b[%b]" % (b"%b", length), b"%b[]", b"%b[<=%b]" % (b"%b", length)]
        return b" ".join([how[int(rng.integers(4))] % match[1], match[2]]) if rng.random() < 0.2 else match[0]

    return re.sub(rb"(?m)^([A-Za-z_/0-9]+)(?:\[[^\]]*\])? ([a-z_0-9]+)$", other, definition)


@cache
def read_alone(subject):
    """What reads a subject, and its rows."""
    decoders = Decoders()
    return decoders, decoders.rows(columns_of(subject.channel, [subject.payload]))[0]


def check_payload(subject, rng):
    """A broken message between two whole ones: these read as alone. -> whether the broken one was refused."""
    decoders, whole = read_alone(subject)
    mixed = columns_of(subject.channel, [subject.payload, broken(subject.payload, rng), subject.payload])
    rows, failures = decoders.rows(mixed)
    assert set(failures) <= {1}, failures
    for message in (0, 2):
        own = rows[rows.message == message]
        assert own.track_id.tolist() == whole.track_id.tolist()
        np.testing.assert_array_equal(own.position, whole.position)
        np.testing.assert_array_equal(own.stamp_ns, whole.stamp_ns)
    assert (np.diff(rows.message) >= 0).all()
    return bool(failures)


def check_definition(subject, rng):
    """A broken definition is refused, or reads the message somehow. -> whether it was refused."""
    data = subject.channel.schema.data
    if subject.channel.message_encoding == "cdr" and rng.random() < 0.5:
        data = renumbered(data, rng)
    schema = replace(subject.channel.schema, data=broken(data, rng) if rng.random() < 0.7 else data)
    rows, failures = Decoders().rows(columns_of(replace(subject.channel, schema=schema), [subject.payload] * 2))
    assert all("\n" not in reason for reason in failures.values())
    assert len(rows) < 1000
    return bool(failures)


def check_transforms(rng, path, n):
    """Broken transforms behind whole ones in a log: what is placed is turned by a rotation. -> messages refused."""
    data = some_transforms().SerializeToString()
    sent = [("/tf", 10**9 * k, payload) for k, payload in enumerate([data, *(broken(data, rng) for _ in range(n))])]
    write_log(path, sent, protobuf_schema(FrameTransforms), "protobuf")
    with Log(path) as log:
        tree = TransformTree.of_log(log)
    assert {"car", "lidar", "pole"} <= tree.edges.keys()
    for frame in list(tree.edges)[:20]:
        with np.errstate(all="ignore"):  # as where objects are placed: what is not finite is left out there
            placed = tree.placement(frame, tree.root_of(frame), TIMES)
        turned = placed.rotation.as_matrix()[placed.known]
        np.testing.assert_allclose(np.linalg.det(turned), np.ones(len(turned)), atol=1e-9)
    return tree.losses.dropped[UNDECODABLE]


TABLE = b"time_s,track_id,x_m,y_m,course_rad,speed_mps,group,length_m,label,turn_signal\n" + b"".join(
    b"%d.5,%s,%d,-1.5,0.25,3,%d,4.5,car,\n" % (1_700_000_000 + k // 2, b"ab"[k % 2 : k % 2 + 1], k, k // 12)
    for k in range(24)
)
FCD = b"<fcd-export>" + b"".join(
    b'<timestep time="%d.0"><vehicle id="a" x="1" y="2" angle="90" speed="1"/></timestep>\n' % k for k in range(12)
)
LABELS = b"".join(b'7 %d 20 30 60 %d 0 0 0 "Cart"\n' % (k, k) for k in range(12))
WALKS = b"".join(b"%d 1.0 %d 2\n" % (10 * k, k) for k in range(12))
TABLES = {
    "csv": (TABLE, {}), "trajnet": (WALKS, {"frames_per_second": 25}), "sdd": (LABELS, {"metres_per_pixel": 0.1}),
    "sumo-fcd": (FCD + b"</fcd-export>", {}), "parquet": (b"", {}), "feather": (b"", {}),
}  # fmt: skip
"""Each format's whole table, and its reader's arguments; Arrow's are those of the csv's cells."""
CELLS = b"nan inf -inf 1e308 1e999 9e15 1_0 0x1 True - ' \" = 1970-01-01T00:00:00Z 9999-12-31T23:59:59 \xff 99".split()
TYPES = (pa.float64(), pa.float32(), pa.int64(), pa.string(), pa.decimal128(18, 2))


def broken_table(form, data, rng):
    """Broken bytes, or in half of the rounds cells that are others."""
    if rng.random() < 0.5:
        return broken(data, rng)
    parts = re.split(rb"([,\s;\"]+)", data)
    for _ in range(int(rng.integers(1, 4))):
        parts[2 * int(rng.integers(len(parts) // 2))] = CELLS[int(rng.integers(len(CELLS)))] * int(rng.integers(2))
    return b"".join(parts)


def check_table(form, path, rng):
    """A broken table is refused in one line, or each of its rows is read or counted. -> whether it was refused."""
    data, options = TABLES[form]
    if data:
        path.write_bytes(broken_table(form, data, rng))
    else:
        rows = [*csv.reader(TABLE.decode().splitlines())]
        made = {name: pa.array([*of]) for name, *of in zip(*rows, strict=True)}
        for name in ("x_m", "y_m", "speed_mps", "group"):
            numbers = pa.array([float(cell) for cell in made[name].to_pylist()])
            made[name] = numbers.cast(TYPES[int(rng.integers(len(TYPES)))], safe=False)
        write = pa.parquet.write_table if form == "parquet" else pa.feather.write_feather
        write(pa.table(made), path)
        path.write_bytes(broken(path.read_bytes(), rng) if rng.random() < 0.8 else path.read_bytes())
    try:
        table = READERS[form](path, **options)
    except RecordingError as error:
        return "\n" not in str(error) or pytest.fail(str(error))
    if form == "csv":
        with path.open(newline="", encoding="utf-8-sig") as text:
            delimiter = max(",;\t", key=text.readline().count)
            text.seek(0)
            n = sum(any(row) for row in csv.reader(text, delimiter=delimiter)) - 1
        seen = sum(map(len, table.detections.values()))
        dropped = {why: n for why, n in table.losses.dropped.items() if not seen or why.startswith("with a n")}
        assert (seen or len(table.tracks) + table.losses.notes[ALONE]) + sum(dropped.values()) == n
    return False
