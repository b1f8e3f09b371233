"""The scenes of the ablation: what a seed gives to every variant, and what a variant reaches there."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import cache, cached_property
from pathlib import Path
from typing import Any, NamedTuple

import autoferry_scenarios as ferry
import mcity_drives as mcity
import numpy as np
from paired_errors import RowErrors, true_rows

from dirprim_filter.arrays import AnyArray, FloatArray
from dirprim_filter.config import FilterConfig, from_table
from dirprim_filter.detections import Detections
from dirprim_filter.estimates import Estimates
from dirprim_filter.evaluation.forecast_cases import SCORES, Cases, score_cases
from dirprim_filter.evaluation.forecasting import rollouts_of
from dirprim_filter.evaluation.scenes import Scene, followed
from dirprim_filter.evaluation.scores import TrackedScene, scored
from dirprim_filter.evaluation.splits import held_out
from dirprim_filter.evaluation.tracking_experiment import TrackingExperiment
from dirprim_filter.filtering import Tracker
from dirprim_filter.filtering.particle_filter import ParticleFilter
from dirprim_filter.primitives.learning import learn_primitives
from dirprim_filter.primitives.primitive_map import PrimitiveMap
from dirprim_filter.recording.tables import read_named
from dirprim_filter.simulation.traffic import simulate
from dirprim_filter.tracks import Tracks

DATA = Path(__file__).parents[2] / "../shared/data"
NEEDS = {
    "roundabout": "town03", "intersection": "town03", "Lankershim": "lankershim",
    "Mcity": "mcity_roadside", "autoferry": "autoferry",
}  # fmt: skip
ALONE = FilterConfig(interaction="none")
N_SAMPLES = 100
HORIZONS_S = (1.0, 5.0)


class Figure(NamedTuple):
    """Values that are compared one by one; clusters are names, or numbers where a run is one."""

    cluster: AnyArray
    value: FloatArray


Outcome = dict[str, Figure]


def absent(scene: str) -> str:
    """The folder of data that is not there; empty where nothing is missing."""
    folder = NEEDS.get(scene)
    return f"../shared/data/{folder}" if folder and not (DATA / folder).is_dir() else ""


@dataclass
class Simulated:
    """Traffic that a simulated sensor reports; the map is learned from other vehicles of it, or of elsewhen.

    Attributes:
        train: to learn from.
        test: to track.
        cases: the same vehicles at their own times, to forecast.
        among: all vehicles, for leaders of forecasts.
        experiment: how the sensor reports.
        seed: of the run.
        given: a map that was learned elsewhere.
    """

    train: Tracks
    test: Tracks
    cases: Tracks
    among: Tracks
    experiment: TrackingExperiment
    seed: int
    given: PrimitiveMap | None = None

    def relearned(self, **options: Any) -> PrimitiveMap:
        """By other options."""
        return learn_primitives(self.train, **options, rng=np.random.default_rng([self.seed, 1]))

    @cached_property
    def learned(self) -> PrimitiveMap:
        """By the defaults."""
        return self.given or self.relearned()

    @cached_property
    def scenes(self) -> list[Scene]:
        """The same for every variant."""
        return [Scene.of(group, self.experiment, seed=self.seed) for group in self.test.by_group()]

    def tracked(self, learned: PrimitiveMap, off: Any) -> Outcome:
        """Errors of tracking without a mechanism."""
        experiment = replace(self.experiment, filter=replace(self.experiment.filter, **off.filter))
        scenes = [scene._replace(tracking=replace(scene.tracking, **off.tracking)) for scene in self.scenes]

        def make() -> Any:
            return off.stripped(ParticleFilter(learned, experiment.filter))

        tracked = followed(scenes, make, experiment, seed=self.seed).filtered
        return errors_of(tracked, experiment)

    def forecast(self, learned: PrimitiveMap, *, alone: bool = False) -> Outcome:
        """Energies of forecasts, without leaders or with them, and the log density of motion."""
        cases = Cases.of(self.cases, horizons_s=HORIZONS_S, among=self.among)
        sample = rollouts_of(learned, HORIZONS_S, leaders=not alone)
        energy = score_cases(sample(cases, N_SAMPLES, np.random.default_rng(self.seed)), cases.later)
        energy = energy[..., SCORES.index("energy")]
        has_groups = np.unique(self.among.group).size > 1
        names = cases.group.astype(np.str_) if has_groups else cases.name
        moving = self.cases[self.cases.speed > 0.5]
        log_p = learned.log_density(moving.position, moving.direction, moving.speed)
        whose = (moving.group if has_groups else moving.track_id).astype(np.str_)
        return {
            **{f"energy at {h:g} s": Figure(names, energy[:, i]) for i, h in enumerate(HORIZONS_S)},
            "density": Figure(whose, log_p),
        }


def errors_of(scenes: list[TrackedScene], experiment: TrackingExperiment) -> Outcome:
    """Squared errors by row; without ids HOTA of each group too."""
    length = experiment.similarity_m
    _, errors = scored(scenes, with_ids=experiment.with_ids, similarity_m=length)
    found = {
        name: Figure(errors.cluster[rows], errors.squared[rows])
        for name, rows in (("in sight", ~errors.is_hidden), ("in gaps", errors.is_hidden))
    }
    if not experiment.with_ids:
        hotas = np.array([scored([scene], with_ids=False, similarity_m=length)[0].hota for scene in scenes])
        groups = np.array([str(scene.truth.group[0]) for scene in scenes])
        found["HOTA"] = Figure(groups if groups.size > 1 else np.zeros(1), hotas)
    return found


@cache
def log_of(path: str) -> Tracks:
    """A table of the data."""
    return read_named(DATA / path).tracks


def town(name: str) -> Callable[[int], Simulated]:
    """Nine tenths of a town's vehicles to learn from, the others to track: all from the same instant on, as none knows
    of another. Whom they followed is not tracked, so none responds to a leader."""

    def make(seed: int) -> Simulated:
        log = log_of(f"town03/{name}.csv")
        train, test = held_out(log, share=0.9, rng=np.random.default_rng([seed, 0]))
        return Simulated(train, at_once(test), test, log, TrackingExperiment(filter=ALONE), seed)

    return make


def at_once(tracks: Tracks) -> Tracks:
    """The same vehicles, each from time 0 on."""
    first_ns = tracks.time_ns[tracks.first_rows]
    return Tracks.concatenate([replace(tracks, time_ns=tracks.time_ns - first_ns[tracks.vehicle])])


def lankershim(seed: int) -> Simulated:
    """Groups of a real junction."""
    log = log_of("lankershim/lankershim.csv")
    train, test = held_out(log, share=0.9, rng=np.random.default_rng([seed, 0]))
    return Simulated(train, test, test, log, TrackingExperiment(), seed)


DENSE = from_table(
    TrackingExperiment,
    {"with_ids": False, "gap_s": 0.0, "miss_rate": 0.2, "false_per_frame": 10.0, "filter": {"n_particles": 300}},
)


@cache
def dense_map(name: str, demand: float) -> PrimitiveMap:
    """Of five minutes of other traffic there."""
    other = simulate(name, duration_s=300.0, seed=1, rate_hz=5.0, demand=demand)
    return learn_primitives(other, rng=np.random.default_rng(0))


def dense(name: str, demand: float) -> Callable[[int], Simulated]:
    """Dense traffic, without ids, other traffic for each seed."""

    def make(seed: int) -> Simulated:
        traffic = simulate(name, duration_s=20.0, seed=2 + seed, rate_hz=10.0, demand=demand)
        return Simulated(traffic, traffic, traffic, traffic, DENSE, seed, dense_map(name, demand))

    return make


@dataclass
class Drives:
    """Mcity's detections of four drives, each by a sensor and a map of the others: there is no one map."""

    seed: int
    learned: None = None

    def tracked(self, _: None, off: Any) -> Outcome:
        """Errors of the true positions that have an estimate."""
        parts = []
        for drive in mcity.with_truth():
            sensor = mcity.calibrated(drive)
            config, tracking = mcity.configured(sensor)
            config = replace(config, **off.filter)
            model = off.stripped(ParticleFilter(mcity.fair_map(drive, self.seed), config, sensor))
            tracker = Tracker(
                model, config=config, sensor=sensor,
                tracking=replace(tracking, **off.tracking), rng=np.random.default_rng(self.seed),
            )  # fmt: skip
            seen = Detections.of(mcity.detected(drive))
            found = Estimates.concatenate([tracker.step(frame) for frame in seen.frames()])
            parts.append(_of_keys(found, mcity.true(drive), seen.time_ns, mcity.GATE_M, drive))
        return {"in sight": _joined(parts)}


@dataclass
class Harbour:
    """Autoferry's radar and lidar together, each scenario with a map of the others, without ids."""

    seed: int
    learned: None = None

    def tracked(self, _: None, off: Any) -> Outcome:
        """HOTA of each scenario, and errors of the true positions that have an estimate."""
        parts, hotas = [], []
        for number in ferry.SCENARIOS:
            scenario = ferry.Scenario.of(number, ("radar", "lidar"))
            scenario = scenario._replace(
                config=replace(scenario.config, **off.filter), tracking=replace(scenario.tracking, **off.tracking)
            )
            model = off.stripped(ParticleFilter(ferry.learned(number, self.seed), scenario.config))
            found = ferry.nearby(scenario.tracked(model, self.seed), number)
            hotas.append(ferry.hota_of(found, number, scenario.instants))
            parts.append(_of_keys(found, ferry.true(number), scenario.instants, ferry.SIMILARITY_M, number))
        names = np.array(list(map(str, ferry.SCENARIOS)))
        return {"HOTA": Figure(names, np.array(hotas)), "in sight": _joined(parts)}


def _of_keys(found: Any, truth: Tracks, time_ns: AnyArray, gate_m: float, cluster: int) -> Figure:
    """Errors of every true position at some instants, NaN where no estimate is near."""
    keys, near = true_rows(truth, time_ns)[1], RowErrors.of(found, truth, gate_m=gate_m)
    squared = np.full(keys.size, np.nan)
    _, at, of = np.intersect1d(keys, near.key, return_indices=True)
    squared[at] = near.squared[of]
    return Figure(np.full(keys.size, str(cluster)), squared)


def _joined(parts: list[Figure]) -> Figure:
    return Figure(*(np.concatenate(column) for column in zip(*parts, strict=True)))


SCENES: dict[str, Callable[[int], Any]] = {
    "roundabout": town("roundabout"),
    "intersection": town("intersection"),
    "Lankershim": lankershim,
    "dense intersection": dense("intersection", 2.2),
    "dense highway": dense("highway", 2.5),
    "Mcity": Drives,
    "autoferry": Harbour,
}
