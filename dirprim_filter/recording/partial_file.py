"""A file that takes its name when it is whole."""

from __future__ import annotations

import os
from io import FileIO
from pathlib import Path
from types import TracebackType

from dirprim_filter.recording.errors import OutputExistsError

SUFFIX = ".partial"


class PartialFile:
    """Stands beside as `NAME.PID.partial` until it is whole: a context manager that gives the open file.

    It is not buffered: what was written outlives the process, and `dirprim recover` makes a whole log of it. An
    exception removes it; a kill leaves it.

    Args:
        path: the name it gets.
        force: overwrite an existing file.
        keep_when_interrupted: Ctrl-C ends it like the end of the body: it gets its name.

    Raises:
        OutputExistsError: the file exists, and `force` is not set.
        OSError: the file cannot be written.
    """

    def __init__(self, path: str | Path, *, force: bool, keep_when_interrupted: bool = False) -> None:
        self.path = Path(path)
        if self.path.exists() and not force:
            raise OutputExistsError(self.path)
        if self.path.is_dir() or not self.path.absolute().parent.is_dir():
            raise NotADirectoryError(f"{self.path}: expected a file in an existing folder; create the folder first")
        self.partial = self.path.with_name(f"{self.path.name}.{os.getpid()}{SUFFIX}")
        self._keep = keep_when_interrupted

    def __enter__(self) -> FileIO:
        self._file = self.partial.open("wb", buffering=0)
        return self._file

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        try:
            if kind is None or (self._keep and issubclass(kind, KeyboardInterrupt)):
                os.fsync(self._file.fileno())
                self._file.close()
                self.partial.replace(self.path)
        finally:
            self._file.close()
            self.partial.unlink(missing_ok=True)
