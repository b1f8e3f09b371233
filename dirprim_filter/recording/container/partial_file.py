"""A file that takes its name when it is whole."""

from __future__ import annotations

import os
from io import FileIO
from itertools import count
from pathlib import Path
from types import TracebackType

from dirprim_filter.recording.container.errors import OutputExistsError

SUFFIX = ".partial"


class PartialFile:
    """Stands beside as `NAME.PID.partial` until it is whole: a context manager that gives the open file.

    It is not buffered: what was written outlives the process, and `dirprim recover` makes a whole log of it. An
    exception removes it, Ctrl-C too; a kill leaves it. What a killed process of the same number left is never
    overwritten: the new one is then called `NAME.PID.2.partial`, and so on.

    Args:
        path: the name it gets.
        force: overwrite an existing file.

    Attributes:
        path: the name it gets.
        partial: where it stands, once it is open.

    Raises:
        OutputExistsError: the file exists, and `force` is not set.
        OSError: the file cannot be written.
    """

    def __init__(self, path: str | Path, *, force: bool) -> None:
        self.path = Path(path)
        if self.path.exists() and not force:
            raise OutputExistsError(self.path)
        if self.path.is_dir() or not self.path.absolute().parent.is_dir():
            raise NotADirectoryError(f"{self.path}: expected a file in an existing folder; create the folder first")
        self.partial = self._beside("")

    def _beside(self, number: str) -> Path:
        return self.path.with_name(f"{self.path.name}.{os.getpid()}{number}{SUFFIX}")

    def __enter__(self) -> FileIO:
        for number in count(2):
            try:
                self._file = self.partial.open("xb", buffering=0)
                break
            except FileExistsError:
                self.partial = self._beside(f".{number}")
            except OSError as error:  # of the name that the caller knows
                raise OSError(error.errno, error.strerror, str(self.path)) from error
        return self._file

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        try:
            if kind is None:
                os.fsync(self._file.fileno())
                self._file.close()
                self.partial.replace(self.path)
        finally:
            self._file.close()
            self.partial.unlink(missing_ok=True)
