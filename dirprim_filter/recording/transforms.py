"""Where the frames of a log are in each other over time, and objects brought into one of them.

Frames form trees: each has one parent. Between two transforms the translation is interpolated on a line and the
rotation at a constant rate, by scipy's rotations, which are here already and do columns of times at once.
pytransform3d, the other library looked at, interpolates screws over float times and knows no gaps; it is the oracle
in the tests.

Source: REP 105 (names of frames: `map` and `odom` stand still, `base_link` goes with the vehicle, `earth` is
geocentric, so no plane); tf2's `lookupTransform`.
"""

from __future__ import annotations

import logging
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from scipy.spatial.transform import Rotation

from dirprim_filter.recording.decoding import Decoders, batches, by_schema, family_of
from dirprim_filter.recording.errors import MissingTransformError
from dirprim_filter.recording.geodesy import Origin, on_plane
from dirprim_filter.recording.records import Message
from dirprim_filter.recording.scan import Scan
from dirprim_filter.recording.schemas.fields import SchemaError
from dirprim_filter.recording.schemas.location import GEODETIC
from dirprim_filter.recording.schemas.observed import ObservedRows
from dirprim_filter.recording.schemas.shredded import NO_TIME
from dirprim_filter.recording.schemas.transform_messages import FAMILIES, TransformRows, transforms_of
from tessellation.arrays import BoolArray, FloatArray, IntArray

logger = logging.getLogger(__name__)

MAX_GAP_NS = 2_000_000_000
"""Between transforms further apart than this nothing is interpolated: a vehicle may have turned meanwhile."""
MAX_EXTRAPOLATION_NS = 100_000_000
"""So far beyond the first and the last transform a frame is taken to move on as it did: one frame of 10 Hz."""
GEOCENTRIC = "earth"
FIXED = ("map", "world", "odom")
"""Frames that stand still on the ground by name: without a transform they may be the map."""
MOVING = ("base_link", "base_footprint")
"""Frames that go with a vehicle."""
MAP = "map"


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
        parent: name of the frame that it is told in.
        time_ns: (n,) ascending, no time twice.
        translation: (n, 3) metres.
        rotation: (n, 4) unit quaternions.
    """

    parent: str
    time_ns: IntArray
    translation: FloatArray
    rotation: FloatArray

    @property
    def is_constant(self) -> bool:
        """All its transforms are the same, or there is but one: it holds at any time."""
        return bool((self.translation == self.translation[0]).all() and (self.rotation == self.rotation[0]).all())

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
    """

    def __init__(self, edges: Mapping[str, Edge]) -> None:
        self.edges = edges

    @classmethod
    def of_log(cls, path: Path) -> TransformTree:
        """All transforms of a log; those that cannot be decoded are passed over and logged.

        A stamp of zero is none: the message's log time stands in.
        """
        with Scan(path) as log:
            topics = frozenset(channel.topic for channel in log.channels() if family_of(channel) in FAMILIES)
        if not topics:
            return cls({})
        decoders = Decoders()
        parts = []
        failed = 0
        with Scan(path, topics.__contains__) as log:
            told = (message for message in log if family_of(message.channel) in FAMILIES)
            for batch in batches(told, decoders):
                for _, messages in by_schema(batch):
                    try:
                        shredded = decoders.shredded(messages)
                    except SchemaError as error:
                        logger.warning("%s: transforms cannot be read: %s", path, error)
                        continue
                    rows = transforms_of(shredded)
                    failed += len(shredded.failures)
                    parts.append(_stamped(rows, messages).of(~np.isin(rows.message, list(shredded.failures))))
        if failed:
            logger.warning("%s: %d messages of transforms cannot be decoded", path, failed)
        return cls(_edges(path, parts) if parts else {})

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


class FrameChange:
    """Brings objects into one frame.

    Attributes:
        target: its name; empty until the first object has told its own.
        origin: of the plane of satellite positions, which counts as the target; None until one was needed.
    """

    def __init__(self, path: Path, target: str | None, origin: Origin | None = None) -> None:
        self.target = target or ""
        self.origin = origin
        self._path = path
        self._tree: TransformTree | None = None
        self._placed = 0
        self._first_lost: tuple[str, int] | None = None

    def apply(self, rows: ObservedRows, time_ns: IntArray) -> tuple[ObservedRows, BoolArray]:
        """The rows in the target frame, and (n,) which of them could be brought there.

        The transform of an object is that of its own stamp where it has one, else that of (n,) `time_ns`.

        Raises:
            MissingTransformError: nothing joins an object's frame to the target; or no target was named, and the root
                of the object's frame is one that moves.
        """
        placed = np.ones(len(rows), np.bool_)
        for frame in dict.fromkeys(rows.frame_id.tolist()) if not _all_equal(rows) else [str(rows.frame_id[0])]:
            if frame in ("", self.target):
                continue
            here = np.flatnonzero(rows.frame_id == frame)
            if frame == GEODETIC:
                rows = self._on_plane(rows, here)
                continue
            when = np.where(rows.stamp_ns[here] > 0, rows.stamp_ns[here], time_ns[here])
            found = self._find(frame, when)
            if found is not None:
                rows = _moved(rows, here, found)
                placed[here] = found.known
                if not found.known.all() and self._first_lost is None:
                    self._first_lost = (frame, int(when[~found.known][0]))
        self._placed += int(placed.sum())
        return rows, placed

    def check(self) -> None:
        """At the end of a log: some objects could be brought into the target frame, if there were any.

        Raises:
            MissingTransformError: at no object's time was its transform known.
        """
        if self._first_lost is not None:
            frame, time_ns = self._first_lost
            if self._placed == 0:
                raise MissingTransformError(self._path, frame=frame, target=self.target, time_ns=time_ns)
            logger.warning(
                "%s: no transform from %r to %r at %d ns, and at other times", self._path, frame, self.target, time_ns
            )

    def _on_plane(self, rows: ObservedRows, here: IntArray) -> ObservedRows:
        if self.origin is None:
            longitude, latitude = rows.position[here[0]].tolist()
            self.origin = Origin(latitude, longitude)
            logger.warning(
                "%s: the plane's origin is the first fix; for the same plane in other logs say --origin %.9f,%.9f",
                self._path, latitude, longitude,
            )  # fmt: skip
        place = on_plane(self.origin, np.column_stack([rows.position[here], rows.height[here]]))
        position, height = rows.position.copy(), rows.height.copy()
        position[here], height[here] = place[:, :2], place[:, 2]
        return replace(rows, position=position, height=height)

    def _find(self, frame: str, time_ns: IntArray) -> Placement | None:
        """A frame in the target; None where they are the same."""
        if self._tree is None:
            self._tree = TransformTree.of_log(self._path)
        self.target = self.target or self._root(self._tree, frame, int(time_ns[0]))
        if frame == self.target:
            return None
        found = self._tree.placement(frame, self.target, time_ns)
        if found is None:
            raise MissingTransformError(self._path, frame=frame, target=self.target, time_ns=int(time_ns[0]))
        return found

    def _root(self, tree: TransformTree, frame: str, time_ns: int) -> str:
        """The frame that all objects are brought into: where those of `frame` have come as far as the log tells."""
        root = tree.root_of(frame)
        if root in MOVING:
            raise MissingTransformError(self._path, frame=root, target=MAP, time_ns=time_ns)
        if root not in FIXED:
            logger.warning(
                "%s: positions are read as they stand in frame %r, which the log places in no other; --frame %s says "
                "that this is meant", self._path, root, root,
            )  # fmt: skip
        return root


def _all_equal(rows: ObservedRows) -> bool:
    return len(rows) > 0 and bool((rows.frame_id == rows.frame_id[0]).all())


def _moved(rows: ObservedRows, here: IntArray, found: Placement) -> ObservedRows:
    place = np.column_stack([rows.position[here], rows.height[here]])
    place = found.rotation.apply(place) + found.translation
    speed, direction = rows.speed[here], rows.direction[here]
    moving = np.where(np.isfinite(speed) & (speed > 0), speed, 1.0)
    climb = np.where(np.isfinite(speed) & (speed > 0), rows.climb[here], 0.0)
    velocity = found.rotation.apply(np.column_stack([moving * np.cos(direction), moving * np.sin(direction), climb]))
    position, height, covariance = rows.position.copy(), rows.height.copy(), rows.covariance.copy()
    directions, speeds, climbs = rows.direction.copy(), rows.speed.copy(), rows.climb.copy()
    position[here], height[here] = place[:, :2], place[:, 2]
    directions[here] = np.arctan2(velocity[:, 1], velocity[:, 0])
    speeds[here] = np.where(speed > 0, np.hypot(velocity[:, 0], velocity[:, 1]), speed)
    climbs[here] = np.where(speed > 0, velocity[:, 2], 0.0)
    covariance[here] = _turned(rows.covariance[here], found.rotation)
    return replace(
        rows, position=position, height=height, direction=directions, speed=speeds, climb=climbs, covariance=covariance
    )


def _turned(covariance: FloatArray, rotation: Rotation) -> FloatArray:
    """(n, 2, 2) covariances in other axes; of the height's error nothing is told, so it adds nothing."""
    if np.isnan(covariance).all():
        return covariance
    plane = rotation.as_matrix()[:, :2, :2]
    with np.errstate(invalid="ignore", over="ignore"):  # infinite ones, which nobody will believe
        turned = plane @ covariance @ plane.transpose(0, 2, 1)
    return np.asarray((turned + turned.transpose(0, 2, 1)) / 2)  # symmetric to the last bit


def _stamped(rows: TransformRows, messages: list[Message]) -> TransformRows:
    log_ns = np.array([min(message.log_time_ns, (1 << 63) - 1) for message in messages], np.int64)[rows.message]
    return rows._replace(stamp_ns=np.where((rows.stamp_ns == NO_TIME) | (rows.stamp_ns == 0), log_ns, rows.stamp_ns))


def _edges(path: Path, parts: list[TransformRows]) -> dict[str, Edge]:
    """The edges of all transforms; of several parents the first is kept, of one time the last."""
    columns: list[Any] = [np.concatenate(column) for column in zip(*parts, strict=True)]
    rows = TransformRows(*columns)
    length = np.linalg.norm(rows.rotation, axis=1)
    valid = np.isfinite(rows.translation).all(axis=1) & np.isfinite(length) & (length > 0) & (rows.child != rows.parent)
    edges = {}
    for child in np.unique(rows.child[valid]).tolist():
        of_child = np.flatnonzero(valid & (rows.child == child))
        parent = str(rows.parent[of_child[0]])
        own = of_child[rows.parent[of_child] == parent]
        if own.size < of_child.size:
            logger.warning("%s: frame %r has several parents; that in %r is taken", path, child, parent)
        order = own[np.argsort(rows.stamp_ns[own], kind="stable")]
        last = np.append(np.diff(rows.stamp_ns[order]) > 0, True)
        kept = order[last]
        edges[str(child)] = Edge(
            parent=parent, time_ns=rows.stamp_ns[kept], translation=rows.translation[kept],
            rotation=rows.rotation[kept] / length[kept, None],
        )  # fmt: skip
    return edges
