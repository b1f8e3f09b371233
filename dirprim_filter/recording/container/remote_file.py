"""A file elsewhere, by its URL: of a log that says where its chunks stand no more is fetched than is read."""

from __future__ import annotations

import errno
import logging
import os
import re
from collections.abc import Iterator
from contextlib import contextmanager
from functools import partial
from pathlib import Path
from typing import Any, BinaryIO

from dirprim_filter.recording.container.errors import NoRoomError, RecordingError, one_line
from dirprim_filter.recording.container.temporary_copy import Copy

logger = logging.getLogger(__name__)

FETCHED_BYTES = 1 << 20
"""At a time."""
URL = re.compile(r"(?P<scheme>[A-Za-z][A-Za-z0-9+.:-]+?):/+(?P<rest>[^/].*)")
"""`Path` folds the slashes of a URL; what names no file and starts like this is taken for one."""


def as_url(name: str) -> str | None:
    """The URL that a path is, its slashes put right; None of others."""
    match = URL.fullmatch(name)
    if match is None or Path(name).exists():
        return None
    root = "/" if match["scheme"] in ("file", "local") else ""
    return f"{match['scheme']}://{root}{match['rest']}"


class RemoteFile(Copy):
    """What of it was fetched: nothing is twice."""

    is_remote = True

    def __init__(self, name: str, remote: BinaryIO) -> None:
        super().__init__(name)
        self._remote, self._fetched = remote, set[int]()
        self._size = remote.seek(0, os.SEEK_END)
        self.file.truncate(self._size)

    def _need(self, start: int, stop: int) -> None:
        for block in range(start // FETCHED_BYTES, -(-min(stop, self._size) // FETCHED_BYTES)):
            if block not in self._fetched:
                at = block * FETCHED_BYTES
                with _trying(f"{self._name}: expected its bytes {at} to {stop}"):
                    self._remote.seek(at)
                    data = self._remote.read(FETCHED_BYTES)
                    if len(data) != (wanted := min(FETCHED_BYTES, self._size - at)):
                        raise OSError(f"the server sent {len(data)} bytes of {wanted}")
                self.file.seek(at)
                self.write(data)
                self._fetched.add(block)


def remote_copy(url: str) -> Copy:
    """Fetched in parts; all of it where a server does not send parts.

    Raises:
        RecordingError: fsspec or what it needs for this scheme is missing, or the server cannot be read.
        FileNotFoundError: there is none.
    """
    with _asking(url) as fsspec:
        files, place = fsspec.core.url_to_fs(url)
        try:
            remote = RemoteFile(url, files.open(place, "rb", block_size=FETCHED_BYTES, cache_type="none"))
            end = len(ending := remote.bytes_of(live=False))
            ending.read(end - 1, end)  # the start comes of any server
        except FileNotFoundError:
            raise
        except (OSError, ValueError, TypeError, RecordingError) as error:  # no parts, or no length
            logger.info("%s", one_line(f"{url}: copied whole: {error}"))
            with files.open(place, "rb", block_size=0) as stream, _trying(f"{url}: expected all of it"):
                return Copy(url, iter(partial(stream.read, FETCHED_BYTES), b""))
        return remote


@contextmanager
def _trying(expected: str) -> Iterator[None]:
    """What comes of the network becomes one line: it is no damage of the file."""
    try:
        yield
    except NoRoomError:
        raise
    except Exception as error:  # of the kind of the file system's own package
        raise RecordingError(f"{expected}: {str(error) or type(error).__name__}; try again") from error


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
