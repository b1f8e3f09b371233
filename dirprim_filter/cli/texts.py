"""Texts for people: counts, numbers, tables; and nothing by which a name in a log could steer the terminal."""

from __future__ import annotations

import math
import os
from collections.abc import Callable, Sequence
from io import TextIOBase
from typing import TextIO

import typer

UNKNOWN = "-"


def counted(n: int, what: str) -> str:
    """A number and what it counts, in the plural unless it is one."""
    return f"{n} {what}" if n == 1 else f"{n} {what}s"


def number(value: float) -> str:
    """Three decimals for small numbers, none for large ones; a dash if unknown."""
    if math.isnan(value):
        return UNKNOWN
    if isinstance(value, int):
        return str(value)
    return f"{value:.3f}" if abs(value) < 100 else f"{value:.0f}"


def columns(rows: Sequence[Sequence[str]], *, n_left: int = 1) -> list[str]:
    """Rows as lines; the first columns stand to the left, the others to the right."""
    widths = [max(map(len, column)) for column in zip(*rows, strict=True)]
    return [
        "  ".join(
            cell.ljust(width) if i < n_left else cell.rjust(width)
            for i, (cell, width) in enumerate(zip(row, widths, strict=True))
        ).rstrip()
        for row in rows
    ]


def say(*lines: str, err: bool = False) -> None:
    """Print lines; what a log calls its things does not break them."""
    if lines:
        typer.echo("\n".join(map(_shown, lines)), err=err)


class Shown(TextIOBase):
    """Standard output or error: without secrets, and without what steers a terminal, whoever writes.

    Who reads it may leave, or not be there: what is written then goes nowhere, and the work goes on.
    """

    encoding, errors = "utf-8", "strict"

    def __init__(self, stream: TextIO | None) -> None:
        self.stream = stream

    def fileno(self) -> int:
        """As of the stream."""
        return -1 if self.stream is None else self.stream.fileno()

    def isatty(self) -> bool:
        """Whether it is a terminal."""
        return self.stream is not None and self.stream.isatty()

    def write(self, text: str) -> int:
        """Show it.

        Raises:
            OSError: there is no room for it.
        """
        shown = "\n".join(map(_shown, text.split("\n")))  # refuses bytes, by which click asks what the stream takes
        if self.stream is not None and shown:
            encoding = self.stream.encoding or "utf-8"
            self._have(self.stream.write, shown.encode(encoding, "backslashreplace").decode(encoding))
        return len(text)

    def flush(self) -> None:
        """Have it read.

        Raises:
            OSError: as `write`.
        """
        if self.stream is not None and not self.stream.closed:  # as Python does with what nobody uses any more
            self._have(self.stream.flush)

    def _have(self, does: Callable[..., object], *what: str) -> None:
        try:
            does(*what)
        except OSError as error:
            nowhere = os.open(os.devnull, os.O_WRONLY)  # what is left in the stream's buffer would fail again at exit
            os.dup2(nowhere, self.fileno())
            os.close(nowhere)
            if not isinstance(error, BrokenPipeError):
                raise OSError(error.errno, error.strerror, "standard output") from error


def hold_standard_streams() -> None:
    """Have the numbers 0 to 2 taken: of a stream that is closed an output would get the number, and its texts."""
    for number in range(3):
        try:
            os.fstat(number)
        except OSError:
            os.open(os.devnull, os.O_RDWR)  # the lowest number that is free


def _shown(text: str) -> str:
    if text.isprintable() and ":/" not in text:  # most, such as the help, which would feel the import
        return text
    from dirprim_filter.recording.container.errors import one_line

    return one_line(text)
