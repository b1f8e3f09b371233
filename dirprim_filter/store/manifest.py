"""The manifest of a store: a small file for each log that was added, so that who writes one harms no other."""

from __future__ import annotations

import hashlib
import json
import os
import re
import socket
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import BinaryIO, Literal, Self
from uuid import uuid4

from dirprim_filter.recording.errors import RecordingError

PART = ".part"
HASH = re.compile("[0-9a-f]{64}")
"""A name of a file is made of it: nothing else may be."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Entry:
    """A log that was added.

    Attributes:
        url: its URL, or its absolute path.
        size: bytes.
        mark: its ETag or time of change: the same for as long as the log is the same; empty where it is unknown.
        rows: SHA-256 of the rows that it holds, by which a recording counts once.
        n_rows: how many.
        n_vehicles: in them.
        start_ns: time of the first.
        end_ns: time of the last.
        n_squares: squares of the lattice that vehicles were in.
        tiles: east and north of the tiles, see `tiles`, that they were in, in order.
        config: `StoreConfig.digest`.
        status: whether all of the log could be read.
    """

    url: str
    size: int
    mark: str
    rows: str
    n_rows: int
    n_vehicles: int
    start_ns: int
    end_ns: int
    n_squares: int
    tiles: list[list[int]]
    config: str
    status: Literal["whole", "damaged"]

    def __post_init__(self) -> None:
        if not (isinstance(self.url, str) and isinstance(self.rows, str) and HASH.fullmatch(self.rows)):
            raise ValueError(f"rows: expected the hash of a recording, got {self.rows!r}")
        if not all(len(tile) == 2 and all(isinstance(number, int) for number in tile) for tile in self.tiles):
            raise ValueError("tiles: expected pairs of whole numbers")

    @staticmethod
    def name_of(url: str) -> str:
        """Of the file of a log in the manifest."""
        return hashlib.sha256(url.encode()).hexdigest()[:32] + ".json"

    def write(self, folder: Path) -> None:
        """Put it into a manifest, in the place of what was there of this log."""
        with new_file(folder / self.name_of(self.url)) as file:
            file.write(json.dumps(asdict(self), sort_keys=True, indent=1).encode())

    @classmethod
    def read(cls, path: Path) -> Self:
        """Read one.

        Raises:
            RecordingError: the file holds no such entry.
        """
        try:
            return cls(**json.loads(path.read_bytes()))
        except (ValueError, TypeError) as error:
            raise RecordingError(
                f"{path}: expected an entry of a store, got {error}; delete it, and add its log again"
            ) from error


@contextmanager
def new_file(path: Path) -> Iterator[BinaryIO]:
    """A file that takes its name when it is whole, in the place of any other; an exception leaves nothing."""
    part = path.with_name(f".{_owner()}-{uuid4().hex}{PART}")
    try:
        with part.open("xb") as file:
            yield file
            file.flush()
            os.fsync(file.fileno())
        part.replace(path)
    finally:
        part.unlink(missing_ok=True)


def remove_parts(folder: Path) -> None:
    """Remove what processes of this machine left that were killed while they wrote."""
    host = _owner().rpartition("-")[0]
    for part in folder.glob(f".{host}-*{PART}"):
        number = part.name.removeprefix(f".{host}-").split("-")[0]
        if number.isdigit() and not _is_alive(int(number)):
            part.unlink(missing_ok=True)


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
