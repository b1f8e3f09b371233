"""Real GPS and AIS: gaps of some usual intervals of the log, cut into trips that no map has seen.

Files named `train*` are learned from where others are beside them. Else every fourth block of consecutive groups is
held out, or of trips where there is one group: pieces of one user follow each other. The map is learned as a user's
would be, from positions; where these are too seldom to show a course, there is no map, and its methods are silent.
"""

from __future__ import annotations

import logging
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace
from functools import cache, partial
from pathlib import Path
from typing import NamedTuple

import numpy as np

from dirprim_filter import PrimitiveMap, Tracks
from dirprim_filter.arrays import AnyArray, BoolArray, FloatArray
from dirprim_filter.config import FilterConfig
from dirprim_filter.evaluation.settings import Axis, Choice, choose
from dirprim_filter.origin import Origin
from grounds.findings import WITH, WITHOUT, Asked, Findings, learned
from grounds.windows import N_SAMPLES, Answer, Window, judged, marks, ours

N_BLOCKS = 24
INTERVALS = (2, 5, 20)
CONTEXT = 12
"""Measurements before a gap, and half as many after it."""
MOST_WINDOWS, TRAINING_WINDOWS = 60, 200
FITTED_WINDOWS = 32
"""That our noise is chosen by, with gaps of five intervals."""
STEPS = 20
"""Of the motion model in a usual interval, at most: a log of minutes needs none of a tenth of a second."""
OUR_GAIN = 0.01
"""Of the log energy scores: what chance may bring."""
MOVES_M = 5.0
"""From one end of a window to the other: of what stands nothing is to be found."""


class Log(NamedTuple):
    """Rows in order of trip and time."""

    trip: AnyArray
    time_s: FloatArray
    place: FloatArray
    block: AnyArray
    is_held_out: BoolArray

    def of(self, rows: AnyArray) -> Log:
        """The chosen rows."""
        return Log(*(column[rows] for column in self))

    def tracks(self) -> Tracks:
        """As a user reads them."""
        return Tracks.from_positions(
            track_id=self.trip, time_ns=np.round(self.time_s * 1e9).astype(np.int64), position=self.place
        )

    def trips(self) -> Iterator[Log]:
        """Each trip."""
        for rows in np.split(np.arange(self.trip.size), np.flatnonzero(self.trip[1:] != self.trip[:-1]) + 1):
            yield self.of(rows)


def _csv(path: Path) -> Sequence[AnyArray]:
    """Trip, group, time and place of each row."""
    of = np.genfromtxt(path, delimiter=",", names=True, dtype=None, encoding="utf-8")
    group = of["group"] if "group" in (of.dtype.names or ()) else np.zeros(of.size, np.int64)
    trip = np.char.add(np.char.add(group.astype(np.str_), "/"), of["track_id"].astype(np.str_))
    return trip, group, of["time_s"].astype(np.float64), np.column_stack([of["x_m"], of["y_m"]])


@dataclass(frozen=True, slots=True)
class Source:
    """A data set.

    Attributes:
        folder: of the data.
        noise_m: of a fix.
        density: m^2/s^3, where the fit of constant velocity begins.
        gaps_s: judged beside those of `INTERVALS`.
        rows: reads a file.
    """

    folder: str
    noise_m: float
    density: float
    gaps_s: tuple[float, ...] = ()
    rows: Callable[[Path], Sequence[AnyArray]] = _csv


def _austin(path: Path) -> Sequence[AnyArray]:
    """A day of Austin's buses; a trip of a vehicle is one, and a vehicle a group."""
    of = np.genfromtxt(path, delimiter=",", names=True, dtype=None, encoding="utf-8", invalid_raise=False)
    stamp = np.array([text[:19] for text in of["timestamp"]], "datetime64[s]")
    place = Origin.parse("30.27,-97.74").to_plane(np.column_stack([of["latitude"], of["longitude"]]))
    trip = [f"{path.stem}/{vehicle}/{name}" for vehicle, name in zip(of["vehicle_id"], of["trip_id"], strict=True)]
    return np.array(trip), of["vehicle_id"].astype(np.int64), stamp.astype(np.float64), place


SOURCES = {
    "geolife": Source("geolife", 5.0, 1.0, gaps_s=(10.0, 60.0)),
    "chicago_bus": Source("chicago_bus", 3.0, 1.0),
    "solent_ais": Source("solent_ais", 10.0, 0.01),
    "austin_bus": Source("austin_bus", 10.0, 1.0, rows=_austin),
}


def log_of(source: Source, data: Path) -> Log:
    """All rows of a folder's files, one of each trip and time, and which are held out."""
    files = sorted(path for path in (data / source.folder).iterdir() if ".csv" in path.name)
    parts = [source.rows(path) for path in files]
    of_train = np.repeat([path.name.startswith("train") for path in files], [len(part[0]) for part in parts])
    trip, group, time_s, place = (np.concatenate(column) for column in zip(*parts, strict=True))
    order = np.lexsort((time_s, trip))
    order = order[np.isfinite(place[order]).all(axis=1)]
    order = order[np.append(True, (trip[order][1:] != trip[order][:-1]) | (np.diff(time_s[order]) > 0))]
    own = group if np.unique(group).size > 1 else np.unique(trip, return_inverse=True)[1]
    number = np.unique(own, return_inverse=True)[1]
    block = number * N_BLOCKS // (number.max() + 1)
    held_out = ~of_train if of_train.any() and not of_train.all() else block % 4 == 3
    return Log(trip[order], time_s[order], place[order], block[order], held_out[order])


def windows_of(log: Log, gap_s: float, *, most: int, seed: int = 0) -> list[Window]:
    """Gaps of this length, a few of each trip, drawn at random; what is measured about each is enough to see by."""
    found = []
    for of in log.trips():
        rng, n = np.random.default_rng([seed, of.trip.size]), of.trip.size
        for start in rng.permutation(np.arange(3, np.searchsorted(of.time_s, of.time_s[-3:][0] - gap_s)))[:3]:
            end = int(np.searchsorted(of.time_s, of.time_s[start] + gap_s - 1e-6))
            first, last = max(start + 1 - CONTEXT, 0), min(end + CONTEXT // 2, n)
            steps = np.diff(of.time_s[first : start + 1]), np.diff(of.time_s[end:last])
            usual = np.median(np.concatenate(steps)) if n - end >= 3 and start >= 3 else 0.0
            if end <= start + 1 or usual == 0 or max(map(np.max, steps)) > max(3.0 * usual, 2.0):
                continue
            moved, lasted_s = of.place[end] - of.place[start], of.time_s[end] - of.time_s[start]
            if np.hypot(*moved) < MOVES_M or lasted_s > 1.5 * gap_s:
                continue
            seen, hidden = np.r_[first : start + 1, end:last], np.arange(start + 1, end)
            since = of.time_s[first]
            found.append(
                Window(
                    str(of.block[0]), of.time_s[seen] - since, of.place[seen], of.time_s[hidden] - since,
                    of.place[hidden],
                )
            )  # fmt: skip
    chosen = np.random.default_rng(seed).permutation(len(found))[:most]
    return [found[i] for i in sorted(chosen)]


def of_gps(name: str, asked: Asked) -> list[Findings]:
    """All gaps of a data set."""
    source = SOURCES[name]
    log = log_of(source, asked.data)
    if asked.is_smoke:
        log = log.of(log.block < 4)
    train, test = log.of(~log.is_held_out), log.of(log.is_held_out)
    usual_s = float(np.median(np.concatenate([np.diff(of.time_s) for of in log.trips()])))
    try:
        with_map = learned(train.tracks(), asked, name, quick_m=50.0)
    except ValueError as error:
        logging.getLogger(__name__).warning("%s: no map, %s", name, error)
        with_map = None
    config = FilterConfig(
        noise_m=source.noise_m, interaction="none", n_particles=100 if asked.is_smoke else 1000,
        step_s=max(usual_s / STEPS, FilterConfig().step_s),
    )  # fmt: skip
    tables, configs, choices = [], (config, config), ()
    if with_map:
        training = windows_of(train, 5 * usual_s, most=3 if asked.is_smoke else FITTED_WINDOWS, seed=1)
        configs, choices = noises_fitted(training, with_map.without_places(), _lasting(config, 5 * usual_s))
    by_map = {WITH: with_map, WITHOUT: with_map.without_places() if with_map else None}
    gaps_s = {*(times * usual_s for times in INTERVALS[: 1 if asked.is_smoke else None]), *source.gaps_s}
    for gap_s in sorted(gaps_s):
        windows = windows_of(test, gap_s, most=3 if asked.is_smoke else MOST_WINDOWS)
        training = windows_of(train, gap_s, most=3 if asked.is_smoke else TRAINING_WINDOWS, seed=1)
        if not windows or not training:
            logging.getLogger(__name__).warning("%s: no trip with a gap of %g s between other rows", name, gap_s)
            continue
        asked_of = [_lasting(of, gap_s) for of in configs]
        answers = {method: partial(_answers, windows, model, asked_of) for method, model in by_map.items()}
        tables += judged(
            windows, training, answers, about=f"{name}, gaps of {gap_s:g} s ({gap_s / usual_s:.1f} intervals)",
            n_seeds=asked.n_seeds, density=source.density, noise_m=source.noise_m,
        )  # fmt: skip
        for table, choice in zip(tables[-2:], choices, strict=False):
            table.settings.append(choice)
    return tables


def _lasting(config: FilterConfig, gap_s: float) -> FilterConfig:
    """With beliefs that outlast a gap."""
    return replace(config, max_gap_s=2.0 * gap_s + 5.0)


def noises_fitted(
    windows: Sequence[Window], model: PrimitiveMap, config: FilterConfig
) -> tuple[tuple[FilterConfig, FilterConfig], tuple[Choice, ...]]:
    """Our noise online and smoothed, as the rivals': by energy scores on training windows, of ours without the map.

    Online they have chance in them, which makes hills: that search begins where the smoothed one, of a smooth curve,
    ends.
    """

    @cache
    def energies(noise_m: float) -> tuple[float, ...]:
        found = ours(windows, model, replace(config, noise_m=noise_m), seed=0)
        return tuple(float(np.log(marks(windows, answer).energy.mean())) for answer in found)

    def chosen(how: str, which: int, start: float) -> Choice:
        axis = Axis(f"our {how} noise_m", start)
        return choose([axis], lambda values: -energies(values[0])[which], least_gain=OUR_GAIN)[0]

    smoothed = chosen("smoothed", 1, config.noise_m)
    online = chosen("online", 0, smoothed.chosen)
    return (replace(config, noise_m=online.chosen), replace(config, noise_m=smoothed.chosen)), (online, smoothed)


def _answers(
    windows: Sequence[Window], model: PrimitiveMap | None, configs: Sequence[FilterConfig], seed: int
) -> tuple[Answer, Answer]:
    """Online by the first configuration, smoothed by the second."""
    if model is None:
        n = sum(of.hidden_s.size for of in windows)
        silent = Answer(*(np.full((n, *shape), np.nan) for shape in ((2,), (2, 2), (N_SAMPLES, 2))))
        return silent, silent
    online, smoothed = ours(windows, model, configs[0], seed=seed)
    return online, smoothed if configs[1] == configs[0] else ours(windows, model, configs[1], seed=seed)[1]
