"""Where the frames of a log are in each other over time: trees of them, as each has one parent.

Source: REP 105 (`earth` is geocentric, so no plane); tf2's `lookupTransform`.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping
from contextlib import suppress
from dataclasses import replace
from itertools import chain
from pathlib import Path

import numpy as np

from dirprim_filter.arrays import AnyArray, BoolArray, IntArray
from dirprim_filter.recording.container.log import Log, LogSource, Scan, opened
from dirprim_filter.recording.container.message_columns import MessageColumns
from dirprim_filter.recording.decoding.field_columns import NO_TIME, FieldColumns, signed
from dirprim_filter.recording.errors import DamagedRecordingError, DecodeError, RecordingError, warn
from dirprim_filter.recording.losses import TRANSFORMS as TRANSFORM_LOSS
from dirprim_filter.recording.losses import Losses
from dirprim_filter.recording.schemas.decoders import Decoders, batches, by_schema, family_of
from dirprim_filter.recording.schemas.families import TRANSFORMS
from dirprim_filter.recording.schemas.family import QUATERNION
from dirprim_filter.recording.transforms.edge import FIXED, ROW, Edge, Placement, listed
from dirprim_filter.track_ids import Numbers, rows_of_each

GEOCENTRIC = "earth"
STATIC = "tf_static"
"""How topics of transforms end that hold from then on, at all times: of a frame the latest one, as in tf2."""


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
        for batch in batches(scan.columns(), decoders.reads) if topics else ():
            for _, messages in by_schema(batch):
                if family_of(messages.first_channel) not in TRANSFORMS:
                    continue
                for _, own, columns in decoders.columns(messages):
                    rows = _rows(columns, own, frames)
                    losses.drop(TRANSFORM_LOSS, ~(valid := _are_valid(rows)))
                    parts.append(rows[valid])
                    if strict and columns.failures:
                        raise DecodeError(log.path, own, columns.failures)
                    losses.fail(columns.failures.values())
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

    def loop_above(self, frame: str) -> list[str]:
        """The frames that are each other's parent where the way up from this one has no end; else none."""
        chain = self.chain(frame)
        return chain[chain.index(chain[-1]) + 1 :]

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
        if loop := self.loop_above(frame) or self.loop_above(target):
            return f"{listed(loop)} are each other's parent"
        if (frames := self.between(frame, target)) is None:
            return f"the log places {self.places()}" if self.edges else "the log has no transforms"
        lost = (name for name in chain(*frames) if not self.edges[name].at(np.array([time_ns])).known[0])
        return ", ".join(f"that of {name!r} in {self.edges[name].span(time_ns)}" for name in lost)

    def places(self) -> str:
        """The frames and their parents, of many the first."""
        return listed([f"{name!r} in {edge.parent!r}" for name, edge in self.edges.items()])

    def _climb(self, frames: Iterable[str], time_ns: IntArray) -> Placement:
        from scipy.spatial.transform import Rotation  # noqa: PLC0415 - logs in one frame do without

        n = time_ns.size
        placed = Placement(Rotation.from_rotvec(np.zeros((n, 3))), np.zeros((n, 3)), np.ones(n, np.bool_))
        for frame in frames:
            placed = self.edges[frame].at(time_ns).after(placed)
        return placed


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
                    self._trees[path] = TransformTree({})  # that cannot be opened, which is reported where it is read
                    with suppress(RecordingError, OSError), opened(source) as other:
                        self._trees[path] = TransformTree.of_log(other)
                yield self._trees[path]


def _rows(columns: FieldColumns, messages: MessageColumns, frames: Numbers) -> AnyArray:
    """Those of messages of one schema, as `ROW`, frames as they are written."""
    message = columns.message_of(columns.fields["id"].table)
    rows, stamp_ns = np.empty(message.size, ROW), columns.read("time", NO_TIME)
    log_ns = signed(messages.log_time_ns)[message]
    rows["time_ns"] = np.where((stamp_ns != NO_TIME) & (stamp_ns != 0), stamp_ns, log_ns)
    rows["ahead_ns"] = rows["time_ns"] - log_ns
    for end, label in (("parent", "frame"), ("child", "id")):
        rows[end] = frames.of(columns.read(label, "").tolist())
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
        warn(path, f"frames with and without a leading slash are the same: {listed(sorted(twice))}")
    rows["child"], rows["parent"] = number[rows["child"]], number[rows["parent"]]
    for here in rows_of_each(rows["child"]):
        name = names[rows["child"][here[0]]]
        with np.errstate(all="ignore"):  # translations of any size
            edges[name] = Edge.of(rows[here], names)
    for root in FIXED:
        up = TransformTree(edges).chain(root)
        if root in up[1:]:
            loop = up[: up.index(root, 1)]
            note = f"and {listed(loop[:-1])} are each other's parent: {root!r} is taken for the root"
            edges[loop[-1]] = replace(edges[loop[-1]], note=note)
            del edges[root]
    return edges
