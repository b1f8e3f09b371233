"""Archives of a store: what recordings of a month were made one of, and thinned; see `compacting`."""

from __future__ import annotations

import json
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Self

from dirprim_filter.recording.errors import RecordingError
from dirprim_filter.store.manifest import HASH, new_file


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

    def write(self, folder: Path) -> None:
        """From then on it counts, and its recordings by themselves do not."""
        with new_file(folder / f"{self.name}.json") as file:
            file.write(json.dumps(asdict(self), sort_keys=True, indent=1).encode())

    @classmethod
    def read(cls, path: Path) -> Self:
        """Read one.

        Raises:
            RecordingError: the file holds no archive.
        """
        try:
            return cls(**json.loads(path.read_bytes()))
        except (ValueError, TypeError) as error:
            raise RecordingError(f"{path}: expected an archive of a store, got {error}; restore the file") from error
