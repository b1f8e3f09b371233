"""The one way to write a file: it takes its name when it is whole, and takes it from no other.

A device or a pipe is written to as it is, for nothing of it is replaced: `/dev/null`, `/dev/stdout`, a FIFO.
"""

from __future__ import annotations

import errno
import logging
import os
import re
import stat
from contextlib import suppress
from io import FileIO
from pathlib import Path
from types import TracebackType
from typing import Any

logger = logging.getLogger(__name__)

SUFFIX = ".partial"
LONGEST = 200
"""Bytes of a name that its temporary one begins with: file systems take 255."""
NO_ROOM = (errno.ENOSPC, errno.EDQUOT, errno.EFBIG)
"""Errors of a file that finds no room: of a full disk, a quota, a limit."""
DESCRIPTOR = re.compile(r"/(?:dev|proc/(?:self|\d+))/fd/(\d+)")
"""Of the number of an open file the name."""
STANDARD = {"/dev/stdout": "/dev/fd/1", "/dev/stderr": "/dev/fd/2"}


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


class Streamed(WholeFile):
    """A device or a pipe. If its reader leaves, the rest goes nowhere, as of a closed pipe of a shell."""

    is_read, n_written = True, 0

    def write(self, data: Any) -> int:
        """All of it, while somebody reads it."""
        self.n_written += memoryview(data).nbytes
        try:
            if self.is_read:
                super().write(data)
        except BrokenPipeError:
            self.is_read = False
            logger.warning("%s: its reader has left; the rest is not written", self.name)
        return memoryview(data).nbytes

    def tell(self) -> int:
        """Bytes so far."""
        return self.n_written


class PartialFile:
    """Stands beside as `NAME.PID.partial` until it is whole: a context manager that gives the open file.

    It is not buffered: what was written outlives the process, and `dirprim recover` makes a whole log of it. An
    exception removes it, Ctrl-C too; a kill leaves it. What is there under the same name is never overwritten: the new
    one is then called `NAME.PID.2.partial`, and so on. A whole file whose name was taken meanwhile keeps this one.

    Of a symlink the file is replaced that it leads to. A file keeps its mode and owner as it is replaced, where the
    system lets it; other hard links to it keep what it held. A character device, a pipe and an open descriptor are
    written to, with and without `force`.

    Args:
        path: the name it gets.
        force: overwrite an existing file.
        keep: an exception leaves what was written under its temporary name, which is logged.

    Attributes:
        path: the name it gets, as it was given.
        partial: where it stands, once it is open.
        keep: as given; may be changed while it is open.
        is_stream: it is written to, not replaced.

    Raises:
        OutputExistsError: the file exists, and `force` is not set.
        OSError: the file cannot be written.
    """

    def __init__(self, path: str | Path, *, force: bool, keep: bool = False) -> None:
        self.path = Path(path)
        self._force, self.keep = force, keep
        found = DESCRIPTOR.fullmatch(STANDARD.get(str(self.path), str(self.path)))
        self._descriptor = int(found[1]) if found else None
        self._before: os.stat_result | None = None
        with suppress(FileNotFoundError, NotADirectoryError):  # the latter is said of the folder
            self._before = self.path.stat()
        kind = 0 if self._before is None else stat.S_IFMT(self._before.st_mode)
        self.is_stream = self._descriptor is not None or kind in (stat.S_IFCHR, stat.S_IFIFO)
        if self.is_stream:
            return
        self._target = Path(os.path.realpath(self.path))
        if kind not in (0, stat.S_IFREG):
            got = {stat.S_IFDIR: "a folder", stat.S_IFBLK: "a block device", stat.S_IFSOCK: "a socket"}.get(kind)
            raise OSError(
                errno.EINVAL, f"expected the name of a file, got that of {got or 'something else'}", str(path)
            )
        if kind and not force:
            raise OutputExistsError(self.path)
        _require_writable(self._target.parent, self.path)

    def __enter__(self) -> FileIO:
        try:
            self._file = self._opened()
        except OSError as error:  # of the name that the caller knows
            raise OSError(error.errno, error.strerror, str(self.path)) from error
        return self._file

    def _opened(self) -> WholeFile:
        if self.is_stream:
            self.partial = self.path
            return Streamed(self.path if self._descriptor is None else os.dup(self._descriptor), "wb")
        begin = os.fsdecode(os.fsencode(self._target.name)[:LONGEST])
        number = 1
        while True:
            own = f"{os.getpid()}" if number == 1 else f"{os.getpid()}.{number}"
            self.partial = self._target.with_name(f"{begin}.{own}{SUFFIX}")
            with suppress(FileExistsError):
                return WholeFile(self.partial, "xb")
            number += 1

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
        if self.is_stream:
            self._file.close()
            return
        is_kept = self.keep
        try:
            if whole:
                self._take_over()
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

    def _take_over(self) -> None:
        """Owner and mode of the file that it replaces."""
        if self._before is not None:
            with suppress(OSError):
                os.fchown(self._file.fileno(), self._before.st_uid, self._before.st_gid)
            with suppress(OSError):
                os.fchmod(self._file.fileno(), stat.S_IMODE(self._before.st_mode))

    def _take_name(self) -> None:
        """Rename it; without `force` only if the name is still free, which `replace` could not see."""
        if not self._force:
            try:
                os.link(self.partial, self._target)
            except OSError as error:  # the name was taken, or it is a file system without links
                if self._target.exists():
                    raise OutputExistsError(self.path) from error
            else:
                self.partial.unlink()
                return
        self.partial.replace(self._target)


def _require_writable(folder: Path, path: Path) -> None:
    """Whether a file can be made there."""
    if not folder.is_dir():
        there = "is a file" if folder.exists() else "does not exist; create it first"
        raise NotADirectoryError(errno.ENOTDIR, f"expected a folder, {folder} {there}", str(path))
    if not os.access(folder, os.W_OK | os.X_OK, effective_ids=os.access in os.supports_effective_ids):
        raise PermissionError(errno.EACCES, f"the folder {folder} cannot be written; choose another", str(path))
