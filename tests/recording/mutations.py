"""Logs broken at random, and what must be true of what is read from them.

Shared by a test, which runs a few rounds, and `tests/benchmarks/fuzz.py`, which runs thousands.
"""

from __future__ import annotations

import io
from collections import Counter
from typing import NamedTuple

from mcap.records import Channel, Message
from mcap.stream_reader import StreamReader, breakup_chunk
from mcap.writer import CompressionType, Writer
from mcap_files import CHUNK, log_bytes, records, stock

from dirprim_filter.recording.container.recovery import recover
from dirprim_filter.recording.errors import NotMcapError
from dirprim_filter.recording.scan import scan

KINDS = ("truncate", "flip", "zero", "splice", "grow")


class Subject(NamedTuple):
    """A whole log: its bytes, and its chunks with their messages (topic, log time, data)."""

    name: str
    data: bytes
    chunks: list[tuple[bytes, Counter]]

    @property
    def messages(self):
        return sum((messages for _, messages in self.chunks), Counter())


def subject(name, data):
    chunks, topics = [], {}
    for stored in (data[start:end] for opcode, start, end in records(data) if opcode == CHUNK):
        whole = next(StreamReader(io.BytesIO(stored), skip_magic=True, emit_chunks=True).records)
        inside = breakup_chunk(whole)
        topics |= {one.id: one.topic for one in inside if isinstance(one, Channel)}
        sent = [one for one in inside if isinstance(one, Message)]
        chunks.append((stored, Counter((topics[one.channel_id], one.log_time, one.data) for one in sent)))
    return Subject(name, data, chunks)


def subjects(rng):
    """Three logs: small chunks with a channel each; overlapping in time, lz4; attachments, metadata, checksums."""
    plain = [(f"/topic{i % 3}", 1000 * i, rng.bytes(int(rng.integers(1, 60)))) for i in range(300)]
    jumping = [(f"/t{i % 5}", int(rng.integers(0, 200_000)), rng.bytes(40)) for i in range(300)]
    buffer = io.BytesIO()
    writer = Writer(buffer, compression=CompressionType.NONE, chunk_size=1500, enable_data_crcs=True)
    writer.start("ros2", "someone")
    writer.add_metadata("made", {"by": "the fuzzer"})
    schemas = [writer.register_schema("Blob", "none", b"definition"), 0]
    channels = [writer.register_channel(f"/a{i}", "blob", schema, {"qos": "1"}) for i, schema in enumerate(schemas)]
    for i in range(200):
        writer.add_message(channels[i % 2], 10 * i, rng.bytes(30), i, i)
        if i == 100:
            writer.add_attachment(1, 2, "notes.txt", "text/plain", rng.bytes(500))
    writer.finish()
    return [
        subject("zstd", log_bytes(plain, chunk_size=900)),
        subject("lz4, overlapping", log_bytes(jumping, compression=CompressionType.LZ4, chunk_size=1200)),
        subject("uncompressed, attached", buffer.getvalue()),
    ]


def mutated(data, rng):
    """The log with one to three places broken. -> its bytes, and what was done."""
    data = bytearray(data)
    done = []
    starts = [start for _, start, _ in records(bytes(data))]
    for _ in range(int(rng.integers(1, 4))):
        kind = KINDS[int(rng.integers(0, len(KINDS)))]
        at = int(rng.integers(0, max(len(data), 1)))
        done.append(kind)
        if kind == "truncate":
            del data[at:]
        elif kind == "flip" and data:
            data[min(at, len(data) - 1)] ^= 1 << int(rng.integers(0, 8))
        elif kind == "zero":
            n = int(rng.integers(1, 400))
            data[at : at + n] = bytes(len(data[at : at + n]))
        elif kind == "splice":
            source = int(rng.integers(0, max(len(data), 1)))
            piece = bytes(data[source : source + int(rng.integers(1, 3000))])
            data[at : at + int(rng.integers(0, 3000))] = piece
        elif kind == "grow":
            at = starts[int(rng.integers(0, len(starts)))] + int(rng.choice([1, 9 + 16, 9 + 32, 9 + 2]))
            if at + 8 <= len(data):
                n = int.from_bytes(data[at : at + 8], "little") + int(rng.choice([1, 300, 5000, 1 << 33, 1 << 62]))
                data[at : at + 8] = (n % (1 << 64)).to_bytes(8, "little")
    return bytes(data), done


def check(whole, data, path):
    """Read a broken log and hold what was read against what is still there. -> whether damage was reported."""
    path.write_bytes(data)
    try:
        log = scan(path)
    except NotMcapError:
        assert data[:5] != whole.data[:5], "a log that starts like one is refused"
        return True
    with log:
        got = Counter((m.topic, m.log_time_ns, m.data) for m in log)
        kinds = {damage.kind for damage in log.damage}
    if got != whole.messages:
        assert kinds, "messages were lost, or came twice, without a word"
    named = "summary" not in kinds  # a broken summary may be all that is left to name a topic by
    if not kinds & {"truncated", "unknown_channel", "data_crc"}:  # what has no checksum, or a wrong one, may be wrong
        assert set(_reported(got, named)) <= set(_reported(whole.messages, named)), f"messages were invented: {kinds}"
    if "unknown_channel" not in kinds:
        for chunk, messages in whole.chunks:
            if chunk in data:
                intact = _reported(messages, named)
                assert intact <= _reported(got, named), (
                    f"an intact chunk of {messages.total()} messages is missing: {kinds}"
                )
    return bool(kinds)


def _reported(messages, named):
    """The messages as they are compared: with or without their topic."""
    return messages if named else Counter(key[1:] for key in messages.elements())


def check_recovery(path, fixed):
    """What is recovered passes the stock reader with checksums, and is what the scan reads. -> what was done."""
    try:
        recovery = recover(path, fixed, force=True)
    except NotMcapError:
        return None
    expected, _ = _scanned(path)
    assert Counter(
        (c.topic, m.log_time, m.publish_time, m.sequence, m.data, s.name if s else "", s.data if s else b"")
        for s, c, m in stock(fixed)
    ) == expected  # fmt: skip
    assert recovery.saved == expected.total()
    assert _scanned(fixed) == (expected, [])
    return recovery


def _scanned(path):
    """Its messages with their definitions, and its damage."""
    with scan(path) as log:
        return Counter(
            (m.topic, m.log_time_ns, m.publish_time_ns, m.sequence, m.data, m.schema_name, m.channel.schema.data)
            for m in log
        ), log.damage  # fmt: skip
