"""Rows out of one or several logs, made into tracks."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace
from functools import partial
from itertools import count

import numpy as np

from dirprim_filter.arrays import AnyArray
from dirprim_filter.detections import NO_ID
from dirprim_filter.optional_columns import is_held, unknown
from dirprim_filter.recording.decoding.growing_column import GrowingColumn
from dirprim_filter.recording.losses import Losses
from dirprim_filter.recording.objects.observations import TimedRows
from dirprim_filter.recording.vehicle_rows import VehicleRows
from dirprim_filter.track_ids import Numbers, vehicle_numbers
from dirprim_filter.tracks import Tracks


@dataclass(frozen=True, slots=True, kw_only=True)
class TrackResult:
    """Tracks of one or more logs, and what was lost on the way.

    Attributes:
        tracks: what was read.
        losses: what was damaged, left out or odd.
        frame: of the last log's positions: a frame's name, or "plane at LATITUDE,LONGITUDE"; empty where none is named.
    """

    tracks: Tracks
    losses: Losses
    frame: str = ""


class _OptionalColumn(GrowingColumn):
    """Sizes or headings: begun at the first that is known, as most logs have none."""

    def __init__(self, *width: int) -> None:
        super().__init__(np.float64, *width)
        self._width = width
        self._n_unknown = 0

    def extend(self, values: AnyArray) -> None:
        if not self._n:
            if not (is_held(values) and np.isfinite(values).any()):
                self._n_unknown += len(values)
                return
            super().extend(unknown(self._n_unknown, *self._width))
        super().extend(values)

    def whole(self) -> AnyArray:
        return super().whole() if self._n else unknown(self._n_unknown, *self._width)


def rows_of_log(parts: Iterable[TimedRows]) -> VehicleRows:
    """The rows of all batches, one after the other.

    An object without a name gets one of its own, "time/number": nothing is taken for the same vehicle at two
    times, and what such a row says of its motion is kept. An id that stands in several groups is a vehicle in each.
    """
    unlabelled = count()
    numbers = Numbers()
    number, real = partial(GrowingColumn, np.int64), partial(GrowingColumn, np.float64)
    columns = {
        "vehicle": number(), "time_ns": number(), "position": real(2), "direction": real(), "speed": real(),
        "group": number(), "size": _OptionalColumn(3), "heading": _OptionalColumn(),
    }  # fmt: skip
    for time_ns, rows in parts:
        names = rows.track_id.tolist()
        if NO_ID in names:
            named = zip(names, time_ns.tolist(), strict=True)
            names = [name or f"{time}/{next(unlabelled)}" for name, time in named]
        of_batch = {"vehicle": numbers.of(names), "time_ns": time_ns}
        for name, column in columns.items():
            column.extend(of_batch[name] if name in of_batch else getattr(rows, name))
    whole = VehicleRows(
        names=np.array(list(numbers), dtype=np.str_), **{name: column.whole() for name, column in columns.items()}
    )
    if not whole.group.any():
        return whole
    vehicle = vehicle_numbers(whole.vehicle, whole.group)
    _, first = np.unique(vehicle, return_index=True)
    return replace(whole, names=whole.names[whole.vehicle[first]], vehicle=vehicle)


def rows_of_logs(logs: Sequence[VehicleRows], names: Sequence[str]) -> VehicleRows:
    """The rows of several logs: groups numbered anew, ids that stand in more than one made different.

    Args:
        logs: at least one.
        names: what each is called; of equal names all get their number in the sequence behind.
    """
    if len(logs) == 1:
        return logs[0]
    names = [f"{name}-{i}" if names.count(name) > 1 else name for i, name in enumerate(names)]
    own, n_logs = np.unique(np.concatenate([np.unique(log.names) for log in logs]), return_counts=True)
    shared = own[n_logs > 1]
    parts, vehicles, n_vehicles, n_groups = [], [], 0, 0
    for log, name in zip(logs, names, strict=True):
        vehicles.append(np.where(np.isin(log.names, shared), np.char.add(f"{name}/", log.names), log.names))
        known, group = np.unique(log.group, return_inverse=True)
        parts.append(replace(log, vehicle=log.vehicle + n_vehicles, group=group.astype(np.int64) + n_groups))
        n_vehicles += len(log.names)
        n_groups += known.size
    return VehicleRows.concatenate(parts, names=np.concatenate(vehicles))
