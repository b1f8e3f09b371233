"""What of a log could not be read."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

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
