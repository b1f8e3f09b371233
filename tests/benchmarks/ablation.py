"""What is each mechanism worth? `python tests/benchmarks/ablation.py [--scene NAME]... [--part NAME]... [--json]`.

Decides what stays. Each mechanism of filter, association and learning is off alone, on every scene that it can matter
on, over five seeds. What is printed are the shares by which errors rise without it, paired row by row, with 95 %
intervals over vehicles (groups, drives, scenarios where there are several; runs where tracks have no ids): a mechanism
whose interval holds 0 everywhere gains nothing that can be shown. Two processes.

Scenes: the town's roundabout and intersection and Lankershim (with ids, each vehicle out of sight once for 3 s); dense
traffic without ids (a fifth missed, ten false a frame); Mcity's and autoferry's real sensors.
Data that are absent are left out, and said.
"""

from __future__ import annotations

import argparse
import json
import sys
from collections.abc import Callable, Mapping
from concurrent.futures import ProcessPoolExecutor
from dataclasses import dataclass, field
from itertools import product
from pathlib import Path
from typing import Any

import numpy as np

sys.path.insert(0, str(Path(__file__).parent))

import ablation_scenes
from ablation_scenes import SCENES, Outcome

from dirprim_filter.config import LearningConfig
from dirprim_filter.evaluation.intervals import difference_of_means, paired, reduction_of_mean, reduction_of_rmse

ON = "all on"
PATIENT = 10**9


@dataclass(frozen=True, slots=True, kw_only=True)
class Mechanism:
    """What is off.

    Attributes:
        scenes: where it can matter; all where empty.
        filter: of `FilterConfig`.
        tracking: of `TrackingConfig`.
        learning: arguments of `learn_primitives`: the map is learned again.
        strip: takes something off a particle filter.
    """

    scenes: tuple[str, ...] = ()
    filter: Mapping[str, Any] = field(default_factory=dict)
    tracking: Mapping[str, Any] = field(default_factory=dict)
    learning: Mapping[str, Any] = field(default_factory=dict)
    strip: Callable[[Any], None] = lambda _: None

    def stripped(self, bayes: Any) -> Any:
        """A filter without it."""
        self.strip(bayes)
        return bayes


def without_births(bayes: Any) -> None:
    """Vehicles begin anywhere alike."""
    bayes.traffic = None


def without_ends(bayes: Any) -> None:
    """Vehicles leave anywhere alike."""
    bayes._of_manoeuvre[:, 1] = 0.0


def without_draws(bayes: Any) -> None:
    """Particles are drawn from the transition alone, however few of them a measurement leaves."""
    bayes._noise = bayes._noise._replace(few=0.0)


def at_two_a_second(bayes: Any) -> None:
    """Deviations from courses decay as fast on every map."""
    bayes._table = bayes._table._replace(course_rate=2.0)


UNNAMED = ("dense intersection", "dense highway", "autoferry")
LEARNED = ("roundabout", "intersection", "Lankershim")
MECHANISMS: dict[str, Mechanism] = {
    "innovation outliers": Mechanism(filter={"innovation_outlier_rate": 0.0}),
    "draws given measurements": Mechanism(strip=without_draws),
    "vehicles go their own way": Mechanism(filter={"own_way_rate": 0.0}),
    "measurement outliers": Mechanism(filter={"outlier_probability": 0.0}),
    "beliefs reinitialised when lost": Mechanism(tracking={"lost_after": PATIENT}),
    "rate of courses (2/s instead)": Mechanism(strip=at_two_a_second),
    "occlusion": Mechanism(scenes=UNNAMED, tracking={"occlusion_rate": 0.0}),
    "births by the map": Mechanism(scenes=UNNAMED, strip=without_births),
    "ends by the map": Mechanism(scenes=UNNAMED, strip=without_ends),
    "departures": Mechanism(scenes=UNNAMED, tracking={"departure_rate": 0.0}),
    "curved primitives": Mechanism(learning={"primitive": "flat"}),
    "joint cells (even ones instead)": Mechanism(learning={"tessellation": "voronoi"}),
    "several modes of a cell": Mechanism(learning={"config": LearningConfig(max_modes=1)}),
    "modes by BIC (by DBSCAN instead)": Mechanism(learning={"modes": "dbscan"}),
    "tails of modes": Mechanism(learning={"config": LearningConfig(broad_share=0.0)}),
}  # fmt: skip
STATISTICS = {
    "in sight": reduction_of_rmse, "in gaps": reduction_of_rmse, "energy at 1 s": reduction_of_mean,
    "energy at 5 s": reduction_of_mean, "density": difference_of_means, "HOTA": difference_of_means,
}  # fmt: skip
"""Of the run without a mechanism beside that with all: a share of errors, nat, and HOTA."""


PARTS = ("tracking", "learning")
"""Of the mechanisms: those of a map that is learned once, and those for which it is learned again."""


def run(scene: str, part: str, seed: int) -> dict[str, Outcome]:
    """A scene with all on, and without each mechanism of a part that can matter there."""
    if part == "learning" and scene not in LEARNED:
        return {}
    situation = SCENES[scene](seed)
    if part == "tracking":
        found = {ON: situation.tracked(situation.learned, Mechanism())}
        for name, off in MECHANISMS.items():
            if not off.learning and (not off.scenes or scene in off.scenes):
                found[name] = situation.tracked(situation.learned, off)
        return found
    found = {ON: situation.tracked(situation.learned, Mechanism()) | situation.forecast(situation.learned)}
    found["leaders"] = situation.forecast(situation.learned, alone=True)
    for name, off in MECHANISMS.items():
        if off.learning:
            learned = situation.relearned(**off.learning)
            found[name] = situation.tracked(learned, Mechanism()) | situation.forecast(learned)
    return found


def without(name: str, seeds: list[dict[str, Outcome]], figure: str) -> dict[str, Any] | None:
    """By how much worse a figure is without a mechanism: positive where the mechanism gains."""
    columns = []
    for number, found in enumerate(seeds):
        if name in found and figure in found[ON] and figure in found[name]:
            own, other = found[name][figure], found[ON][figure]
            named = own.cluster if own.cluster.dtype.kind == "U" else np.full(own.value.size, str(number))
            columns.append((named, own.value, other.value))
    if not columns:
        return None
    cluster, first, second = (np.concatenate(column) for column in zip(*columns, strict=True))
    change = paired(cluster, first, second, STATISTICS[figure])
    if not change.n_clusters:
        return None
    return {"value": -change.value, "low": -change.high, "high": -change.low, "n_clusters": change.n_clusters}


def main() -> None:
    """Run, and print the rows of each scene, as JSON."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--scene", action="append", choices=list(SCENES), help="may be repeated; default: all")
    parser.add_argument("--part", action="append", choices=PARTS, help="may be repeated; default: both")
    parser.add_argument("--seeds", type=int, default=5)
    parser.add_argument("--processes", type=int, default=2)
    parser.add_argument("--json", action="store_true")
    given = parser.parse_args()
    chosen = given.scene or list(SCENES)
    absent = {scene: why for scene in chosen if (why := ablation_scenes.absent(scene))}
    for scene, why in absent.items():
        sys.stderr.write(f"{scene}: left out, no {why}\n")
    tasks = [
        (scene, part, seed)
        for seed, part, scene in product(range(given.seeds), given.part or PARTS, chosen) if scene not in absent
    ]  # fmt: skip
    done: dict[str, list[dict[str, Outcome]]] = {}
    with ProcessPoolExecutor(given.processes) as pool:
        for (scene, *_), found in zip(tasks, pool.map(run, *zip(*tasks, strict=True)), strict=True):
            done.setdefault(scene, []).extend([found] if found else [])
    rows = {scene: table(seeds) for scene, seeds in done.items() if seeds}
    print(json.dumps({"seeds": given.seeds, "rows": rows}, indent=None if given.json else 1))


def table(seeds: list[dict[str, Outcome]]) -> dict[str, dict[str, Any]]:
    """How much worse each figure is without each mechanism."""
    names = dict.fromkeys(name for found in seeds for name in found if name != ON)
    return {name: {figure: without(name, seeds, figure) for figure in STATISTICS} for name in names}


if __name__ == "__main__":
    main()
