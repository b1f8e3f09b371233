"""What is each mechanism worth? `python tests/benchmarks/ablation.py [--scene NAME]... [--json]`.

Decides what stays. Each mechanism of filter, association and learning is off alone, on every scene that it can matter
on, over five seeds. Beside "all on" stand the shares by which errors rise without it, paired row by row, with 95 %
intervals over vehicles (groups, drives, scenarios where there are several; runs where tracks have no ids): a mechanism
whose interval holds 0 everywhere gains nothing that can be shown. Made on two cores by two processes; what is done is
kept in `--kept FOLDER` and not done again.

Scenes: the town's roundabout and intersection and Lankershim (with ids, each vehicle out of sight once for 3 s); dense
traffic without ids (a fifth missed, ten false a frame); vehicles that misbehave; Mcity's and autoferry's real sensors.
Data that are absent are left out, and said.
"""

from __future__ import annotations

import argparse
import json
import sys
import time
from collections.abc import Callable, Iterator, Mapping
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
from dirprim_filter.evaluation.intervals import (
    Interval,
    difference_of_means,
    paired,
    reduction_of_mean,
    reduction_of_rmse,
)

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
        white: the sensor's errors do not last.
    """

    scenes: tuple[str, ...] = ()
    filter: Mapping[str, Any] = field(default_factory=dict)
    tracking: Mapping[str, Any] = field(default_factory=dict)
    learning: Mapping[str, Any] = field(default_factory=dict)
    strip: Callable[[Any], None] | None = None
    white: bool = False

    @property
    def changes_map(self) -> bool:
        """Whether the map is learned again."""
        return bool(self.learning)


def without_births(bayes: Any) -> None:
    """Vehicles begin anywhere alike."""
    bayes.traffic = None


def without_ends(bayes: Any) -> None:
    """Vehicles leave anywhere alike."""
    bayes._ends[:] = 0.0


UNNAMED = ("dense intersection", "dense highway", "autoferry")
LEARNED = ("roundabout", "intersection", "Lankershim")
WITHOUT_TAILS = LearningConfig(broad_share=0.0)
MECHANISMS: dict[str, Mechanism] = {
    "innovation outliers": Mechanism(filter={"innovation_outlier_rate": 0.0}),
    "vehicles go their own way": Mechanism(filter={"own_way_rate": 0.0}),
    "measurement outliers": Mechanism(filter={"outlier_probability": 0.0}),
    "carried errors": Mechanism(scenes=("Mcity",), white=True),
    "beliefs begun anew when lost": Mechanism(tracking={"lost_after": PATIENT}),
    "occlusion": Mechanism(scenes=UNNAMED, tracking={"occlusion_rate": 0.0}),
    "births by the map": Mechanism(scenes=UNNAMED, strip=without_births),
    "ends by the map": Mechanism(scenes=UNNAMED, strip=without_ends),
    "curved primitives": Mechanism(scenes=LEARNED, learning={"primitive": "flat"}),
    "joint cells (even ones instead)": Mechanism(scenes=LEARNED, learning={"tessellation": "voronoi"}),
    "tails of modes": Mechanism(scenes=LEARNED, learning={"config": WITHOUT_TAILS}),
}  # fmt: skip
STATISTICS = {
    "in sight": reduction_of_rmse, "in gaps": reduction_of_rmse, "energy at 1 s": reduction_of_mean,
    "energy at 5 s": reduction_of_mean, "density": difference_of_means, "HOTA": difference_of_means,
    "lost": difference_of_means,
}  # fmt: skip
"""Of the run without a mechanism beside that with all: a share of errors, nat, HOTA, and a share of rows."""


PARTS = ("tracking", "learning")
"""Of the mechanisms: those of a map that is learned once, and those for which it is learned again."""


def run(scene: str, part: str, seed: int) -> dict[str, Outcome]:
    """A scene with all on, and without each mechanism of a part that can matter there."""
    situation = SCENES[scene](seed)
    if part == "tracking":
        found = {ON: situation.tracked(situation.learned(), Mechanism())}
        for name, off in MECHANISMS.items():
            if not off.changes_map and (not off.scenes or scene in off.scenes):
                found[name] = situation.tracked(situation.learned(), off)
        return found
    if scene not in LEARNED:
        return {}
    found = {ON: situation.tracked(situation.learned(), Mechanism()) | situation.forecast(situation.learned())}
    found["leaders"] = situation.forecast(situation.learned(), alone=True)
    for name, off in MECHANISMS.items():
        if off.changes_map:
            learned = situation.relearned(**off.learning)
            found[name] = situation.tracked(learned, Mechanism()) | situation.forecast(learned)
    return found


def kept_run(task: tuple[str, str, int, Path | None]) -> tuple[str, dict[str, Outcome]]:
    """The same, from where it was kept, or kept there."""
    scene, part, seed, folder = task
    path = None if folder is None else folder / f"{scene.replace(' ', '_')}_{part}_{seed}.npz"
    if path is not None and path.exists():
        return scene, ablation_scenes.unpacked(path)
    began = time.perf_counter()
    found = run(scene, part, seed)
    if path is not None:
        ablation_scenes.pack(path, found)
    sys.stderr.write(f"{scene}, {part}, seed {seed}: {time.perf_counter() - began:.0f} s\n")
    return scene, found


def without(name: str, seeds: list[dict[str, Outcome]], figure: str) -> Interval | None:
    """By how much worse a figure is without a mechanism: positive where the mechanism gains."""
    columns = []
    for number, found in enumerate(seeds):
        if name in found and figure in found[ON] and figure in found[name]:
            own, other = found[name][figure], found[ON][figure]
            named = own.cluster if own.cluster.dtype.kind == "U" else np.full(own.value.size, str(number))
            columns.append((named, own.value, other.value))
    if not columns:
        return None
    change = paired(*(np.concatenate(column) for column in zip(*columns, strict=True)), STATISTICS[figure])
    if not change.n_clusters:
        return None
    sign = 1.0 if figure == "lost" else -1.0  # rows lost rise; errors are reduced by less than nothing, the others fall
    low, high = sorted((sign * change.low, sign * change.high))
    return Interval(sign * change.value, low, high, change.n_clusters)


def rows(seeds: list[dict[str, Outcome]]) -> Iterator[tuple[str, dict[str, Any]]]:
    """A row for all on, with its figures, and one for each mechanism."""
    yield ON, {figure: level(seeds, ON, figure) for figure in (*STATISTICS, "NEES in sight", "NEES in gaps")}
    for name in MECHANISMS:
        if not any(name in found for found in seeds):
            continue
        changes = {figure: without(name, seeds, figure) for figure in STATISTICS}
        row: dict[str, Any] = {
            figure: None if change is None else change._asdict() for figure, change in changes.items()
        }
        yield name, row | {figure: level(seeds, name, figure) for figure in ("NEES in sight", "NEES in gaps")}


def level(seeds: list[dict[str, Outcome]], name: str, figure: str) -> float | None:
    """The figure itself, over all seeds."""
    values = [found[name][figure].value for found in seeds if name in found and figure in found[name]]
    if not values or not np.isfinite(np.concatenate(values)).any():
        return None
    mean = float(np.nanmean(np.concatenate(values)))
    return float(np.sqrt(mean)) if figure in ("in sight", "in gaps") else mean


def main() -> None:
    """Run, and print a table for each scene."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--scene", action="append", choices=list(SCENES), help="may be repeated; default: all")
    parser.add_argument("--part", action="append", choices=PARTS, help="may be repeated; default: both")
    parser.add_argument("--seeds", type=int, default=5)
    parser.add_argument("--processes", type=int, default=2)
    parser.add_argument("--kept", type=Path, help="folder of what is done already")
    parser.add_argument("--json", action="store_true")
    given = parser.parse_args()
    if given.kept is not None:
        given.kept.mkdir(parents=True, exist_ok=True)
    chosen = given.scene or list(SCENES)
    absent = {scene: why for scene in chosen if (why := ablation_scenes.absent(scene))}
    for scene, why in absent.items():
        sys.stderr.write(f"{scene}: left out, no {why}\n")
    parts = given.part or PARTS
    tasks = [
        (scene, part, seed, given.kept)
        for part, seed, scene in product(parts, range(given.seeds), chosen) if scene not in absent
    ]  # fmt: skip
    done: dict[str, list[dict[str, Outcome]]] = {}
    with ProcessPoolExecutor(given.processes) as pool:
        for scene, found in pool.map(kept_run, tasks):
            if found:
                done.setdefault(scene, []).append(found)
    table = {scene: dict(rows(seeds)) for scene, seeds in done.items()}
    if given.json:
        sys.stdout.write(json.dumps({"seeds": given.seeds, "rows": table}) + "\n")
        return
    for scene, found_rows in table.items():
        print(f"\n{scene}: without it, worse by")
        for name, row in found_rows.items():
            print(
                f"{name:34}"
                + "  ".join(f"{figure} {shown(value)}" for figure, value in row.items() if value is not None)
            )


def shown(value: Any) -> str:
    """A level, or a change with its interval; a star where that is beyond chance."""
    if not isinstance(value, Mapping):
        return f"{value:.3f}"
    star = "*" if value["low"] > 0 or value["high"] < 0 else " "
    return f"{value['value']:+.3f} ({value['low']:+.3f} to {value['high']:+.3f}){star}"


if __name__ == "__main__":
    main()
