"""What can be wrong with what a file holds, beside what is wrong with the file itself; one line each, as there."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from os import fspath

from dirprim_filter.partial_file import OutputExistsError
from dirprim_filter.recording.container.errors import DamagedRecordingError, NotMcapError, Path, RecordingError, warn
from dirprim_filter.recording.container.message_columns import MessageColumns
from dirprim_filter.recording.container.records import Channel

__all__ = [
    "DamagedRecordingError", "DecodeError", "MissingExtraError", "MissingTransformError",
    "NoTracksError", "NotMcapError", "OutputExistsError", "RecordingError", "TableError", "warn",
]  # fmt: skip
TOPICS_SHOWN = 6
"""Of a log, in one line; `dirprim info` lists all."""


class NoTracksError(RecordingError):
    """No topic of the log can serve as asked."""

    def __init__(
        self, path: Path, *, has: Iterable[Channel], wanted: str, damage: Sequence[object] = (), why: str = ""
    ) -> None:
        """`has`: all channels of the log; `wanted`: what was looked for, in words; `why`: the reason if known."""
        topics = list(dict.fromkeys(f"{c.topic} ({c.schema.name or 'no schema'})" for c in has))
        more = f" and {len(topics) - TOPICS_SHOWN} more" if len(topics) > TOPICS_SHOWN else ""
        broken = f"; it is damaged: {damage[0]}" if damage else ""
        way = why or "choose a topic or another log, or say by --set fields=... where objects of an unknown schema are"
        shown = ", ".join(topics[:TOPICS_SHOWN]) or "no topics"
        super().__init__(f"{fspath(path)}: expected {wanted}; the log has {shown}{more}{broken}; {way}")


class DecodeError(RecordingError):
    """A message does not hold what its schema promises."""

    def __init__(self, path: Path, messages: MessageColumns, failures: Mapping[int, str]) -> None:
        """`failures`: by number why some of the messages cannot be read; the first is named."""
        i, reason = next(iter(failures.items()))
        channel = messages.channels[int(messages.channel[i])]
        super().__init__(
            f"{fspath(path)}: topic {channel.topic}, message at {int(messages.log_time_ns[i])} ns: expected a message "
            f"of {channel.schema.name}, got {reason}; leave the topic out, or write it anew"
        )


class MissingTransformError(RecordingError):
    """Nothing joins an object's frame to the one that is asked for; `why` is what there is instead."""

    def __init__(self, path: Path, *, frame: str, target: str, time_ns: int, why: str) -> None:
        self.why = why
        super().__init__(
            f"{fspath(path)}: expected a transform from frame {frame!r} to frame {target!r} at {time_ns} ns, but "
            f"{why}; choose another by --set frame=..., other topics, or a log with its transforms"
        )


class MissingExtraError(RecordingError):
    """A file needs a library that is not installed."""

    def __init__(self, what: str, *, library: str, extra: str) -> None:
        super().__init__(f"{what}: expected {library}, which is not installed; pip install 'dirprim-filter[{extra}]'")


class TableError(RecordingError):
    """A line of a table, or another place in it, is not what the format asks for."""

    def __init__(self, path: Path, place: int | str, expected: str, got: str, remedy: str) -> None:
        where = f", line {place}" if isinstance(place, int) else f", {place}" if place else ""
        super().__init__(f"{fspath(path)}{where}: expected {expected}, got {got}; {remedy}")
