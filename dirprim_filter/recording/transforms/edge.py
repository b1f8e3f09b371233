"""One frame in its parent over time.

Between two transforms the translation is interpolated on a line and the rotation at a constant rate, by scipy's
rotations, which are here already and do columns of times at once. pytransform3d, the other library looked at,
interpolates screws over float times and knows no gaps; it is the oracle in the tests.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, NamedTuple, Self

import numpy as np

from dirprim_filter.arrays import AnyArray, BoolArray, FloatArray, IntArray

if TYPE_CHECKING:
    from scipy.spatial.transform import Rotation

MAX_GAP_NS = 2_000_000_000
"""Between transforms further apart than this nothing is interpolated: a vehicle may have turned meanwhile."""
MAX_EXTRAPOLATION_NS = 100_000_000
"""So far beyond the first and the last transform a frame is taken to move on as it did: one frame of 10 Hz."""
FIXED = ("world", "map", "odom")
"""Frames that stand still on the ground by name, those further up first: without a transform they may be the map."""
JUMP_M, JUMP_SHARE = 0.5, 0.1
"""Frames do not go so far back and forth between one transform and the next, and do so for so many of them."""
OTHER_CLOCK_S = 600.0
"""Times that are so far apart in the same log may be of two clocks."""
SHOWN = 4
"""Frames in one line."""
SAME = 1e-6
"""Metres, and parts of quaternions, by which transforms are alike."""

ROW = np.dtype([
    ("time_ns", np.int64), ("parent", np.int64), ("child", np.int64), ("translation", np.float64, 3),
    ("rotation", np.float64, 4), ("is_static", np.bool_), ("ahead_ns", np.int64),
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
        ahead_s: by how much its stamps are ahead of log time, seconds; None where that varies, or it does not move.
    """

    parent: str
    is_static: bool
    time_ns: IntArray
    translation: FloatArray
    rotation: FloatArray
    note: str = ""
    ahead_s: float | None = None

    @classmethod
    def of(cls, own: AnyArray, names: list[str]) -> Self:
        """By all its transforms, as `ROW` with the names of frames: in the first parent, static ones as of the last."""
        notes, lasts = [], own["is_static"]
        if lasts.any() and not lasts.all():
            moves = not _are_alike(own[~lasts])
            if moves or not _are_alike(own):
                which = "the latter count, as they move" if moves else "the static ones count, as the others stand too"
                notes.append(f"has transforms that are static and others over time: {which}")
            own = own[lasts != moves]
        parents = [names[i] for i in dict.fromkeys(own["parent"].tolist())]
        if own["is_static"][0]:
            notes += ["has several static transforms: the last counts"] if not _are_alike(own) else []
            own = own[-1:]
        elif len(parents) > 1:
            parent = next(filter(parents.__contains__, FIXED), parents[0])
            notes.append(f"has several parents, {listed(parents)}: only its transforms in {parent!r} are used")
            own = own[own["parent"] == names.index(parent)]
        own = own[np.argsort(own["time_ns"], kind="stable")]
        step = np.diff(own["translation"], axis=0)
        far = np.linalg.norm(step, axis=1) > JUMP_M
        is_back = far[1:] & far[:-1] & ((step[1:] * step[:-1]).sum(axis=1) < 0)
        if is_back.sum() > JUMP_SHARE * is_back.size:
            notes.append("jumps back and forth: two nodes that disagree, or a clock that began again? All count")
        own = own[np.append(np.diff(own["time_ns"]) > 0, True)]  # of one time the last
        columns = {of: np.ascontiguousarray(own[of]) for of in COLUMNS}
        parent, is_static = names[own["parent"][0]], bool(own["is_static"][0])
        low, middle, high = np.percentile(own["ahead_ns"], (25, 50, 75)).tolist()
        ahead_s = None if high - low > MAX_GAP_NS or _are_alike(own) else middle * 1e-9
        return cls(parent=parent, is_static=is_static, note="; it ".join(notes), ahead_s=ahead_s, **columns)

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
        if self.note or self.is_static or away_ns <= MAX_GAP_NS or not self.at(time_ns).known.all():
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

        if all((of[[0, -1]] == of[0]).all() and (of == of[0]).all() for of in (self.translation, self.rotation)):
            still, n = np.zeros_like(time_ns), time_ns.size
            return Placement(Rotation.from_quat(self.rotation[still]), self.translation[still], np.ones(n, np.bool_))
        before = np.clip(np.searchsorted(self.time_ns, time_ns, side="right") - 1, 0, self.time_ns.size - 2)
        gap = self.time_ns[before + 1] - self.time_ns[before]
        share = (time_ns - self.time_ns[before]) / gap
        first, last = self.time_ns[0] - MAX_EXTRAPOLATION_NS, self.time_ns[-1] + MAX_EXTRAPOLATION_NS
        known = (time_ns >= first) & (time_ns <= last) & ((gap <= MAX_GAP_NS) | (share == 0) | (share == 1))
        start = Rotation.from_quat(self.rotation[before])
        turn = (start.inv() * Rotation.from_quat(self.rotation[before + 1])).as_rotvec()
        moved = self.translation[before + 1] - self.translation[before]
        placed = self.translation[before] + moved * share[:, None]
        return Placement(start * Rotation.from_rotvec(turn * share[:, None]), placed, known)


def listed(names: Sequence[str]) -> str:
    """Some names in a line, of many the first."""
    return " and ".join([*names[:SHOWN], *([f"{len(names) - SHOWN} more"] * (len(names) > SHOWN))])


def _are_alike(rows: AnyArray) -> bool:
    """Whether transforms are the same, but for their times."""
    return (rows["parent"] == rows["parent"][0]).all() and all(
        (np.abs(rows[of] - rows[of][0]) <= SAME).all() for of in ("translation", "rotation")
    )
