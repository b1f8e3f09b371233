"""Damage is reported, all that is intact is delivered, and what is recovered is whole by the stock reader."""

import struct

import numpy as np
import pytest
from mcap.reader import make_reader
from mcap.stream_reader import StreamReader
from mcap.writer import CompressionType
from mcap_files import CHUNK, log_bytes, records, rows, shared, stock
from mutations import check, check_recovery, mutated, subjects

from dirprim_filter.cli.main import run
from dirprim_filter.recording.container.recovery import recover
from dirprim_filter.recording.errors import DamagedRecordingError
from dirprim_filter.recording.reader import read_tracks
from dirprim_filter.recording.scan import scan

SENT = [(f"/topic{i % 3}", 1000 * i, str(i).encode() * 9) for i in range(200)]
# Messages of 91 that each must deliver, and the damage it must report.
DAMAGED = {
    "osi_bad_magic": (91, "magic"),
    "osi_chunk_bitflip": (0, "chunk_data"),
    "osi_chunk_crc_wrong": (0, "chunk_crc"),
    "osi_chunk_size_huge": (91, "chunk_header"),
    "osi_cut_after_dataend": (91, "truncated"),
    "osi_cut_before_dataend": (91, "truncated"),
    "osi_footer_summary_crc_wrong": (91, "summary"),
    "osi_footer_summary_past_end": (91, "summary"),
    "osi_no_footer_magic": (91, "magic"),
    "osi_opcode_zero": (91, "record"),
    "osi_private_record_inserted": (91, "summary"),
    "osi_record_len_huge": (91, "record"),
    "osi_trunc_10pct": (0, "truncated"),  # its only chunk starts with a message of 691 kB
    "osi_trunc_50pct": (0, "truncated"),
    "osi_trunc_90pct": (0, "truncated"),
}


def read(tmp_path, data):
    path = tmp_path / "damaged.mcap"
    path.write_bytes(data)
    log = scan(path)
    return rows(log), [damage.kind for damage in log.damage]


@pytest.mark.parametrize("name", DAMAGED)
def test_a_real_log_broken_on_purpose_is_read_and_recovered_as_far_as_it_is_intact(tmp_path, name):
    (path,) = shared(f"mcap_damaged/{name}.mcap")
    intact = list(scan(*shared("mcap_osi/omega_prime/osi_centerline_example.mcap")))
    n, kind = DAMAGED[name]
    log = scan(path)
    assert list(log) == intact[:n]
    assert [damage.kind for damage in log.damage] == [kind]
    with pytest.raises(DamagedRecordingError, match=f"{name}.*{kind}"):
        read_tracks(path, strict=True)
    assert check_recovery(path, tmp_path / "fixed.mcap").damage == tuple(log.damage)


@pytest.mark.parametrize("chunked", [True, False])
def test_a_log_cut_anywhere_delivers_all_that_stands_before_the_cut(tmp_path, chunked):
    layout = {"chunk_size": 700} if chunked else {"use_chunking": False}
    data = log_bytes(SENT, compression=CompressionType.NONE, **layout)
    in_order = [data.index(struct.pack("<QQ", time_ns, time_ns + 1)) for _, time_ns, _ in SENT]
    for cut in range(300, len(data), 997):
        got, kinds = read(tmp_path, data[:cut])
        whole = sum(at + 16 + len(payload) <= cut for at, (*_, payload) in zip(in_order, SENT, strict=True))
        assert got == SENT[:whole]
        assert kinds in (["truncated"], ["magic"])


def test_what_no_checksum_vouches_for_renames_no_topic(tmp_path):
    """A flip in a summary whose footer is cut off: the chunk that is read last, whose checksum holds, says the name."""
    data = bytearray(log_bytes(SENT[::-1], chunk_size=1000))
    data[data.rindex(b"/topic1")] = ord("-")
    assert read(tmp_path, data)[1] == ["summary"]
    for cut in (60, 30):  # in the summary offsets, in the footer
        got, kinds = read(tmp_path, data[:-cut])
        assert "truncated" in kinds
        assert got == SENT


LOGS = subjects(np.random.default_rng(0))
ROUNDS = 50


@pytest.mark.parametrize("whole", LOGS, ids=lambda whole: whole.name)
def test_what_is_intact_is_delivered_and_what_is_lost_is_reported(whole, tmp_path):
    path, fixed = tmp_path / "broken.mcap", tmp_path / "fixed.mcap"
    noticed = 0
    for i in range(ROUNDS):
        data, done = mutated(whole.data, np.random.default_rng([i, 7]))
        try:
            noticed += check(whole, data, path)
            if i % 6 == 0:
                check_recovery(path, fixed)
        except AssertionError as error:
            raise AssertionError(f"round {i}, {done}") from error
    assert noticed > 0.8 * ROUNDS  # a byte of an index, or of padding, may change unnoticed: nothing hangs on it


def described(path):
    """What the stock reader finds around the messages."""
    with path.open("rb") as file:
        reader = make_reader(file, validate_crcs=True)
        summary, beside = reader.get_summary(), [*reader.iter_attachments(), *reader.iter_metadata()]
        spans = [(index.message_start_time, index.message_end_time) for index in summary.chunk_indexes]
        return reader.get_header(), summary.statistics, summary.channels, beside, spans


def test_a_whole_log_keeps_its_header_summary_attachments_and_metadata(tmp_path):
    (tmp_path / "a.mcap").write_bytes(LOGS[-1].data)
    recover(tmp_path / "a.mcap", tmp_path / "b.mcap")
    found = described(tmp_path / "b.mcap")
    assert found == described(tmp_path / "a.mcap")
    assert [len(found[3]), len(found[4]) > 1] == [2, True]


def test_an_attachment_whose_checksum_does_not_hold_is_damage(tmp_path):
    data = bytearray(LOGS[-1].data)
    data[data.index(b"notes.txt") + 100] ^= 1
    got, kinds = read(tmp_path, data)
    assert (len(got), kinds) == (LOGS[-1].messages.total(), ["attachment"])


def test_ids_that_mean_one_thing_here_and_another_there(tmp_path):
    """Two logs in one file: the same ids, other topics."""
    one, two = log_bytes(SENT[:50]), log_bytes([(f"/other{t}", time, data) for t, time, data in SENT[50:90]])
    tail = records(one)[-1][1]
    data_end = next(start for opcode, start, _ in records(one) if opcode == 0x0F)
    (chunk,) = (two[start:end] for opcode, start, end in records(two) if opcode == CHUNK)
    (tmp_path / "a.mcap").write_bytes(one[:data_end] + chunk + one[data_end:tail])
    check_recovery(tmp_path / "a.mcap", tmp_path / "b.mcap")
    assert len({channel.topic for _, channel, _ in stock(tmp_path / "b.mcap")}) == 6


def test_conformance_files_stay_what_they_are(tmp_path):
    for path in shared("mcap_conformance/[!o]*/*.mcap")[::5]:  # each is written to the disk for good, in its time
        recovery = recover(path, tmp_path / "b.mcap", force=True)
        assert recovery.damage == (), path.name
        with scan(path) as before, scan(tmp_path / "b.mcap") as after:
            assert list(after) == list(before), path.name
            assert after.metadata == before.metadata
            assert list(after.attachments()) == list(before.attachments())
            assert after.damage == []
        with (tmp_path / "b.mcap").open("rb") as file:
            list(StreamReader(file, validate_crcs=True).records)  # chunks opened, all checksums held


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
    assert rows(log) == SENT
    assert [(damage.kind, damage.messages) for damage in log.damage] == [("definition", 0)]
