"""What is not read here, and the way from it to what is: files of other formats, messages of other encodings."""

from __future__ import annotations

from collections.abc import Iterable
from typing import NamedTuple

from dirprim_filter.recording.container.records import ENCODINGS

READ_BYTES = 16
"""Enough of a file to know every format."""


class OtherFormat(NamedTuple):
    """A format that is no MCAP.

    Attributes:
        opening: how its files begin.
        name: what it is.
        way: what to do, a clause.
    """

    opening: bytes
    name: str
    way: str


AS_TABLE = "`dirprim convert` without --format makes a log of it"
OTHER_FORMATS = (
    OtherFormat(b"SQLite format 3", "a ROS 2 bag in SQLite", "`dirprim` reads its folder, or a file named .db3"),
    OtherFormat(b"#ROSBAG", "a ROS 1 bag", "`dirprim` reads a file named .bag"),
    OtherFormat(b"RRF", "a rerun recording", "`dirprim view` shows it"),
    OtherFormat(b"PAR1", "a Parquet table", AS_TABLE),
    OtherFormat(b"ARROW1", "a Feather table", AS_TABLE),
    OtherFormat(b"FEA1", "a Feather table", AS_TABLE),
    OtherFormat(
        b"\x89HDF",
        "an HDF5 file",
        "write it as Parquet, in pandas by `read_hdf(FILE).to_parquet(NEW)`, for `dirprim convert`",
    ),
    OtherFormat(b"PK\x03\x04", "a zip archive", "unpack it first"),
    OtherFormat(b"\x28\xb5\x2f\xfd", "a file compressed by zstd", "decompress it first"),
    OtherFormat(b"\x1f\x8b", "a file compressed by gzip", "decompress it; `dirprim convert` reads a .csv.gz as it is"),
    OtherFormat(b"\x89MCAP", "an MCAP log", "it needs no converting: `dirprim info` shows what it contains"),
)


def other_format(opening: bytes) -> OtherFormat | None:
    """The format of a file that begins with these bytes; None where it is not known."""
    return next((known for known in OTHER_FORMATS if opening.startswith(known.opening)), None)


def unread_encodings(encodings: Iterable[str]) -> str | None:
    """Why messages are not read, and the way out, where none has an encoding that is."""
    found = sorted(set(encodings))
    if not found or set(found) & set(ENCODINGS):
        return None
    why = f"messages encoded as {', '.join(found)} are not read, but {', '.join(ENCODINGS)}"
    ros1 = "; give the ROS 1 bag itself, a file named .bag" if "ros1" in found else ""
    return why + ros1
