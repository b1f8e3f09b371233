"""What can be wrong with a file: each error is one line that names the file, the place and the way out."""

from __future__ import annotations

import re
from collections.abc import Sequence
from os import PathLike, fspath

from dirprim_filter.recording.container.other_formats import other_format

Path = str | PathLike[str]


_URL = re.compile(r"([A-Za-z][\w+.-]*:/+)(?:[^/@\s]+@)?([^\s?]*)(\?\S*?(?=[:,;.]?(?:\s|$)))?")
"""With what gives access: the user and the password, and the query, which may be a signature."""


def without_secrets(text: str) -> str:
    """The text with what gives access to a URL left out."""
    return _URL.sub(lambda url: url[1] + url[2] + "?..." * bool(url[3]), text)


def one_line(text: str) -> str:
    """The text as it may be shown: with escapes for what would break the line or steer a terminal, without secrets.

    Names in a file of any origin may hold anything.
    """
    text = without_secrets(text)
    return "".join(one if one.isprintable() else one.encode("unicode_escape").decode() for one in text)


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
            got, way = known.name, known.way
        super().__init__(f"{fspath(path)}: expected an MCAP log, got {got}; {way}")


class DamagedRecordingError(RecordingError):
    """The log is damaged, and the caller asked not to go on with what is left (strict)."""

    def __init__(self, path: Path, damage: Sequence[object]) -> None:
        more = f" and {len(damage) - 1} more" if len(damage) > 1 else ""
        super().__init__(f"{fspath(path)}: expected an undamaged log, got {damage[0]}{more}; read it without strict")
