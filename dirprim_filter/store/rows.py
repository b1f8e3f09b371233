"""The rows of a recording as a store keeps them: whole numbers of 4 cm, ms, quarters of a degree, and dm/s."""

from __future__ import annotations

import hashlib
import io
from dataclasses import dataclass
from typing import Self

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq

from dirprim_filter.arrays import BoolArray, FloatArray, IntArray
from dirprim_filter.config import LearningConfig
from dirprim_filter.primitives.rows import TrackRows
from dirprim_filter.tracks import Tracks

SCHEMA = pa.schema([
    ("track", pa.int32()), ("group", pa.int32()), ("t_ms", pa.int64()), ("x_cm", pa.int32()), ("y_cm", pa.int32()),
    ("course_qdeg", pa.int16()), ("speed_dm_s", pa.int16()), ("weight", pa.float32()),
])  # fmt: skip
ENCODING = {f.name: "BYTE_STREAM_SPLIT" for f in SCHEMA} | dict.fromkeys(("track", "t_ms"), "DELTA_BINARY_PACKED")
"""Of Parquet. Differences of positions are no fewer bits than their bytes apart: each vehicle begins elsewhere."""
STEP_CM = 4
"""Positions are multiples of it, within 2 cm of what the log says: half a byte a row less."""
FARTHEST_M = 2e7
"""Of a position from the origin: beyond, centimetres are no 32 bits."""
FASTEST = 3000.0
"""Metres per second, likewise."""
LATEST_MS = (1 << 63) // 1_000_000 - 1
"""Of nanoseconds in 64 bits."""
MOST_ROWS = 20_000_000
"""In a file; one that claims more is not opened."""


@dataclass(frozen=True, slots=True)
class StoredRows:
    """Columns of some rows of a recording, in order of vehicles, then of time."""

    track: IntArray  # (n,) number of the vehicle in the recording
    group: IntArray  # (n,) of the log
    t_ms: IntArray
    x_cm: IntArray
    y_cm: IntArray
    course_qdeg: IntArray  # quarters of a degree of the course over ground, counter-clockwise from east
    speed_dm_s: IntArray
    weight: FloatArray  # how many vehicles the row's vehicle stands for

    @classmethod
    def of(cls, tracks: Tracks) -> Self:
        """Of the rows that learning keeps of a log.

        Raises:
            ValueError: a position or a speed that no vehicle has.
        """
        kept = TrackRows.thinned(tracks, interval_s=LearningConfig().row_interval_s)
        if (np.abs(kept.position) > FARTHEST_M).any() or (kept.speed > FASTEST).any():
            raise ValueError(
                f"position, speed: expected at most {FARTHEST_M:g} m from the origin and {FASTEST:g} m/s; choose "
                "another --set origin=... or frame=..."
            )
        group_of = np.empty(tracks.n_tracks, np.int64)
        group_of[tracks.vehicle] = np.unique(tracks.group, return_inverse=True)[1]
        x_cm, y_cm = STEP_CM * np.round(kept.position * (100.0 / STEP_CM)).astype(np.int64).T
        return cls(
            kept.vehicle, group_of[kept.vehicle], kept.time_ns // 1_000_000, x_cm, y_cm,
            np.round(np.degrees(kept.direction) * 4.0).astype(np.int64), np.round(kept.speed * 10.0).astype(np.int64),
            np.ones(len(kept)),
        )  # fmt: skip

    @classmethod
    def together(cls, parts: list[Self]) -> Self:
        """All rows of all parts of a recording."""
        none = cls(*(np.empty(0, np.int64),) * 7, np.empty(0))
        rows = cls(*(np.concatenate([getattr(part, name) for part in (none, *parts)]) for name in SCHEMA.names))
        return rows.some(np.lexsort((rows.t_ms, rows.track)))

    def __len__(self) -> int:
        return int(self.track.size)

    def some(self, rows: BoolArray | IntArray) -> Self:
        """The chosen rows, by mask or indices."""
        return type(self)(*(np.asarray(getattr(self, name))[rows] for name in SCHEMA.names))

    @property
    def position(self) -> FloatArray:
        """(n, 2) metres."""
        return np.asarray(np.column_stack([self.x_cm, self.y_cm]) * 0.01, np.float64)

    @property
    def digest(self) -> str:
        """SHA-256 of what the rows say, by which a recording counts once, however its log is written."""
        digest = hashlib.sha256()
        for name in SCHEMA.names[:-1]:
            digest.update(np.ascontiguousarray(getattr(self, name), "<i8").tobytes())
        return digest.hexdigest()

    def to_parquet(self) -> bytes:
        """A file of them, that any tool reads: see `docs/fleet.md` for how many bytes a row takes."""
        table, file = pa.table({name: getattr(self, name) for name in SCHEMA.names}, schema=SCHEMA), io.BytesIO()
        pq.write_table(
            table, file, compression="zstd", compression_level=12, use_dictionary=False, column_encoding=ENCODING,
            write_page_checksum=True, write_statistics=["t_ms", "x_cm", "y_cm"], store_schema=False,
        )  # fmt: skip
        return file.getvalue()

    @classmethod
    def from_parquet(cls, data: bytes) -> Self:
        """Of such a file, whoever wrote it.

        Raises:
            ValueError: it is none, or says of vehicles what cannot be.
        """
        try:
            file = pq.ParquetFile(io.BytesIO(data), page_checksum_verification=True)
            if file.metadata.num_rows > MOST_ROWS:
                raise ValueError(f"expected at most {MOST_ROWS} rows, got {file.metadata.num_rows}")
            table = file.read(columns=SCHEMA.names).select(SCHEMA.names)
        except (OSError, KeyError, pa.ArrowException) as error:
            raise ValueError(f"expected Parquet: {error}") from error
        if not table.schema.equals(SCHEMA) or any(column.null_count for column in table.columns):
            raise ValueError(f"expected the columns {', '.join(SCHEMA.names)}, of their types and without nulls")
        rows = cls(*(table[n].to_numpy().astype(np.float64 if n == "weight" else np.int64) for n in SCHEMA.names))
        rows._check()
        return rows

    def _check(self) -> None:
        bounds = {
            "track": (0, 2**31), "group": (0, 2**31), "t_ms": (-LATEST_MS, LATEST_MS),
            "x_cm": (-FARTHEST_M * 100, FARTHEST_M * 100), "y_cm": (-FARTHEST_M * 100, FARTHEST_M * 100),
            "course_qdeg": (-720, 720), "speed_dm_s": (0, FASTEST * 10), "weight": (1e-6, 1e9),
        }  # fmt: skip
        for name, (low, high) in bounds.items():
            column = getattr(self, name)
            if not ((column >= low) & (column <= high)).all():
                raise ValueError(f"{name}: expected {low:g} to {high:g}, got others")
        same = np.diff(self.track) == 0
        if (np.diff(self.track) < 0).any() or (np.diff(self.t_ms)[same] <= 0).any():
            raise ValueError("track, t_ms: expected rows in order of vehicles and of time, each once")

    @property
    def first(self) -> IntArray:
        """(n_vehicles,) the first row of each vehicle."""
        return np.flatnonzero(np.diff(self.track, prepend=-1))

    @property
    def vehicle(self) -> IntArray:
        """(n,) which of the vehicles each row is of."""
        return np.cumsum(np.diff(self.track, prepend=-1) > 0) - 1

    def tracks(self, track: IntArray, group: IntArray) -> Tracks:
        """As learning takes them, by numbers of vehicles and groups (n,) that are of all recordings."""
        return Tracks(
            track_id=track, time_ns=self.t_ms * 1_000_000, position=self.position,
            direction=np.radians(self.course_qdeg * 0.25), speed=np.asarray(self.speed_dm_s * 0.1, np.float64),
            group=group,
        )  # fmt: skip
