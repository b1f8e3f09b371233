"""Raw GPS of Chicago's campus buses, a fix each two seconds or slower: a map of it, and forecasts at that rate.

`Tracks.from_positions` derives no course across more than two seconds, and drops such rows. The map is learned from
what it keeps, as a user gets it; and beside it from trips filled each second by straight lines, up to `FILLED_S`.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from functools import cache
from pathlib import Path
from typing import NamedTuple

import numpy as np
from paired_errors import likeliest

from dirprim_filter import PrimitiveMap, Tracks, learn_primitives
from dirprim_filter.arrays import BoolArray, FloatArray, IntArray
from dirprim_filter.evaluation.baselines.trajectory_memory import States, TrajectoryMemory
from dirprim_filter.evaluation.forecast_cases import Cases, score_cases
from dirprim_filter.evaluation.forecasting import SampleRollouts, from_beliefs, straight_on_as

DATA = Path(__file__).parents[2] / "../shared/data/chicago_bus/chicago_bus.csv"
N_FOLDS = 2
HORIZONS_S = (5.0, 10.0, 20.0)
CHOSEN_BY_S = HORIZONS_S[:2]
"""Horizons by which the memory's settings are chosen: to the last one takes twice as long."""
FILLED_S = 10.0
"""Between two fixes further apart a bus may have turned."""
STARTS, LONGEST_STEP_S = 8, 4.0
"""Forecasts of a trip, and the longest step before a start, which gives its course and speed: nothing ahead is used."""
MIN_SPEED = 0.5
N_SAMPLES = 100


class Fixes(NamedTuple):
    """Rows in order of trip and time."""

    trip: IntArray
    time_s: FloatArray
    position: FloatArray

    def of(self, rows: BoolArray) -> Fixes:
        """The chosen rows."""
        return Fixes(*(column[rows] for column in self))

    @property
    def steps_s(self) -> FloatArray:
        """Seconds between fixes of a trip."""
        return np.asarray(np.diff(self.time_s)[np.diff(self.trip) == 0])

    def tracks(self) -> Tracks:
        """As a user reads them."""
        return Tracks.from_positions(
            track_id=self.trip, time_ns=np.round(self.time_s * 1e9).astype(np.int64), position=self.position
        )

    def filled(self) -> Fixes:
        """A row each second by straight lines, where fixes are at most `FILLED_S` apart; else the trip is cut."""
        parts = []
        cut = (np.diff(self.trip) != 0) | (np.diff(self.time_s) > FILLED_S)
        for number, rows in enumerate(np.split(np.arange(self.trip.size), np.flatnonzero(cut) + 1)):
            time_s = np.arange(self.time_s[rows[0]], self.time_s[rows[-1]] + 1e-6)
            place = [np.interp(time_s, self.time_s[rows], self.position[rows, axis]) for axis in (0, 1)]
            parts.append(Fixes(np.full(time_s.size, number), time_s, np.column_stack(place)))
        return Fixes(*(np.concatenate(column) for column in zip(*parts, strict=True)))


@cache
def fixes() -> Fixes:
    """All."""
    rows = np.genfromtxt(DATA, delimiter=",", names=True)
    rows = rows[np.lexsort((rows["time_s"], rows["track_id"]))]
    return Fixes(rows["track_id"].astype(np.int64), rows["time_s"], np.column_stack([rows["x_m"], rows["y_m"]]))


def starts_of(given: Fixes) -> Cases:
    """Up to `STARTS` instants of each trip, spread over it, by what is known then."""
    chosen, later = [], []
    for rows in np.split(np.arange(given.trip.size), np.flatnonzero(np.diff(given.trip)) + 1):
        time_s = given.time_s[rows]
        able = np.flatnonzero(
            (np.diff(time_s, prepend=-np.inf) <= LONGEST_STEP_S) & (time_s + HORIZONS_S[0] <= time_s[-1])
        )
        if able.size == 0:
            continue
        at = able[np.unique(np.linspace(0, able.size - 1, min(able.size, STARTS)).round().astype(np.int64))]
        wanted = time_s[at][:, None] + np.array(HORIZONS_S)
        place = [np.interp(wanted, time_s, given.position[rows, axis], right=np.nan) for axis in (0, 1)]
        after = np.clip(np.searchsorted(time_s, wanted), 1, time_s.size - 1)
        near = time_s[after] - time_s[after - 1] <= FILLED_S / 2.0
        chosen.append(rows[at])
        later.append(np.where(near[..., None], np.stack(place, axis=-1), np.nan))
    row = np.concatenate(chosen)
    step = np.diff(given.position, axis=0, prepend=0.0) / np.diff(given.time_s, prepend=-np.inf)[:, None]
    log = Tracks(
        track_id=given.trip, time_ns=np.round(given.time_s * 1e9).astype(np.int64), position=given.position,
        direction=np.arctan2(step[:, 1], step[:, 0]), speed=np.hypot(*step.T),
    )  # fmt: skip
    vehicle = given.trip[row]
    row = np.argsort(np.argsort(given.time_s, kind="stable"))[row]  # tracks are in order of time
    return Cases(
        vehicle=vehicle, name=vehicle.astype(np.str_), group=log.group[row], position=log.position[row],
        direction=log.direction[row], speed=log.speed[row], later=np.concatenate(later), log=log, row=row,
    )  # fmt: skip


class Fold(NamedTuple):
    """Trips to learn from, and trips to be judged by."""

    train: Fixes
    test: Fixes
    seed: int


def folds() -> Iterator[Fold]:
    """Each trip is held out once."""
    names, trip = np.unique(fixes().trip, return_inverse=True)
    part = np.random.default_rng(0).permutation(np.arange(names.size) % N_FOLDS)[trip]
    for i in range(N_FOLDS):
        yield Fold(fixes().of(part != i), fixes().of(part == i), i)


def moving(tracks: Tracks) -> Tracks:
    """Rows that have a direction."""
    return tracks[tracks.speed > MIN_SPEED]


@cache
def maps(seed: int) -> dict[str, PrimitiveMap]:
    """Of the training trips of a fold."""
    fold = list(folds())[seed]
    kept = fold.train.tracks()
    with_map = learn_primitives(kept, rng=np.random.default_rng(seed))
    one_cell = learn_primitives(kept, tessellation="grid", n_cells=1, rng=np.random.default_rng(seed))
    filled = learn_primitives(fold.train.filled().tracks(), rng=np.random.default_rng(seed))
    return {
        "with the map": with_map, "without the map": with_map.without_places(), "one cell": one_cell,
        "with the map, trips filled": filled, "without the map, trips filled": filled.without_places(),
    }  # fmt: skip


@cache
def flat_grid(seed: int, cell_size: float) -> FloatArray:
    """Log densities of a fold's held-out rows on a grid of the paper's flat primitives."""
    fold = list(folds())[seed]
    rng = np.random.default_rng(seed)
    learned = learn_primitives(
        moving(fold.train.tracks()), tessellation="grid", cell_size=cell_size, primitive="flat", rng=rng
    )
    return log_density(learned, moving(fold.test.tracks()))


def log_density(learned: PrimitiveMap, rows: Tracks) -> FloatArray:
    """(n,) of direction and speed, per radian and m/s."""
    return np.asarray(learned.log_density(rows.position, rows.direction, rows.speed))


def densities() -> tuple[IntArray, dict[str, FloatArray]]:
    """The trip of each held-out row, and its log density by each method; the flat grid's size is best in hindsight."""
    (size,) = likeliest(lambda at: float(sum(flat_grid(i, at[0]).sum() for i in range(N_FOLDS))), cell_size=20.0)
    trips, found = [], {}
    for fold in folds():
        rows = moving(fold.test.tracks())
        trips.append(rows.track_id)
        for name, learned in maps(fold.seed).items():
            found.setdefault(name, []).append(log_density(learned, rows))
        found.setdefault(f"flat grid of {size:g} m", []).append(flat_grid(fold.seed, size))
    return np.concatenate(trips), {name: np.concatenate(parts) for name, parts in found.items()}


def forecasts() -> tuple[IntArray, dict[str, FloatArray]]:
    """The trip of each start, and (n, horizons) energy scores by each method, metres; NaN where no truth is known."""
    trips, found = [], {}
    for fold in folds():
        starts = starts_of(fold.test)
        trips.append(starts.vehicle)
        for name, (sample, rng) in samplers(fold).items():
            energy = score_cases(sample(starts, N_SAMPLES, rng), starts.later)[..., 0]
            found.setdefault(name, []).append(energy)
    return np.concatenate(trips), {name: np.concatenate(parts) for name, parts in found.items()}


@cache
def memory_settings() -> tuple[float, float]:
    """The rival's nearness and strength, chosen once: trips of the other fold's test part choose too, in its favour."""
    trips = next(folds()).train.filled().tracks()
    cases = Cases.of(trips, horizons_s=CHOSEN_BY_S)
    found, _ = TrajectoryMemory.of(trips).chosen(cases, CHOSEN_BY_S, rng=np.random.default_rng(0))
    return found.nearness, found.strength


def samplers(fold: Fold) -> dict[str, tuple[SampleRollouts, np.random.Generator]]:
    """What forecasts, each with random numbers of its own."""
    nearness, strength = memory_settings()
    memory = replace(TrajectoryMemory.of(fold.train.filled().tracks()), nearness=nearness, strength=strength)

    def remembered(cases: Cases, n_samples: int, rng: np.random.Generator) -> FloatArray:
        now = States(cases.position, cases.direction, cases.speed)
        return memory.sample(now, time_s=np.array(HORIZONS_S), n_samples=n_samples, rng=rng)

    known = starts_of(fold.train)
    return {
        "constant velocity": (straight_on_as(known, HORIZONS_S), np.random.default_rng(fold.seed)),
        "trajectory memory": (remembered, np.random.default_rng([fold.seed, 1])),
    } | {
        name: (from_beliefs(learned, known, HORIZONS_S, rng := np.random.default_rng([fold.seed, 2])).sample, rng)
        for name, learned in maps(fold.seed).items()
    }
