"""The one way to write a file: it takes its name when it is whole, and takes it from no other."""

from __future__ import annotations

import errno
import logging
import os
from io import FileIO
from itertools import count
from pathlib import Path
from types import TracebackType
from typing import Any

logger = logging.getLogger(__name__)

SUFFIX = ".partial"
NO_ROOM = (errno.ENOSPC, errno.EDQUOT, errno.EFBIG)
"""Errors of a file that finds no room: of a full disk, a quota, a limit."""


class OutputExistsError(FileExistsError):
    """The file to write is there already."""

    def __init__(self, path: Path) -> None:
        super().__init__(f"{path}: expected a new file, it exists; choose another name or use --force")


class WholeFile(FileIO):
    """Unbuffered, and takes all of what it is given: the system takes a part where a disk is almost full."""

    def write(self, data: Any) -> int:
        """All of it, or an error."""
        whole = left = memoryview(data).cast("B")
        while left:
            left = left[super().write(left) :]
        return len(whole)


class PartialFile:
    """Stands beside as `NAME.PID.partial` until it is whole: a context manager that gives the open file.

    It is not buffered: what was written outlives the process, and `dirprim recover` makes a whole log of it. An
    exception removes it, Ctrl-C too; a kill leaves it. What is there under the same name is never overwritten: the new
    one is then called `NAME.PID.2.partial`, and so on. A whole file whose name was taken meanwhile keeps this one.

    Args:
        path: the name it gets.
        force: overwrite an existing file.
        keep: an exception leaves what was written under its temporary name, which is logged.

    Attributes:
        path: the name it gets.
        partial: where it stands, once it is open.
        keep: as given; may be changed while it is open.

    Raises:
        OutputExistsError: the file exists, and `force` is not set.
        OSError: the file cannot be written.
    """

    def __init__(self, path: str | Path, *, force: bool, keep: bool = False) -> None:
        self.path = Path(path)
        self._force, self.keep = force, keep
        if self.path.exists() and not force:
            raise OutputExistsError(self.path)
        if self.path.is_dir() or not self.path.absolute().parent.is_dir():
            raise NotADirectoryError(f"{self.path}: expected a file in an existing folder; create the folder first")

    def __enter__(self) -> FileIO:
        for number in count(1):
            own = f"{os.getpid()}" if number == 1 else f"{os.getpid()}.{number}"
            self.partial = self.path.with_name(f"{self.path.name}.{own}{SUFFIX}")
            try:
                self._file = WholeFile(self.partial, "xb")
                break
            except FileExistsError:
                continue
            except OSError as error:  # of the name that the caller knows
                raise OSError(error.errno, error.strerror, str(self.path)) from error
        return self._file

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self._name(error)
        self.close(whole=kind is None)

    def _name(self, error: BaseException | None) -> None:
        """Have an error of a write say of which file, and what to do."""
        if isinstance(error, OSError) and error.errno in NO_ROOM and error.filename is None:
            error.filename = str(self.path)
            error.strerror = f"{error.strerror}; make room there, or choose another place"

    def close(self, *, whole: bool) -> None:
        """It gets its name if it is whole.

        Raises:
            OutputExistsError: the name was taken meanwhile.
            OSError: it cannot be renamed.
        """
        is_kept = self.keep
        try:
            if whole:
                os.fsync(self._file.fileno())
                is_kept = True
                self._take_name()
        except OSError as error:
            self._name(error)
            raise
        finally:
            self._file.close()
            if not is_kept:
                self.partial.unlink(missing_ok=True)
            elif self.partial.exists():
                logger.warning("%s: holds what was written; it is not called %s", self.partial, self.path.name)

    def _take_name(self) -> None:
        """Rename it; without `force` only if the name is still free, which `replace` could not see."""
        if not self._force:
            try:
                os.link(self.partial, self.path)
            except OSError as error:  # the name was taken, or it is a file system without links
                if self.path.exists():
                    raise OutputExistsError(self.path) from error
            else:
                self.partial.unlink()
                return
        self.partial.replace(self.path)
