"""Where the bytes of a log come from: files, a pipe, a URL or a bag; in the end always files.

The order of log time needs the whole log, so what is no file is copied to a temporary one first; memory stays bounded.
The copy lasts as long as the process: a pipe can be read only once, but a log is opened several times. Where open
files can be opened again by number, the copy has no name: nothing is left of it when the process is killed.
"""

from __future__ import annotations

import atexit
import errno
import logging
import os
import re
import stat
import sys
import tempfile
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from functools import partial
from io import BufferedReader, FileIO
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
_pipes: dict[str, _Pipe] = {}
"""Of which copies the end may be missing."""


def local_files(path: str | PathLike[str], *, live: bool = False) -> list[Path]:
    """The file itself, or those of a folder that rosbag2 recorded; of what is none the copy.

    A pipe ("-" is standard input), a URL and a bag in SQLite are copied when they are first asked for; a live pipe as
    it is read.

    Raises:
        RecordingError: a URL or a folder that cannot be read, or fsspec or what it needs for this scheme is missing.
        OSError: it cannot be read.
    """
    name = fspath(path)
    if copy := _copies.get(_key(name)):
        return [copy]
    if name == STDIN:
        return [_piped(name, sys.stdin.buffer, live=live)]
    file = Path(name)
    if url := as_url(name):
        return [_fetched(name, url)]
    if file.is_dir() or file.suffix in BAGS:
        from dirprim_filter.recording.container import ros_bags  # noqa: PLC0415  (`dirprim info` of a log does without)

        files = ros_bags.files_of(file) if file.is_dir() else []
        return files or [_copied(name, ros_bags.as_mcap(file))]
    if not stat.S_ISREG(file.stat().st_mode):
        pipe = file.open("rb")
        copy = _piped(name, pipe, live=live)
        if not live:
            pipe.close()
        return [copy]
    return [file]


def _piped(name: str, stream: BinaryIO, *, live: bool) -> Path:
    """The copy of a pipe; of a live one without what comes later."""
    if not live:
        return _copied(name, _blocks(stream))
    copy = _copied(name, lambda _: None)
    _pipes[_key(name)] = _Pipe(stream, copy)
    return copy


class _Pipe:
    """What has come of a live pipe, in a file."""

    def __init__(self, stream: BinaryIO, copy: Path) -> None:
        self._stream = cast("BufferedReader", stream)
        self._copy = copy.open("ab", buffering=0)
        self._size: float = 0

    def wait(self, _: int, stop: int) -> None:
        """Until so many bytes have come, or no more will."""
        while self._size < stop:
            block = self._stream.read1(BLOCK_BYTES)
            self._size += len(block)
            if not block:
                self.close()
            while block:
                block = block[self._copy.write(block) :]

    def close(self) -> None:
        """No more comes."""
        self._size = float("inf")
        self._copy.close()
        if self._stream is not sys.stdin.buffer:
            self._stream.close()


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
                outline_by_summary(log_bytes(_copied(name, write), path))
    except NotInPartsError as error:
        logger.info("%s: copied whole: %s", name, error)
        drop_copy(path)
    return _key(name) in _in_parts


def drop_copy(path: str | PathLike[str]) -> None:
    """Remove the copy of a pipe or a URL, if there is one: who reads many need not keep them all."""
    _in_parts.pop(_key(path), None)
    if pipe := _pipes.pop(_key(path), None):
        pipe.close()
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


def is_in_parts(path: str | PathLike[str]) -> bool:
    """Whether chunks of the log come when they are first read."""
    return _key(path) in _in_parts


def log_bytes(file: Path, path: str | PathLike[str], *, live: bool = False) -> FileBytes:
    """The bytes of a local file of a log.

    Args:
        file: what is read.
        path: what the user calls it.
        live: of a pipe as they come, if it was opened so.

    Raises:
        NotMcapError: it is empty, or neither starts nor ends like an MCAP log.
        OSError: it cannot be opened.
    """
    copy, pipe = _in_parts.get(_key(path)), _pipes.get(_key(path))
    if pipe and not live:
        pipe.wait(0, 1 << 63)
    if pipe and live:
        bytes_of = FileBytes(file, supply=pipe.wait, is_live=True)
    else:
        bytes_of = FileBytes(file, supply=partial(copy.fetch, file) if copy else None)
    opening = bytes_of.read(0, READ_BYTES)
    if opening.startswith(VERSION_FREE_MAGIC):
        return bytes_of
    size = len(bytes_of)
    if bytes_of.read(max(size - len(MAGIC), 0), size) == MAGIC:
        return bytes_of
    bytes_of.close()
    raise NotMcapError(path, opening)


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
