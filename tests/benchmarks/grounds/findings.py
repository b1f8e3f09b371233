"""What a benchmark on neutral ground found, as plain values."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from dirprim_filter import PrimitiveMap, Tracks, learn_primitives, load_map, save_map
from dirprim_filter.evaluation.intervals import Interval
from dirprim_filter.evaluation.settings import Choice

WITH, WITHOUT, STRAIGHT = "with the map", "without the map", "constant velocity"


class Asked(NamedTuple):
    """What a ground is run on.

    Attributes:
        data: a folder laid out as `../shared/data`.
        n_seeds: runs with other random numbers.
        is_smoke: as little as shows that all of it works.
        maps: a folder where learned maps are kept and found again; None: nowhere.
    """

    data: Path
    n_seeds: int = 5
    is_smoke: bool = False
    maps: Path | None = None


def learned(tracks: Tracks, asked: Asked, name: str, *, quick_m: float) -> PrimitiveMap:
    """By the defaults, or in squares of this side where all is to be quick; or as it was before, under this name."""
    kept = None if asked.maps is None else asked.maps / f"{name}.mcap"
    if kept is not None and kept.exists():
        return load_map(kept)
    options: dict[str, Any] = {"tessellation": "grid", "cell_size": quick_m} if asked.is_smoke else {}
    found = learn_primitives(tracks, rng=np.random.default_rng(0), **options)
    if kept is not None:
        save_map(found, kept)
    return found


@dataclass(slots=True)
class Findings:
    """One table of a ground.

    Attributes:
        about: what was judged.
        rows: each method's figures.
        gains: by how much the first method of a name is better than the second.
        settings: what rivals were fitted to, and the least and greatest value tried.
    """

    about: str
    rows: dict[str, dict[str, float]] = field(default_factory=dict)
    gains: dict[str, Interval] = field(default_factory=dict)
    settings: list[Choice] = field(default_factory=list)

    def as_json(self) -> dict[str, Any]:
        """Plain values; what is not known is null."""

        def plain(values: Mapping[str, float]) -> dict[str, float | None]:
            return {key: round(float(of), 5) if math.isfinite(of) else None for key, of in values.items()}

        return {
            "about": self.about,
            "rows": {name: plain(of) for name, of in self.rows.items()},
            "gains": {name: plain(of._asdict()) for name, of in self.gains.items()},
            "settings": [choice._asdict() for choice in self.settings],
        }
