"""Damage is reported, and all that is intact is delivered."""

import struct

import pytest
from mcap.writer import CompressionType
from mcap_files import DATA, log_bytes

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
    got = [(m.topic, m.log_time_ns, m.data) for m in log]
    return got, [damage.kind for damage in log.damage], log.damage


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


def test_what_no_checksum_vouches_for_renames_no_topic(tmp_path):
    """A flip in a summary whose footer is cut off: the chunk that is read last, whose checksum holds, says the name."""
    data = bytearray(log_bytes(SENT[::-1], chunk_size=1000))
    data[data.rindex(b"/topic1")] = ord("-")
    assert read(tmp_path, data)[1] == ["summary"]
    for cut in (60, 30):  # in the summary offsets, in the footer
        got, kinds, _ = read(tmp_path, data[:-cut])
        assert "truncated" in kinds
        assert got == SENT
