"""Where the frames of a log are in each other over time.

Frames form trees: each has one parent. Between two transforms the translation is interpolated on a line and the
rotation at a constant rate, by scipy's rotations, which are here already and do columns of times at once.
pytransform3d, the other library looked at, interpolates screws over float times and knows no gaps; it is the oracle
in the tests.

Source: REP 105 (`earth` is geocentric, so no plane); tf2's `lookupTransform`.
"""

from __future__ import annotations

import logging
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import chain
from pathlib import Path
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from dirprim_filter.arrays import AnyArray, BoolArray, FloatArray, IntArray
from dirprim_filter.recording.container.log import Log, LogSource, Scan, opened
from dirprim_filter.recording.container.message_columns import MessageColumns
from dirprim_filter.recording.decoding.field_columns import NO_TIME, FieldColumns, SchemaError, signed
from dirprim_filter.recording.errors import DamagedRecordingError, DecodeError, RecordingError
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
FIXED = ("world", "map", "odom")
"""Frames that stand still on the ground by name, those further up first: without a transform they may be the map."""
JUMP_M, JUMP_SHARE = 0.5, 0.1
"""Frames do not go so far back and forth between one transform and the next, and do so for so many of them."""
OTHER_CLOCK_S = 600.0
"""Transforms so far from an object's time may be of another clock."""
SHOWN = 4
"""Frames in one line."""
SAME = 1e-6
"""Metres, and parts of quaternions, by which transforms are alike."""


ROW = np.dtype([
    ("time_ns", np.int64), ("parent", np.int64), ("child", np.int64), ("translation", np.float64, 3),
    ("rotation", np.float64, 4), ("is_static", np.bool_),
])  # fmt: skip
"""A transform: the pose of the child's frame in its parent's, frames by number, the rotation a unit quaternion."""


COLUMNS = ("time_ns", "translation", "rotation")
"""Of these, what an edge holds."""


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
        is_static: it holds at all times.
        time_ns: (n,) ascending, no time twice.
        translation: (n, 3) metres.
        rotation: (n, 4) unit quaternions.
        note: what is odd with it.
    """

    parent: str
    is_static: bool
    time_ns: IntArray
    translation: FloatArray
    rotation: FloatArray
    note: str = ""

    def is_like(self, other: Edge) -> bool:
        """Whether the last transforms are the same."""
        ours, theirs = (np.append(edge.translation[-1], edge.rotation[-1]) for edge in (self, other))
        return self.parent == other.parent and bool((np.abs(ours - theirs) <= SAME).all())

    def continued(self, other: Edge) -> Edge:
        """With the transforms of another log, if these come all before or all after, as in splits of one recording."""
        first, last = sorted((self, other), key=lambda edge: int(edge.time_ns[0]))
        if self.is_static or other.is_static or self.parent != other.parent or first.time_ns[-1] >= last.time_ns[0]:
            return self
        time_ns, translation, rotation = (np.concatenate([getattr(e, of) for e in (first, last)]) for of in COLUMNS)
        return replace(self, time_ns=time_ns, translation=translation, rotation=rotation)

    def notes(self, time_ns: IntArray) -> str:
        """What is odd with it, and with its use at some times."""
        away_ns = max(int(self.time_ns[0]) - int(time_ns.min()), int(time_ns.max()) - int(self.time_ns[-1]))
        if self.note or self.is_static or away_ns <= MAX_GAP_NS or not self.at(time_ns).known.any():
            return self.note
        return f"is taken to stand in {self.parent!r}, as do its transforms of {away_ns * 1e-9:.1f} s before or after"

    def span(self, time_ns: int) -> str:
        """The parent, and which times are known, beside one that is not."""
        first, last = self.time_ns[[0, -1]].tolist()
        away_s = max(first - time_ns, time_ns - last) * 1e-9
        clocks = f", {away_s:.0f} s away: do the clocks differ, one simulated?" * (away_s > OTHER_CLOCK_S)
        pause = f", with pauses of more than {MAX_GAP_NS * 1e-9:g} s" * (away_s <= 0)
        return f"{self.parent!r} is known from {first} to {last} ns{clocks}{pause}"

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

    def lent(self, others: Iterable[TransformTree]) -> TransformTree:
        """This, and what other logs know beside it: frames that this one does not place, and times around its own.

        A frame that two of them place differently at all times is left out.
        """
        edges, unlike = dict(self.edges), set[str]()
        for name, edge in ((name, edge) for tree in others for name, edge in tree.edges.items()):
            if name not in edges:
                edges[name] = edge
            elif name in self.edges or not edge.is_static:
                edges[name] = edges[name].continued(edge)
            elif not edge.is_like(edges[name]):
                unlike.add(name)
        return TransformTree({name: edge for name, edge in edges.items() if name not in unlike}, self.losses)

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

    def between(self, frame: str, target: str) -> tuple[list[str], list[str]] | None:
        """The frames from each of the two up to where they meet, that one left out; None where they do not."""
        up, down = self.chain(frame), self.chain(target)
        joint = next(filter(set(down).__contains__, up), None)
        return None if joint is None else (up[: up.index(joint)], down[: down.index(joint)])

    def placement(self, frame: str, target: str, time_ns: IntArray) -> Placement | None:
        """`frame` in `target` at (n,) times; None where nothing joins the two."""
        if (frames := self.between(frame, target)) is None:
            return None
        up, down = (self._climb(names, time_ns) for names in frames)
        return down.inverse().after(up)

    def why_not(self, frame: str, target: str, time_ns: int) -> str:
        """Why `frame` cannot be placed in `target` at a time, by what there is."""
        for names in (self.chain(frame), self.chain(target)):
            if names[-1] in names[:-1]:
                loop = names[names.index(names[-1]) + 1 :]
                return f"{_listed(loop[:SHOWN])} are each other's parent"
        if (frames := self.between(frame, target)) is None:
            placed = [f"{name!r} in {edge.parent!r}" for name, edge in self.edges.items()]
            more = f" and {len(placed) - SHOWN} more" if len(placed) > SHOWN else ""
            return f"the log places {_listed(placed[:SHOWN])}{more}" if placed else "the log has no transforms"
        lost = (name for name in chain(*frames) if not self.edges[name].at(np.array([time_ns])).known[0])
        return ", ".join(f"that of {name!r} in {self.edges[name].span(time_ns)}" for name in lost)

    def _climb(self, frames: Iterable[str], time_ns: IntArray) -> Placement:
        from scipy.spatial.transform import Rotation  # noqa: PLC0415 - logs in one frame do without

        n = time_ns.size
        placed = Placement(Rotation.from_rotvec(np.zeros((n, 3))), np.zeros((n, 3)), np.ones(n, np.bool_))
        for frame in frames:
            placed = self.edges[frame].at(time_ns).after(placed)
        return placed


def _listed(names: Sequence[str]) -> str:
    return " and ".join(names)


class SharedTransforms:
    """The transforms of logs that are read together, each read once, when another log first needs it."""

    def __init__(self, logs: Iterable[LogSource]) -> None:
        self._logs = {Path(log.path if isinstance(log, Log) else log): log for log in logs}
        self._trees: dict[Path, TransformTree] = {}

    def beside(self, log: Log) -> Iterator[TransformTree]:
        """Those of the other logs."""
        for path, source in self._logs.items():
            if path != log.path:
                if path not in self._trees:
                    self._trees[path] = _tree_of(source)
                yield self._trees[path]


def _tree_of(source: LogSource) -> TransformTree:
    """That of a log beside; one that cannot be opened has none, and is reported where it is read itself."""
    try:
        with opened(source) as log:
            return TransformTree.of_log(log)
    except (RecordingError, OSError):
        return TransformTree({})


def _rows(columns: FieldColumns, messages: MessageColumns, frames: Numbers) -> AnyArray:
    """Those of messages of one schema, as `ROW`, frames as they are written."""
    message = columns.message_of(columns.fields["id"].table)
    rows, stamp_ns = np.empty(message.size, ROW), columns.times("time")
    rows["time_ns"] = np.where((stamp_ns != NO_TIME) & (stamp_ns != 0), stamp_ns, signed(messages.log_time_ns)[message])
    for end, label in (("parent", "frame"), ("child", "id")):
        rows[end] = frames.of(columns.names(label).tolist())
    rows["translation"], rotation = columns.vectors(("x", "y", "z")), columns.vectors(QUATERNION)
    with np.errstate(all="ignore"):
        rows["rotation"] = rotation / np.linalg.norm(rotation, axis=1, keepdims=True)
    rows["is_static"] = np.strings.endswith(messages.topic[message], STATIC)
    return np.asarray(rows[~np.isin(message, list(columns.failures))])


def _are_valid(rows: AnyArray) -> BoolArray:
    """(n,) which place a frame in another one, at a time whose distance to others fits into int64."""
    is_pose = np.isfinite(rows["translation"]).all(axis=1) & (np.abs(np.square(rows["rotation"]).sum(axis=1) - 1) < 0.5)
    return np.asarray(is_pose & (rows["child"] != rows["parent"]) & (np.abs(rows["time_ns"] // 2) < 1 << 61))


def _edges(path: Path, rows: AnyArray, written: list[str]) -> dict[str, Edge]:
    """The frames in the first parent that the log gives them: static ones as of the last, the others over time.

    The slash that names began with in ROS 1 is no part of them.
    """
    frames = Numbers()
    number = frames.of([name.lstrip("/") for name in written])
    names, edges = list(frames), dict[str, Edge]()
    if len(names) < len(written):
        twice = {name.lstrip("/") for name in written if name.startswith("/")} & set(written)
        logger.warning("%s: frames with and without a leading slash are the same: %s", path, _listed(sorted(twice)))
    rows["child"], rows["parent"] = number[rows["child"]], number[rows["parent"]]
    order = np.argsort(rows["child"], kind="stable")
    for here in np.split(order, np.flatnonzero(np.diff(rows["child"][order])) + 1) if order.size else ():
        name = names[rows["child"][here[0]]]
        with np.errstate(all="ignore"):  # translations of any size
            edges[name] = _edge(rows[here], names)
    for root in FIXED:
        up = TransformTree(edges).chain(root)
        if root in up[1:]:
            loop = up[: up.index(root, 1)]
            note = f"and {_listed(loop[:-1][:SHOWN])} are each other's parent: {root!r} is taken for the root"
            edges[loop[-1]] = replace(edges[loop[-1]], note=note)
            del edges[root]
    return edges


def _edge(own: AnyArray, names: list[str]) -> Edge:
    """One frame by all its transforms, and what was chosen of several."""
    notes, is_static = [], own["is_static"]
    if is_static.any() and not is_static.all():
        moves = not _are_alike(own[~is_static])
        if moves or not _are_alike(own):
            which = "the latter count, as they move" if moves else "the static ones count, as the others stand too"
            notes.append(f"has transforms that are static and others over time: {which}")
        own = own[is_static != moves]
    parents = [names[i] for i in dict.fromkeys(own["parent"].tolist())]
    if own["is_static"][0]:
        notes += ["has several static transforms: the last counts"] if not _are_alike(own) else []
        own = own[-1:]
    elif len(parents) > 1:
        parent = next(filter(parents.__contains__, FIXED), parents[0])
        notes.append(f"has several parents, {_listed(parents[:SHOWN])}: that in {parent!r} is taken")
        own = own[own["parent"] == names.index(parent)]
    own = own[np.argsort(own["time_ns"], kind="stable")]
    step = np.diff(own["translation"], axis=0)
    far = np.linalg.norm(step, axis=1) > JUMP_M
    is_back = far[1:] & far[:-1] & ((step[1:] * step[:-1]).sum(axis=1) < 0)
    if is_back.mean() > JUMP_SHARE if is_back.size else False:
        notes.append("jumps back and forth: two nodes that disagree, or a clock that began again? All count")
    own = own[np.append(np.diff(own["time_ns"]) > 0, True)]  # of one time the last
    columns = {of: np.ascontiguousarray(own[of]) for of in COLUMNS}
    first = own[0]
    return Edge(parent=names[first["parent"]], is_static=bool(first["is_static"]), note="; it ".join(notes), **columns)


def _are_alike(rows: AnyArray) -> bool:
    """Whether transforms are the same, but for their times."""
    return (rows["parent"] == rows["parent"][0]).all() and all(
        (np.abs(rows[of] - rows[of][0]) <= SAME).all() for of in ("translation", "rotation")
    )
