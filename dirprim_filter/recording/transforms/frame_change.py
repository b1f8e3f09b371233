"""Objects brought into one frame: by the log's transforms, or from satellite positions onto a plane.

Source: REP 105 (names of frames: `map` and `odom` stand still, `base_link` goes with the vehicle).
"""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np

from dirprim_filter.arrays import BoolArray, FloatArray, IntArray
from dirprim_filter.origin import Origin
from dirprim_filter.recording.container.log import Log
from dirprim_filter.recording.errors import MissingTransformError, RecordingError, warn
from dirprim_filter.recording.rows import Rows
from dirprim_filter.recording.schemas.decoders import schema_name
from dirprim_filter.recording.schemas.family import GEODETIC
from dirprim_filter.recording.transforms.edge import FIXED, Placement
from dirprim_filter.recording.transforms.geodesy import FIXES, LIVE_FIXES, check_kind, median_of, on_plane
from dirprim_filter.recording.transforms.transform_tree import SharedTransforms, TransformTree

if TYPE_CHECKING:
    from scipy.spatial.transform import Rotation

MOVING = ("base_link", "base_footprint")
"""Frames that go with a vehicle."""
MAP = "map"


class FrameChange:
    """Brings objects into one frame.

    Attributes:
        target: its name; empty until the first object came with its own.
        origin: of the plane of satellite positions, which counts as the target; None until one was needed.
        tree: the log's transforms; none until they were needed.
        ahead_s: of transforms that were used, by name: by how many seconds their stamps are ahead of log time.
    """

    def __init__(
        self, log: Log, target: str | None, origin: Origin | None = None, *, meets: str = "", strict: bool = False,
        shared: SharedTransforms | None = None,
    ) -> None:  # fmt: skip
        self.target = (target or "").lstrip("/")
        self._shared = shared  # until they were lent
        self._reported: set[str] = set()
        self._is_asked, self._without_name = bool(target), 0  # rows; where a target is asked for they are in it
        self.origin = origin
        self.tree, self._has_tree = TransformTree({}), False
        self.ahead_s: dict[str, float] = {}
        self._meets, self._is_stated = meets, origin is not None and not meets
        self._is_geodetic: bool | None = None
        self._fixes: list[FloatArray] = []  # those that come before there is an origin
        self._strict = strict
        self._log = log
        self._placed = 0
        self._first_lost: tuple[str, int] | None = None

    def waits(self, rows: Rows) -> bool:
        """Whether what comes is to be kept, and applied later: the origin is the median of the first fixes."""
        if self.origin is not None or self._is_geodetic is False:
            return False
        self._fixes.append(rows.position[rows.frame_id == GEODETIC, ::-1])
        return 0 < sum(map(len, self._fixes)) < (LIVE_FIXES if self._log.is_live else FIXES)

    def apply(self, rows: Rows) -> tuple[Rows, BoolArray]:
        """The rows in the target frame, and (n,) which of them could be brought there.

        The transform of an object is that of its own stamp where it has one, else that of the time that counts.

        Raises:
            MissingTransformError: nothing joins an object's frame to the target; or no target was named, and the root
                of the object's frame is one that moves.
        """
        placed = np.ones(len(rows), np.bool_)
        is_one = (rows.frame_id == rows.frame_id[:1]).all()
        for name in rows.frame_id[:1] if is_one else np.unique(rows.frame_id).tolist():
            frame = name.lstrip("/")
            plane = Origin.of_frame(frame)
            is_geodetic = plane is not None or frame == GEODETIC
            self._check_kind(is_geodetic=is_geodetic)
            here = np.flatnonzero(rows.frame_id == name)
            if frame in ("", self.target) and not is_geodetic:
                if not frame:
                    self._report_unnamed(here.size)
                continue
            if is_geodetic:
                rows = self._on_plane(rows, here, plane)
                continue
            when = np.where(rows.stamp_ns[here] > 0, rows.stamp_ns[here], rows.time_ns[here])
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

        Those whose frame has no name count as there already, which is said where others' frames have one.

        Raises:
            MissingTransformError: at no object's time was its transform known.
        """
        if self._without_name and self.target and not self._is_asked:
            line = f"the frame of {self._without_name} rows has no name: they are taken to be in {self.target!r}"
            warn(self._log.path, f"{line}, as others are; --set frame={self.target} says that they are")
        if self._first_lost is not None:
            frame, time_ns = self._first_lost
            missing = self._missing(frame, self.target, time_ns)
            if self._placed == 0:
                raise missing
            where = f"from {frame!r} to {self.target!r} at {time_ns} ns or later"
            warn(self._log.path, f"no transform {where}: {missing.why}")

    def _missing(self, frame: str, target: str, time_ns: int) -> MissingTransformError:
        why = self.tree.why_not(frame, target, time_ns)
        odometry = [channel.topic for channel in self._log.channels() if schema_name(channel).endswith("Odometry")]
        if odometry and target not in self.tree.chain(frame):
            why += f" (odometry, as on {odometry[0]}, is not used as a transform)"
        return MissingTransformError(self._log.path, frame=frame, target=target, time_ns=time_ns, why=why)

    def _report_unnamed(self, n_rows: int) -> None:
        """Report once that positions of a frame without a name are read as they are, where the log has transforms."""
        self._without_name += n_rows
        if "" in self._reported or self.target:
            return
        self._reported.add("")
        if placed := TransformTree.of_log(self._log).places():
            how = f"so positions are read as they are, though the log places {placed}: are they a vehicle's?"
            warn(self._log.path, f"the frame of objects has no name, {how} --set frame=map says that they are not")

    def _check_kind(self, *, is_geodetic: bool) -> None:
        """All positions of a log, and of what it meets, are of the Earth, or none is; unless the origin is stated."""
        if self._is_geodetic is None:
            self._is_geodetic = is_geodetic
            if self._meets:
                check_kind(self._log.path, is_geodetic=is_geodetic, origin=self.origin, meets=self._meets)
        elif self._is_geodetic != is_geodetic and not self._is_stated:
            expected = "positions all in metres, or all latitudes and longitudes"
            raise RecordingError(f"{self._log.path}: expected {expected}, got both; choose some by --topics")

    def _on_plane(self, rows: Rows, here: IntArray, own: Origin | None) -> Rows:
        """Rows of satellite positions, or of the plane of their `own` origin, on the plane of ours."""
        if self.origin is None and own is None:
            fixes = np.concatenate(self._fixes)
            self.origin = median_of(fixes)
            of = f"the median of the first {min(len(fixes), FIXES)} fixes"
            warn(self._log.path, f"the origin of the plane is {self.origin}, {of}; --set origin={self.origin} keeps it")
        self.origin = self.origin or own
        if own is not None and own.is_of(self.origin):
            return rows
        place = rows.position[here]
        return _with(rows, here, position=on_plane(self.origin, place if own else place[:, ::-1], own))

    def _find(self, frame: str, time_ns: IntArray) -> Placement | None:
        """A frame in the target; None where they are the same."""
        if not self._has_tree:
            self.tree, self._has_tree = TransformTree.of_log(self._log, strict=self._strict), True
            self._own = frozenset(self.tree.edges)
        target = self.target or self.tree.root_of(frame)
        found = None if frame == target else self.tree.placement(frame, target, time_ns)
        is_whole = frame == target or (found is not None and found.known.all())
        is_whole = is_whole and bool(self.target or target in FIXED)
        if not is_whole and self._shared is not None:
            self.tree, self._shared = self.tree.lent(self._shared.beside(self._log)), None
            return self._find(frame, time_ns)
        self.target = self.target or self._root(frame, int(time_ns[0]))
        if frame == self.target:
            return None
        if found is None:
            raise self._missing(frame, self.target, int(time_ns[0]))
        self._report(frame, time_ns)
        return found

    def _report(self, frame: str, time_ns: IntArray) -> None:
        """Say once what is odd with the transforms of a frame."""
        if frame in self._reported:
            return
        self._reported.add(frame)
        up, down = self.tree.between(frame, self.target) or ([], [])
        for name in (*up, *down):
            edge = self.tree.edges[name]
            note = edge.notes(time_ns)
            self.ahead_s |= {} if edge.ahead_s is None else {f"transforms of {name!r}": edge.ahead_s}
            if name not in self._own:
                note = f"is placed in {edge.parent!r} by the other logs, as this one does not"
            if note:
                warn(self._log.path, f"frame {name!r} {note}")

    def _root(self, frame: str, time_ns: int) -> str:
        """The frame that all objects are brought into: where those of `frame` have come as far as the log says."""
        root, parents = self.tree.root_of(frame), {edge.parent for edge in self.tree.edges.values()}
        fixed = next(filter(parents.__contains__, FIXED), "")
        if root in MOVING or (fixed and root not in FIXED) or self.tree.loop_above(frame):
            raise self._missing(root, fixed or MAP, time_ns)
        if root not in FIXED:
            where = f"frame {root!r}, which the log places in no other; --set frame={root} says that this is meant"
            warn(self._log.path, f"positions are read as they stand in {where}")
        return root


def _moved(rows: Rows, here: IntArray, found: Placement) -> Rows:
    turned = found.rotation.apply
    place = turned(np.column_stack([rows.position[here], rows.height[here]])) + found.translation
    speed, course, yaw = rows.speed[here], rows.direction[here], rows.heading[here]
    moves = np.isfinite(speed) & (speed > 0)
    length, climb = np.where(moves, speed, 1.0), np.where(moves, rows.climb[here], 0.0)
    velocity = turned(np.column_stack([length * np.cos(course), length * np.sin(course), climb]))
    ahead = turned(np.column_stack([np.cos(yaw), np.sin(yaw), np.zeros(yaw.size)]))
    return _with(
        rows, here, position=place[:, :2], height=place[:, 2],
        covariance=_turned(rows.covariance[here], found.rotation),
        direction=np.arctan2(velocity[:, 1], velocity[:, 0]), heading=np.arctan2(ahead[:, 1], ahead[:, 0]),
        speed=np.where(speed > 0, np.hypot(velocity[:, 0], velocity[:, 1]), speed),
        climb=np.where(speed > 0, velocity[:, 2], 0.0),
    )  # fmt: skip


def _with(rows: Rows, here: IntArray, **columns: FloatArray) -> Rows:
    """The rows, of which those `here` have other values."""
    made = {name: getattr(rows, name).copy() for name in columns}
    for name, values in columns.items():
        made[name][here] = values
    return replace(rows, **made)


def _turned(covariance: FloatArray, rotation: Rotation) -> FloatArray:
    """(n, 2, 2) covariances in other axes; the height's error is unknown, so it adds nothing."""
    if np.isnan(covariance).all():
        return covariance
    plane = rotation.as_matrix()[:, :2, :2]
    with np.errstate(invalid="ignore", over="ignore"):  # infinite covariances, which weigh nothing
        turned = plane @ covariance @ plane.transpose(0, 2, 1)
    return np.asarray((turned + turned.transpose(0, 2, 1)) / 2)  # symmetric to the last bit
