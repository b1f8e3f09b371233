"""Our own messages: `dirprim.Observations`, `dirprim.TrackEstimates` and `dirprim.Assignments`.

Source: dirprim.proto. Columns travel as packed doubles, so numbers come back bit for bit.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Any, TypeVar

import numpy as np
from google.protobuf.message import DecodeError, Message

from dirprim_filter.arrays import FloatArray, IntArray
from dirprim_filter.detections import Detections
from dirprim_filter.estimates import Assignments, Estimates
from dirprim_filter.origin import Origin
from dirprim_filter.recording.decoding.field_columns import NANOSECONDS
from dirprim_filter.recording.schemas import ASSIGNMENTS_SCHEMA, ESTIMATES_SCHEMA, dirprim_pb2
from dirprim_filter.recording.schemas.family import matrices
from dirprim_filter.track_ids import as_texts
from dirprim_filter.tracks import Tracks

Sent = TypeVar("Sent", bound=Message)
MAP_FRAME = "map"
"""The frame_id of positions that have no origin: local metres, x east, y north."""
FIELDS: dict[str, tuple[str, ...]] = {
    "position": ("x", "y"), "covariance": ("covariance_xx", "covariance_xy", "covariance_yy"),
    "size": ("length", "width", "height"), "cue": ("cue_turn", "cue_concentration"),
    **{name: (name,) for name in (
        "heading", "confidence", "direction", "direction_resultant", "speed", "speed_std", "effective_sample_size",
        "log_evidence", "existence", "unseen_s", "follows_map",
    )},
}  # fmt: skip
"""What a message calls the columns of ours."""
_LATER = ("existence", "unseen_s", "follows_map")
"""Logs of before they were written have none of them."""
DECODED: Mapping[str, tuple[type[Message], Any, Mapping[str, Any]]] = {
    ESTIMATES_SCHEMA: (dirprim_pb2.TrackEstimates, Estimates, {}),
    ASSIGNMENTS_SCHEMA: (dirprim_pb2.Assignments, Assignments, {"assigned": np.str_, "group": np.int64}),
}
"""What a tracker writes, by schema: the message, its rows, and the types of their further columns."""
_UPPER = [0, 1, 3]
"""Where the covariances are in a matrix of 2 x 2."""


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
    more: dict[str, Any] = {}
    if isinstance(observed, Tracks) or observed.group.any():
        more["group"] = observed.group[rows].tolist()
    if labels:
        more["label"] = [labels.get(name, "") for name in observed.track_id[rows].tolist()]
    return _filled(dirprim_pb2.Observations, observed, rows, time_ns, more)


def encode_estimates(estimates: Estimates, time_ns: int) -> dirprim_pb2.TrackEstimates:
    """The estimates of one instant as a message.

    Raises:
        ValueError: an estimate is of another time.
    """
    if (estimates.time_ns != time_ns).any():
        raise ValueError(f"estimates: expected all at {time_ns} ns, got {np.unique(estimates.time_ns)} ns")
    return _filled(dirprim_pb2.TrackEstimates, estimates, np.s_[:], time_ns, {})


def encode_assignments(found: Assignments, time_ns: int) -> dirprim_pb2.Assignments:
    """Which tracks the detections of one instant were assigned to, as a message."""
    group = found.group.tolist() if found.group.any() else []
    more = {"assigned": found.assigned.tolist(), "group": group}
    return _filled(dirprim_pb2.Assignments, found, np.s_[:], time_ns, more)


def _filled(
    kind: type[Sent], values: Tracks | Detections | Estimates | Assignments, rows: IntArray | slice, time_ns: int,
    more: Mapping[str, Any],
) -> Sent:  # fmt: skip
    """A message with frame, time, ids and `more`, and of each field the columns, unless nothing is known of any row."""
    columns: dict[str, Any] = {"track_id": as_texts(values.track_id[rows]).tolist(), **more}
    for name, of in FIELDS.items():
        if (field := getattr(values, name, None)) is not None:
            flat = field.reshape(len(field), math.prod(field.shape[1:]))[rows]
            flat = flat[:, _UPPER] if name == "covariance" else flat
            columns |= {} if np.isnan(flat).all() else dict(zip(of, flat.T.tolist(), strict=True))
    seconds, nanos = divmod(int(time_ns), NANOSECONDS)  # also where both are 0, so that the time is never unset
    frame = MAP_FRAME if values.origin is None else values.origin.frame
    return kind(frame_id=frame, timestamp={"seconds": seconds, "nanos": nanos}, **columns)


def decoded(schema: str, data: bytes) -> Any:
    """The rows of a message of one of the `DECODED`, which all are of one time.

    Raises:
        DecodeError: the bytes are no such message, its columns differ in length, or a number is not finite.
    """
    made, kind, more = DECODED[schema]
    message: Any = made()
    try:
        message.ParseFromString(data)  # numbers of items are then bounded by the length of the bytes
    except DecodeError as error:
        raise DecodeError(f"{schema}: {len(data)} bytes that are no such message") from error
    n, time_ns = len(message.track_id), message.timestamp.seconds * NANOSECONDS + message.timestamp.nanos
    if not -(2**63) <= time_ns < 2**63:
        raise DecodeError(f"timestamp: expected nanoseconds within int64, got {message.timestamp.seconds} s")
    columns: dict[str, Any] = {
        name: np.column_stack([_floats(message, one, n) for one in of])
        for name, of in FIELDS.items()
        if name in kind.__dataclass_fields__ and (name not in _LATER or getattr(message, name))
    }
    columns = {name: matrices(of) if name == "covariance" else of for name, of in columns.items()}
    columns = {name: of[:, 0] if of.shape[1:] == (1,) else of for name, of in columns.items()}
    try:
        return kind(
            track_id=np.array(message.track_id, dtype=np.str_), time_ns=np.full(n, time_ns, np.int64),
            origin=Origin.of_frame(message.frame_id), **columns,
            **{name: np.array(getattr(message, name), dtype=of) for name, of in more.items()},
        )  # fmt: skip
    except ValueError as error:
        raise DecodeError(f"{schema}: {error}") from error


def _floats(message: Message, name: str, n: int) -> FloatArray:
    """(n,) the packed doubles of a field."""
    column = getattr(message, name)
    if len(column) != n:
        raise DecodeError(f"{message.DESCRIPTOR.full_name}.{name}: expected {n} numbers, got {len(column)}")
    return np.array(column, dtype=np.float64)
