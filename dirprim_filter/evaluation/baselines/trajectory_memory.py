"""Trajectory memory: a vehicle goes on as one that was seen here and moved like it.

All training tracks are kept, and a vehicle replays the way of one of them: neighbours of its state, weighed by a
Gaussian kernel, each with its own future. The memory learns nothing of what vehicles have in common and grows with the
log; a map of primitives should come close to it without remembering single vehicles.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field, replace
from typing import NamedTuple, Self

import numpy as np
from scipy.spatial import cKDTree

from dirprim_filter.arrays import BoolArray, FloatArray, IntArray
from dirprim_filter.distributions.angles import difference
from dirprim_filter.evaluation.forecast_cases import Cases, mean_log_energy
from dirprim_filter.evaluation.settings import Axis, Choice, choose
from dirprim_filter.tracks import Tracks

ROW_S = 0.5
"""Between rows of the memory: at 10 m/s on a bend of 20 m radius the chord is 0.15 m off the arc."""
LONGEST_GAP_S = 1.5
"""Between two rows further apart the vehicle's way is not known: another track begins."""
MOVING = 0.5
"""m/s; slower rows have no direction of their own."""
PLACE_M, DIRECTION, SPEED, SPEED_SHARE = 1.5, 0.12, 0.5, 0.15
"""How far apart vehicles are alike: metres, radians, and m/s with a share of the speed."""
FARTHEST = 18.0
"""Squared distance, in those units, beyond which vehicles are not alike at all."""
CREEP, FASTEST = 0.5, 3.0
"""m/s, added where speeds are compared by their ratio; and the largest ratio at which a way is replayed."""
DIRECTION_RATE, SPEED_RATE = 1.0, 0.2
"""1/s, how fast a vehicle's own direction and pace give way to those of the track that it follows."""
DIRECTION_SPREAD, SPEED_SPREAD, DRIFT = 0.05, 0.05, 0.005
"""Radians, share of the speed, and m^2/s, by which vehicles of one way differ."""
LIKE_SPEEDS = 0.025
"""Share of all rows, to either side in order of speed, from which a vehicle unlike all others draws one."""
STRAIGHT_SHARE = 0.15
"""Share of those that go straight on at constant speed instead."""
STEP_S = 0.5
LEAST_AHEAD = 3
"""Rows: a track that ends sooner says little about what comes next."""
NEIGHBOURS = 64
"""Rows that are weighed: the nearest."""
FORGET_RATE = 0.1
"""1/s, how often a vehicle goes over to another track that it has come to be like."""
MOST_STARTS, N_SAMPLES = 1000, 16
"""Of the training cases by which nearness and strength are chosen."""
FACTOR = 1.5
"""Between neighbours of the grid on which these are searched."""


class States(NamedTuple):
    """Vehicles at instants."""

    position: FloatArray  # (n, 2) metres
    direction: FloatArray  # (n,) radians
    speed: FloatArray  # (n,) m/s

    def of(self, rows: BoolArray | IntArray) -> States:
        """The chosen rows."""
        return States(*(column[rows] for column in self))

    def features(self) -> FloatArray:
        """(n, 5) features whose Euclidean distance measures similarity; standing vehicles have no direction."""
        turned = np.minimum(self.speed, 1.0) / DIRECTION
        compass = turned[:, None] * np.column_stack([np.cos(self.direction), np.sin(self.direction)])
        pace = np.log(SPEED + SPEED_SHARE * self.speed) / SPEED_SHARE
        return np.column_stack([self.position / PLACE_M, compass, pace])


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class TrajectoryMemory:
    """Tracks of vehicles, a row each `ROW_S`, one track after the other.

    Attributes:
        vehicle: (n,) number of each row's vehicle.
        states: n rows; directions are continuous along a track, and turn evenly while a vehicle stands.
        last: (n,) the last row of each row's track.
        nearness: how near is alike, in units of `PLACE_M`, `DIRECTION` and `SPEED`.
        strength: number of similar rows that weighs as much as the dissimilar ones.
    """

    vehicle: IntArray
    states: States
    last: IntArray
    nearness: float = 0.7
    strength: float = 0.1
    _going: IntArray = field(init=False, repr=False)
    _tree: cKDTree = field(init=False, repr=False)

    def __post_init__(self) -> None:
        going = np.flatnonzero(np.arange(self.last.size) + LEAST_AHEAD <= self.last)
        object.__setattr__(self, "_going", going[np.argsort(self.states.speed[going], kind="stable")])
        object.__setattr__(self, "_tree", cKDTree(self.at(np.asarray(self._going + 0.5, np.float64)).features()))

    @classmethod
    def of(cls, tracks: Tracks) -> Self:
        """Remember tracks."""
        parts = list(_resampled(tracks))
        n_rows = np.array([len(states.speed) for _, states in parts], np.int64)
        columns = [np.concatenate(column) for column in zip(*(states for _, states in parts), strict=True)]
        return cls(
            vehicle=np.repeat(np.array([vehicle for vehicle, _ in parts], np.int64), n_rows),
            states=States(*columns) if parts else States(np.empty((0, 2)), np.empty(0), np.empty(0)),
            last=np.repeat(np.cumsum(n_rows) - 1, n_rows),
        )

    def at(self, row: FloatArray) -> States:
        """The states at fractional rows."""
        before = row.astype(np.int64)
        share = row - before
        a, b = self.states.of(before), self.states.of(np.minimum(before + 1, self.last[before]))
        return States(*(x + (share * (y - x).T).T for x, y in zip(a, b, strict=True)))

    def sample(
        self, start: States, *, time_s: FloatArray, n_samples: int, but: IntArray | None = None,
        rng: np.random.Generator,
    ) -> FloatArray:  # fmt: skip
        """Rollouts of vehicles.

        Args:
            start: n of them.
            time_s: (n_times,) ascending, seconds ahead.
            n_samples: of each.
            but: (n,) a vehicle that each must not follow: itself.
            rng: draws them.

        Returns:
            (n, n_samples, n_times, 2) metres.
        """
        n = start.speed.size
        if n == 0:  # of a fold there may be none
            return np.empty((0, n_samples, len(time_s), 2))
        but = np.full(n, -1) if but is None else but
        now = start.of(np.repeat(np.arange(n), n_samples))
        path = np.empty((now.speed.size, len(time_s), 2))
        particles = _Particles(self, now, np.repeat(but, n_samples), rng)
        particles.look(start, but, np.arange(now.speed.size))
        before = 0.0
        for i, later in enumerate(time_s):
            n_steps = int(np.ceil((later - before) / STEP_S - 1e-9))
            for _ in range(n_steps):
                particles.move((later - before) / n_steps)
            path[:, i], before = particles.position, later
        return path.reshape(n, n_samples, len(time_s), 2)

    def found(
        self, start: States, but: IntArray, n_samples: int, *, rng: np.random.Generator
    ) -> tuple[FloatArray, BoolArray]:
        """Fractional rows to continue along, by weights e^{-d^2 / 2} against that of dissimilar ones; which are such.

        (n n_samples,) each; NaN for straight on.
        """
        n = but.size
        row, weight = self._alike(start, but)
        so_far = np.cumsum(weight, axis=1)
        drawn = rng.random((n, n_samples)) * (so_far[:, -1:] + self.strength)
        is_unmatched = (drawn >= so_far[:, -1:]).ravel()
        place = np.minimum((drawn[..., None] >= so_far[:, None]).sum(axis=-1), NEIGHBOURS - 1)
        followed = np.take_along_axis(row, place, axis=1).ravel()
        of = np.repeat(np.arange(n), n_samples)[is_unmatched]
        followed[is_unmatched] = self._anywhere(start.speed[of], but[of], rng=rng)
        return followed, is_unmatched

    def _alike(self, start: States, but: IntArray) -> tuple[FloatArray, FloatArray]:
        """The nearest rows, each beside its vehicle, and their weights. (n, NEIGHBOURS), (n, NEIGHBOURS)."""
        n, going = but.size, self._going
        if going.size == 0:
            return np.full((n, NEIGHBOURS), np.nan), np.zeros((n, NEIGHBOURS))
        half = 0.5 * ROW_S * (1.5 * start.speed + 1.0) / PLACE_M  # of the way from a row to the next
        reach = float(np.sqrt(FARTHEST) * self.nearness + half.max(initial=0.0))
        features = start.features()
        _, index = self._tree.query(features, k=NEIGHBOURS, distance_upper_bound=reach)
        row = going[np.minimum(index, going.size - 1)]
        way = self.states.position[row + 1] - self.states.position[row]
        along = ((start.position[:, None] - self.states.position[row]) * way).sum(axis=-1)
        beside = row + np.clip(along / np.maximum((way**2).sum(axis=-1), 1e-6), 0.0, 1.0)
        apart = self.at(beside.ravel()).features().reshape(n, NEIGHBOURS, -1) - features[:, None]
        distance = ((apart / self.nearness) ** 2).sum(axis=-1)
        alike = (index < going.size) & (self.vehicle[row] != but[:, None]) & (distance <= FARTHEST)
        return beside, np.where(alike, np.exp(-0.5 * distance), 0.0)

    def _anywhere(self, speed: FloatArray, but: IntArray, *, rng: np.random.Generator) -> FloatArray:
        """Rows of any place about as fast, or straight on."""
        n, straight = self._going.size, rng.random(speed.size) < STRAIGHT_SHARE
        if n == 0:
            return np.full(speed.size, np.nan)
        slower = np.searchsorted(self.states.speed[self._going], speed)
        offset = (rng.random(speed.size) * 2.0 - 1.0) * (1.0 + LIKE_SPEEDS * n)
        row = self._going[np.clip(slower + offset.astype(np.int64), 0, n - 1)]
        return np.where(straight | (self.vehicle[row] == but), np.nan, row + rng.random(speed.size))

    def chosen(
        self, cases: Cases, horizons_s: Sequence[float], *, rng: np.random.Generator
    ) -> tuple[Self, tuple[Choice, ...]]:
        """The same with the nearness and strength that forecast its vehicles best, each from all others.

        Best is the least `mean_log_energy`.

        Args:
            cases: of the vehicles that are remembered.
            horizons_s: theirs.
            rng: draws cases and rollouts; all settings are tried on the same.

        Returns:
            The memory, and each setting between others that are no better; no settings of too few cases.
        """
        some = rng.permutation(cases.speed.size)[:MOST_STARTS]
        start, later = States(cases.position, cases.direction, cases.speed).of(some), cases.later[some]
        if np.isnan(mean_log_energy(np.zeros((some.size, 2, len(horizons_s), 2)), later)):
            return self, ()
        seed = rng.integers(2**63)

        def score(values: tuple[float, ...]) -> float:
            path = replace(self, nearness=values[0], strength=values[1]).sample(
                start, time_s=np.asarray(horizons_s), n_samples=N_SAMPLES, but=cases.vehicle[some],
                rng=np.random.default_rng(seed),
            )  # fmt: skip
            return -mean_log_energy(path, later)

        axes = [Axis(name, getattr(self, name), factor=FACTOR) for name in ("nearness", "strength")]
        found = choose(axes, score)
        return replace(self, nearness=found[0].chosen, strength=found[1].chosen), found


class _Particles:
    """Vehicles that go along rows of a memory, each turned and stretched by what it deviates."""

    def __init__(self, memory: TrajectoryMemory, now: States, but: IntArray, rng: np.random.Generator) -> None:
        self._memory, self._but, self._rng = memory, but, rng
        self.position, self.direction, self.speed = (column.copy() for column in now)
        n = but.size
        self._row, self._is_unmatched = np.empty(n), np.empty(n, np.bool_)
        self._turned, self._log_ratio = np.empty(n), np.empty(n)

    def look(self, start: States, but: IntArray, rows: IntArray) -> None:
        """Let `rows`, as many for each of the starts, find something to follow."""
        self._row[rows], self._is_unmatched[rows] = self._memory.found(start, but, rows.size // but.size, rng=self._rng)
        rows = rows[~np.isnan(self._row[rows])]
        beside = self._memory.at(self._row[rows])
        self._turned[rows] = difference(self.direction[rows], beside.direction)
        self._log_ratio[rows] = np.log((self.speed[rows] + CREEP) / (beside.speed + CREEP))

    def move(self, h: float) -> None:
        """Move all by `h` seconds."""
        memory, rng = self._memory, self._rng
        self.position += (
            np.sqrt(DRIFT * h) * np.minimum(self.speed, 1.0)[:, None] * rng.standard_normal((self.speed.size, 2))
        )
        straight = np.flatnonzero(np.isnan(self._row))
        ahead = h * self.speed[straight]
        self.position[straight, 0] += ahead * np.cos(self.direction[straight])
        self.position[straight, 1] += ahead * np.sin(self.direction[straight])
        rows = np.flatnonzero(~np.isnan(self._row))
        before, last = self._row[rows], memory.last[self._row[rows].astype(np.int64)]
        pace = np.exp(np.clip(self._log_ratio[rows], -np.log(FASTEST), np.log(FASTEST)))
        after = np.minimum(before + pace * h / ROW_S, last)
        now, later = memory.at(before), memory.at(after)
        turned = self._turned[rows]
        kept = np.where(self._is_unmatched[rows], 1.0, np.exp(-DIRECTION_RATE * h))
        turned_later = kept * turned + DIRECTION_SPREAD * np.sqrt(1.0 - kept**2) * rng.standard_normal(rows.size)
        east, north = (later.position - now.position).T
        c, s = np.cos(0.5 * (turned + turned_later)), np.sin(0.5 * (turned + turned_later))
        self.position[rows] += np.column_stack([c * east - s * north, s * east + c * north])
        kept = np.exp(-SPEED_RATE * h)
        noise = SPEED_SPREAD * np.sqrt(1.0 - kept**2) * rng.standard_normal(rows.size)
        self._log_ratio[rows] = kept * self._log_ratio[rows] + noise
        self._row[rows], self._turned[rows] = after, turned_later
        self.direction[rows] = later.direction + turned_later
        self.speed[rows] = np.maximum((later.speed + CREEP) * np.exp(self._log_ratio[rows]) - CREEP, 0.0)
        looks = rng.random(self.speed.size) < 1.0 - np.exp(-FORGET_RATE * h)
        looks[rows[after >= last]] = True
        ended = np.flatnonzero(looks)
        if ended.size:
            self.look(States(self.position[ended], self.direction[ended], self.speed[ended]), self._but[ended], ended)


def _resampled(tracks: Tracks) -> Iterator[tuple[int, States]]:
    """Vehicle and rows `ROW_S` apart of each track without a gap."""
    vehicle = tracks.vehicle
    order = np.lexsort((tracks.time_ns, vehicle))
    time_s = (tracks.time_ns[order] - tracks.time_ns.min(initial=0)) * 1e-9
    begins = np.flatnonzero((np.diff(vehicle[order], prepend=-1) != 0) | (np.diff(time_s, prepend=0.0) > LONGEST_GAP_S))
    ends = np.append(begins[1:], order.size)
    for begin, end in zip(begins, ends, strict=True):
        rows, known = order[begin:end], time_s[begin:end]
        at = np.arange(known[0], known[-1] + 1e-6, ROW_S)
        if at.size < 2:
            continue
        moves = tracks.speed[rows] >= MOVING
        moves = moves if moves.any() else ~moves
        course = np.unwrap(tracks.direction[rows[moves]])
        yield (
            int(vehicle[rows[0]]),
            States(
                np.column_stack([np.interp(at, known, tracks.position[rows, axis]) for axis in (0, 1)]),
                np.interp(at, known[moves], course),
                np.interp(at, known, tracks.speed[rows]),
            ),
        )
