"""The scan against the stock writer and reader, and against the MCAP project's own conformance files."""

import io
import json
import sys

import numpy as np
import pytest
from mcap.writer import CompressionType, IndexType
from mcap_files import CHUNK, log_bytes, records, rows, shared, stock

from dirprim_filter.recording.container import file_bytes
from dirprim_filter.recording.scan import scan

LAYOUTS = [
    {"compression": CompressionType.ZSTD, "chunk_size": 400},
    {"compression": CompressionType.LZ4, "chunk_size": 400},
    {"compression": CompressionType.NONE, "chunk_size": 400, "enable_data_crcs": True},
    {"compression": CompressionType.ZSTD, "chunk_size": 400, "enable_crcs": False},
    {"compression": CompressionType.ZSTD, "chunk_size": 400, "index_types": IndexType.NONE},
    {"compression": CompressionType.ZSTD, "chunk_size": 400, "repeat_channels": False, "repeat_schemas": False},
    {"compression": CompressionType.NONE, "use_chunking": False, "enable_data_crcs": True},
]
CRC_AT = 1 + 8 + 3 * 8
"""Of a chunk's record: behind the opcode, the length, two times and a size."""


def jittered(n=300):
    """Messages whose times go back and forth over several chunks, some of them equal."""
    rng = np.random.default_rng(7)
    times = 1_000_000 + np.arange(n) // 2 * 10 + rng.integers(0, 200, n)
    return [(f"/topic{i % 3}", int(time), bytes([i % 251]) * int(rng.integers(0, 60))) for i, time in enumerate(times)]


@pytest.mark.parametrize("layout", LAYOUTS)
def test_delivers_all_messages_in_stable_order_of_log_time_to_each_of_several_iterations_at_once(log_file, layout):
    """Begun, left and taken up in turn, and one within another; a channel's index differs from one to the other."""
    sent = jittered()
    log = scan(path := log_file(log_bytes(sent, **layout)))
    assert sorted(channel.topic for channel in log.channels()) == ["/topic0", "/topic1", "/topic2"]
    expected = sorted(enumerate(sent), key=lambda item: item[1][1])
    parts, got = log.parts(), []
    for k, both in enumerate(zip(log, log, strict=True)):
        got.append(both)
        if k % 40 == 7:
            next(parts, None)
            next(iter(log))
    for one in zip(*got, strict=True):
        assert [(m.sequence, (m.topic, m.log_time_ns, m.data)) for m in one] == expected
    assert log.damage == []
    assert all(m.publish_time_ns == m.log_time_ns + 1 for m in log)
    message = next(iter(log))
    schema = message.channel.schema
    assert (message.schema_name, message.message_encoding) == ("Blob", "blob")
    assert (schema.encoding, schema.data) == ("none", b"definition")
    assert list(scan(path, topics=lambda topic: topic == "/topic1")) == [m for m in log if m.topic == "/topic1"]


@pytest.mark.parametrize("compression", list(CompressionType))
def test_a_chunk_is_lost_where_its_checksum_does_not_hold_and_not_where_its_size_is_wrong(log_file, compression):
    """All else reads as it was written; damage is that of the iteration begun last."""
    whole = log_bytes(sent := jittered(), compression=compression, chunk_size=400)
    second = [start for opcode, start, _ in records(whole) if opcode == CHUNK][1] + CRC_AT
    log = scan(log_file(whole[:second] + bytes([whole[second] ^ 1]) + whole[second + 1 :]))
    assert log.damage == []
    first = iter(log)
    kept = {message.sequence for message in log}
    assert {message.sequence for message in first} == kept
    assert [damage.kind for damage in log.damage] == ["chunk_crc"]
    assert 0 < len(sent) - len(kept) < 30
    for size in (0, 7, 1 << 60):
        log = scan(log_file(whole[: second - 8] + size.to_bytes(8, "little") + whole[second:]))
        assert len(list(log)) == len(sent)
        assert [(damage.kind, damage.messages) for damage in log.damage] == [("chunk_header", 0)]


def test_equals_the_stock_reader_on_real_logs():
    for path in shared("mcap_osi/**/*.mcap", "mcap_rosbag2/**/*.mcap"):
        log = scan(path)
        got = [(m.log_time_ns, m.publish_time_ns, m.sequence, m.topic, m.data, m.schema_name) for m in log]
        assert log.damage == []
        assert sorted(got) == sorted(
            (m.log_time, m.publish_time, m.sequence, c.topic, m.data, s.name if s else "") for s, c, m in stock(path)
        )
        assert [row[0] for row in got] == sorted(row[0] for row in got)


def test_conformance_files_read_to_what_their_json_says_streamed_and_sought(monkeypatch):
    described = shared("mcap_conformance/[!o]*/*.json")
    assert len(described) == 416
    for path in described:
        log = scan(path.with_suffix(".mcap"))
        parts = json.loads(path.read_text())["records"]
        expected, metadata = _described(parts)
        attached = [dict(part["fields"]) for part in parts if part["type"] == "Attachment"]
        assert [(a.name, a.media_type, a.log_time, a.create_time, a.data) for a in log.attachments()] == [
            (a["name"], a["media_type"], int(a["log_time"]), int(a["create_time"]), bytes(map(int, a["data"])))
            for a in attached
        ], path.name
        monkeypatch.setattr(sys, "stdin", io.TextIOWrapper(io.BytesIO(path.with_suffix(".mcap").read_bytes())))
        sought = scan(path.with_suffix(".mcap"), start_ns=3, end_ns=7, topics=bool)
        middle = [row for row in expected if 3 <= row[0] < 7]
        for read, wanted in ((log, expected), (scan("-"), expected), (sought, middle)):
            assert [_as_row(message) for message in read] == wanted, path.name
        assert log.metadata == metadata, path.name
        assert log.damage == [], path.name


def test_files_of_older_writers_read_without_an_exception():
    for path in shared("mcap_conformance/old_history/*.mcap"):
        n_messages = len(list(scan(path)))
        assert n_messages == (10 if path.name.startswith("TenMessages") else 0), path.name


def _as_row(message):
    return (
        message.log_time_ns, message.publish_time_ns, message.sequence, message.topic, message.data,
        message.message_encoding, message.schema_name, message.channel.schema.encoding, message.channel.schema.data,
    )  # fmt: skip


def _described(parts):
    """What a reader must see: the messages in order of log time, and the metadata records."""
    schemas = {"0": {"name": "", "encoding": "", "data": []}}
    channels, rows, metadata = {}, [], []
    for part in parts:
        values = dict(part["fields"])
        if part["type"] == "Schema":
            schemas[values["id"]] = values
        elif part["type"] == "Channel":
            channels[values["id"]] = values
        elif part["type"] == "Metadata":
            metadata.append((values["name"], values["metadata"]))
        elif part["type"] == "Message":
            channel = channels[values["channel_id"]]
            schema = schemas[channel["schema_id"]]
            times = [int(values[name]) for name in ("log_time", "publish_time", "sequence")]
            rows.append((
                *times, channel["topic"], bytes(map(int, values["data"])), channel["message_encoding"],
                schema["name"], schema["encoding"], bytes(map(int, schema["data"])),
            ))  # fmt: skip
    return sorted(rows, key=lambda row: row[0]), metadata


@pytest.mark.parametrize("window", [16, 100, 1000, 1 << 16])
@pytest.mark.parametrize("layout", [{"chunk_size": 900}, {"chunk_size": 1 << 20}, {"use_chunking": False}])
def test_a_log_reads_alike_through_any_window(log_file, monkeypatch, window, layout):
    """Message indexes, runs of bare messages and chunks' headers that reach beyond what is held of the file."""
    monkeypatch.setattr(file_bytes, "WINDOW_BYTES", window)
    sent = [(f"/{i % 7}", i, bytes(i % 90)) for i in range(900)]
    log = scan(log_file(log_bytes(sent, **layout)))
    assert rows(log) == sent
    assert log.damage == []
