"""Rows out of one or several logs, made into tracks."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace
from itertools import count
from pathlib import Path

import numpy as np

from dirprim_filter.detections import NO_ID
from dirprim_filter.optional_columns import chosen, is_held, joined, unknown
from dirprim_filter.recording.container.damage import Damage
from dirprim_filter.recording.losses import ClockFaults, Drops
from dirprim_filter.recording.objects.observations import TimedRows
from dirprim_filter.track_ids import Numbers, as_track_ids, repeated_rows, vehicle_numbers
from dirprim_filter.tracks import Tracks
from tessellation.arrays import AnyArray, ArrayValue, BoolArray, FloatArray, IntArray


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


class _Column:
    """A column under way, one block that grows: of many small ones the system would not get its memory back."""

    def __init__(self, kind: type, *width: int) -> None:
        self._values: AnyArray = np.empty((0, *width), kind)
        self._n = 0

    def extend(self, values: AnyArray) -> None:
        end = self._n + len(values)
        if end > len(self._values):
            self._values.resize((end + end // 8, *self._values.shape[1:]), refcheck=False)
        self._values[self._n : end] = values
        self._n = end

    def whole(self) -> AnyArray:
        self._values.resize((self._n, *self._values.shape[1:]), refcheck=False)
        return self._values


class _OptionalColumn(_Column):
    """Sizes or headings: begun at the first that is known, as most logs have none."""

    def __init__(self, *width: int) -> None:
        super().__init__(np.float64, *width)
        self._width = width
        self._untold = 0

    def extend(self, values: AnyArray) -> None:
        if not self._n:
            if not (is_held(values) and np.isfinite(values).any()):
                self._untold += len(values)
                return
            super().extend(unknown(self._untold, *self._width))
        super().extend(values)

    def whole(self) -> AnyArray:
        return super().whole() if self._n else unknown(self._untold, *self._width)


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Columns(ArrayValue):
    """Rows as logs tell them, not yet tracks.

    Attributes:
        names: (m,) str, of the vehicles; those of several groups may share one.
        vehicle: (n,) int64, the place of each row's vehicle among them: a column of text is as wide as its longest.
        time_ns: (n,) int64.
        position: (n, 2) metres.
        direction: (n,) radians; NaN where the log does not tell.
        speed: (n,) m/s; NaN where the log does not tell.
        group: (n,) int64.
        size: (n, 3) metres; NaN where the log does not tell.
        heading: (n,) radians; NaN where the log does not tell.
    """

    names: AnyArray
    vehicle: IntArray
    time_ns: IntArray
    position: FloatArray
    direction: FloatArray
    speed: FloatArray
    group: IntArray
    size: FloatArray
    heading: FloatArray

    @classmethod
    def of_rows(cls, parts: Iterable[TimedRows]) -> Columns:
        """The rows of all batches, one after the other.

        An object without a name gets one of its own, "time/number": nothing is taken for the same vehicle at two
        times, and what such a row tells of its motion is kept.
        """
        nameless = count()
        numbers = Numbers()
        kept = {
            "vehicle": _Column(np.int64), "time_ns": _Column(np.int64), "position": _Column(np.float64, 2),
            "direction": _Column(np.float64), "speed": _Column(np.float64), "group": _Column(np.int64),
            "size": _OptionalColumn(3), "heading": _OptionalColumn(),
        }  # fmt: skip
        for time_ns, rows in parts:
            names = rows.track_id.tolist()
            if NO_ID in names:
                named = zip(names, time_ns.tolist(), strict=True)
                names = [name or f"{time}/{next(nameless)}" for name, time in named]
            vehicle = np.fromiter(map(numbers.__getitem__, names), np.int64, len(names))
            of_batch = {"vehicle": vehicle, "time_ns": time_ns}
            for name, column in kept.items():
                column.extend(of_batch[name] if name in of_batch else getattr(rows, name))
        whole = cls(
            names=np.array(list(numbers), dtype=np.str_), **{name: column.whole() for name, column in kept.items()}
        )
        return whole._by_group() if whole.group.any() else whole

    def _by_group(self) -> Columns:
        """The same rows, where an id that stands in several groups is a vehicle in each."""
        vehicle = vehicle_numbers(self.vehicle, self.group)
        _, first = np.unique(vehicle, return_index=True)
        return replace(self, names=self.names[self.vehicle[first]], vehicle=vehicle)

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
        own, n_logs = np.unique(np.concatenate([np.unique(log.names) for log in logs]), return_counts=True)
        shared = own[n_logs > 1]
        vehicles, groups, n_groups = [], [], 0
        for log, name in zip(logs, names, strict=True):
            vehicles.append(np.where(np.isin(log.names, shared), np.char.add(f"{name}/", log.names), log.names))
            known, group = np.unique(log.group, return_inverse=True)
            groups.append(group.astype(np.int64) + n_groups)
            n_groups += known.size
        first = np.cumsum([0, *(len(log.names) for log in logs)])
        return cls(
            names=np.concatenate(vehicles),
            vehicle=np.concatenate([log.vehicle + start for log, start in zip(logs, first[:-1], strict=True)]),
            time_ns=np.concatenate([log.time_ns for log in logs]),
            position=np.concatenate([log.position for log in logs]),
            direction=np.concatenate([log.direction for log in logs]),
            speed=np.concatenate([log.speed for log in logs]),
            group=np.concatenate(groups),
            size=joined([log.size for log in logs]),
            heading=joined([log.heading for log in logs]),
        )

    def __getitem__(self, rows: BoolArray) -> Columns:
        """The rows of a mask."""
        if rows.all():
            return self
        return Columns(
            names=self.names,
            vehicle=self.vehicle[rows],
            time_ns=self.time_ns[rows],
            position=self.position[rows],
            direction=self.direction[rows],
            speed=self.speed[rows],
            group=self.group[rows],
            size=chosen(self.size, rows),
            heading=chosen(self.heading, rows),
        )

    def without_repeats(self, drops: Drops) -> Columns:
        """The first of the rows of each vehicle and time; the others are counted."""
        repeated = repeated_rows(self.vehicle, self.time_ns)
        drops.repeated += int(repeated.sum())
        return self[~repeated]

    def as_tracks(self, drops: Drops) -> Tracks:
        """Direction and speed as told where that is so in all rows of a vehicle, else from positions.

        Where only the speed is told, or the heading of the body, both stay, and the direction is derived.
        """
        told = np.isfinite(self.direction) & np.isfinite(self.speed) & (self.speed >= 0)
        is_told = np.ones(self.names.size, np.bool_)
        is_told[self.vehicle[~told]] = False
        known, rest = self[is_told[self.vehicle]], self[~is_told[self.vehicle]]
        ids = as_track_ids(self.names)
        derived = Tracks.from_positions(
            track_id=ids[rest.vehicle], time_ns=rest.time_ns, position=rest.position, group=rest.group,
            size=rest.size, heading=rest.heading, speed=np.where(rest.speed >= 0, rest.speed, np.nan),
        )  # fmt: skip
        drops.alone += rest.time_ns.size - len(derived)
        taken = Tracks(
            track_id=ids[known.vehicle], time_ns=known.time_ns, position=known.position, direction=known.direction,
            speed=known.speed, group=known.group, size=known.size, heading=known.heading,
        )  # fmt: skip
        return Tracks.concatenate([part for part in (taken, derived) if len(part)] or [taken])
