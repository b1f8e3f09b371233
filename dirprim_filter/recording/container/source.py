"""Where the bytes of a log or a table come from: files, a folder, a pipe, a URL or a bag.

The order of log time needs the whole log, and a log is read several times: a pipe and a bag are copied to a temporary
file; of a URL parts come as they are asked for. Who opens one owns it: it is gone when it is closed.
"""

from __future__ import annotations

import os
import stat
import sys
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from contextvars import ContextVar
from functools import partial
from os import PathLike, fspath
from pathlib import Path

from dirprim_filter.recording.container.errors import GZIP, READ_BYTES, ZSTD, NotMcapError, RecordingError
from dirprim_filter.recording.container.file_bytes import FileBytes
from dirprim_filter.recording.container.records import MAGIC
from dirprim_filter.recording.container.remote_file import as_url, remote_copy
from dirprim_filter.recording.container.temporary_copy import Copy, Pipe, decompressed

STDIN = "-"
BAGS = (".db3", ".bag")
"""What the names of bags end in: in SQLite, and of ROS 1."""
VERSION_FREE_MAGIC = MAGIC[:5]
"""A log whose opening magic differs only behind this is read, and reported as damaged."""
Files = list[tuple[Path, FileBytes]]
"""Of a log or a table, open, by their names."""

_copies: ContextVar[dict[str, Copy] | None] = ContextVar("copies", default=None)


@contextmanager
def copied_once() -> Iterator[None]:
    """Within, as within a command, what is opened again is not copied again; at the end all copies go."""
    outer = _copies.set({})
    try:
        yield
    finally:
        _copies.reset(outer)


def open_files(path: str | PathLike[str], *, live: bool = False) -> Files:
    """The files of a log or a table, open: one, or those of a folder that rosbag2 recorded.

    Args:
        path: a file, a folder, "-" for standard input, another pipe, a URL, or a bag.
        live: a pipe is read as it comes, not to its end first.

    Raises:
        RecordingError: a URL or a folder that cannot be read, or fsspec or what it needs for this scheme is missing.
        OSError: it cannot be read.
    """
    name, file = fspath(path), Path(path)
    if name == STDIN:
        if (stdin := sys.stdin) is None:
            raise RecordingError("-: expected a log on standard input, which is closed; give a file, or open it")
        return [(file, _copy(file, lambda: Pipe(STDIN, stdin.buffer)).bytes_of(live=live))]
    if url := as_url(name):
        return [(file, _copy(file, lambda: remote_copy(url)).bytes_of(live=live))]
    if file.is_dir() or file.suffix in BAGS:
        from dirprim_filter.recording.container import ros_bags  # noqa: PLC0415 - `dirprim info` does without

        if files := ros_bags.files_of(file) if file.is_dir() else []:
            return [(one, FileBytes(os.open(one, os.O_RDONLY))) for one in files]
        return [(file, _copy(file, lambda: ros_bags.copied(file)).bytes_of(live=live))]
    if not stat.S_ISREG(file.stat().st_mode):
        return [(file, _copy(file, lambda: Pipe(name, file.open("rb"))).bytes_of(live=live))]
    return [(file, FileBytes(os.open(path, os.O_RDONLY)))]


def _copy(file: Path, make: Callable[[], Copy]) -> Copy:
    """A copy that is made now, or was within `copied_once`; a URL and the `Path` of it are one."""
    copies, key = _copies.get(), str(file)
    if copies is None:
        return make()
    if key not in copies:
        copies[key] = make()
    return copies[key]


def log_files(path: str | PathLike[str], *, live: bool = False) -> Files:
    """The same of an MCAP log, which may be compressed as a whole.

    Raises:
        NotMcapError: a file is empty, or neither starts nor ends like one.
        RecordingError: as `open_files`.
        OSError: as there.
    """
    files = open_files(path, live=live)
    for i, (file, stored) in enumerate(files):
        bytes_of, opening = stored, stored.read(0, READ_BYTES)
        if opening.startswith((ZSTD, GZIP)):
            copy = _copy(Path(f"{file} inside"), partial(Copy, str(file), decompressed(file, stored, opening)))
            if len(inside := copy.bytes_of(live=False)):
                files[i], bytes_of, opening = (file, inside), inside, inside.read(0, READ_BYTES)
        if not opening.startswith(VERSION_FREE_MAGIC):
            size = len(bytes_of)
            if bytes_of.read(max(size - len(MAGIC), 0), size) != MAGIC:
                raise NotMcapError(path if len(files) == 1 else file, opening)
    return files
