"""Damage is reported, and all that is intact is delivered."""

import struct

import numpy as np
import pytest
from mcap.writer import CompressionType
from mcap_files import CHUNK, DATA, log_bytes, records

from dirprim_filter.recording.errors import DamagedRecordingError, NotMcapError
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
    got = [(m.topic, m.log_time_ns, m.data) for m in log]
    return got, [damage.kind for damage in log.damage], log.damage


def chunks(data):
    return [(start, end) for opcode, start, end in records(data) if opcode == CHUNK]


@pytest.mark.parametrize("name", DAMAGED)
def test_real_log_broken_on_purpose(name):
    path = DATA / "mcap_damaged" / f"{name}.mcap"
    if not path.exists():
        pytest.skip(f"damaged logs are not at {path.parent}")
    intact = list(scan(DATA / "mcap_osi/omega_prime/osi_centerline_example.mcap"))
    n, kind = DAMAGED[name]
    log = scan(path)
    assert list(log) == intact[:n]
    assert [damage.kind for damage in log.damage] == [kind]
    with pytest.raises(DamagedRecordingError, match=f"{name}.*{kind}"):
        read_tracks(path, strict=True)


@pytest.mark.parametrize(("data", "reported"), [(b"", "empty file"), (b"time_s,x_m\n" * 9, "starts with b'time_s,x")])
def test_what_is_no_mcap_is_an_error(tmp_path, data, reported):
    path = tmp_path / "log.mcap"
    path.write_bytes(data)
    with pytest.raises(NotMcapError, match=f"log.mcap.*{reported}"):
        scan(path)


@pytest.mark.parametrize("compression", list(CompressionType))
def test_a_broken_chunk_costs_its_own_messages_and_no_others(tmp_path, compression):
    data = bytearray(log_bytes(SENT, compression=compression, chunk_size=1000))
    start, end = chunks(data)[2]
    data[end - 30] ^= 0x10
    got, kinds, damage = read(tmp_path, data)
    lost = [m for m in SENT if m not in got]
    assert kinds in (["chunk_crc"], ["chunk_data"])
    assert damage[0].offset == start
    assert damage[0].messages == len(lost) > 0
    assert lost == SENT[SENT.index(lost[0]) :][: len(lost)]


@pytest.mark.parametrize("chunked", [True, False])
def test_a_log_cut_anywhere_delivers_all_that_stands_before_the_cut(tmp_path, chunked):
    layout = {"chunk_size": 700} if chunked else {"use_chunking": False}
    data = log_bytes(SENT, compression=CompressionType.NONE, **layout)
    in_order = [data.index(struct.pack("<Q", time_ns) * 1 + struct.pack("<Q", time_ns + 1)) for _, time_ns, _ in SENT]
    for cut in range(300, len(data), 997):
        got, kinds, _ = read(tmp_path, data[:cut])
        whole = sum(at + 16 + len(m[2]) <= cut for at, m in zip(in_order, SENT, strict=True))
        assert got == SENT[:whole]
        assert kinds in (["truncated"], ["magic"])


@pytest.mark.parametrize("length", [0, 5, 1 << 33, (1 << 64) - 1])
def test_after_a_record_of_wrong_length_the_next_chunks_are_read(tmp_path, length):
    data = bytearray(log_bytes(SENT, chunk_size=1000))
    start, _ = chunks(data)[2]
    data[start] = 0x07  # no chunk by its opcode either
    struct.pack_into("<Q", data, start + 1, length)
    data[start + 9 : start + 49] = b"\xff" * 40  # nor by its fields
    got, kinds, _ = read(tmp_path, data)
    before = read(tmp_path, bytes(data[:start]))[0]
    assert "record" in kinds
    assert got[: len(before)] == before
    assert got[-1] == SENT[-1]
    assert len(SENT) - 60 < len(got) < len(SENT)


def test_a_tail_of_zeros_is_reported_once(tmp_path):
    data = log_bytes(SENT, chunk_size=1000)
    start, _ = chunks(data)[4]
    got, kinds, _ = read(tmp_path, data[:start] + bytes(50_000))
    assert kinds == ["record"]
    assert got == SENT[: len(got)] != []


def test_sizes_that_a_file_claims_are_not_allocated(tmp_path):
    data = bytearray(log_bytes(SENT, chunk_size=1000))
    for start, _ in chunks(data):
        struct.pack_into("<Q", data, start + 9 + 16, 1 << 60)
    got, kinds, _ = read(tmp_path, data)
    assert got == SENT
    assert set(kinds) == {"chunk_header"}


def test_a_wrong_start_time_of_a_chunk_does_not_delay_its_messages(tmp_path):
    data = bytearray(log_bytes(SENT, chunk_size=1000))
    for start, _ in chunks(data)[:3]:
        struct.pack_into("<Q", data, start + 9, 150_000)
    got, _, _ = read(tmp_path, data)
    assert got == SENT


def test_messages_of_an_undefined_channel_are_counted(tmp_path):
    data = bytearray(log_bytes(SENT, use_chunking=False))
    channel = struct.pack("<HH", 2, 1)  # the id of /topic1's channel, and of its schema
    for at in (data.index(channel), data.rindex(channel)):
        data[at] = 9
    got, kinds, damage = read(tmp_path, data)
    assert set(kinds) == {"summary", "unknown_channel"}  # the flip in the summary breaks its checksum
    assert sum(d.messages for d in damage if d.kind == "unknown_channel") == 67
    assert got == [m for m in SENT if m[0] != "/topic1"]


def test_what_no_checksum_vouches_for_renames_no_topic(tmp_path):
    """A flip in a summary whose footer is cut off: the chunk that is read last, whose checksum holds, says the name."""
    data = bytearray(log_bytes(SENT[::-1], chunk_size=1000))
    data[data.rindex(b"/topic1")] = ord("-")
    assert read(tmp_path, data)[1] == ["summary"]
    for cut in (60, 30):  # in the summary offsets, in the footer
        got, kinds, _ = read(tmp_path, data[:-cut])
        assert "truncated" in kinds
        assert got == SENT


def test_flipped_bits_of_bare_messages_are_noticed(tmp_path):
    data = bytearray(log_bytes(SENT, use_chunking=False, enable_data_crcs=True))
    at = data.index(b"199" * 9)
    data[at] ^= 1
    log = tmp_path / "log.mcap"
    log.write_bytes(data)
    messages = scan(log)
    assert len(list(messages)) == len(SENT)
    assert [damage.kind for damage in messages.damage] == ["data_crc"]


@pytest.mark.parametrize("seed", range(4))
def test_random_mutations_neither_crash_nor_invent_messages(tmp_path, seed):
    rng = np.random.default_rng(seed)
    compression = list(CompressionType)[seed % 3]
    whole = log_bytes(SENT, compression=compression, chunk_size=800)
    for _ in range(100):
        data = _mutated(bytearray(whole), rng)
        if len(data) < 8 or not data.startswith(whole[:5]):
            continue
        got, kinds, _ = read(tmp_path, data)
        if "truncated" not in kinds:  # what the end of the file cuts has no checksum
            assert set(got) <= set(SENT)
        if len(got) < len(SENT):
            assert kinds


def _mutated(data, rng):
    for _ in range(rng.integers(1, 4)):
        at = int(rng.integers(0, max(len(data), 1)))
        match rng.integers(0, 5):
            case 0:
                del data[at:]
            case 1 if data:
                data[at] ^= 1 << int(rng.integers(0, 8))
            case 2:
                data[at : at + 40] = bytes(len(data[at : at + 40]))
            case 3:
                data[at:at] = rng.bytes(int(rng.integers(1, 100)))
            case 4:
                data[at : at + 8] = b"\xff" * len(data[at : at + 8])
    return bytes(data)
