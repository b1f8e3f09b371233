"""What a part of a map cannot say of the whole, as a `dirprim.MapSummary` message.

Source: dirprim.proto.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, Self

import numpy as np
from google.protobuf.message import DecodeError

from dirprim_filter.arrays import FloatArray
from dirprim_filter.primitives.primitive_map import PrimitiveMap
from dirprim_filter.primitives.traffic import Passages, Totals
from dirprim_filter.recording.schemas import dirprim_pb2
from dirprim_filter.recording.schemas.dirprim import parse
from dirprim_filter.recording.schemas.map_tiles import VERSION
from dirprim_filter.recording.schemas.tile_message import check_version, n_cells_of, shared_part


def summary_of(primitive_map: PrimitiveMap) -> dirprim_pb2.MapSummary:
    """The summary of a map, to which tiles are then added."""
    totals = Totals.of(Passages.of(primitive_map), primitive_map.tessellation)
    return dirprim_pb2.MapSummary(
        version=VERSION,
        n_cells=primitive_map.tessellation.n_cells,
        n_manoeuvres=primitive_map.motion.n_placed,
        traffic=None if totals is None else dirprim_pb2.Traffic(**_sums(totals)),
    )


def add_tile(summary: dirprim_pb2.MapSummary, tile: dirprim_pb2.PrimitiveMap) -> None:
    """Note a tile, the next by its number; its message has nothing of its own then."""
    summary.tiles.append(dirprim_pb2.TileSummary(box=tile.box))
    shared = shared_part(tile)
    if len(summary.tiles) == 1:
        summary.shared.ParseFromString(shared)


@dataclass(frozen=True, slots=True, kw_only=True)
class MapSummary:
    """What is known of a map before any of its tiles is read.

    Attributes:
        shared: what every tile repeats.
        shared_bytes: the same, encoded.
        box: (n_tiles, 4) west, south, east and north of each tile and of all where its cells may be, metres.
        n_cells: of the map.
        n_manoeuvres: of places.
        totals: of its traffic; None where it counted no transitions.
    """

    shared: dirprim_pb2.PrimitiveMap
    shared_bytes: bytes
    box: FloatArray
    n_cells: int
    n_manoeuvres: int
    totals: Totals | None

    @property
    def grid(self) -> dirprim_pb2.Grid:
        """The squares that cells are in, none of them named."""
        return self.shared.grid if self.shared.HasField("grid") else self.shared.voronoi.region

    @classmethod
    def decoded(cls, data: bytes) -> Self:
        """Out of its message.

        Raises:
            DecodeError: bytes that are no such message, another version of it, or numbers that make no summary.
        """
        message = dirprim_pb2.MapSummary()
        parse(message, data)
        check_version(message.version)
        if n_cells_of(message.shared) or len(message.tiles) != message.shared.n_tiles:
            raise DecodeError(f"summary: expected {message.shared.n_tiles} tiles, got {len(message.tiles)}")
        box = np.array([[of.box.west, of.box.south, of.box.east, of.box.north] for of in message.tiles])
        return cls(
            shared=message.shared, shared_bytes=message.shared.SerializeToString(deterministic=True),
            box=box.reshape(-1, 4), n_cells=message.n_cells, n_manoeuvres=message.n_manoeuvres,
            totals=_totals_of(message) if message.HasField("traffic") else None,
        )  # fmt: skip


def _sums(totals: Totals) -> dict[str, Any]:
    return {name: getattr(totals, name) for name in dirprim_pb2.Traffic.DESCRIPTOR.fields_by_name}


def _totals_of(message: dirprim_pb2.MapSummary) -> Totals:
    of = message.traffic
    sums = np.array([of.area, of.seconds, of.begun, of.end_rate])
    if not (np.isfinite(sums) & (sums >= 0)).all() or not of.seconds > 0:
        raise DecodeError(f"traffic: expected no negative and no infinite sums, got {sums.tolist()}")
    return Totals(message.n_manoeuvres, of.area, of.seconds, of.begun, of.end_rate)
