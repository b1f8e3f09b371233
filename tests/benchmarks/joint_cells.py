"""Is it worth it to learn cells jointly with the primitives? `python tests/benchmarks/joint_cells.py LOG...`.

Defends `tessellation="joint"` as the default: beside it stand square cells of every size, of which the best is picked
in hindsight, which flatters them; Voronoi cells by positions alone; joint cells half as many as the best grid has; flat
primitives; one cell; and the model without the map. What is compared is the mean log density of direction and speed of
held-out vehicles, or groups, of all folds, rows every 0.5 s, faster than 0.5 m/s. `difference` is that of joint, curved
cells less the row's, with its 95 % interval over vehicles or groups.
"""

from __future__ import annotations

import argparse
import json
import sys

import numpy as np

from dirprim_filter import learn_primitives, read_tracks
from dirprim_filter.evaluation.density import mean_over, rows_to_judge
from dirprim_filter.evaluation.splits import honest_split, split
from dirprim_filter.track_ids import vehicle_numbers

SIZES = (2.0, 3.0, 4.5, 7.0, 10.0, 15.0)
JOINT = "joint, curved"


def in_all_folds(folds, *, without_map=False, **options):
    """Log densities of the held-out rows of all folds, and the mean number of cells."""
    log_p, n_cells = [], []
    for fold in folds:
        m = learn_primitives(fold.train, rng=np.random.default_rng(0), **options)
        used = m.without_places() if without_map else m
        log_p.append(used.log_density(fold.test.position, fold.test.direction, fold.test.speed))
        n_cells.append(m.tessellation.n_cells)
    return np.concatenate(log_p), float(np.mean(n_cells))


def best_grid(folds, primitive):
    """The grid that is best in hindsight, by its name."""
    found = {size: in_all_folds(folds, tessellation="grid", cell_size=size, primitive=primitive) for size in SIZES}
    size = max(found, key=lambda tried: found[tried][0].mean())
    return f"grid, {primitive}, {size:g} m is best", found[size]


def methods(folds):
    """Every row of the table: its name, log densities and cells."""
    yield JOINT, in_all_folds(folds)
    yield "voronoi, curved", in_all_folds(folds, tessellation="voronoi")
    for primitive in ("curved", "flat"):
        name, best = best_grid(folds, primitive)
        yield name, best
        half = int(best[1] // 2)
        yield f"joint, {primitive}, {half} cells", in_all_folds(folds, n_cells=half, primitive=primitive)
    yield "joint, flat", in_all_folds(folds, primitive="flat")
    yield "one cell", in_all_folds(folds, n_cells=1)
    one_flat = {"tessellation": "grid", "n_cells": 1, "primitive": "flat"}
    yield "without the map", in_all_folds(folds, without_map=True, **one_flat)


def table(given):
    """The rows by their names."""
    rows = rows_to_judge(read_tracks(given.logs), min_speed=0.5, interval_s=0.5)
    by = honest_split(rows)
    folds = split(rows, by=by, n_folds=given.folds, rng=np.random.default_rng(0))
    group = np.concatenate([fold.test.group for fold in folds])
    vehicle = vehicle_numbers(np.concatenate([fold.test.track_id for fold in folds]), group)
    cluster = group if by == "group" else vehicle
    print(f"{len(rows):,} rows, {rows.n_tracks} vehicles, held out by {by}, {len(folds)} folds", file=sys.stderr)
    print(f"{'':42}mean log density   cells   joint is ahead by", file=sys.stderr)
    found, joint = {}, None
    for name, (log_p, cells) in methods(folds):
        joint = log_p if joint is None else joint
        ahead = mean_over(cluster, joint - log_p)
        found[name] = {
            "mean": log_p.mean(), "cells": cells, "difference": ahead.value, "low": ahead.low, "high": ahead.high
        }  # fmt: skip
        text = "" if joint is log_p else f"   {ahead.value:.3f} ({ahead.low:.3f} to {ahead.high:.3f})"
        print(f"{name:42}{log_p.mean():16.3f}{cells:8.0f}{text}", flush=True, file=sys.stderr)
    return found


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("logs", nargs="+")
    parser.add_argument("--folds", type=int, default=4)
    parser.add_argument("--json", action="store_true", help="the rows again, on stdout")
    given = parser.parse_args()
    found = table(given)
    if given.json:
        print(json.dumps({"rows": found}, default=float))


if __name__ == "__main__":
    main()
