"""Where the bytes of a log come from, and how they are read: files, a pipe, a URL or a bag.

The order of log time needs the whole log, and a log is read several times: a pipe and a bag are copied to a temporary
file that has no name, so nothing is left of it when the process is killed; of a URL parts come as they are asked for,
so of a log that says where its chunks stand no more is fetched than is read.
"""

from __future__ import annotations

import errno
import logging
import os
import re
import stat
import sys
import tempfile
import zlib
from collections.abc import Callable, Iterable, Iterator
from contextlib import contextmanager
from functools import partial
from io import BufferedReader
from os import PathLike, fspath
from pathlib import Path
from typing import Any, BinaryIO, cast

from dirprim_filter.partial_file import NO_ROOM
from dirprim_filter.recording.container.errors import READ_BYTES, NoRoomError, NotMcapError, RecordingError, one_line
from dirprim_filter.recording.container.records import MAGIC

WINDOW_BYTES = 1 << 16
"""Short reads are served from a window of this size."""
BLOCK_BYTES = 1 << 20
"""Long ones that are only looked through come in blocks."""


class FileBytes:
    """An open file that may be cut short while it is read: what is read of it is then short too.

    Args:
        number: of the open file, which this one closes.
        need: called with the first byte that is about to be read and the one after the last, of a copy that is filled
            as it is read.
        is_live: it grows until its end has come.
        is_remote: what is not read is not fetched.
    """

    def __init__(
        self, number: int, need: Callable[[int, int], None] | None = None, *, is_live: bool = False,
        is_remote: bool = False,
    ) -> None:  # fmt: skip
        self._number, self._need = number, need or (lambda start, stop: None)
        self.is_live, self.is_remote = is_live, is_remote
        self._size = os.fstat(number).st_size
        self._at, self._window = 0, b""

    def __len__(self) -> int:
        return self._known_to(1 << 63)

    def has(self, end: int) -> bool:
        """Whether there are so many bytes; of a live pipe once that is known."""
        return end <= min(os.fstat(self._number).st_size, self._known_to(end))

    def _known_to(self, end: int) -> int:
        """Its size; of a live pipe so much of it as has come once `end` has."""
        if self.is_live:
            self._need(0, end)
            return os.fstat(self._number).st_size
        return self._size

    def read(self, start: int, stop: int) -> bytes:
        """The bytes between two places, as far as there are any."""
        stop = min(stop, self._known_to(stop))
        self._need(start, stop)
        return self._there(start, stop)

    def _there(self, start: int, stop: int) -> bytes:
        data = os.pread(self._number, max(stop - start, 0), start) if start < 1 << 63 else b""
        while (at := start + len(data)) < stop and (more := os.pread(self._number, stop - at, at)):
            data += more  # 2 GiB come at a time
        return data

    def peek(self, at: int, n: int) -> bytes:
        """The next `n` bytes from a place on, if there are so many."""
        return self.window(at, n)[:n]

    def window(self, at: int, n: int) -> bytes:
        """The next `n` bytes from a place on, if there are so many, and more that are at hand."""
        i = at - self._at
        if i < 0 or i + n > len(self._window):
            ahead = n if self.is_remote else max(n, WINDOW_BYTES)
            stop = min(at + ahead, self._known_to(at + n))
            self._need(at, min(at + n, stop))
            self._at, self._window, i = at, self._there(at, stop), 0
        return self._window[i:]

    def blocks(self, start: int = 0, stop: int | None = None) -> Iterator[bytes]:
        """The bytes between two places, some at a time."""
        end = len(self) if stop is None else stop
        return (self.read(at, min(at + BLOCK_BYTES, end)) for at in range(start, end, BLOCK_BYTES))

    def crc(self, start: int, stop: int) -> int:
        """CRC-32 of the bytes between two places."""
        found = 0
        for block in self.blocks(start, stop):
            found = zlib.crc32(block, found)
        return found

    def close(self) -> None:
        """Let go of the file."""
        if self._number >= 0:
            os.close(self._number)
            self._number = -1

    def __del__(self) -> None:
        self.close()


logger = logging.getLogger(__name__)

STDIN = "-"
BAGS = (".db3", ".bag")
"""What the names of bags end in: in SQLite, and of ROS 1."""
VERSION_FREE_MAGIC = MAGIC[:5]
"""A log whose opening magic differs only behind this is read, and reported as damaged."""
READ_AT_ONCE = 1 << 22
FETCHED_BYTES = 1 << 20
"""Of a URL, at a time."""
URL = re.compile(r"(?P<scheme>[A-Za-z][A-Za-z0-9+.:-]+?):/+(?P<rest>[^/].*)")
"""`Path` folds the slashes of a URL; what names no file and starts like this is taken for one."""


_kept: dict[str, Copy] = {}


def open_files(path: str | PathLike[str], *, live: bool = False) -> list[tuple[Path, FileBytes]]:
    """The files of a log or a table, open: one, or those of a folder that rosbag2 recorded.

    Args:
        path: a file, a folder, "-" for standard input, another pipe, a URL, or a bag.
        live: a pipe is read as it comes, not to its end first.

    Raises:
        RecordingError: a URL or a folder that cannot be read, or fsspec or what it needs for this scheme is missing.
        OSError: it cannot be read.
    """
    name, key = fspath(path), _key(path)
    file = Path(path)
    if key not in _kept:
        if name == STDIN:
            if sys.stdin is None:
                raise RecordingError("-: expected a log on standard input, which is closed; give a file, or open it")
            _kept[key] = _Pipe(name, sys.stdin.buffer)
        elif url := as_url(name):
            _kept[key] = _remote(name, url)
        elif file.is_dir() or file.suffix in BAGS:
            from dirprim_filter.recording.container import ros_bags  # noqa: PLC0415 - `dirprim info` does without

            if files := ros_bags.files_of(file) if file.is_dir() else []:
                return [(one, FileBytes(os.open(one, os.O_RDONLY))) for one in files]
            copy = Copy(name)
            ros_bags.write_mcap(file, copy)
            _kept[key] = copy
        elif not stat.S_ISREG(file.stat().st_mode):
            _kept[key] = _Pipe(name, file.open("rb"))
    bytes_of = _kept[key].bytes_of(live=live) if key in _kept else FileBytes(os.open(path, os.O_RDONLY))
    return [(Path(path), bytes_of)]


def drop_copy(path: str | PathLike[str]) -> None:
    """Forget what is kept of a pipe or a URL: who reads many need not keep them all."""
    _kept.pop(_key(path), None)


def _key(path: str | PathLike[str]) -> str:
    """The same for a URL and for the `Path` of it, which folds its slashes."""
    return str(Path(path))


def log_files(path: str | PathLike[str], *, live: bool = False) -> list[tuple[Path, FileBytes]]:
    """The same of an MCAP log.

    Raises:
        NotMcapError: a file is empty, or neither starts nor ends like one.
        RecordingError: as `open_files`.
        OSError: as there.
    """
    files = open_files(path, live=live)
    for file, bytes_of in files:
        opening = bytes_of.read(0, READ_BYTES)
        if not opening.startswith(VERSION_FREE_MAGIC):
            size = len(bytes_of)
            if bytes_of.read(max(size - len(MAGIC), 0), size) != MAGIC:
                raise NotMcapError(path if len(files) == 1 else file, opening)
    return files


def as_url(name: str) -> str | None:
    """The URL that a path is, its slashes put right; None of others."""
    match = URL.fullmatch(name)
    if match is None or Path(name).exists():
        return None
    root = "/" if match["scheme"] in ("file", "local") else ""
    return f"{match['scheme']}://{root}{match['rest']}"


class Copy:
    """A temporary file of blocks; `name` is what the user calls it."""

    def __init__(self, name: str, blocks: Iterable[bytes] = ()) -> None:
        self.file = tempfile.TemporaryFile(prefix="dirprim-", buffering=0)  # noqa: SIM115
        self.tell, self.flush = self.file.tell, self.file.flush
        self._name = name
        for block in blocks:
            self.write(block)

    def write(self, block: bytes | memoryview) -> int:
        """All of it.

        Raises:
            NoRoomError: there is none.
        """
        left = memoryview(block)
        try:
            while left:
                left = left[self.file.write(left) :]
        except OSError as error:
            if error.errno not in NO_ROOM:
                raise
            drop_copy(self._name)
            raise NoRoomError(
                f"{self._name}: expected to copy it to {tempfile.gettempdir()}: {error.strerror}; make room there, or "
                "set TMPDIR to a folder that has some"
            ) from error
        return len(block)

    def bytes_of(self, *, live: bool) -> FileBytes:
        """What it holds."""
        return FileBytes(os.dup(self.file.fileno()))

    def __del__(self) -> None:
        self.file.close()


class _Pipe(Copy):
    """What has come of a pipe."""

    def __init__(self, name: str, stream: Any) -> None:
        super().__init__(name)
        self._stream = cast("BufferedReader", stream)
        self._size: float = 0

    def _need(self, _: int, stop: int) -> None:
        """So many bytes have come, or no more will."""
        while self._size < stop:
            block = self._stream.read1(READ_AT_ONCE)
            self._size += len(block) if block else float("inf")
            self.write(block)
            if not block and self._stream is not sys.stdin.buffer:
                self._stream.close()

    def bytes_of(self, *, live: bool) -> FileBytes:
        if live:
            return FileBytes(os.dup(self.file.fileno()), self._need, is_live=True)
        self._need(0, 1 << 63)
        return super().bytes_of(live=False)


class _Remote(Copy):
    """A file elsewhere, and what of it was fetched: nothing is twice."""

    def __init__(self, name: str, remote: BinaryIO) -> None:
        super().__init__(name)
        self._remote, self._fetched = remote, set[int]()
        self.file.truncate(remote.seek(0, os.SEEK_END))

    def _need(self, start: int, stop: int) -> None:
        for block in range(start // FETCHED_BYTES, -(-stop // FETCHED_BYTES)):
            if block not in self._fetched:
                at = block * FETCHED_BYTES
                try:
                    self._remote.seek(at)
                    data = self._remote.read(FETCHED_BYTES)
                except Exception as error:  # of the kind of the file system's own package
                    why = str(error) or type(error).__name__
                    raise RecordingError(
                        f"{self._name}: expected its bytes {start} to {stop}: {why}; try again"
                    ) from error
                self.file.seek(at)
                self.write(data)
                self._fetched.add(block)

    def bytes_of(self, *, live: bool) -> FileBytes:
        return FileBytes(os.dup(self.file.fileno()), self._need, is_remote=True)


def _remote(name: str, url: str) -> Copy:
    """Fetched in parts; all of it where a server does not send parts."""
    with _asking(url) as fsspec:
        files, place = fsspec.core.url_to_fs(url)
        try:
            remote = _Remote(name, files.open(place, "rb", block_size=FETCHED_BYTES, cache_type="none"))
            remote.bytes_of(live=False).read(0, READ_BYTES)
        except FileNotFoundError:
            raise
        except (OSError, ValueError, TypeError, RecordingError) as error:  # no parts, or no length
            logger.info("%s", one_line(f"{name}: copied whole: {error}"))
            with files.open(place, "rb", block_size=0) as stream:
                return Copy(name, iter(partial(stream.read, READ_AT_ONCE), b""))
        return remote


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
