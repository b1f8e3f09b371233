"""Rows out of one or several logs, made into tracks."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from itertools import count
from pathlib import Path

import numpy as np

from dirprim_filter.detections import NO_ID
from dirprim_filter.recording.damage import Damage
from dirprim_filter.recording.drops import ClockFaults, Drops, Numbers
from dirprim_filter.recording.observations import TimedRows
from dirprim_filter.recording.schemas.observed import NO_ROWS
from dirprim_filter.tracks import Tracks, repeated_rows
from tessellation.arrays import AnyArray, BoolArray, FloatArray, IntArray


@dataclass(frozen=True, slots=True, kw_only=True)
class TrackLog:
    """Tracks of one or more logs, and what was lost on the way.

    Attributes:
        tracks: what was read.
        damage: path and damage, for each place that could not be read.
        dropped: what of the readable messages was left out.
        clock: what is odd about the times of the messages.
    """

    tracks: Tracks
    damage: tuple[tuple[Path, Damage], ...]
    dropped: Drops
    clock: ClockFaults


@dataclass(frozen=True, slots=True, kw_only=True)
class Columns:
    """Rows as logs tell them, not yet tracks.

    Attributes:
        track_id: (n,) str.
        time_ns: (n,) int64.
        position: (n, 2) metres.
        direction: (n,) radians; NaN where the log does not tell.
        speed: (n,) m/s; NaN where the log does not tell.
        group: (n,) int64.
    """

    track_id: AnyArray
    time_ns: IntArray
    position: FloatArray
    direction: FloatArray
    speed: FloatArray
    group: IntArray

    @classmethod
    def of_rows(cls, parts: Iterable[TimedRows]) -> Columns:
        """The rows of all batches, one after the other.

        An object without a name gets one of its own, "time/number": nothing is taken for the same vehicle at two
        times, and what such a row tells of its motion is kept.
        """
        nameless = count()
        numbers = Numbers()
        of: list[IntArray] = [np.empty(0, np.int64)]
        kept = [TimedRows(np.empty(0, np.int64), NO_ROWS)]
        for part in parts:
            names = part.rows.track_id.tolist()  # as numbers at once: a column of text is as wide as its longest
            if NO_ID in names:
                times = part.time_ns.tolist()
                names = [name or f"{time}/{next(nameless)}" for name, time in zip(names, times, strict=True)]
            of.append(np.fromiter(map(numbers.__getitem__, names), np.int64, len(names)))
            kept.append(part)
        vehicles = np.array(list(numbers), dtype=np.str_)
        return cls(
            track_id=vehicles[np.concatenate(of)] if vehicles.size else np.empty(0, np.str_),
            time_ns=np.concatenate([part.time_ns for part in kept]),
            position=np.concatenate([part.rows.position for part in kept]),
            direction=np.concatenate([part.rows.direction for part in kept]),
            speed=np.concatenate([part.rows.speed for part in kept]),
            group=np.concatenate([part.rows.group for part in kept]),
        )

    @classmethod
    def of_logs(cls, logs: Sequence[Columns], names: Sequence[str]) -> Columns:
        """The rows of several logs: groups numbered anew, ids that stand in more than one told apart.

        Args:
            logs: at least one.
            names: what each is called; of equal names all get their number in the sequence behind.
        """
        if len(logs) == 1:
            return logs[0]
        names = [f"{name}-{i}" if names.count(name) > 1 else name for i, name in enumerate(names)]
        own, n_logs = np.unique(np.concatenate([np.unique(log.track_id) for log in logs]), return_counts=True)
        shared = own[n_logs > 1]
        ids, groups, n_groups = [], [], 0
        for log, name in zip(logs, names, strict=True):
            is_shared = np.isin(log.track_id, shared)
            ids.append(np.where(is_shared, np.char.add(f"{name}/", log.track_id), log.track_id))
            known, group = np.unique(log.group, return_inverse=True)
            groups.append(group.astype(np.int64) + n_groups)
            n_groups += known.size
        return cls(
            track_id=np.concatenate(ids),
            time_ns=np.concatenate([log.time_ns for log in logs]),
            position=np.concatenate([log.position for log in logs]),
            direction=np.concatenate([log.direction for log in logs]),
            speed=np.concatenate([log.speed for log in logs]),
            group=np.concatenate(groups),
        )

    def __getitem__(self, rows: BoolArray) -> Columns:
        """The rows of a mask."""
        return Columns(
            track_id=self.track_id[rows],
            time_ns=self.time_ns[rows],
            position=self.position[rows],
            direction=self.direction[rows],
            speed=self.speed[rows],
            group=self.group[rows],
        )

    def without_repeats(self, drops: Drops) -> Columns:
        """The first of the rows of each vehicle and time; the others are counted."""
        repeated = repeated_rows(self.track_id, self.time_ns)
        drops.repeated += int(repeated.sum())
        return self[~repeated] if repeated.any() else self

    def as_tracks(self, drops: Drops) -> Tracks:
        """Direction and speed as told where that is so in all rows of a vehicle, else from positions."""
        names, vehicle = np.unique(self.track_id, return_inverse=True)
        told = np.isfinite(self.direction) & np.isfinite(self.speed) & (self.speed >= 0)
        is_told = np.ones(names.size, np.bool_)
        is_told[vehicle[~told]] = False
        known, rest = self[is_told[vehicle]], self[~is_told[vehicle]]
        derived = Tracks.from_positions(
            track_id=rest.track_id, time_ns=rest.time_ns, position=rest.position, group=rest.group
        )
        drops.alone += rest.time_ns.size - len(derived)
        taken = Tracks(
            track_id=known.track_id, time_ns=known.time_ns, position=known.position,
            direction=known.direction, speed=known.speed, group=known.group,
        )  # fmt: skip
        return Tracks.concatenate([part for part in (taken, derived) if len(part)] or [taken])
