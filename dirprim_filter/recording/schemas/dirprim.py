"""Our own messages of observed and estimated motion: `dirprim.Observations` and `dirprim.TrackEstimates`.

Source: dirprim.proto. Columns travel as packed doubles, so numbers come back bit for bit.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np
from google.protobuf.message import DecodeError, Message

from dirprim_filter.arrays import FloatArray, IntArray
from dirprim_filter.detections import Detections
from dirprim_filter.estimates import Estimates
from dirprim_filter.optional_columns import is_held, unknown
from dirprim_filter.recording.schemas import dirprim_pb2
from dirprim_filter.recording.schemas.family import matrices
from dirprim_filter.track_ids import as_texts
from dirprim_filter.tracks import Tracks

if TYPE_CHECKING:
    from collections.abc import Mapping

    from google.protobuf.timestamp_pb2 import Timestamp

MAP_FRAME = "map"
"""The frame_id of all that we write: local metres, x east, y north."""

NANOSECONDS = 1_000_000_000

_ESTIMATE_COLUMNS = (
    "direction", "direction_resultant", "speed", "speed_std", "effective_sample_size", "log_evidence",
)  # fmt: skip
_COVARIANCE = ("covariance_xx", "covariance_xy", "covariance_yy")
_SIZE = ("length", "width", "height")
_CUE = ("cue_turn", "cue_concentration")
_LATER_COLUMNS = ("existence", "unseen_s")
"""Logs of before they were written have none of them."""


def set_time(stamp: Any, time_ns: int) -> None:
    """Write nanoseconds into a protobuf Timestamp or Duration; zero too, so that it is never unset."""
    stamp.SetInParent()
    stamp.seconds, stamp.nanos = divmod(int(time_ns), NANOSECONDS)


def time_of(stamp: Timestamp) -> int:
    """The nanoseconds of a protobuf Timestamp.

    Raises:
        DecodeError: they do not fit into int64.
    """
    time_ns = stamp.seconds * NANOSECONDS + stamp.nanos
    if not -(2**63) <= time_ns < 2**63:
        raise DecodeError(f"timestamp: expected nanoseconds within int64, got {stamp.seconds} s")
    return int(time_ns)


def parse(message: Message, data: bytes) -> None:
    """Parse `data` into `message`; numbers of items are then bounded by the length of `data`.

    Raises:
        DecodeError: `data` is no such message.
    """
    try:
        message.ParseFromString(data)
    except DecodeError as error:
        name = message.DESCRIPTOR.full_name
        raise DecodeError(f"{name}: {len(data)} bytes that are no such message") from error


def floats_of(message: Message, name: str, n: int) -> FloatArray:
    """(n,) the packed doubles of a field.

    Raises:
        DecodeError: there are not n of them.
    """
    column = getattr(message, name)
    if len(column) != n:
        raise DecodeError(f"{message.DESCRIPTOR.full_name}.{name}: expected {n} numbers, got {len(column)}")
    return np.array(column, dtype=np.float64)


def _covariance_of(message: Message, n: int) -> FloatArray:
    """(n, 2, 2) out of three columns."""
    return matrices(*(floats_of(message, name, n) for name in _COVARIANCE))


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
    position = observed.position[rows]
    message = dirprim_pb2.Observations(
        frame_id=MAP_FRAME,
        track_id=as_texts(observed.track_id[rows]).tolist(),
        x=position[:, 0].tolist(),
        y=position[:, 1].tolist(),
    )
    set_time(message.timestamp, time_ns)
    direction, speed = observed.direction[rows], observed.speed[rows]
    if not (np.isnan(direction).all() and np.isnan(speed).all()):
        message.direction.extend(direction.tolist())
        message.speed.extend(speed.tolist())
    if isinstance(observed, Tracks) or observed.group.any():
        message.group.extend(observed.group[rows].tolist())
    if isinstance(observed, Detections) and not np.isnan(observed.covariance[rows]).all():
        message.covariance_xx.extend(observed.covariance[rows, 0, 0].tolist())
        message.covariance_xy.extend(observed.covariance[rows, 0, 1].tolist())
        message.covariance_yy.extend(observed.covariance[rows, 1, 1].tolist())
    for names, of in ((_SIZE, observed.size), (_CUE, unknown(0, 2) if isinstance(observed, Tracks) else observed.cue)):
        if is_held(of) and not np.isnan(known := of[rows]).all():
            for name, column in zip(names, known.T.tolist(), strict=True):
                getattr(message, name).extend(column)
    if isinstance(observed, Tracks) and is_held(observed.heading):
        heading = observed.heading[rows]
        if not np.isnan(heading).all():
            message.heading.extend(heading.tolist())
    if labels:
        message.label.extend(labels.get(name, "") for name in observed.track_id[rows].tolist())
    return message


def encode_estimates(estimates: Estimates, time_ns: int) -> dirprim_pb2.TrackEstimates:
    """The estimates of one instant as a message.

    Raises:
        ValueError: an estimate is of another time.
    """
    if (estimates.time_ns != time_ns).any():
        raise ValueError(f"estimates: expected all at {time_ns} ns, got {np.unique(estimates.time_ns)} ns")
    message = dirprim_pb2.TrackEstimates(
        frame_id=MAP_FRAME,
        track_id=as_texts(estimates.track_id).tolist(),
        x=estimates.position[:, 0].tolist(),
        y=estimates.position[:, 1].tolist(),
        covariance_xx=estimates.covariance[:, 0, 0].tolist(),
        covariance_xy=estimates.covariance[:, 0, 1].tolist(),
        covariance_yy=estimates.covariance[:, 1, 1].tolist(),
        **{name: getattr(estimates, name).tolist() for name in (*_ESTIMATE_COLUMNS, *_LATER_COLUMNS)},
    )
    set_time(message.timestamp, time_ns)
    return message


def decode_estimates(data: bytes) -> Estimates:
    """The rows of a `dirprim.TrackEstimates`.

    Raises:
        DecodeError: the bytes are no such message, its columns differ in length, or a number is not finite.
    """
    message = dirprim_pb2.TrackEstimates()
    parse(message, data)
    n = len(message.track_id)
    maybe = {name: floats_of(message, name, n) for name in _LATER_COLUMNS if getattr(message, name)}
    try:
        return Estimates(
            track_id=np.array(message.track_id, dtype=np.str_),
            time_ns=np.full(n, time_of(message.timestamp), np.int64),
            position=np.column_stack([floats_of(message, "x", n), floats_of(message, "y", n)]),
            covariance=_covariance_of(message, n),
            **{name: floats_of(message, name, n) for name in _ESTIMATE_COLUMNS},
            **maybe,
        )
    except ValueError as error:
        raise DecodeError(f"dirprim.TrackEstimates: {error}") from error
