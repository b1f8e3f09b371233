"""What `peers.py` shows to every tracker: unlabelled detections with their truth, and other traffic of the same place.

A scene is a function in `SCENES`, of the number of seeds, that makes folds: `Part`s to be judged, others that settings
are chosen by, tracks that a map is learned from, and what is known of the sensor, which every tracker is given.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass, field, replace
from functools import partial

import ablation_scenes as ablation
import autoferry_scenarios as ferry
import mcity_drives as mcity
import numpy as np
from paired_errors import true_rows

from dirprim_filter import Tracks, read_tracks
from dirprim_filter.arrays import BoolArray
from dirprim_filter.cli.demo import in_ring, recordings_folder, with_blind_ring
from dirprim_filter.config import TrackingConfig
from dirprim_filter.detections import Detections
from dirprim_filter.evaluation.metrics.comparison import SIMILARITY_M, Comparison
from dirprim_filter.evaluation.scenes import Scene, honest_tracking
from dirprim_filter.evaluation.splits import held_out
from dirprim_filter.evaluation.tracked_rows import TrackedRows
from dirprim_filter.evaluation.truth import interpolated, known_at
from dirprim_filter.recording.reader import stream_detections
from dirprim_filter.sensor import Sensor
from dirprim_filter.simulation.sensor import detect
from dirprim_filter.simulation.traffic import simulate

RATE_NS = 100_000_000
NOISE_M, MISS_RATE, FALSE_PER_FRAME = 0.5, 0.05, 0.2
"""Of the recordings that ship, see `recordings/README.md`."""


Judging = Callable[[TrackedRows, Tracks], TrackedRows]
"""Which of a tracker's rows to judge by a truth."""


class UnavailableError(RuntimeError):
    """What a scene or a tracker needs is not here; the message says what."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Part:
    """One scene, or one run of it, of one group: its number is dropped.

    Attributes:
        seen: detections without ids.
        truth: at the instants that are judged.
        is_hidden: (n,) rows of the truth that the sensor cannot see. Left out: none.
        judged: the reported rows of which the truth says whether they are right. Left out: all.
    """

    seen: Detections
    truth: Tracks
    is_hidden: BoolArray = field(default_factory=lambda: np.empty(0, np.bool_))
    judged: Judging = lambda rows, _: rows

    def __post_init__(self) -> None:
        if not self.is_hidden.size:
            object.__setattr__(self, "is_hidden", np.zeros(len(self.truth), np.bool_))
        object.__setattr__(self, "truth", replace(self.truth, group=np.zeros(len(self.truth), np.int64)))

    def frames(self) -> Iterator[tuple[int, Detections]]:
        """The time and what is detected, at each instant of either, in order."""
        seen = {int(frame.time_ns[0]): frame for frame in self.seen.frames()}
        for time_ns in np.union1d(self.truth.time_ns, self.seen.time_ns).tolist():
            yield time_ns, seen.get(time_ns, Detections.none())


@dataclass(frozen=True, slots=True, kw_only=True)
class Fold:
    """A scene: what is judged, and what was known before.

    Attributes:
        judged: parts that intervals are over, such as one for each seed of the sensor.
        training: parts of other traffic, that all settings are chosen by.
        traffic: what a map is learned from; nothing of it is judged.
        noise_m: standard deviation of a detection in each axis.
        tracking: the true rates of detections, misses and arrivals.
        max_gap_s: how long our tracks may be unseen; others choose.
        similarity_m: of the scores.
        sensor: what ours is given of a sensor whose errors last, are late and biased; no other package takes it.
    """

    judged: tuple[Part, ...]
    training: tuple[Part, ...]
    traffic: Tracks
    noise_m: float
    tracking: TrackingConfig
    max_gap_s: float = 5.0
    similarity_m: float = SIMILARITY_M
    sensor: Sensor | None = None


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
        judged=tuple(part(of, truth) for of in seen),
        training=(part(_detected(other, 99), other),), traffic=traffic, noise_m=NOISE_M,
        tracking=known(traffic, area=area), max_gap_s=6.0 if is_blind else 5.0,
    )  # fmt: skip
    return [fold]


def _detected(truth: Tracks, seed: int) -> Detections:
    rng = np.random.default_rng(seed)
    return detect(truth, noise_m=NOISE_M, miss_rate=MISS_RATE, false_per_frame=FALSE_PER_FRAME, rng=rng)


def at_ten_hertz(tracks: Tracks, *, from_s: float, to_s: float) -> Tracks:
    """Rows of a slower log between two times, ten a second."""
    instants = np.arange(round(from_s * 1e9), round(to_s * 1e9), RATE_NS)
    found = known_at(tracks, np.zeros_like(instants), instants, longest_gap_s=1.0)
    instant, before, after = (column[np.argsort(found.instant, kind="stable")] for column in found)
    return interpolated(tracks, before, after, instants[instant])


def known(traffic: Tracks, *, area: float) -> TrackingConfig:
    """What is known of the sensor over an area, and how many vehicles come, by other traffic; per frame of .1 s."""
    n_frames = np.ptp(traffic.time_ns) / RATE_NS
    together = np.unique(traffic.time_ns, return_counts=True)[1].mean()
    return TrackingConfig(
        detection_probability=1.0 - MISS_RATE, clutter_density=FALSE_PER_FRAME / area,
        birth_density=float(traffic.n_tracks / n_frames / area), vehicle_density=float(together) / area,
    )  # fmt: skip


def dense(n_seeds: int, *, scene: str, demand: float) -> list[Fold]:
    """Dense traffic as in the ablation, of each seed 10 s; settings are chosen by 4 s of other traffic."""
    make = partial(simulate, scene, rate_hz=10.0, demand=demand)
    judged = tuple(_shown(make(duration_s=10.0, seed=2 + seed), seed) for seed in range(n_seeds))
    traffic = simulate(scene, duration_s=300.0, seed=1, rate_hz=5.0, demand=demand)
    return [_by_dense_sensor(judged, make(duration_s=4.0, seed=99), traffic)]


def lankershim(_: int) -> list[Fold]:
    """A quarter of the groups, by the sensor of the dense scenes; settings are chosen by 3 s of the others' median."""
    _check("Lankershim")
    train, test = held_out(ablation.log_of("lankershim/lankershim.csv"), share=0.75, rng=np.random.default_rng(0))
    groups = sorted(train.by_group(), key=len)
    other = groups[len(groups) // 2]
    other = other[other.time_ns < other.time_ns[0] + round(3e9)]
    return [_by_dense_sensor(tuple(_shown(group, 0) for group in test.by_group()), other, train)]


def _by_dense_sensor(judged: tuple[Part, ...], other: Tracks, traffic: Tracks) -> Fold:
    """Parts as the sensor of the ablation's dense scenes shows them, settings chosen by other tracks."""
    return Fold(
        judged=judged, training=(_shown(other, 99),), traffic=traffic,
        noise_m=ablation.DENSE.noise_m, tracking=honest_tracking(other, ablation.DENSE),
    )  # fmt: skip


def _check(scene: str) -> None:
    if missing := ablation.absent(scene):
        raise UnavailableError(f"{scene}: no {missing}")


def _shown(tracks: Tracks, seed: int) -> Part:
    return Part(seen=Scene.of(tracks, ablation.DENSE, seed=seed).seen, truth=tracks)


def drives(_: int) -> list[Fold]:
    """Mcity's drives, one left out in turn; settings are chosen by the one after it.

    Rows of a tracker that are far from the instrumented vehicles are not judged.
    """
    _check("Mcity")

    def part(drive: int) -> Part:
        seen = Detections.of(mcity.detected(drive)).without_ids()
        truth = true_rows(mcity.true(drive), seen.time_ns)[0]
        return Part(seen=seen, truth=truth, judged=near_the_truth)

    def fold(i: int) -> Fold:
        drive, after, *_ = (*mcity.with_truth(), *mcity.with_truth())[i:]
        sensor = mcity.calibrated(drive)
        config, tracking = mcity.configured(sensor)
        return Fold(
            judged=(part(drive),), training=(part(after),),
            traffic=mcity.traffic(drive), noise_m=config.noise_m, tracking=tracking, sensor=sensor,
        )  # fmt: skip

    return [fold(i) for i in range(len(mcity.with_truth()))]


def near_the_truth(rows: TrackedRows, truth: Tracks) -> TrackedRows:
    """Those within the gate of an instrumented vehicle: of others the truth does not say whether they are right."""
    near = Comparison.of(truth, rows, similarity_m=mcity.GATE_M).near
    return rows[np.unique(near.column)]


def boats(_: int) -> list[Fold]:
    """Autoferry's scenarios by radar, one left out in turn; settings are chosen by the one after it."""
    _check("autoferry")

    def part(number: int) -> Part:
        scene = ferry.Scenario.of(number, ("radar",))
        truth = true_rows(ferry.true(number), scene.instants)[0]
        return Part(seen=scene.seen, truth=truth, judged=lambda rows, _: ferry.nearby(rows, number))

    def fold(i: int) -> Fold:
        number, *others = ferry.SCENARIOS[i:] + ferry.SCENARIOS[:i]
        scene = ferry.Scenario.of(number, ("radar",))
        return Fold(
            judged=(part(number),), training=(part(others[0]),),
            traffic=Tracks.concatenate(list(map(ferry.true, others))), noise_m=scene.config.noise_m,
            tracking=scene.tracking, max_gap_s=ferry.MAX_GAP_S,
            similarity_m=ferry.SIMILARITY_M,
        )  # fmt: skip

    return [fold(i) for i in range(len(ferry.SCENARIOS))]


SCENES: dict[str, Callable[[int], list[Fold]]] = {
    "A": partial(recorded, is_blind=False),
    "B": partial(recorded, is_blind=True),
    "intersection": partial(dense, scene="intersection", demand=2.2),
    "highway": partial(dense, scene="highway", demand=2.5),
    "lankershim": lankershim,
    "mcity": drives,
    "autoferry": boats,
}
