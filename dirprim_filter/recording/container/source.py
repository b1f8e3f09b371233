"""Where the bytes of a log come from: files, a pipe, a URL or a bag; in the end always files that can be mapped.

The order of log time needs the whole log, so what cannot be mapped is copied to a temporary file first; memory stays
bounded. The copy lasts as long as the process: a pipe can be read only once, but a log is opened several times. Where
open files can be opened again by number, the copy has no name: nothing is left of it when the process is killed.
"""

from __future__ import annotations

import atexit
import errno
import logging
import mmap
import os
import re
import stat
import sys
import tempfile
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from functools import partial
from io import FileIO
from os import PathLike, fspath
from pathlib import Path
from typing import Any, BinaryIO, cast

from dirprim_filter.recording.container import partial_copy
from dirprim_filter.recording.container.errors import NoRoomError, NotMcapError, RecordingError
from dirprim_filter.recording.container.file_bytes import FileBytes
from dirprim_filter.recording.container.other_formats import READ_BYTES
from dirprim_filter.recording.container.partial_copy import NotInPartsError, PartialCopy, Remote
from dirprim_filter.recording.container.records import MAGIC

logger = logging.getLogger(__name__)

STDIN = "-"
BAGS = (".db3", ".bag")
"""What the names of bags end in: in SQLite, and of ROS 1."""
VERSION_FREE_MAGIC = MAGIC[:5]
"""A log whose opening magic differs only behind this is read, and reported as damaged."""
BLOCK_BYTES = 1 << 22
NO_ROOM = (errno.ENOSPC, errno.EDQUOT, errno.EFBIG)
URL = re.compile(r"(?P<scheme>[A-Za-z][A-Za-z0-9+.:-]+?):/+(?P<rest>[^/].*)")
"""`Path` folds the slashes of a URL; what names no file and starts like this is taken for one."""

OPEN_FILES = Path("/proc/self/fd")
"""Of this process by their numbers, where the system lists them."""

_copies: dict[str, Path] = {}
_in_parts: dict[str, PartialCopy] = {}
"""Of which copies chunks are missing."""


def local_files(path: str | PathLike[str]) -> list[Path]:
    """The file itself, or those of a folder that rosbag2 recorded; of what cannot be mapped the copy.

    A pipe ("-" is standard input), a URL and a bag in SQLite are copied when they are first asked for.

    Raises:
        RecordingError: a URL or a folder that cannot be read, or fsspec or what it needs for this scheme is missing.
        OSError: it cannot be read.
    """
    name = fspath(path)
    if copy := _copies.get(_key(name)):
        return [copy]
    if name == STDIN:
        return [_copied(name, _blocks(sys.stdin.buffer))]
    file = Path(name)
    if url := as_url(name):
        return [_fetched(name, url)]
    if file.is_dir() or file.suffix in BAGS:
        from dirprim_filter.recording.container import ros_bags  # noqa: PLC0415  (`dirprim info` of a log does without)

        files = ros_bags.files_of(file) if file.is_dir() else []
        return files or [_copied(name, ros_bags.as_mcap(file))]
    if not stat.S_ISREG(file.stat().st_mode):
        with file.open("rb") as pipe:
            return [_copied(name, _blocks(pipe))]
    return [file]


def copy_in_parts(path: str | PathLike[str]) -> bool:
    """Until `drop_copy`, have chunks of a URL's log come when they are first read, see `partial_copy`; whether that is.

    A log that is short, or has no whole Summary section with the places of its chunks, is to be copied whole; so is one
    of which all bytes are wanted, for a checksum.

    Raises:
        RecordingError: as `local_files`.
        OSError: as there.
    """
    name = fspath(path)
    if (url := as_url(name)) is None or _key(name) in _copies:
        return False

    from dirprim_filter.recording.container.outline import outline_by_summary  # noqa: PLC0415  (it has kernels)

    def write(file: FileIO) -> None:
        _in_parts[_key(name)] = PartialCopy(remote, file)

    try:
        with _asking(url) as fsspec:
            files, place = fsspec.core.url_to_fs(url)
            remote = Remote(files, place, int(files.info(place).get("size") or 0))
            if remote.size >= partial_copy.SHORT_BYTES:
                with mapped(_copied(name, write), path) as log:
                    outline_by_summary(log)
    except NotInPartsError as error:
        logger.info("%s: copied whole: %s", name, error)
        drop_copy(path)
    return _key(name) in _in_parts


def drop_copy(path: str | PathLike[str]) -> None:
    """Remove the copy of a pipe or a URL, if there is one: who reads many need not keep them all."""
    _in_parts.pop(_key(path), None)
    copy = _copies.pop(_key(path), None)
    if copy is None:
        return
    if copy.parent == OPEN_FILES:
        os.close(int(copy.name))
    else:
        copy.unlink(missing_ok=True)


def _key(path: str | PathLike[str]) -> str:
    """The same for a URL and for the `Path` of it, which folds its slashes."""
    return str(Path(path))


def mapped(file: Path, path: str | PathLike[str]) -> FileBytes:
    """The bytes of a local file of a log.

    Args:
        file: what is mapped.
        path: what the user calls it.

    Raises:
        NotMcapError: it is empty, or neither starts nor ends like an MCAP log.
        OSError: it cannot be opened.
    """
    with file.open("rb") as opened:
        if file.stat().st_size == 0:
            raise NotMcapError(path, b"")
        bytes_of = FileBytes(opened.fileno(), 0, access=mmap.ACCESS_READ)
        bytes_of.number = os.dup(opened.fileno())
    if copy := _in_parts.get(_key(path)):
        bytes_of.fetch = partial(copy.fetch, file)
    opening = bytes_of[:READ_BYTES]
    if not opening.startswith(VERSION_FREE_MAGIC) and bytes_of[-len(MAGIC) :] != MAGIC:
        bytes_of.close()
        raise NotMcapError(path, opening)
    return bytes_of


def as_url(name: str) -> str | None:
    """The URL that a path is, its slashes put right; None of others."""
    match = URL.fullmatch(name)
    if match is None or Path(name).exists():
        return None
    root = "/" if match["scheme"] in ("file", "local") else ""
    return f"{match['scheme']}://{root}{match['rest']}"


def _fetched(name: str, url: str) -> Path:
    with _asking(url) as fsspec, fsspec.open(url, "rb") as remote:
        return _copied(name, _blocks(remote))


@contextmanager
def _asking(url: str) -> Iterator[Any]:
    """fsspec, whose errors become ours."""
    try:
        import fsspec  # noqa: PLC0415 - an extra
    except ImportError as error:
        raise RecordingError(
            f"{url}: expected fsspec to read URLs, it is not installed; pip install 'dirprim-filter[remote]'"
        ) from error
    try:
        yield fsspec
    except RecordingError:
        raise
    except FileNotFoundError as error:  # some name only a path, even if no server answers
        why = f": {error.__cause__}" if error.__cause__ else ""
        raise FileNotFoundError(errno.ENOENT, f"No such file{why}", url) from error
    except Exception as error:  # the scheme is unknown, its package is missing, or of that package's own kind
        why = str(error) or type(error).__name__
        raise RecordingError(f"{url}: expected a URL that fsspec can read: {why}; copy the log here") from error


def _copied(name: str, write: Callable[[FileIO], None]) -> Path:
    with tempfile.NamedTemporaryFile(prefix="dirprim-", suffix=".mcap", buffering=0, delete=False) as copy:
        path = Path(copy.name)
        if OPEN_FILES.is_dir():
            path.unlink()
            path = OPEN_FILES / str(os.dup(copy.fileno()))
        else:
            atexit.register(path.unlink, missing_ok=True)
        _copies[_key(name)] = path
        try:
            write(cast("FileIO", copy))
        except BaseException as error:
            drop_copy(name)
            if not isinstance(error, OSError) or error.errno not in NO_ROOM:
                raise
            raise NoRoomError(
                f"{name}: expected to copy it to {tempfile.gettempdir()}: {error.strerror}; make room there, or "
                "set TMPDIR to a folder that has some"
            ) from error
    logger.info("%s: copied to %s", name, tempfile.gettempdir())
    return path


def _blocks(stream: BinaryIO) -> Callable[[FileIO], None]:
    """Writes what a stream holds."""

    def write(file: FileIO) -> None:
        while block := memoryview(stream.read(BLOCK_BYTES)):
            while block:
                block = block[file.write(block) :]

    return write
