"""MCAP files for tests, written by the stock writer and pulled apart record by record."""

import io
import json
import struct
from functools import cache
from pathlib import Path

import numpy as np
import pytest
from foxglove_schemas_protobuf.FrameTransform_pb2 import FrameTransform
from foxglove_schemas_protobuf.SceneUpdate_pb2 import SceneUpdate
from mcap.reader import make_reader
from mcap.writer import Writer
from mcap_protobuf.schema import build_file_descriptor_set

from dirprim_filter.detections import Detections
from dirprim_filter.recording.container.message_columns import MessageColumns
from dirprim_filter.recording.reader import stream_detections

DATA = Path(__file__).parents[2] / "../shared/data"
RECORD = struct.Struct("<BQ")
MESSAGE, CHUNK = 5, 6


def shared(*patterns):
    """The files that lie beside the repository; without them the test is skipped."""
    found = sorted(path for pattern in patterns for path in DATA.glob(pattern))
    return found or pytest.skip(f"{patterns[0]} is not at {DATA}")


def log_bytes(messages, **options):
    """A log of (topic, log time, data); publish time is log time + 1, sequence counts all messages."""
    blob, buffer = ("Blob", "none", b"definition"), io.BytesIO()
    write_into(buffer, ((*one, blob, one[1] + 1, i) for i, one in enumerate(messages)), "blob", **options)
    return buffer.getvalue()


def write_into(file, messages, encoding, **options):
    """(topic, log time, data, schema), and publish time and sequence if these are not log time and 0."""
    writer = Writer(file, **options)
    writer.start()
    schemas, channels = {}, {}
    for topic, time_ns, data, schema, *more in messages:
        if topic not in channels:
            schemas[schema] = schemas.get(schema) or writer.register_schema(*schema)
            channels[topic] = writer.register_channel(topic, encoding, schemas[schema])
        writer.add_message(channels[topic], time_ns, data, *more or [time_ns])
    writer.finish()


def records(data):
    """(opcode, start, end) of each record of an intact file."""
    at, found = 8, []
    while at < len(data) - 8:
        opcode, length = RECORD.unpack_from(data, at)
        found.append((opcode, at, at + RECORD.size + length))
        at = found[-1][2]
    return found


def rows(log):
    """(topic, log time, data) of each message."""
    return [(m.topic, m.log_time_ns, m.data) for m in log]


def stock(path, topics=None):
    """(schema, channel, message) by the stock reader, checksums held."""
    with path.open("rb") as file:
        return list(make_reader(file, validate_crcs=True).iter_messages(topics=topics))


def scene(objects, stamp_s=0):
    """A scene by the nuScenes convention: an entity with one cube for each (id, x, y)."""
    update = SceneUpdate()
    for name, x, y in objects:
        entity = update.entities.add(id=name, frame_id="map")
        entity.timestamp.seconds = stamp_s
        cube = entity.cubes.add()
        cube.pose.position.x, cube.pose.position.y, cube.pose.position.z = x, y, 1.0
        cube.pose.orientation.w = 1.0
    return update


@cache
def protobuf_schema(kind):
    """Name, encoding and definition of a message's schema."""
    return kind.DESCRIPTOR.full_name, "protobuf", build_file_descriptor_set(kind).SerializeToString()


def write_protobuf_log(path, messages, **options):
    """A log of (topic, log time, protobuf message or raw bytes of a SceneUpdate) by the stock writer."""

    def parts():
        for topic, time_ns, message in messages:
            kind = SceneUpdate if isinstance(message, bytes) else type(message)
            data = message if isinstance(message, bytes) else message.SerializeToString()
            yield topic, time_ns, data, protobuf_schema(kind)

    return write_messages(path, parts(), "protobuf", **options)


def write_log(path, messages, schema, encoding, **options):
    """A log of (topic, log time, data) of one schema: name, encoding of the definition, and the definition."""
    return write_messages(path, ((*message, schema) for message in messages), encoding, **options)


def json_log(path, schema, messages, topic="/objects"):
    """A log of (log time, message) in JSON on a topic."""
    sent = ((topic, time_ns, json.dumps(message).encode()) for time_ns, message in messages)
    return write_log(path, sent, (schema, "jsonschema", b'{"type": "object"}'), "json")


def write_messages(path, messages, encoding, **options):
    """A log of (topic, log time, data, schema)."""
    with path.open("wb") as file:
        write_into(file, messages, encoding, **options)
    return path


def transform(parent, child, *, time_ns=None, place=(0.0, 0.0, 0.0), turn=(0.0, 0.0, 0.0, 1.0)):
    """One of Foxglove's; its turn is a quaternion, w last."""
    one = FrameTransform(parent_frame_id=parent, child_frame_id=child)
    if time_ns is not None:
        one.timestamp.FromNanoseconds(time_ns)
    one.translation.x, one.translation.y, one.translation.z = place
    one.rotation.x, one.rotation.y, one.rotation.z, one.rotation.w = turn
    return one


def run(plan, payloads):
    """The columns that a plan finds in messages."""
    messages = columns_of(None, payloads)
    return plan.read(np.frombuffer(messages.contents, np.uint8), messages.start, messages.stop)


def columns_of(channel, payloads):
    """Messages of one channel that stand in no file, at times 0, 1, ..."""
    n, length = len(payloads), np.array([len(payload) for payload in payloads], np.int64)
    stop, times = np.cumsum(length), np.arange(n, dtype=np.uint64)
    return MessageColumns(
        log_time_ns=times, publish_time_ns=times, sequence=np.zeros(n, np.uint32), channel=np.zeros(n, np.int32),
        position=np.zeros(n, np.int32),
        start=stop - length, stop=stop, contents=b"".join(payloads), channels=[channel],
    )  # fmt: skip


def detections(path, **options):
    """All that a log or a table brings to a tracker, in one."""
    return Detections.concatenate(stream_detections(path, **options))
