"""Where the frames of a log are in each other over time.

Frames form trees: each has one parent. Between two transforms the translation is interpolated on a line and the
rotation at a constant rate, by scipy's rotations, which are here already and do columns of times at once.
pytransform3d, the other library looked at, interpolates screws over float times and knows no gaps; it is the oracle
in the tests.

Source: REP 105 (`earth` is geocentric, so no plane); tf2's `lookupTransform`.
"""

from __future__ import annotations

import logging
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from dirprim_filter.arrays import AnyArray, BoolArray, FloatArray, IntArray
from dirprim_filter.recording.container.log import Log, Scan
from dirprim_filter.recording.container.message_columns import MessageColumns
from dirprim_filter.recording.decoding.field_columns import NO_TIME, FieldColumns, SchemaError, signed
from dirprim_filter.recording.errors import DamagedRecordingError, DecodeError
from dirprim_filter.recording.losses import TRANSFORMS as TRANSFORM_LOSS
from dirprim_filter.recording.losses import Losses
from dirprim_filter.recording.schemas.decoders import Decoders, batches, by_schema, family_of
from dirprim_filter.recording.schemas.families import TRANSFORMS
from dirprim_filter.recording.schemas.family import QUATERNION
from dirprim_filter.track_ids import Numbers

if TYPE_CHECKING:
    from scipy.spatial.transform import Rotation

logger = logging.getLogger(__name__)

MAX_GAP_NS = 2_000_000_000
"""Between transforms further apart than this nothing is interpolated: a vehicle may have turned meanwhile."""
MAX_EXTRAPOLATION_NS = 100_000_000
"""So far beyond the first and the last transform a frame is taken to move on as it did: one frame of 10 Hz."""
GEOCENTRIC = "earth"
STATIC = "tf_static"
"""How topics of transforms end that hold from then on, at all times: of a frame the latest one, as in tf2."""


ROW = np.dtype([
    ("time_ns", np.int64), ("parent", np.int64), ("child", np.int64), ("translation", np.float64, 3),
    ("rotation", np.float64, 4), ("is_static", np.bool_),
])  # fmt: skip
"""A transform: the pose of the child's frame in its parent's, frames by number, the rotation a unit quaternion."""


class Placement(NamedTuple):
    """The pose of a frame in another one, at some times."""

    rotation: Rotation  # n of them
    translation: FloatArray  # (n, 3)
    known: BoolArray  # (n,) else meaningless

    def after(self, inner: Placement) -> Placement:
        """First `inner`, then this."""
        translation = self.rotation.apply(inner.translation) + self.translation
        return Placement(self.rotation * inner.rotation, translation, self.known & inner.known)

    def inverse(self) -> Placement:
        """The way back."""
        back = self.rotation.inv()
        return Placement(back, -back.apply(self.translation), self.known)


@dataclass(frozen=True, slots=True, kw_only=True)
class Edge:
    """A frame in its parent over time.

    Attributes:
        parent: name of the frame that it is in.
        time_ns: (n,) ascending, no time twice.
        translation: (n, 3) metres.
        rotation: (n, 4) unit quaternions.
    """

    parent: str
    time_ns: IntArray
    translation: FloatArray
    rotation: FloatArray

    def at(self, time_ns: IntArray) -> Placement:
        """The frame in its parent at (n,) times; one whose transforms are all the same is there at any time."""
        from scipy.spatial.transform import Rotation  # noqa: PLC0415 - logs in one frame do without

        if all((of == of[0]).all() for of in (self.translation, self.rotation)):
            still, n = np.zeros_like(time_ns), time_ns.size
            return Placement(Rotation.from_quat(self.rotation[still]), self.translation[still], np.ones(n, np.bool_))
        before = np.clip(np.searchsorted(self.time_ns, time_ns, side="right") - 1, 0, self.time_ns.size - 2)
        gap = self.time_ns[before + 1] - self.time_ns[before]
        share = (time_ns - self.time_ns[before]) / gap
        known = (time_ns >= self.time_ns[0] - MAX_EXTRAPOLATION_NS) & (
            time_ns <= self.time_ns[-1] + MAX_EXTRAPOLATION_NS
        )
        known &= (gap <= MAX_GAP_NS) | (share == 0) | (share == 1)
        start = Rotation.from_quat(self.rotation[before])
        turn = (start.inv() * Rotation.from_quat(self.rotation[before + 1])).as_rotvec()
        moved = self.translation[before + 1] - self.translation[before]
        placed = self.translation[before] + moved * share[:, None]
        return Placement(start * Rotation.from_rotvec(turn * share[:, None]), placed, known)


class TransformTree:
    """The frames of a log.

    Attributes:
        edges: by the name of a frame, where it is in its parent.
        losses: what of the log was damaged, and of its transforms left out.
    """

    def __init__(self, edges: Mapping[str, Edge], losses: Losses | None = None) -> None:
        self.edges = edges
        self.losses = losses or Losses()

    @classmethod
    def of_log(cls, log: Log, *, strict: bool = False) -> TransformTree:
        """All transforms of a log; those that cannot be decoded, or are none, are left out and counted.

        A stamp of zero is none: the message's log time stands in.

        Args:
            log: the log.
            strict: raise at the first damage, or message that is not what its schema says.

        Raises:
            DamagedRecordingError: strict, and the log is damaged.
            DecodeError: strict, and a message is not what its schema says.
        """
        topics = frozenset(channel.topic for channel in log.channels() if family_of(channel) in TRANSFORMS)
        decoders, losses, parts, frames = Decoders(), Losses(), [np.empty(0, ROW)], Numbers()
        scan = Scan(log, topics.__contains__, waits=False)
        for batch in batches(scan.columns(), decoders) if topics else ():
            for _, messages in by_schema(batch):
                if family_of(messages.first_channel) not in TRANSFORMS:
                    continue
                for _, own, columns in decoders.columns(messages):
                    if isinstance(columns, SchemaError):
                        failures = dict.fromkeys(range(len(own)), str(columns))
                    else:
                        rows = _rows(columns, own, frames)
                        failures, valid = columns.failures, _are_valid(rows)
                        losses.drop(TRANSFORM_LOSS, ~valid)
                        parts.append(rows[valid])
                    if strict and failures:
                        raise DecodeError.of(log.path, own, failures)
                    losses.fail(failures.values())
        if strict and scan.damage:
            raise DamagedRecordingError(log.path, scan.damage)
        losses.damage = scan.damage
        return cls(_edges(log.path, np.concatenate(parts), list(frames)), losses)

    def chain(self, frame: str) -> list[str]:
        """The frame, its parent, and so on up to the root."""
        chain = [frame]
        while chain[-1] in self.edges and len(chain) <= len(self.edges):
            chain.append(self.edges[chain[-1]].parent)
        return chain

    def root_of(self, frame: str) -> str:
        """The frame at the top of this one's tree; below `earth`, which is no plane."""
        chain = self.chain(frame)
        return chain[-2] if chain[-1] == GEOCENTRIC and len(chain) > 1 else chain[-1]

    def placement(self, frame: str, target: str, time_ns: IntArray) -> Placement | None:
        """`frame` in `target` at (n,) times; None where nothing joins the two."""
        up, down = self.chain(frame), self.chain(target)
        joint = next((name for name in up if name in down), None)
        if joint is None:
            return None
        return (
            self._climb(down[: down.index(joint)], time_ns).inverse().after(self._climb(up[: up.index(joint)], time_ns))
        )

    def _climb(self, frames: Iterable[str], time_ns: IntArray) -> Placement:
        from scipy.spatial.transform import Rotation  # noqa: PLC0415 - logs in one frame do without

        n = time_ns.size
        placed = Placement(Rotation.from_rotvec(np.zeros((n, 3))), np.zeros((n, 3)), np.ones(n, np.bool_))
        for frame in frames:
            placed = self.edges[frame].at(time_ns).after(placed)
        return placed


def _rows(columns: FieldColumns, messages: MessageColumns, frames: Numbers) -> AnyArray:
    """Those of messages of one schema, as `ROW`; frames without the slash that names began with in ROS 1."""
    message = columns.message_of(columns.fields["id"].table)
    rows, stamp_ns = np.empty(message.size, ROW), columns.times("time")
    rows["time_ns"] = np.where((stamp_ns != NO_TIME) & (stamp_ns != 0), stamp_ns, signed(messages.log_time_ns)[message])
    for end, label in (("parent", "frame"), ("child", "id")):
        rows[end] = frames.of(np.strings.lstrip(columns.names(label), "/").tolist())
    rows["translation"], rotation = columns.vectors(("x", "y", "z")), columns.vectors(QUATERNION)
    with np.errstate(all="ignore"):
        rows["rotation"] = rotation / np.linalg.norm(rotation, axis=1, keepdims=True)
    rows["is_static"] = np.strings.endswith(messages.topic[message], STATIC)
    return np.asarray(rows[~np.isin(message, list(columns.failures))])


def _are_valid(rows: AnyArray) -> BoolArray:
    """(n,) which place a frame in another one, at a time whose distance to others fits into int64."""
    is_pose = np.isfinite(rows["translation"]).all(axis=1) & (np.abs(np.square(rows["rotation"]).sum(axis=1) - 1) < 0.5)
    return np.asarray(is_pose & (rows["child"] != rows["parent"]) & (np.abs(rows["time_ns"] // 2) < 1 << 61))


def _edges(path: Path, rows: AnyArray, names: list[str]) -> dict[str, Edge]:
    """The frames in the first parent that the log gives them: static ones as of the last, the others over time."""
    edges: dict[str, Edge] = {}
    order = np.argsort(rows["child"], kind="stable")
    for here in np.split(order, np.flatnonzero(np.diff(rows["child"][order])) + 1) if order.size else ():
        own = rows[here]
        name, parent = names[own["child"][0]], own["parent"][0]
        if own["is_static"].any():
            own = own[np.flatnonzero(own["is_static"])[-1:]]
            parent = own["parent"][0]
        elif (own["parent"] != parent).any():
            logger.warning("%s: frame %r has several parents; that in %r is taken", path, name, names[parent])
            own = own[own["parent"] == parent]
        own = own[np.argsort(own["time_ns"], kind="stable")]
        own = own[np.append(np.diff(own["time_ns"]) > 0, True)]  # of one time the last
        columns = {of: np.ascontiguousarray(own[of]) for of in ("time_ns", "translation", "rotation")}
        edges[name] = Edge(parent=names[parent], **columns)
    return edges
