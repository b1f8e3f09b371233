"""What `peers.py` shows to every tracker: unlabelled detections with their truth, and other traffic of the same place.

A scene is a function in `SCENES`, of the number of seeds, that gives folds: each with `Part`s to be judged, others that
settings are chosen by, tracks that a map is learned from, and what is known of the sensor, which every tracker is told.
"""

from __future__ import annotations

import sys
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, field, replace
from functools import cache, partial
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

sys.path.insert(0, str(Path(__file__).parents[1]))

from scipy.interpolate import CubicHermiteSpline

from dirprim_filter import Tracks, read_tracks
from dirprim_filter.arrays import BoolArray, IntArray
from dirprim_filter.cli.blind_demo import in_ring, with_blind_ring
from dirprim_filter.cli.demo import recordings_folder
from dirprim_filter.config import FilterConfig, TrackingConfig
from dirprim_filter.detections import Detections
from dirprim_filter.evaluation.calibration.pairing import Scene as Paired
from dirprim_filter.evaluation.tracking_report import Scales
from dirprim_filter.evaluation.truth import interpolated, known_at
from dirprim_filter.recording.reader import stream_detections
from dirprim_filter.simulation.sensor import detect

DATA = Path(__file__).parents[2] / "../shared/data"
RATE_NS = 100_000_000
"""All scenes but autoferry are of 10 frames a second."""
NOISE_M, MISS_RATE, FALSE_PER_FRAME = 0.5, 0.05, 0.2
"""Of the recordings that ship, see `recordings/README.md`."""


class UnavailableError(RuntimeError):
    """What a scene or a tracker needs is not here; the message says what."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Part:
    """One world, or one run of it.

    Attributes:
        seen: detections without ids.
        truth: at the instants that are judged.
        is_hidden: (n,) rows of the truth that the sensor cannot see. Left out: none.
    """

    seen: Detections
    truth: Tracks
    is_hidden: BoolArray = field(default_factory=lambda: np.empty(0, np.bool_))

    def __post_init__(self) -> None:
        if not self.is_hidden.size:
            object.__setattr__(self, "is_hidden", np.zeros(len(self.truth), np.bool_))

    def frames(self) -> Iterator[tuple[int, Detections]]:
        """The time and what is detected, at each instant of either, in order."""
        instants = np.union1d(self.truth.time_ns, self.seen.time_ns)
        seen = self.seen[np.argsort(self.seen.time_ns, kind="stable")]
        ends = np.searchsorted(seen.time_ns, instants, side="right")
        starts = np.searchsorted(seen.time_ns, instants, side="left")
        for time_ns, start, end in zip(instants.tolist(), starts.tolist(), ends.tolist(), strict=True):
            yield time_ns, seen[np.arange(start, end)]


@dataclass(frozen=True, slots=True, kw_only=True)
class Fold:
    """What is judged, and what was known before.

    Attributes:
        judged: parts that intervals are over.
        clusters: what they are: seeds, groups, drives.
        training: parts of other traffic, that all settings are chosen by.
        traffic: what a map is learned from; nothing of it is judged.
        noise_m: standard deviation of a detection in each axis.
        tracking: the true rates of detections, misses and arrivals.
        max_gap_s: how long our tracks may be unseen; others choose.
        scales: of the metrics.
    """

    judged: tuple[Part, ...]
    clusters: str
    training: tuple[Part, ...]
    traffic: Tracks
    noise_m: float
    tracking: TrackingConfig
    max_gap_s: float = 5.0
    scales: Scales = field(default_factory=Scales)


# --- The recordings that ship --------------------------------------------------------------------------


def recorded(n_seeds: int, *, is_blind: bool) -> list[Fold]:
    """The intersection's recording; the first seed is as it was recorded, others are detected anew."""
    log = recordings_folder() / "intersection_track.mcap"
    truth, traffic = read_tracks(log), read_tracks(recordings_folder() / "intersection_learn.mcap")
    seen = [Detections.concatenate(stream_detections(log)), *(_detected(truth, seed) for seed in range(1, n_seeds))]
    other = at_ten_hertz(traffic, from_s=300.0, to_s=330.0)

    def part(of: Detections, rows: Tracks) -> Part:
        if is_blind:
            return Part(seen=with_blind_ring(of), truth=rows, is_hidden=in_ring(rows.position))
        return Part(seen=of.without_ids(), truth=rows)

    area = float(np.prod(np.ptp(truth.position, axis=0)))
    fold = Fold(
        judged=tuple(part(of, truth) for of in seen), clusters="seeds",
        training=(part(_detected(other, 99), other),), traffic=traffic, noise_m=NOISE_M,
        tracking=known(traffic, miss_rate=MISS_RATE, false_per_frame=FALSE_PER_FRAME, area=area),
        max_gap_s=6.0 if is_blind else 5.0,
    )  # fmt: skip
    return [fold]


def _detected(truth: Tracks, seed: int) -> Detections:
    rng = np.random.default_rng(seed)
    return detect(truth, noise_m=NOISE_M, miss_rate=MISS_RATE, false_per_frame=FALSE_PER_FRAME, rng=rng)


def at_ten_hertz(tracks: Tracks, *, from_s: float, to_s: float) -> Tracks:
    """Rows of a slower log between two times, ten a second: cubic in between, by the positions and velocities."""
    parts = []
    instants = np.arange(round(from_s * 1e9), round(to_s * 1e9), RATE_NS)
    for name in np.unique(tracks.track_id):
        of = tracks[tracks.track_id == name]
        inside = instants[(instants >= of.time_ns[0]) & (instants <= of.time_ns[-1])]
        if len(of) < 2 or not inside.size:
            continue
        velocity = of.speed[:, None] * np.column_stack([np.cos(of.direction), np.sin(of.direction)])
        way = CubicHermiteSpline(of.time_ns * 1e-9, of.position, velocity)
        moved = way.derivative()(inside * 1e-9)
        stands = np.hypot(*moved.T) < 0.1
        last = np.searchsorted(of.time_ns, inside, side="right") - 1
        parts.append(
            Tracks(
                track_id=np.full(inside.size, name), time_ns=inside, position=way(inside * 1e-9),
                direction=np.where(stands, of.direction[last], np.arctan2(moved[:, 1], moved[:, 0])),
                speed=np.hypot(*moved.T),
            )
        )  # fmt: skip
    return Tracks.concatenate(parts)


def known(traffic: Tracks, *, miss_rate: float, false_per_frame: float, area: float) -> TrackingConfig:
    """What is known of a sensor over an area, and how many vehicles come, by other traffic; per frame of .1 s."""
    worlds = list(traffic.worlds())
    n_frames = sum(np.ptp(world.time_ns) for world in worlds) / RATE_NS
    together = np.concatenate([np.unique(world.time_ns, return_counts=True)[1] for world in worlds]).mean()
    return TrackingConfig(
        detection_probability=1.0 - miss_rate, clutter_density=max(false_per_frame, 1e-6) / area,
        birth_density=float(traffic.n_tracks / n_frames / area), vehicle_density=float(together) / area,
    )  # fmt: skip


# --- Scenes that are made ------------------------------------------------------------------------------


def dense(n_seeds: int, *, place: str, demand: float) -> list[Fold]:
    """SUMO's dense traffic: a fifth of the vehicles missed, ten false detections in each frame."""
    truth = _simulated(place, demand=demand, duration_s=30.0, seed=2)
    other = _simulated(place, demand=demand, duration_s=300.0, seed=1)
    window = other[(other.time_ns >= 100_000_000_000) & (other.time_ns < 110_000_000_000)]
    fold = Fold(
        judged=tuple(_cluttered(truth, seed) for seed in range(n_seeds)), clusters="seeds",
        training=(_cluttered(window, 99),), traffic=other[(other.time_ns // RATE_NS) % 2 == 0], noise_m=NOISE_M,
        tracking=known(other, miss_rate=0.2, false_per_frame=10.0, area=_area(truth)),
    )  # fmt: skip
    return [fold]


@cache
def _simulated(place: str, *, demand: float, duration_s: float, seed: int) -> Tracks:
    from dirprim_filter.simulation.traffic import SimulationError, simulate

    try:
        return simulate(place, duration_s=duration_s, seed=seed, demand=demand)
    except SimulationError as error:
        raise UnavailableError(str(error)) from error


def _cluttered(truth: Tracks, seed: int) -> Part:
    seen = detect(truth, noise_m=NOISE_M, miss_rate=0.2, false_per_frame=10.0, rng=np.random.default_rng(seed))
    return Part(seen=seen.without_ids(), truth=truth)


def _area(tracks: Tracks) -> float:
    return float(np.prod(np.ptp(tracks.position, axis=0)))


# --- Real places and real sensors ----------------------------------------------------------------------


def lankershim(n_seeds: int) -> list[Fold]:
    """Eight of Lankershim's recordings, each a world of its own, with the same sensor; a map of the other sixteen."""
    tracks = read_table("lankershim/lankershim.csv")
    worlds = list(tracks.worlds())
    order = np.random.default_rng(0).permutation(len(worlds))
    judged, others = [worlds[i] for i in order[:8]], [worlds[i] for i in order[8:]]
    traffic = Tracks.concatenate(others)
    area = float(np.mean([_area(world) for world in others]))
    fold = Fold(
        judged=tuple(_cluttered(_alone(world), n_seeds + i) for i, world in enumerate(judged)), clusters="groups",
        training=tuple(_cluttered(_alone(world), 99) for world in others[:2]), traffic=traffic, noise_m=NOISE_M,
        tracking=known(traffic, miss_rate=0.2, false_per_frame=10.0, area=area),
    )  # fmt: skip
    return [fold]


def read_table(name: str) -> Tracks:
    """A table of real data."""
    from dirprim_filter.recording.tables import read_csv

    path = DATA / name
    if not path.exists():
        raise UnavailableError(f"{path} is absent")
    return read_csv(path).tracks


def _alone(world: Tracks) -> Tracks:
    return replace(world, group=np.zeros(len(world), np.int64))


def mcity(_: int) -> list[Fold]:
    """Roadside detections of a drive, in turn; all else is of the other drives. Truth is taken a latency before."""
    import mcity_drives as roadside

    if not roadside.DATA.exists():
        raise UnavailableError(f"{roadside.DATA} is absent")
    return [_mcity_fold(roadside, held) for held in roadside.WITH_TRUTH]


def _mcity_fold(roadside: Any, held: int) -> Fold:
    others = [drive for drive in roadside.WITH_TRUTH if drive != held]
    sensor = roadside.calibrated(held)
    parts = {drive: _mcity_part(roadside, drive, sensor.latency_s) for drive in roadside.WITH_TRUTH}
    traffic = [roadside.without_bias(roadside.detected(drive), sensor) for drive in roadside.DRIVES if drive != held]
    return Fold(
        judged=(parts[held],), clusters="drives", training=tuple(parts[drive] for drive in others),
        traffic=roadside.in_one_world(traffic),
        noise_m=float(np.sqrt(0.5 * (sensor.along.spread_m**2 + sensor.across.spread_m**2))),
        tracking=sensor.informs(FilterConfig(), TrackingConfig())[1],
    )  # fmt: skip


def _mcity_part(roadside: Any, drive: int, latency_s: float) -> Part:
    seen = Detections.of(roadside.detected(drive)).without_ids()
    return Part(
        seen=replace(seen, group=np.zeros(len(seen), np.int64)),
        truth=at_instants(roadside.true(drive), np.unique(seen.time_ns), latency_s=latency_s),
    )


def at_instants(truth: Tracks, instants: IntArray, *, latency_s: float = 0.0, longest_s: float = 1.0) -> Tracks:
    """Truth between its rows, linearly, a latency before each instant and named by it; no gap is bridged for longer."""
    at = instants - round(latency_s * 1e9)
    found = known_at(truth, np.full(at.size, truth.group[0]), at, longest_gap_s=longest_s)
    order = np.argsort(at[found.instant], kind="stable")
    instant, before, after = (column[order] for column in found)
    return replace(interpolated(truth, before, after, at[instant]), time_ns=instants[instant])


BOATS_GATE_M = 15.0
"""A detection of a boat lies within it."""


def autoferry(_: int) -> list[Fold]:
    """Radar and lidar of a harbour, a scenario left out in turn; noise and rates are those of the other scenarios."""
    detections, truth = (DATA / f"autoferry/{name}.csv" for name in ("detections", "truth"))
    if not truth.exists():
        raise UnavailableError(f"{truth} is absent")
    columns = np.genfromtxt(detections, delimiter=",", names=True, dtype=None, encoding="utf-8")
    tracks = read_table("autoferry/truth.csv")
    groups = np.unique(tracks.group).tolist()
    boats = {}
    for group in groups:
        rows = columns[columns["group"] == group]
        seen = Detections(
            track_id=np.full(rows.size, ""), time_ns=np.round(rows["time_s"] * 1e9).astype(np.int64),
            position=np.column_stack([rows["x_m"], rows["y_m"]]),
        )  # fmt: skip
        world = tracks[tracks.group == group]
        truth_rows = at_instants(replace(world, group=np.zeros(len(world), np.int64)), np.unique(seen.time_ns))
        boats[group] = _Boats(Part(seen=seen, truth=truth_rows), rows["sensor"] == "radar")
    return [_autoferry_fold(boats, held, tracks[tracks.group != held]) for held in groups]


class _Boats(NamedTuple):
    """A scenario, and which of its detections are the radar's."""

    part: Part
    is_radar: BoolArray


def _autoferry_fold(boats: Mapping[int, _Boats], held: int, traffic: Tracks) -> Fold:
    others = [of for group, of in boats.items() if group != held]
    spread, n_hits, n_false, n_true, n_frames = {}, 0, 0, 0, 0
    for is_radar in (True, False):
        errors = []
        for part, radar in others:
            seen = part.seen[radar == is_radar]
            paired = Paired(seen, part.truth)
            rows = paired.truth_at(0.0)
            row, other = paired.matched(rows, gate_m=BOATS_GATE_M)
            errors.append((seen.position[other] - rows.position[row]).ravel())
            n_hits, n_false = n_hits + row.size, n_false + len(seen) - row.size
            n_true, n_frames = n_true + rows.frame.size, n_frames + np.unique(seen.time_ns).size
        spread[is_radar] = float(np.sqrt(np.mean(np.concatenate(errors) ** 2)))

    def told(of: _Boats) -> Part:
        variance = np.where(of.is_radar, spread[True] ** 2, spread[False] ** 2)
        return replace(of.part, seen=replace(of.part.seen, covariance=variance[:, None, None] * np.eye(2)))

    area = float(np.prod(np.ptp(np.concatenate([of.part.seen.position for of in others]), axis=0)))
    return Fold(
        judged=(told(boats[held]),), clusters="scenarios", training=tuple(map(told, others[:2])), traffic=traffic,
        noise_m=float(np.sqrt(0.5 * (spread[True] ** 2 + spread[False] ** 2))),
        tracking=TrackingConfig(
            detection_probability=n_hits / n_true, clutter_density=n_false / n_frames / area,
            birth_density=traffic.n_tracks / n_frames / area, vehicle_density=2.0 / area,
        ),
        scales=Scales(cutoff_m=20.0, similarity_m=20.0),
    )  # fmt: skip


SCENES: dict[str, Callable[[int], list[Fold]]] = {
    "A": partial(recorded, is_blind=False),
    "B": partial(recorded, is_blind=True),
    "intersection": partial(dense, place="intersection", demand=2.2),
    "highway": partial(dense, place="highway", demand=2.5),
    "lankershim": lankershim,
    "mcity": mcity,
    "autoferry": autoferry,
}
