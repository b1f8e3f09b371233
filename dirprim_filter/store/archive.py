"""Archives of a store: what recordings of a month were made one of, and thinned; see `compacting`."""

from __future__ import annotations

import json
from dataclasses import asdict, dataclass
from typing import Self

from dirprim_filter.recording.errors import RecordingError
from dirprim_filter.store.manifest import HASH

ARCHIVES = "archives"
"""The folder of them."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Archive:
    """Recordings that count together, as one file of a store, with a share of their vehicles.

    Attributes:
        name: of that file, the hash of what it holds.
        month: in which the recordings begin, UTC, such as 2026-08.
        share: of their vehicles whose steps were kept.
        recordings: the hashes of their rows.
        tiles: east and north of the tiles, see `tiles`, that there are steps in, in order.
    """

    name: str
    month: str
    share: float
    recordings: list[str]
    tiles: list[list[int]]

    def __post_init__(self) -> None:
        if not all(isinstance(rows, str) and HASH.fullmatch(rows) for rows in (self.name, *self.recordings)):
            raise ValueError("recordings: expected hashes")
        if not all(len(tile) == 2 and all(isinstance(number, int) for number in tile) for tile in self.tiles):
            raise ValueError("tiles: expected pairs of whole numbers")

    @property
    def file(self) -> str:
        """Of it in a store."""
        return f"{ARCHIVES}/{self.name}.json"

    def to_json(self) -> bytes:
        """What its file holds: where that is, it counts, and its recordings by themselves do not."""
        return json.dumps(asdict(self), sort_keys=True, indent=1).encode()

    @classmethod
    def from_json(cls, data: bytes, file: str) -> Self:
        """Of what its file holds.

        Raises:
            RecordingError: the file holds no archive.
        """
        try:
            return cls(**json.loads(data))
        except (ValueError, TypeError) as error:
            raise RecordingError(f"{file}: expected an archive of a store, got {error}; restore the file") from error
