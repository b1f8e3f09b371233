"""How a store's logs are read and counted: fixed when it is made, for only what was counted alike adds up."""

from __future__ import annotations

import hashlib
import json
from dataclasses import asdict, dataclass, field
from functools import lru_cache
from typing import Any, Self

from dirprim_filter.recording.reader import FieldMapping, Origin, ReadOptions, TimeSource
from dirprim_filter.store.lattice import Lattice

FORMAT, BEFORE = 4, 3
"""Of stores; before, the frame stood in the file of how they are read and counted."""


@dataclass(frozen=True, slots=True, kw_only=True)
class StoreConfig:
    """How logs are read and counted.

    Attributes:
        topics: as for `read_tracks`, as are the next five.
        time_source: which time of a message counts.
        frame: of the positions.
        fields: where the fields of objects are, as `FieldMapping.parse` takes it.
        origin: latitude,longitude of the plane of satellite positions.
        labels: of the objects that are wanted.
        lattice: that motion is counted on.
    """

    topics: str | None = None
    time_source: TimeSource = "log"
    frame: str | None = None
    fields: str | None = None
    origin: str | None = None
    labels: str | None = None
    lattice: Lattice = field(default_factory=Lattice)

    @property
    def reading(self) -> ReadOptions:
        """How logs are read."""
        return ReadOptions(
            topics=self.topics, time_source=self.time_source, frame=self.frame, labels=self.labels,
            mapping=FieldMapping.parse(self.fields) if self.fields else None,
            origin=Origin.parse(self.origin) if self.origin else None,
        )  # fmt: skip

    def to_json(self) -> dict[str, Any]:
        """As `from_json` takes it."""
        return asdict(self)

    @classmethod
    def from_json(cls, said: dict[str, Any], version: int) -> Self:
        """Of what `to_json` gave.

        Raises:
            TypeError: other fields.
            ValueError: a number that is out of range, or another version of stores.
        """
        if version not in (BEFORE, FORMAT):
            raise ValueError(f"format {version}")
        return cls(**(said | {"lattice": Lattice(**said["lattice"])}))

    @property
    def digest(self) -> str:
        """Sixteen hexadecimal digits: the same for the same configuration."""
        return _digest(self)


@lru_cache
def _digest(config: StoreConfig) -> str:
    """Asked for with each of many logs."""
    return hashlib.sha256(json.dumps(config.to_json(), sort_keys=True).encode()).hexdigest()[:16]
