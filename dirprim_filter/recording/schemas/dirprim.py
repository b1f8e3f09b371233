"""Our own messages of observed and estimated motion: `dirprim.Observations` and `dirprim.TrackEstimates`.

Source: dirprim.proto. Columns travel as packed doubles, so numbers come back bit for bit.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from google.protobuf.message import DecodeError, Message

from dirprim_filter.arrays import AnyArray, FloatArray, IntArray
from dirprim_filter.detections import Detections
from dirprim_filter.estimates import Estimates
from dirprim_filter.recording.schemas import dirprim_pb2
from dirprim_filter.recording.schemas.family import matrices
from dirprim_filter.track_ids import as_texts
from dirprim_filter.tracks import Tracks

MAP_FRAME = "map"
"""The frame_id of all that we write: local metres, x east, y north."""
NANOSECONDS = 1_000_000_000
_PLACE = ("x", "y")
_COVARIANCE = ("covariance_xx", "covariance_xy", "covariance_yy")
_UPPER = [0, 1, 3]
"""Where these are in a matrix of 2 x 2."""
_ESTIMATED = (
    "direction", "direction_resultant", "speed", "speed_std", "effective_sample_size", "log_evidence", "existence",
    "unseen_s", "follows_map",
)  # fmt: skip
_LATER = ("existence", "unseen_s", "follows_map")
"""Logs of before they were written have none of them."""


def encode_observations(
    observed: Tracks | Detections, rows: IntArray, time_ns: int, *, labels: Mapping[int | str, str] | None = None
) -> dirprim_pb2.Observations:
    """The rows of one instant as a message; of detections only the motion that was measured.

    Args:
        observed: rows of any instants.
        rows: (k,) those of this one.
        time_ns: its time.
        labels: what vehicles are, by their ids.
    """
    columns = _columns(_PLACE, observed.position[rows]) | _known(
        ("direction", "speed"), np.column_stack([observed.direction[rows], observed.speed[rows]])
    )
    columns |= _known(("length", "width", "height"), observed.size[rows])
    if isinstance(observed, Tracks):
        columns |= _known(("heading",), observed.heading[rows, None])
    else:
        columns |= _known(_COVARIANCE, observed.covariance[rows].reshape(-1, 4)[:, _UPPER])
        columns |= _known(("cue_turn", "cue_concentration"), observed.cue[rows])
    if isinstance(observed, Tracks) or observed.group.any():
        columns["group"] = observed.group[rows].tolist()
    names = observed.track_id[rows]
    if labels:
        columns["label"] = [labels.get(name, "") for name in names.tolist()]
    message = dirprim_pb2.Observations(frame_id=MAP_FRAME, track_id=as_texts(names).tolist(), **columns)
    _set_time(message, time_ns)
    return message


def encode_estimates(estimates: Estimates, time_ns: int) -> dirprim_pb2.TrackEstimates:
    """The estimates of one instant as a message.

    Raises:
        ValueError: an estimate is of another time.
    """
    if (estimates.time_ns != time_ns).any():
        raise ValueError(f"estimates: expected all at {time_ns} ns, got {np.unique(estimates.time_ns)} ns")
    columns = _columns(_PLACE, estimates.position)
    columns |= _columns(_COVARIANCE, estimates.covariance.reshape(-1, 4)[:, _UPPER])
    columns |= {name: getattr(estimates, name).tolist() for name in _ESTIMATED}
    message = dirprim_pb2.TrackEstimates(frame_id=MAP_FRAME, track_id=as_texts(estimates.track_id).tolist(), **columns)
    _set_time(message, time_ns)
    return message


def _columns(names: Sequence[str], values: AnyArray) -> dict[str, Any]:
    return dict(zip(names, values.T.tolist(), strict=True))


def _known(names: Sequence[str], values: FloatArray) -> dict[str, Any]:
    """The columns, (n, k), unless nothing is known of any row."""
    return {} if np.isnan(values).all() else _columns(names, values)


def _set_time(message: Any, time_ns: int) -> None:
    """Zero too, so that it is never unset."""
    message.timestamp.SetInParent()
    message.timestamp.seconds, message.timestamp.nanos = divmod(int(time_ns), NANOSECONDS)


def decode_estimates(data: bytes) -> Estimates:
    """The rows of a `dirprim.TrackEstimates`.

    Raises:
        DecodeError: the bytes are no such message, its columns differ in length, or a number is not finite.
    """
    message = dirprim_pb2.TrackEstimates()
    try:
        message.ParseFromString(data)  # numbers of items are then bounded by the length of the bytes
    except DecodeError as error:
        raise DecodeError(f"dirprim.TrackEstimates: {len(data)} bytes that are no such message") from error
    n, time_ns = len(message.track_id), message.timestamp.seconds * NANOSECONDS + message.timestamp.nanos
    if not -(2**63) <= time_ns < 2**63:
        raise DecodeError(f"timestamp: expected nanoseconds within int64, got {message.timestamp.seconds} s")
    estimated = (name for name in _ESTIMATED if name not in _LATER or getattr(message, name))
    try:
        return Estimates(
            track_id=np.array(message.track_id, dtype=np.str_),
            time_ns=np.full(n, time_ns, np.int64),
            position=np.column_stack([_floats(message, name, n) for name in _PLACE]),
            covariance=matrices(np.column_stack([_floats(message, name, n) for name in _COVARIANCE])),
            **{name: _floats(message, name, n) for name in estimated},
        )
    except ValueError as error:
        raise DecodeError(f"dirprim.TrackEstimates: {error}") from error


def _floats(message: Message, name: str, n: int) -> FloatArray:
    """(n,) the packed doubles of a field."""
    column = getattr(message, name)
    if len(column) != n:
        raise DecodeError(f"{message.DESCRIPTOR.full_name}.{name}: expected {n} numbers, got {len(column)}")
    return np.array(column, dtype=np.float64)
