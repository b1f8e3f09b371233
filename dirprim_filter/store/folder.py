"""Where the files of a store are: a folder of this machine, or by a URL what an object store has under a prefix.

Files have names such as logs/x.json. Each is whole or not there, and who writes one harms no other: so who reads finds
nothing half, whoever is killed and whenever.
"""

from __future__ import annotations

import errno
import glob
import os
import socket
from collections.abc import Iterable, Iterator, Mapping
from contextlib import AbstractContextManager, contextmanager, suppress
from dataclasses import dataclass
from os import PathLike, fspath
from pathlib import Path
from typing import TYPE_CHECKING, BinaryIO, Protocol
from uuid import uuid4

from dirprim_filter.recording.container.source import as_url

if TYPE_CHECKING:
    from dirprim_filter.store.remote_folder import RemoteFile

PART = ".part"


class Folder(Protocol):
    """Where files are. What cannot be read or written is an `OSError` or, far away, a `RecordingError`."""

    def __str__(self) -> str:
        """As users know it."""
        ...

    @property
    def is_shared(self) -> bool:
        """Whether other processes see it."""
        ...

    def is_free(self) -> bool:
        """Whether nothing is there."""
        ...

    def make(self, *parts: str) -> None:
        """Make it, with folders in it, where folders are made at all."""
        ...

    def has(self, name: str) -> bool:
        """Whether a file is there."""
        ...

    def sizes(self, part: str) -> dict[str, int]:
        """Bytes of the files of a folder in it, by their names."""
        ...

    def read(self, name: str) -> bytes:
        """A file; `FileNotFoundError` where there is none."""
        ...

    def read_some(self, names: Iterable[str]) -> dict[str, bytes]:
        """Those of some files that are there, at once."""
        ...

    def read_all(self, part: str) -> dict[str, bytes]:
        """All files of a folder in it whose names end in .json, by their names and in order of them."""
        ...

    def gather(self, part: str, *, anew: bool) -> None:
        """Let `read_all` be fast for others; `anew` if files came or went since this process read them all."""
        ...

    def write(self, files: Mapping[str, bytes]) -> None:
        """Files by their names, each in the place of any other."""
        ...

    def create(self, name: str, data: bytes) -> bool:
        """Write a file unless it is there; -> whether it was written: of many who do so at once, by one alone."""
        ...

    def new_file(self, name: str) -> AbstractContextManager[BinaryIO]:
        """A file that is there when it is whole, in the place of any other; an exception leaves nothing."""
        ...

    def remove(self, *names: str) -> None:
        """Remove files, if they are there."""
        ...

    def remove_parts(self, *parts: str) -> None:
        """Remove what killed processes of this machine left, in some folders in it."""
        ...

    def file(self, name: str) -> Path | RemoteFile:
        """A file to be read by `open`."""
        ...


def folder_at(path: str | PathLike[str]) -> Folder:
    """The folder of a path, or of a URL that fsspec knows.

    Raises:
        ValueError: a URL with `*`, `?` or `[`, which would be more than one folder.
    """
    url = as_url(fspath(path))
    if url is None:
        return LocalFolder(Path(path))
    scheme, _, rest = url.partition("://")
    if scheme in ("file", "local"):
        return LocalFolder(Path(rest))
    if glob.has_magic(url.partition("?")[0] if scheme.startswith("http") else url):  # else a query, as of a signed URL
        raise ValueError(f"{url}: expected the URL of one store, got a pattern; leave out what stands for other names")
    from dirprim_filter.store.remote_folder import RemoteFolder  # noqa: PLC0415 (needs an extra)

    return RemoteFolder(url.rstrip("/"))


@dataclass(frozen=True, slots=True)
class LocalFolder:
    """A folder of this machine; see `Folder`."""

    path: Path

    def __str__(self) -> str:
        """Its path."""
        return str(self.path)

    @property
    def is_shared(self) -> bool:
        """As all files are."""
        return True

    def is_free(self) -> bool:
        """It is not there, or empty but for what others begin to write."""
        return not self.path.exists() or (
            self.path.is_dir() and all(path.name.endswith(PART) for path in self.path.iterdir())
        )

    def make(self, *parts: str) -> None:
        """With the folders that it is in."""
        for part in parts:
            (self.path / part).mkdir(parents=True, exist_ok=True)

    def has(self, name: str) -> bool:
        """Whether it is there."""
        return (self.path / name).exists()

    def sizes(self, part: str) -> dict[str, int]:
        """Of files that are whole."""
        found = {}
        with suppress(FileNotFoundError), os.scandir(self.path / part) as there:
            for one in there:
                if one.is_file() and not one.name.endswith(PART):
                    found[f"{part}/{one.name}"] = one.stat().st_size
        return found

    def read(self, name: str) -> bytes:
        """All of it."""
        return (self.path / name).read_bytes()

    def read_some(self, names: Iterable[str]) -> dict[str, bytes]:
        """One after the other."""
        found = {}
        for name in names:
            with suppress(FileNotFoundError):  # it may go at any time
                found[name] = self.read(name)
        return found

    def read_all(self, part: str) -> dict[str, bytes]:
        """One after the other."""
        return self.read_some(sorted(f"{part}/{path.name}" for path in (self.path / part).glob("*.json")))

    def gather(self, part: str, *, anew: bool) -> None:
        """It is."""

    def write(self, files: Mapping[str, bytes]) -> None:
        """One after the other."""
        for name, data in files.items():
            with self.new_file(name) as file:
                file.write(data)

    def create(self, name: str, data: bytes) -> bool:
        """By a link, which is refused where a file is."""
        try:
            with new_file(self.path / name, unless_there=True) as file:
                file.write(data)
        except FileExistsError:
            return False
        return True

    def new_file(self, name: str) -> AbstractContextManager[BinaryIO]:
        """Under another name until it is whole."""
        (self.path / name).parent.mkdir(exist_ok=True)  # stores are older than some of their folders
        return new_file(self.path / name)

    def remove(self, *names: str) -> None:
        """One after the other."""
        for name in names:
            (self.path / name).unlink(missing_ok=True)

    def remove_parts(self, *parts: str) -> None:
        """By the number of the process that each name holds."""
        host = _owner().rpartition("-")[0]
        for path in (path for folder in parts for path in (self.path / folder).glob(f".{host}-*{PART}")):
            number = path.name.removeprefix(f".{host}-").split("-")[0]
            if number.isdigit() and not _is_alive(int(number)):
                path.unlink(missing_ok=True)

    def file(self, name: str) -> Path:
        """Its path."""
        return self.path / name


@contextmanager
def new_file(path: Path, *, unless_there: bool = False) -> Iterator[BinaryIO]:
    """A file that takes its name when it is whole, in the place of any other; an exception leaves nothing.

    Raises:
        FileExistsError: there is another, in whose place it shall not be.
    """
    part = path.with_name(f".{_owner()}-{uuid4().hex}{PART}")
    try:
        with part.open("xb") as file:
            yield file
            file.flush()
            os.fsync(file.fileno())
        if unless_there and _has_taken(path, part):
            return
        part.replace(path)
    finally:
        part.unlink(missing_ok=True)


def _has_taken(path: Path, part: Path) -> bool:
    """Whether a file has another's name now as well; not on a disk without links, where the name is free."""
    try:
        path.hardlink_to(part)
    except FileExistsError:
        raise
    except OSError:
        if path.exists():
            raise FileExistsError(errno.EEXIST, "File exists", str(path)) from None
        return False
    return True


def _owner() -> str:
    return f"{socket.gethostname()}-{os.getpid()}"


def _is_alive(process: int) -> bool:
    try:
        os.kill(process, 0)
    except ProcessLookupError:
        return False
    except PermissionError:
        return True
    return True
