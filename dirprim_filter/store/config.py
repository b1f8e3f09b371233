"""How a store's logs are read: fixed when it is made, for rows that were read differently are not of one map."""

from __future__ import annotations

import json
from dataclasses import asdict, dataclass
from typing import Self

from dirprim_filter.recording.reader import FieldMapping, Origin, ReadOptions, TimeSource

FORMAT = 6
"""Of stores; those before had positions of 1 cm, or were no Delta tables."""


@dataclass(frozen=True, slots=True, kw_only=True)
class StoreConfig:
    """How logs are read.

    Attributes:
        topics: as for `read_tracks`, as are all others.
        time_source: which time of a message counts.
        frame: of the positions.
        fields: where the fields of objects are, as `FieldMapping.parse` takes it.
        origin: latitude,longitude of the plane of satellite positions.
        labels: of the objects that are wanted.
        format: of tables.
    """

    topics: str | None = None
    time_source: TimeSource = "header"
    frame: str | None = None
    fields: str | None = None
    origin: str | None = None
    labels: str | None = None
    format: str | None = None

    @property
    def reading(self) -> ReadOptions:
        """How logs are read."""
        return ReadOptions(
            topics=self.topics, time_source=self.time_source, frame=self.frame, labels=self.labels,
            format=self.format,
            mapping=FieldMapping.parse(self.fields) if self.fields else None,
            origin=Origin.parse(self.origin) if self.origin else None,
        )  # fmt: skip

    def to_json(self, frame: str) -> str:
        """With the frame that positions are in, as `from_json` takes it."""
        return json.dumps({"format": FORMAT, "frame": frame, "config": asdict(self)}, sort_keys=True)

    @classmethod
    def from_json(cls, text: str) -> tuple[Self, str]:
        """Of what `to_json` gave, and the frame.

        Raises:
            ValueError: it is of no store, or of another format.
        """
        try:
            metadata = json.loads(text)
            version, frame, config = metadata["format"], str(metadata["frame"]), dict(metadata["config"])
        except (TypeError, KeyError, ValueError) as error:
            raise ValueError("no configuration of a store") from error
        if version != FORMAT:
            raise ValueError(f"format {version}, this program reads {FORMAT}")
        return cls(**config), frame
