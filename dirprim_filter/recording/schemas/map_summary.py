"""What a part of a map cannot say of the whole, as a message `dirprim.MapSummary`: which tiles there are, and sums.

A map can be read without it, but only whole. Source of the tables: `map_tiles`.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Self

import numpy as np

from dirprim_filter.arrays import FloatArray
from dirprim_filter.primitives.primitive_map import PrimitiveMap
from dirprim_filter.primitives.traffic import Passages, Totals
from dirprim_filter.recording.schemas.arrow_message import ArrowMessage, encode
from dirprim_filter.recording.schemas.map_tiles import NOTHING, VERSION, OfAll, shared_by_tiles, tables_of
from tessellation.tiles import Tile

SUMS = ("area", "seconds", "begun", "end_rate")


def encode_summary(primitive_map: PrimitiveMap, tiles: list[Tile]) -> bytes:
    """The summary of a map; it is a tile without cells as well.

    Args:
        primitive_map: the map.
        tiles: its tiles.
    """
    totals = Totals.of(Passages.of(primitive_map), primitive_map.tessellation)
    scalars, tables = shared_by_tiles(primitive_map, len(tiles))
    sizes = {"n_cells": primitive_map.tessellation.n_cells, "n_manoeuvres": primitive_map.motion.n_placed}
    return encode(scalars | sizes, tables_of(primitive_map, NOTHING, OfAll.of(primitive_map)) | tables | {
        "tile": {"box": np.array([tile.box for tile in tiles])},
        "traffic": {name: np.array([] if totals is None else [getattr(totals, name)]) for name in SUMS},
    })  # fmt: skip


def check_version(message: ArrowMessage) -> None:
    """Whether a message is of the version that this program reads.

    Raises:
        ValueError: it is not.
    """
    version = message.whole_number("version")
    if version != VERSION:
        age = "an older" if version < VERSION else "a newer"
        raise ValueError(f"it is of {age} version, {version}; this program reads version {VERSION}")


@dataclass(frozen=True, slots=True, kw_only=True)
class MapSummary:
    """What is known of a map before any of its tiles is read.

    Attributes:
        shared: what every tile repeats.
        box: (n_tiles, 4) west, south, east and north of each tile and of all where its cells may be, metres.
        n_cells: of the map.
        n_manoeuvres: of places.
        totals: of its traffic; None where it counted no transitions.
    """

    shared: ArrowMessage
    box: FloatArray
    n_cells: int
    n_manoeuvres: int
    totals: Totals | None

    @classmethod
    def decoded(cls, data: bytes) -> Self:
        """Out of its message.

        Raises:
            ValueError: bytes that are no such message, another version of it, or numbers that make no summary.
        """
        message = ArrowMessage(data)
        check_version(message)
        n_tiles, box = message.whole_number("n_tiles"), message.table("tile", floats=("box",))["box"]
        if box.shape != (n_tiles, 4) or not n_tiles:
            raise ValueError(f"summary: expected {n_tiles} tiles, got {len(box)}")
        return cls(
            shared=message, box=box,
            n_cells=message.whole_number("n_cells"), n_manoeuvres=message.whole_number("n_manoeuvres"),
            totals=_totals(message) if message.rows("traffic") else None,
        )  # fmt: skip


def _totals(message: ArrowMessage) -> Totals:
    area, seconds, begun, end_rate = (float(of[0]) for of in message.table("traffic", floats=SUMS).values())
    sums = np.array([area, seconds, begun, end_rate])
    if not (np.isfinite(sums) & (sums >= 0)).all() or not seconds > 0:
        raise ValueError(f"traffic: expected no negative and no infinite sums, got {sums.tolist()}")
    return Totals(message.whole_number("n_manoeuvres"), area, seconds, begun, end_rate)
