"""Where the bytes of a log come from: a file, a pipe, or a URL; in the end always a file that can be mapped.

The order of log time needs the whole log, so what cannot be mapped is copied to a temporary file first; memory stays
bounded. The copy lasts as long as the process: a pipe can be read only once, but a log is opened several times.
"""

from __future__ import annotations

import atexit
import errno
import logging
import mmap
import re
import stat
import sys
import tempfile
from os import PathLike, fspath
from pathlib import Path
from typing import BinaryIO

from dirprim_filter.recording.container.errors import NoRoomError, NotMcapError, RecordingError
from dirprim_filter.recording.container.other_formats import READ_BYTES
from dirprim_filter.recording.container.records import MAGIC

logger = logging.getLogger(__name__)

STDIN = "-"
VERSION_FREE_MAGIC = MAGIC[:5]
"""A log whose opening magic differs only behind this is read, and reported as damaged."""
BLOCK_BYTES = 1 << 22
URL = re.compile(r"(?P<scheme>[A-Za-z][A-Za-z0-9+.:-]+?):/+(?P<rest>[^/].*)")
"""`Path` folds the slashes of a URL; what names no file and starts like this is taken for one."""

_copies: dict[str, Path] = {}


def local_file(path: str | PathLike[str]) -> Path:
    """The file itself; of a pipe ("-" is standard input) or of a URL the copy, made when first asked for.

    Raises:
        RecordingError: a URL that cannot be read, or fsspec or what it needs for this scheme is missing.
        OSError: it cannot be read.
    """
    name = fspath(path)
    if name in _copies:
        return _copies[name]
    if name == STDIN:
        return _copied(name, sys.stdin.buffer)
    file = Path(name)
    if (match := URL.fullmatch(name)) and not file.exists():
        root = "/" if match["scheme"] in ("file", "local") else ""
        return _fetched(name, f"{match['scheme']}://{root}{match['rest']}")
    if not stat.S_ISREG(file.stat().st_mode) and not file.is_dir():
        with file.open("rb") as pipe:
            return _copied(name, pipe)
    return file


def drop_copy(path: str | PathLike[str]) -> None:
    """Remove the copy of a pipe or a URL, if there is one: who reads many need not keep them all."""
    if copy := _copies.pop(fspath(path), None):
        copy.unlink(missing_ok=True)


def mapped(path: str | PathLike[str]) -> mmap.mmap:
    """The bytes of a log.

    Raises:
        NotMcapError: it is empty, or neither starts nor ends like an MCAP log.
        RecordingError: a URL that cannot be read here.
        OSError: it cannot be opened.
    """
    file = local_file(path)
    with file.open("rb") as opened:
        if file.stat().st_size == 0:
            raise NotMcapError(path, b"")
        bytes_of = mmap.mmap(opened.fileno(), 0, access=mmap.ACCESS_READ)
    opening = bytes_of[:READ_BYTES]
    if not opening.startswith(VERSION_FREE_MAGIC) and bytes_of[-len(MAGIC) :] != MAGIC:
        bytes_of.close()
        raise NotMcapError(path, opening)
    return bytes_of


def let_go(file: mmap.mmap, start: int, end: int) -> None:
    """Pages of the file leave this process's memory until they are read again; else a long log would fill it."""
    first = start - start % mmap.PAGESIZE
    if hasattr(file, "madvise") and end > first:
        file.madvise(mmap.MADV_DONTNEED, first, end - first)


def _fetched(name: str, url: str) -> Path:
    try:
        import fsspec  # noqa: PLC0415 - an extra
    except ImportError as error:
        raise RecordingError(
            f"{url}: expected fsspec to read URLs, it is not installed; pip install 'dirprim-filter[remote]'"
        ) from error
    try:
        with fsspec.open(url, "rb") as remote:
            return _copied(name, remote)
    except NoRoomError:
        raise
    except FileNotFoundError as error:  # some name only a path, even if no server answers
        why = f": {error.__cause__}" if error.__cause__ else ""
        raise FileNotFoundError(errno.ENOENT, f"No such file{why}", url) from error
    except Exception as error:  # the scheme is unknown, its package is missing, or of that package's own kind
        why = str(error) or type(error).__name__
        raise RecordingError(f"{url}: expected a URL that fsspec can read: {why}; copy the log here") from error


def _copied(name: str, stream: BinaryIO) -> Path:
    with tempfile.NamedTemporaryFile(prefix="dirprim-", suffix=".mcap", delete=False) as copy:
        atexit.register(Path(copy.name).unlink, missing_ok=True)
        while block := stream.read(BLOCK_BYTES):
            try:
                copy.write(block)
            except OSError as error:
                raise NoRoomError(
                    f"{name}: expected to copy it to {tempfile.gettempdir()}: {error.strerror}; make room there, or "
                    "set TMPDIR to a folder that has some"
                ) from error
    _copies[name] = Path(copy.name)
    logger.info("%s: copied to %s", name, copy.name)
    return _copies[name]
