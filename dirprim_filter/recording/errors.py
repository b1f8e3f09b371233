"""What can be wrong with a file: each error is one line that names the file, the place and the way out."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from os import PathLike, fspath
from typing import Self

from dirprim_filter.recording.other_formats import other_format, unread_encodings
from dirprim_filter.recording.records import Channel, Message

Path = str | PathLike[str]
TOPICS_TOLD = 6
"""Of a log, in one line; `dirprim info` tells all."""


class RecordingError(Exception):
    """A file cannot be read or written as asked; its text is one line for the user."""


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
            got, way = known.name, known.way
        super().__init__(f"{fspath(path)}: expected an MCAP log, got {got}; {way}")


class NoTracksError(RecordingError):
    """No topic of the log can serve as asked."""

    def __init__(self, path: Path, *, has: Iterable[Channel], wanted: str, damage: Sequence[object] = ()) -> None:
        """`has`: all channels of the log; `wanted`: what was looked for, in words."""
        channels = list(has)
        topics = list(dict.fromkeys(f"{c.topic} ({c.schema.name or 'no schema'})" for c in channels))
        more = f" and {len(topics) - TOPICS_TOLD} more" if len(topics) > TOPICS_TOLD else ""
        broken = f"; it is damaged: {damage[0]}" if damage else ""
        way = unread_encodings(c.message_encoding for c in channels) or (
            "choose a topic or another log, or say by --fields where the objects of a schema are that is not known"
        )
        told = ", ".join(topics[:TOPICS_TOLD]) or "no topics"
        super().__init__(f"{fspath(path)}: expected {wanted}; the log has {told}{more}{broken}; {way}")


class DamagedRecordingError(RecordingError):
    """The log is damaged, and the caller asked not to go on with what is left (strict)."""

    def __init__(self, path: Path, damage: Sequence[object]) -> None:
        more = f" and {len(damage) - 1} more" if len(damage) > 1 else ""
        super().__init__(f"{fspath(path)}: expected an undamaged log, got {damage[0]}{more}; read it without strict")


class DecodeError(RecordingError):
    """A message does not hold what its schema promises."""

    def __init__(self, path: Path, *, topic: str, time_ns: int, expected: str, got: str) -> None:
        super().__init__(
            f"{fspath(path)}: topic {topic}, message at {time_ns} ns: expected {expected}, got {got}; "
            "leave the topic out, or write it anew"
        )

    @classmethod
    def of(cls, path: Path, message: Message, reason: str) -> Self:
        """Of a message that cannot be read, and why."""
        expected = f"a message of {message.schema_name}"
        return cls(path, topic=message.topic, time_ns=message.log_time_ns, expected=expected, got=reason)


class MissingTransformError(RecordingError):
    """An object's frame cannot be told in the frame that is asked for."""

    def __init__(self, path: Path, *, frame: str, target: str, time_ns: int) -> None:
        super().__init__(
            f"{fspath(path)}: expected a transform from frame {frame!r} to frame {target!r} at {time_ns} ns, the log "
            "has none; choose another --frame, other topics, or a log with its transforms"
        )


class MissingExtraError(RecordingError):
    """A file needs a library that is not installed."""

    def __init__(self, what: str, *, library: str, extra: str) -> None:
        super().__init__(f"{what}: expected {library}, which is not installed; pip install 'dirprim-filter[{extra}]'")


class TableError(RecordingError):
    """A line of a table is not what the format asks for."""

    def __init__(self, path: Path, line: int, expected: str, got: str, remedy: str) -> None:
        super().__init__(f"{fspath(path)}, line {line}: expected {expected}, got {got}; {remedy}")


class OutputExistsError(RecordingError):
    """The file to write is there already."""

    def __init__(self, path: Path) -> None:
        super().__init__(f"{fspath(path)}: expected a new file, it exists; choose another name or use --force")
