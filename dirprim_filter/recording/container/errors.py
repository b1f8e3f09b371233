"""What can be wrong with a file: damage, formats that are not read here, and errors.

Each error is one line that names the file, the place and the way out.
"""

from __future__ import annotations

import logging
import re
from collections.abc import Sequence
from dataclasses import dataclass
from os import PathLike, fspath
from typing import Literal

logger = logging.getLogger(__name__)

DamageKind = Literal[
    "magic",  # the opening or closing magic is wrong or missing
    "truncated",  # the file ends inside a record, or before its footer
    "record",  # opcode or length of a record make no sense; up to the next readable chunk all is lost
    "definition",  # a schema, channel or metadata record cannot be parsed, or the summary says something else
    "attachment",  # an attachment cannot be parsed, or differs from what was written
    "chunk_header",  # fields of a chunk contradict each other
    "chunk_data",  # a chunk cannot be decompressed
    "chunk_crc",  # the contents of a chunk differ from what was written
    "chunk_times",  # a chunk holds messages from before its stated start
    "message",  # a message record cannot be parsed
    "unknown_channel",  # a message of a channel that is defined nowhere
    "data_crc",  # unchunked messages differ from what was written
    "summary",  # the summary section contradicts the data; it is not needed
    "trailing",  # bytes after the end
]


@dataclass(frozen=True, slots=True, kw_only=True)
class Damage:
    """One place of a log that is broken.

    Attributes:
        kind: what is broken.
        offset: byte in the file where it starts.
        length: bytes concerned.
        messages: messages lost by it; None where that cannot be known.
        detail: what was expected and what came.
    """

    kind: DamageKind
    offset: int
    length: int
    messages: int | None
    detail: str

    def __str__(self) -> str:
        lost = "unknown number of messages" if self.messages is None else f"{self.messages} messages"
        return f"{self.kind} at byte {self.offset} ({self.length} bytes, {lost} lost): {self.detail}"


READ_BYTES = 16
"""Enough of a file to know every format."""
ZSTD, GZIP = b"\x28\xb5\x2f\xfd", b"\x1f\x8b"
"""What frames and files of zstd, and files of gzip begin with."""
AS_TABLE = "`dirprim convert` without --format makes a log of it"
OTHER_FORMATS = {
    b"SQLite format 3": ("a ROS 2 bag in SQLite", "`dirprim` reads its folder, or a file named .db3"),
    b"#ROSBAG": ("a ROS 1 bag", "`dirprim` reads a file named .bag"),
    b"RRF": ("a rerun recording", "`dirprim view` shows it"),
    b"PAR1": ("a Parquet table", AS_TABLE),
    b"ARROW1": ("a Feather table", AS_TABLE),
    b"FEA1": ("a Feather table", AS_TABLE),
    b"\x89HDF": ("an HDF5 file", "write it as Parquet, in pandas by `read_hdf(FILE).to_parquet(NEW)`"),
    b"PK\x03\x04": ("a zip archive", "unpack it first"),
    ZSTD: ("a file compressed by zstd", "it does not decompress: look how it was made"),
    GZIP: ("a file compressed by gzip", "it does not decompress; `dirprim convert` reads a .csv.gz"),
    b"\x89MCAP": ("an MCAP log", "it needs no converting: `dirprim info` shows what it contains"),
}
"""By how their files begin, formats that are no MCAP, or no table, and what to do, a clause."""


def other_format(opening: bytes) -> tuple[str, str] | None:
    """The name of the format of a file that begins with these bytes, and what to do; None where it is not known."""
    return next((known for begin, known in OTHER_FORMATS.items() if opening.startswith(begin)), None)


Path = str | PathLike[str]
_USER = re.compile(r"(:/+)[^/\s]*@")
"""Of a URL, with the password."""
_WORD = re.compile(r'[^\s"\\]+')
"""What a URL's query ends in; in JSON a quote is not the URL's own."""
_SHORT = re.compile(r"\.\.\.([0-9a-f]{12})?")
"""In place of a query, as a store's names of logs have it too."""
_BEHIND = ":,;.'])}"


def without_secrets(text: str) -> str:
    """The text with what gives access to a URL left out: user and password, and the query. Linear in its length.

    What users and logs call their things passes here before it leaves the program: to a terminal, JSON, the metadata of
    a file, a store.
    """
    if ":/" not in text:
        return text
    return _WORD.sub(lambda word: _without_query(word[0]), _USER.sub(r"\1", text))


def _without_query(word: str) -> str:
    """A signature may be in it."""
    begin, of_url, rest = word.partition(":/")
    path, asks, query = rest.partition("?")
    if not of_url or not asks:
        return word
    if short := _SHORT.match(query):
        own = short[0]
        return word if not query[len(own) :].strip(_BEHIND) else f"{begin}:/{path}?..."
    own = query.rstrip(_BEHIND)
    return f"{begin}:/{path}?...{query[len(own) :]}"


def one_line(text: str) -> str:
    """The text as it may be shown: with escapes for what would break the line or steer a terminal, without secrets.

    Names in a file of any origin may hold anything.
    """
    text = without_secrets(text)
    return "".join(one if one.isprintable() else one.encode("unicode_escape").decode() for one in text)


def warn(path: Path, text: str) -> None:
    """Log what is odd with a file that is read all the same, as one line."""
    logger.warning("%s", one_line(f"{fspath(path)}: {text}"))


class RecordingError(Exception):
    """A file cannot be read or written as asked; its text is one line for the user."""

    def __init__(self, text: str) -> None:
        super().__init__(one_line(text))


class NoRoomError(RecordingError):
    """What must be copied before it is read finds no room."""


class NotMcapError(RecordingError):
    """The file is no MCAP log at all."""

    def __init__(self, path: Path, opening: bytes) -> None:
        """`opening`: the bytes that the file begins with."""
        got, way = f"a file that starts with {opening[:8]!r}", "`dirprim convert` makes logs of tables"
        if not opening:
            got, way = "an empty file", "look how it was made"
        elif known := other_format(opening):
            got, way = known
        super().__init__(f"{fspath(path)}: expected an MCAP log, got {got}; {way}")


class DamagedRecordingError(RecordingError):
    """The log is damaged, and the caller asked not to go on with what is left (strict)."""

    def __init__(self, path: Path, damage: Sequence[object]) -> None:
        more = f" and {len(damage) - 1} more" if len(damage) > 1 else ""
        super().__init__(f"{fspath(path)}: expected an undamaged log, got {damage[0]}{more}; read it without strict")
