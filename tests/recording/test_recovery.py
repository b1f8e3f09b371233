"""A recovered log is whole by the stock reader, and holds what the scan reads of the broken one."""

import io

import pytest
from mcap.reader import make_reader
from mcap.stream_reader import StreamReader
from mcap.writer import Writer
from mcap_files import CHUNK, DATA, log_bytes, records

from dirprim_filter.cli.main import run
from dirprim_filter.recording.container.recovery import recover
from dirprim_filter.recording.errors import NotMcapError
from dirprim_filter.recording.scan import scan

SENT = [(f"/topic{i % 3}", 1000 * i, str(i).encode() * 9) for i in range(200)]


def stock(path):
    with path.open("rb") as file:
        return sorted(
            (c.topic, m.log_time, m.publish_time, m.sequence, m.data, s.name if s else "", s.data if s else b"")
            for s, c, m in make_reader(file, validate_crcs=True).iter_messages()
        )


def streamed(path):
    """Every record, chunks opened, all checksums held."""
    with path.open("rb") as file:
        return list(StreamReader(file, validate_crcs=True).records)


def scanned(path):
    with scan(path) as log:
        rows = sorted(
            (m.topic, m.log_time_ns, m.publish_time_ns, m.sequence, m.data, m.schema_name, m.channel.schema.data)
            for m in log
        )
        return rows, log.damage


def test_the_summary_tells_what_is_there(tmp_path):
    buffer = io.BytesIO()
    writer = Writer(buffer, chunk_size=300)
    writer.start("ros2", "someone")
    writer.add_metadata("scene", {"weather": "rain"})
    channel = writer.register_channel("/a", "json", 0, {"qos": "1"})
    for i in range(100):
        writer.add_message(channel, 50 + i, b"{}" * 20, i, i)
    writer.add_attachment(1, 2, "notes.txt", "text/plain", b"hello")
    writer.finish()
    (tmp_path / "a.mcap").write_bytes(buffer.getvalue())
    recover(tmp_path / "a.mcap", tmp_path / "b.mcap")
    with (tmp_path / "b.mcap").open("rb") as file:
        reader = make_reader(file, validate_crcs=True)
        old = make_reader(io.BytesIO(buffer.getvalue()))
        reported, before = reader.get_summary(), old.get_summary()
        assert reader.get_header() == old.get_header()
        assert [(a.name, a.data) for a in reader.iter_attachments()] == [("notes.txt", b"hello")]
        assert [(m.name, m.metadata) for m in reader.iter_metadata()] == [("scene", {"weather": "rain"})]
    assert reported.statistics == before.statistics
    assert reported.channels == before.channels
    spans = [[(c.message_start_time, c.message_end_time) for c in s.chunk_indexes] for s in (reported, before)]
    assert spans[0] == spans[1]


def test_ids_that_mean_one_thing_here_and_another_there(tmp_path):
    """Two logs in one file: the same ids, other topics."""
    one, two = log_bytes(SENT[:50]), log_bytes([(f"/other{t}", time, data) for t, time, data in SENT[50:90]])
    tail = records(one)[-1][1]
    data_end = next(start for opcode, start, _ in records(one) if opcode == 0x0F)
    (chunk,) = (two[start:end] for opcode, start, end in records(two) if opcode == CHUNK)
    (tmp_path / "a.mcap").write_bytes(one[:data_end] + chunk + one[data_end:tail])
    recover(tmp_path / "a.mcap", tmp_path / "b.mcap")
    assert stock(tmp_path / "b.mcap") == scanned(tmp_path / "a.mcap")[0]
    assert len({row[0] for row in stock(tmp_path / "b.mcap")}) == 6


def test_real_logs_broken_on_purpose(tmp_path):
    paths = sorted((DATA / "mcap_damaged").glob("*.mcap"))
    if not paths:
        pytest.skip(f"damaged logs are not at {DATA}")
    for path in paths:
        if path.name == "osi_zero_bytes.mcap":
            with pytest.raises(NotMcapError):
                recover(path, tmp_path / path.name)
            continue
        recovery = recover(path, tmp_path / path.name)
        rows, damage = scanned(path)
        assert stock(tmp_path / path.name) == rows
        assert recovery.damage == tuple(damage) != ()


def test_conformance_files_stay_what_they_are(tmp_path):
    paths = sorted(p for p in (DATA / "mcap_conformance").glob("*/*.mcap") if p.parent.name != "old_history")
    if not paths:
        pytest.skip(f"conformance files are not at {DATA}")
    for path in paths[::5]:  # each is written to the disk for good, which takes its time
        recovery = recover(path, tmp_path / "b.mcap", force=True)
        assert recovery.damage == (), path.name
        with scan(path) as before, scan(tmp_path / "b.mcap") as after:
            assert list(after) == list(before), path.name
            assert after.metadata == before.metadata
            assert list(after.attachments()) == list(before.attachments())
            assert after.damage == []
        streamed(tmp_path / "b.mcap")


def test_the_command_tells_what_was_lost_and_exits_with_3(tmp_path, capsys):
    data = bytearray(log_bytes(SENT, chunk_size=1000))
    data[[start for opcode, start, _ in records(bytes(data)) if opcode == CHUNK][1] + 70] ^= 1
    broken, fixed = tmp_path / "a.mcap", tmp_path / "b.mcap"
    broken.write_bytes(data)
    assert run(["recover", str(broken), "-o", str(fixed)]) == 3
    n = len(stock(fixed))
    reported = capsys.readouterr().out
    assert f"{fixed}: {n} messages saved" in reported
    assert f"lost: {len(SENT) - n} messages" in reported
    assert "damage: chunk_data at byte" in reported
    assert run(["recover", str(fixed), "-o", str(tmp_path / "c.mcap")]) == 0
    assert "nothing was damaged" in capsys.readouterr().out


def test_a_flipped_topic_outside_of_chunks_is_put_right_by_the_summary(tmp_path):
    """Nothing but the summary's checksum protects it."""
    data = bytearray(log_bytes(SENT, use_chunking=False))
    data[data.index(b"/topic1") + 1] ^= 1
    (tmp_path / "a.mcap").write_bytes(data)
    log = scan(tmp_path / "a.mcap")
    assert [(m.topic, m.log_time_ns, m.data) for m in log] == SENT
    assert [(damage.kind, damage.messages) for damage in log.damage] == [("definition", 0)]
