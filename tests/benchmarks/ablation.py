"""What is each mechanism worth? `python tests/benchmarks/ablation.py [--scene NAME]... [--mechanism NAME]... [--json]`.

Decides what stays. Each mechanism of filter, association and learning is off alone, on every scene that it can matter
on, over five seeds. Beside "all on" stand the shares by which errors rise without it, paired row by row, with 95 %
intervals over vehicles (groups, drives, scenarios where there are several; runs where tracks have no ids): a mechanism
whose interval holds 0 everywhere gains nothing that can be shown. Two processes. What a clean commit
has done is kept in `.cache/ablation/COMMIT`, so that a run may be resumed, or made in pieces.

Scenes: the town's roundabout and intersection and Lankershim (with ids, each vehicle out of sight once for 3 s); dense
traffic without ids (a fifth missed, ten false a frame); Mcity's and autoferry's real sensors.
Data that are absent are left out, and said.
"""

from __future__ import annotations

import argparse
import json
import subprocess
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
from ablation_scenes import SCENES, Figure, Outcome

from dirprim_filter.config import LearningConfig
from dirprim_filter.evaluation.intervals import (
    Interval,
    difference_of_means,
    paired,
    reduction_of_mean,
    reduction_of_rmse,
)

ROOT = Path(__file__).parents[2]
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
    strip: Callable[[Any], None] | None = None

    @property
    def changes_map(self) -> bool:
        """Whether the map is learned again."""
        return bool(self.learning)


def without_births(bayes: Any) -> None:
    """Vehicles begin anywhere alike."""
    bayes.traffic = None


def without_ends(bayes: Any) -> None:
    """Vehicles leave anywhere alike."""
    bayes._of_manoeuvre[:, 1] = 0.0


def without_draws(bayes: Any) -> None:
    """Particles are drawn from the transition alone, however few of them a measurement leaves."""
    bayes._noise = bayes._noise._replace(few=0.0)


UNNAMED = ("dense intersection", "dense highway", "autoferry")
LEARNED = ("roundabout", "intersection", "Lankershim")
WITHOUT_TAILS = LearningConfig(broad_share=0.0)
ONE_MODE = LearningConfig(max_modes=1)
MECHANISMS: dict[str, Mechanism] = {
    "innovation outliers": Mechanism(filter={"innovation_outlier_rate": 0.0}),
    "draws given measurements": Mechanism(strip=without_draws),
    "vehicles go their own way": Mechanism(filter={"own_way_rate": 0.0}),
    "measurement outliers": Mechanism(filter={"outlier_probability": 0.0}),
    "beliefs reinitialised when lost": Mechanism(tracking={"lost_after": PATIENT}),
    "occlusion": Mechanism(scenes=UNNAMED, tracking={"occlusion_rate": 0.0}),
    "births by the map": Mechanism(scenes=UNNAMED, strip=without_births),
    "ends by the map": Mechanism(scenes=UNNAMED, strip=without_ends),
    "departures": Mechanism(scenes=UNNAMED, tracking={"departure_rate": 0.0}),
    "curved primitives": Mechanism(scenes=LEARNED, learning={"primitive": "flat"}),
    "joint cells (even ones instead)": Mechanism(scenes=LEARNED, learning={"tessellation": "voronoi"}),
    "several modes of a cell": Mechanism(scenes=LEARNED, learning={"config": ONE_MODE}),
    "modes by BIC (by DBSCAN instead)": Mechanism(scenes=LEARNED, learning={"modes": "dbscan"}),
    "tails of modes": Mechanism(scenes=LEARNED, learning={"config": WITHOUT_TAILS}),
}  # fmt: skip
STATISTICS = {
    "in sight": reduction_of_rmse, "in gaps": reduction_of_rmse, "energy at 1 s": reduction_of_mean,
    "energy at 5 s": reduction_of_mean, "density": difference_of_means, "HOTA": difference_of_means,
}  # fmt: skip
"""Of the run without a mechanism beside that with all: a share of errors, nat, and HOTA."""


PARTS = ("tracking", "learning")
"""Of the mechanisms: those of a map that is learned once, and those for which it is learned again."""


def run(scene: str, part: str, seed: int, chosen: tuple[str, ...]) -> dict[str, Outcome]:
    """A scene with all on, and without each chosen mechanism of a part that can matter there."""
    if part == "learning" and scene not in LEARNED:
        return {}
    situation = SCENES[scene](seed)
    if part == "tracking":
        found = {ON: situation.tracked(situation.learned(), Mechanism())}
        for name, off in MECHANISMS.items():
            if name in chosen and not off.changes_map and (not off.scenes or scene in off.scenes):
                found[name] = situation.tracked(situation.learned(), off)
        return found
    found = {ON: situation.tracked(situation.learned(), Mechanism()) | situation.forecast(situation.learned())}
    found["leaders"] = situation.forecast(situation.learned(), alone=True)
    for name, off in MECHANISMS.items():
        if name in chosen and off.changes_map:
            learned = situation.relearned(**off.learning)
            found[name] = situation.tracked(learned, Mechanism()) | situation.forecast(learned)
    return found


def kept_run(task: tuple[str, str, int, tuple[str, ...], Path | None]) -> tuple[str, dict[str, Outcome], float]:
    """The same, from where it was kept, or kept there, and the processor's seconds that it took."""
    scene, part, seed, chosen, folder = task
    named = "" if chosen == tuple(MECHANISMS) else "_".join(("", *chosen))
    path = None if folder is None else folder / f"{scene}_{part}_{seed}{named}.npz".replace(" ", "_")
    if path is not None and path.exists():
        return scene, *loaded(path)
    began = time.process_time()
    found = run(scene, part, seed, chosen)
    seconds = time.process_time() - began
    if path is not None:
        save(path, found, seconds)
    sys.stderr.write(f"{scene}, {part}, seed {seed}: {seconds:.0f} s of processor\n")
    return scene, found, seconds


def save(path: Path, found: dict[str, Outcome], seconds: float) -> None:
    """Keep what was found, of each mechanism and figure its columns; whole or not at all."""
    columns = {
        f"{name}|{figure}|{column}": values
        for name, outcome in found.items()
        for figure, of in outcome.items()
        for column, values in of._asdict().items()
    }
    partial = path.with_suffix(".partial.npz")
    np.savez_compressed(partial, seconds=seconds, **columns)
    partial.rename(path)


def loaded(path: Path) -> tuple[dict[str, Outcome], float]:
    """What was kept."""
    found: dict[str, Outcome] = {}
    with np.load(path, allow_pickle=False) as kept:
        for key in kept.files[1:]:
            name, figure, column = key.split("|")
            if column == "cluster":
                found.setdefault(name, {})[figure] = Figure(kept[key], kept[f"{name}|{figure}|value"])
        return found, float(kept["seconds"])


def folder_of_commit() -> Path | None:
    """Where this commit keeps what it has done; none where code differs from it."""
    git, root = ["git", "-C", str(ROOT)], ROOT / ".cache" / "ablation"
    status = [*git, "status", "--porcelain", "--untracked-files=no", "--", ".", ":!docs"]
    if subprocess.run(status, capture_output=True, text=True, check=True).stdout.strip():
        return None
    name = subprocess.run([*git, "rev-parse", "--short", "HEAD"], capture_output=True, text=True, check=True).stdout
    (root / name.strip()).mkdir(parents=True, exist_ok=True)
    return root / name.strip()


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
    return Interval(-change.value, -change.high, -change.low, change.n_clusters)


def rows(seeds: list[dict[str, Outcome]]) -> Iterator[tuple[str, dict[str, Any]]]:
    """A row for all on, with its figures, and one for each mechanism."""
    yield ON, {figure: level(seeds, ON, figure) for figure in (*STATISTICS, "NEES in sight", "NEES in gaps")}
    for name in dict.fromkeys(name for found in seeds for name in found if name != ON):
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
    """Run, and print the rows of each scene, as JSON."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--scene", action="append", choices=list(SCENES), help="may be repeated; default: all")
    parser.add_argument("--part", action="append", choices=PARTS, help="may be repeated; default: both")
    parser.add_argument("--mechanism", action="append", choices=list(MECHANISMS), help="may be repeated; default: all")
    parser.add_argument("--seeds", type=int, default=5)
    parser.add_argument("--processes", type=int, default=2)
    parser.add_argument("--json", action="store_true")
    given = parser.parse_args()
    kept = folder_of_commit()
    chosen = given.scene or list(SCENES)
    absent = {scene: why for scene in chosen if (why := ablation_scenes.absent(scene))}
    for scene, why in absent.items():
        sys.stderr.write(f"{scene}: left out, no {why}\n")
    parts = given.part or PARTS
    mechanisms = tuple(given.mechanism or MECHANISMS)
    tasks = [
        (scene, part, seed, mechanisms, kept)
        for seed, part, scene in product(range(given.seeds), parts, chosen) if scene not in absent
    ]  # fmt: skip
    done: dict[str, list[dict[str, Outcome]]] = {}
    total = 0.0
    with ProcessPoolExecutor(given.processes) as pool:
        for scene, found, seconds in pool.map(kept_run, tasks):
            total += seconds
            if found:
                done.setdefault(scene, []).append(found)
    table = {scene: dict(rows(seeds)) for scene, seeds in done.items()}
    result = {"seeds": given.seeds, "processor_s": total, "rows": table}
    print(json.dumps(result, indent=None if given.json else 1))


if __name__ == "__main__":
    main()
