"""Rows out of one or several logs, made into tracks."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace
from itertools import count

import numpy as np

from dirprim_filter.detections import NO_ID
from dirprim_filter.recording.losses import Losses
from dirprim_filter.recording.schemas.object_rows import ObjectRows
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


KEPT = ("time_ns", "position", "direction", "speed", "group", "size", "heading")
"""Of objects, what tracks hold."""


def rows_of_log(parts: Iterable[ObjectRows]) -> VehicleRows:
    """The rows of all batches, one after the other.

    An object without a name gets one of its own, "time/number": nothing is taken for the same vehicle at two
    times, and what such a row says of its motion is kept. An id that stands in several groups is a vehicle in each.
    """
    unlabelled, numbers = count(), Numbers()
    none = np.empty(0, np.str_)
    read = [VehicleRows.of(none, time_ns=np.empty(0, np.int64), position=np.empty((0, 2)))]
    for rows in parts:
        names = rows.track_id.tolist()
        if NO_ID in names:
            named = zip(names, rows.time_ns.tolist(), strict=True)
            names = [name or f"{time}/{next(unlabelled)}" for name, time in named]
        kept = {name: getattr(rows, name) for name in KEPT}
        read.append(VehicleRows(names=none, vehicle=numbers.of(names), **kept))
    whole = VehicleRows.concatenate(read[1:] or read, names=np.array(list(numbers), dtype=np.str_))
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
