"""Rows out of one or several logs, made into tracks."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace
from itertools import count

import numpy as np

from dirprim_filter.detections import NO_ID
from dirprim_filter.recording.losses import Losses
from dirprim_filter.recording.rows import LEFT_OUT, Rows
from dirprim_filter.track_ids import Numbers
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


OF_MESSAGES = ("message", "stamp_ns", "frame_id", "height", "climb", "covariance", "label", "cue")
"""Columns that tracks do not hold."""


def rows_of_log(parts: Iterable[Rows]) -> Rows:
    """The rows of all batches, one after the other.

    An object without a name gets one of its own, "time/number": nothing is taken for the same vehicle at two
    times, and what such a row says of its motion is kept. An id that stands in several groups is a vehicle in each.
    """
    unlabelled, numbers = count(), Numbers()
    read = [Rows(track_id=numbers.of(()), time_ns=np.empty(0, np.int64), position=np.empty((0, 2)))]
    for rows in parts:
        names = rows.track_id.tolist()
        if NO_ID in names:
            named = zip(names, rows.time_ns.tolist(), strict=True)
            names = [name or f"{time}/{next(unlabelled)}" for name, time in named]
        read.append(replace(rows, track_id=numbers.of(names), **dict.fromkeys(OF_MESSAGES, LEFT_OUT)))
    whole = Rows.concatenate(read[1:] or read, names=np.array(list(numbers), dtype=np.str_))
    return whole.by_group() if whole.group.any() else whole


def rows_of_logs(logs: Sequence[Rows], names: Sequence[str]) -> Rows:
    """The rows of several logs: groups numbered anew, ids that stand in more than one made different.

    Args:
        logs: at least one, with `names`.
        names: what each is called; of equal names all get their number in the sequence behind.
    """
    if len(logs) == 1:
        return logs[0]
    names = [f"{name}-{i}" if names.count(name) > 1 else name for i, name in enumerate(names)]
    own, n_logs = np.unique(np.concatenate([np.unique(log.names) for log in logs]), return_counts=True)
    parts, vehicles, n_vehicles, n_groups = [], [], 0, 0
    for log, name in zip(logs, names, strict=True):
        is_shared = np.isin(log.names, own[n_logs > 1])
        vehicles.append(np.where(is_shared, np.char.add(f"{name}/", log.names), log.names))
        known, group = np.unique(log.group, return_inverse=True)
        parts.append(replace(log, track_id=log.track_id + n_vehicles, group=group.astype(np.int64) + n_groups))
        n_vehicles += log.names.size
        n_groups += known.size
    return Rows.concatenate(parts, names=np.concatenate(vehicles))
