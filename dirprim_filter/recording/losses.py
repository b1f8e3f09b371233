"""What of a log or a table did not come through."""

from __future__ import annotations

from collections import Counter
from collections.abc import Collection
from dataclasses import dataclass, field, fields
from pathlib import Path
from typing import Self

import numpy as np

from dirprim_filter.arrays import BoolArray
from dirprim_filter.recording.container.errors import Damage, warn

UNDECODABLE = "messages that cannot be decoded"
UNTIMED = "messages without a usable time"
TRANSFORMS = "transforms that are not finite, or place a frame in itself"
INVALID = "with a position that is none or an overlong id"
FAR = (
    "that are no latitude and longitude within 300 km of the origin: placeholders such as 0,0, both swapped, degrees "
    "times 1e7, or another place"
)
REPEATED = "that repeat a vehicle and a time"
STRAY = (
    "with a stamp far from the usual offset of their topic's stamps to log time (--time-source log does without stamps)"
)
BACKWARD = (
    "later than all those that could be kept in memory to be put in order (--time-source log takes them in order)"
)
TOO_LATE = (
    "more than 0.1 s later than others, which a live pipe does not wait for (--time-source log, or track the file)"
)
UNPLACED = "of a time for which no transform of their frame is known"
OFF_WAY = "that no vehicle reaches from its rows before and after"
NEGATIVE = "speeds below 0, which count as unknown"
ALONE = "rows alone in time, so that no velocity can be derived"


@dataclass(slots=True, kw_only=True)
class Losses:
    """What of a log or a table did not come through.

    Attributes:
        damage: what of the files could not be read.
        dropped: how many rows, or messages, were left out, by reason.
        why: the reasons why messages could not be decoded, how often each.
        notes: what was put right without a loss, and how often.
        faults: what is likely to be wrong with a column, with times or with ids, a line each.
    """

    damage: list[Damage] = field(default_factory=list)
    dropped: Counter[str] = field(default_factory=Counter)
    why: Counter[str] = field(default_factory=Counter)
    notes: Counter[str] = field(default_factory=Counter)
    faults: list[str] = field(default_factory=list)

    def __iadd__(self, other: Self) -> Self:
        for f in fields(self):
            setattr(self, f.name, getattr(self, f.name) + getattr(other, f.name))
        return self

    def drop(self, reason: str, left_out: BoolArray | int) -> None:
        """Count the rows of a mask, or so many, that are left out for a reason."""
        if n := int(np.sum(left_out)):
            self.dropped[reason] += n

    def note(self, what: str, n: int) -> None:
        """Count what was put right."""
        if n:
            self.notes[what] += n

    def fail(self, reasons: Collection[str]) -> None:
        """Count messages that cannot be decoded, each for its reason."""
        self.drop(UNDECODABLE, len(reasons))
        self.why.update(reasons)

    def doubt_ids(self, n_rows: int) -> None:
        """Name the likely causes where half of so many rows, or more, repeat a vehicle and a time."""
        if 2 * self.dropped[REPEATED] >= n_rows > 0:
            self.faults.append(
                "so many repeat that ids may name no vehicles (`dirprim track --no-ids` does without), stamps may stay "
                "the same (--time-source log does without), or two sessions be in one (give each a `group`)"
            )

    def __str__(self) -> str:
        """What was left out."""
        units = dict.fromkeys((UNDECODABLE, UNTIMED, TRANSFORMS), "")
        counts = [f"{n} {units.get(reason, 'rows ')}{reason}" for reason, n in self.dropped.items()]
        why = "; ".join(f"{n} x {reason}" for reason, n in self.why.most_common(3))
        return (", ".join(counts) or "nothing") + (f" ({why})" if why else "")

    @property
    def remarks(self) -> list[str]:
        """A line for each fault and each note."""
        return [*self.faults, *(f"{n} {what}" for what, n in self.notes.items())]

    def log(self, path: Path | str) -> None:
        """A warning for what of a file could not be read, for what was left out, for each fault and each note."""
        if self.damage:
            more = f", and {len(self.damage) - 1} more" if len(self.damage) > 1 else ""
            warn(path, f"damaged, the rest is read: {self.damage[0]}{more}")
        if self.dropped:
            warn(path, f"left out {self}")
        for line in self.remarks:
            warn(path, line)
