"""The manifest of a store: a small file for each log that was added, so that who writes one harms no other."""

from __future__ import annotations

import hashlib
import json
import re
from dataclasses import asdict, dataclass
from typing import Literal, Self

from dirprim_filter.recording.errors import RecordingError

MANIFEST = "logs"
"""The folder of entries."""
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
        """Of the files of a log."""
        return hashlib.sha256(url.encode()).hexdigest()[:32] + ".json"

    @classmethod
    def file_of(cls, url: str) -> str:
        """Of a log in the manifest."""
        return f"{MANIFEST}/{cls.name_of(url)}"

    def to_json(self) -> bytes:
        """What its file holds."""
        return json.dumps(asdict(self), sort_keys=True, indent=1).encode()

    @classmethod
    def from_json(cls, data: bytes, file: str) -> Self:
        """Of what its file holds.

        Raises:
            RecordingError: the file holds no such entry.
        """
        try:
            return cls(**json.loads(data))
        except (ValueError, TypeError) as error:
            raise RecordingError(
                f"{file}: expected an entry of a store, got {error}; delete it, and add its log again"
            ) from error
