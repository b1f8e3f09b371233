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
from dataclasses import dataclass, field
from pathlib import Path
from typing import NamedTuple

import numpy as np
from scipy.spatial.transform import Rotation

from dirprim_filter.arrays import BoolArray, FloatArray, IntArray
from dirprim_filter.recording.container.log import Log, Scan
from dirprim_filter.recording.container.message_columns import MessageColumns
from dirprim_filter.recording.decoding.field_columns import NO_TIME, signed
from dirprim_filter.recording.decoding.fields import SchemaError
from dirprim_filter.recording.decoding.growing_column import GrowingColumn
from dirprim_filter.recording.errors import DamagedRecordingError, DecodeError
from dirprim_filter.recording.losses import TRANSFORMS, Losses
from dirprim_filter.recording.schemas.decoders import Decoders, batches, by_schema, family_of
from dirprim_filter.recording.schemas.transform_messages import FAMILIES, NO_TRANSFORMS, TransformRows, transforms_of
from dirprim_filter.track_ids import Numbers

logger = logging.getLogger(__name__)

MAX_GAP_NS = 2_000_000_000
"""Between transforms further apart than this nothing is interpolated: a vehicle may have turned meanwhile."""
MAX_EXTRAPOLATION_NS = 100_000_000
"""So far beyond the first and the last transform a frame is taken to move on as it did: one frame of 10 Hz."""
GEOCENTRIC = "earth"
STATIC = "tf_static"
"""How topics of transforms end that hold from then on, at all times: of a frame the latest one, as in tf2."""


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
        is_constant: all its transforms are the same, or there is but one: it holds at any time.
    """

    parent: str
    time_ns: IntArray
    translation: FloatArray
    rotation: FloatArray
    is_constant: bool = field(init=False)

    def __post_init__(self) -> None:
        values = (self.translation, self.rotation)
        same = all((of[-1] == of[0]).all() for of in values) and all((of == of[0]).all() for of in values)
        object.__setattr__(self, "is_constant", same)

    def at(self, time_ns: IntArray) -> Placement:
        """The frame in its parent at (n,) times."""
        n = time_ns.size
        if self.is_constant:
            rotation = Rotation.from_quat(np.broadcast_to(self.rotation[0], (n, 4)))
            return Placement(rotation, np.broadcast_to(self.translation[0], (n, 3)), np.ones(n, np.bool_))
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
        return Placement(
            start * Rotation.from_rotvec(turn * share[:, None]),
            self.translation[before] + moved * share[:, None],
            known,
        )


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
        topics = frozenset(channel.topic for channel in log.channels() if family_of(channel) in FAMILIES)
        if not topics:
            return cls({})
        decoders, losses, transforms = Decoders(), Losses(), _Transforms()
        scan = Scan(log, topics.__contains__)
        for batch in batches(scan.columns(), decoders):
            for _, messages in by_schema(batch):
                if family_of(messages.first_channel) not in FAMILIES:
                    continue
                rows, failures = _decoded(decoders, messages)
                if strict and failures:
                    raise DecodeError.of(log.path, messages, failures)
                losses.fail(failures.values())
                valid = _valid(rows)
                losses.drop(TRANSFORMS, ~valid)
                is_static = np.strings.endswith(messages.topic[rows.message], STATIC)
                transforms.extend(rows.of(valid & ~is_static))
                transforms.hold(rows.of(valid & is_static))
        if strict and scan.damage:
            raise DamagedRecordingError(log.path, scan.damage)
        losses.damage = scan.damage
        return cls(transforms.edges(log.path), losses)

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
        placed = Placement(
            Rotation.from_quat(np.broadcast_to([0.0, 0.0, 0.0, 1.0], (time_ns.size, 4))),
            np.zeros((time_ns.size, 3)),
            np.ones(time_ns.size, np.bool_),
        )
        for frame in frames:
            placed = self.edges[frame].at(time_ns).after(placed)
        return placed


def _decoded(decoders: Decoders, messages: MessageColumns) -> tuple[TransformRows, dict[int, str]]:
    """The transforms of messages of one schema, each with a time, and by number why a message cannot be read."""
    try:
        columns = decoders.columns(messages)
    except SchemaError as error:
        return NO_TRANSFORMS, dict.fromkeys(range(len(messages)), str(error))
    rows = transforms_of(columns)
    rows = rows.of(~np.isin(rows.message, list(columns.failures)))
    log_ns = signed(messages.log_time_ns)[rows.message]
    is_stamped = (rows.stamp_ns != NO_TIME) & (rows.stamp_ns != 0)
    return rows._replace(stamp_ns=np.where(is_stamped, rows.stamp_ns, log_ns)), columns.failures


def _valid(rows: TransformRows) -> BoolArray:
    """(n,) which transforms place a frame in another one, at a time whose distance to others fits into int64."""
    with np.errstate(over="ignore", invalid="ignore"):
        length = np.linalg.norm(rows.rotation, axis=1)
    is_pose = np.isfinite(rows.translation).all(axis=1) & np.isfinite(length) & (length > 0)
    return np.asarray(is_pose & (rows.child != rows.parent) & (np.abs(rows.stamp_ns // 2) < 1 << 61))


class _GrowingEdge:
    """A frame in the first parent that the log gives it, under way."""

    def __init__(self, parent: str) -> None:
        self.parent = parent
        self.has_others = False
        self._columns = GrowingColumn(np.int64), GrowingColumn(np.float64, 3), GrowingColumn(np.float64, 4)

    def extend(self, rows: TransformRows) -> None:
        is_own = rows.parent == self.parent
        if not is_own.all():
            self.has_others, rows = True, rows.of(is_own)
        rotation = rows.rotation / np.linalg.norm(rows.rotation, axis=1, keepdims=True)
        for column, values in zip(self._columns, (rows.stamp_ns, rows.translation, rotation), strict=True):
            column.extend(values)

    def whole(self) -> Edge:
        """In order of time; of one time the last. Columns that are in order already are not copied."""
        time_ns, translation, rotation = (column.whole() for column in self._columns)
        if not (time_ns[1:] > time_ns[:-1]).all():
            order = np.argsort(time_ns, kind="stable")
            kept = order[np.append(np.diff(time_ns[order]) > 0, True)]
            time_ns, translation, rotation = time_ns[kept], translation[kept], rotation[kept]
        return Edge(parent=self.parent, time_ns=time_ns, translation=translation, rotation=rotation)


class _Transforms:
    """The edges of a log, under way."""

    def __init__(self) -> None:
        self._edges: dict[str, _GrowingEdge] = {}
        self._static: dict[str, Edge] = {}

    def hold(self, rows: TransformRows) -> None:
        """Take the last of each frame's static transforms."""
        for i, name in enumerate(rows.child.tolist()):
            one = slice(i, i + 1)
            self._static[name] = Edge(
                parent=str(rows.parent[i]), time_ns=rows.stamp_ns[one], translation=rows.translation[one],
                rotation=rows.rotation[one] / np.linalg.norm(rows.rotation[one]),
            )  # fmt: skip

    def extend(self, rows: TransformRows) -> None:
        if not rows.stamp_ns.size:
            return
        numbers = Numbers()
        child = numbers.of(rows.child.tolist())
        names = list(numbers)
        by_child = np.argsort(child, kind="stable")
        for own in np.split(by_child, np.flatnonzero(np.diff(child[by_child])) + 1):
            name = names[child[own[0]]]
            if name not in self._edges:
                self._edges[name] = _GrowingEdge(str(rows.parent[own[0]]))
            self._edges[name].extend(rows.of(own))

    def edges(self, path: Path) -> dict[str, Edge]:
        """The edges of all transforms."""
        for name, edge in self._edges.items():
            if edge.has_others:
                logger.warning("%s: frame %r has several parents; that in %r is taken", path, name, edge.parent)
        return {name: edge.whole() for name, edge in self._edges.items()} | self._static
