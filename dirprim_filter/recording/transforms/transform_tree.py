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
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from dirprim_filter.arrays import BoolArray, FloatArray, IntArray
from dirprim_filter.recording.container.log import Log, Scan
from dirprim_filter.recording.container.message_columns import MessageColumns
from dirprim_filter.recording.decoding.field_columns import NO_TIME, FieldColumns, signed
from dirprim_filter.recording.decoding.fields import SchemaError
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
        from scipy.spatial.transform import Rotation  # noqa: PLC0415 - logs in one frame do without

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
        topics = frozenset(channel.topic for channel in log.channels() if family_of(channel) in TRANSFORMS)
        if not topics:
            return cls({})
        decoders, losses, parts, frames = Decoders(), Losses(), list[_Transforms](), Numbers()
        scan = Scan(log, topics.__contains__, waits=False)
        for batch in batches(scan.columns(), decoders):
            for _, messages in by_schema(batch):
                if family_of(messages.first_channel) not in TRANSFORMS:
                    continue
                for _, own, columns in decoders.columns(messages):
                    if isinstance(columns, SchemaError):
                        failures = dict.fromkeys(range(len(own)), str(columns))
                    else:
                        rows = _Transforms.of(columns, own, frames)
                        failures, valid = columns.failures, rows.is_valid()
                        losses.drop(TRANSFORM_LOSS, ~valid)
                        parts.append(rows.chosen(valid))
                    if strict and failures:
                        raise DecodeError.of(log.path, own, failures)
                    losses.fail(failures.values())
        if strict and scan.damage:
            raise DamagedRecordingError(log.path, scan.damage)
        losses.damage = scan.damage
        return cls(_edges(log.path, parts, frames), losses)

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

        placed = Placement(
            Rotation.from_quat(np.broadcast_to([0.0, 0.0, 0.0, 1.0], (time_ns.size, 4))),
            np.zeros((time_ns.size, 3)),
            np.ones(time_ns.size, np.bool_),
        )
        for frame in frames:
            placed = self.edges[frame].at(time_ns).after(placed)
        return placed


class _Transforms(NamedTuple):
    """Transforms of a batch of messages: poses of the children's frames in their parents'."""

    time_ns: IntArray  # (n,)
    parent: IntArray  # (n,) by number, as texts would be as wide as the longest
    child: IntArray  # (n,)
    translation: FloatArray  # (n, 3) metres
    rotation: FloatArray  # (n, 4) quaternion x, y, z, w; unit where valid
    is_static: BoolArray  # (n,) of a topic whose transforms hold from then on

    @classmethod
    def of(cls, columns: FieldColumns, messages: MessageColumns, frames: Numbers) -> _Transforms:
        """Those of messages of one schema; frames without the slash that names began with in ROS 1."""
        parent, child = columns.names("frame"), columns.names("id")
        message = columns.message_of(columns.fields["id"].table)
        stamp_ns, log_ns = columns.times("time"), signed(messages.log_time_ns)[message]
        rotation = columns.vectors(QUATERNION)
        with np.errstate(all="ignore"):
            rotation = rotation / np.linalg.norm(rotation, axis=1, keepdims=True)
        parents, children = (frames.of(np.strings.lstrip(names, "/").tolist()) for names in (parent, child))
        rows = cls(
            time_ns=np.where((stamp_ns != NO_TIME) & (stamp_ns != 0), stamp_ns, log_ns), parent=parents, child=children,
            translation=columns.vectors(("x", "y", "z")), rotation=rotation,
            is_static=np.strings.endswith(messages.topic[message], STATIC),
        )  # fmt: skip
        return rows.chosen(~np.isin(message, list(columns.failures)))

    def chosen(self, rows: BoolArray | IntArray) -> _Transforms:
        """Those of a mask, or of indices."""
        columns: list[Any] = [column[rows] for column in self]
        return _Transforms(*columns)

    def is_valid(self) -> BoolArray:
        """(n,) which place a frame in another one, at a time whose distance to others fits into int64."""
        is_pose = np.isfinite(self.translation).all(axis=1) & (np.abs(np.square(self.rotation).sum(axis=1) - 1) < 0.5)
        return np.asarray(is_pose & (self.child != self.parent) & (np.abs(self.time_ns // 2) < 1 << 61))


def _edges(path: Path, parts: list[_Transforms], frames: Numbers) -> dict[str, Edge]:
    """The frames in the first parent that the log gives them: static ones as of the last, the others over time."""
    edges: dict[str, Edge] = {}
    if not parts:
        return edges
    rows = _Transforms(*map(np.concatenate, zip(*parts, strict=True)))
    names, order = list(frames), np.argsort(rows.child, kind="stable")
    for here in np.split(order, np.flatnonzero(np.diff(rows.child[order])) + 1) if order.size else ():
        own = rows.chosen(here)
        name = names[own.child[0]]
        if own.is_static.any():
            own = own.chosen(np.flatnonzero(own.is_static)[-1:])
        elif (has_others := own.parent != own.parent[0]).any():
            logger.warning("%s: frame %r has several parents; that in %r is taken", path, name, names[own.parent[0]])
            own = own.chosen(~has_others)
        if not (own.time_ns[1:] > own.time_ns[:-1]).all():  # of one time the last
            by_time = np.argsort(own.time_ns, kind="stable")
            own = own.chosen(by_time[np.append(np.diff(own.time_ns[by_time]) > 0, True)])
        edges[name] = Edge(
            parent=names[own.parent[0]], time_ns=own.time_ns, translation=own.translation, rotation=own.rotation
        )
    return edges
