"""Is it worth it to learn cells jointly with the primitives? `python tests/benchmarks/joint_cells.py LOG...`.

Defends `tessellation="joint"` as the default: beside it stand square cells of every size, of which the best is picked
in hindsight, which flatters them; Voronoi cells by positions alone; joint cells half as many as the best grid has; the
place-free primitive; and a neural field (torch: see neural_field.py). What is compared is the mean log density of
direction and speed of held-out vehicles (or groups: `--by group`), rows every 0.5 s, faster than 0.5 m/s.

`--moved` learns the joint map again from data moved by (1e6, -1e6) m and from data turned by 90 degrees.
`--speed` measures fit_jointly instead: 1e5 and 1e6 rows of ring traffic, no log needed.
"""

from __future__ import annotations

import argparse
import json
import resource
import sys
import time
from dataclasses import replace
from pathlib import Path

import numpy as np

sys.path.insert(0, str(Path(__file__).parents[1]))

from dirprim_filter import learn_primitives, read_tracks
from dirprim_filter.distributions.angles import wrap
from dirprim_filter.evaluation.density import rows_to_judge
from dirprim_filter.evaluation.splits import honest_split, split
from situations import ring_traffic

SIZES = (2.0, 3.0, 4.5, 7.0, 10.0, 15.0)


def learned(train, test, **options):
    """Log densities of the held-out rows, the number of cells, seconds."""
    began = time.perf_counter()
    m = learn_primitives(train, rng=np.random.default_rng(0), **options)
    taken = time.perf_counter() - began
    return m.log_density(test.position, test.direction, test.speed), m.tessellation.n_cells, taken


def in_all_folds(folds, **options):
    """Mean log density over the rows of all folds, with its standard deviation over folds; cells and seconds of one."""
    log_p, n_cells, taken = zip(*(learned(fold.train, fold.test, **options) for fold in folds), strict=True)
    return np.concatenate(log_p).mean(), np.std([p.mean() for p in log_p]), np.mean(n_cells), np.mean(taken)


FOUND = {}
"""Every row of the table, for `--json`."""


def tell(name, mean, spread, n_cells=None, taken=None):
    FOUND[name] = {"mean": mean, "deviation": spread, "cells": n_cells, "seconds": taken}
    cells = f"{n_cells:7.0f}" if n_cells is not None else 7 * " "
    seconds = f"{taken:7.1f}" if taken is not None else ""
    print(f"{name:42}{mean:8.3f} +- {spread:5.3f}{cells}{seconds}", flush=True, file=sys.stderr)


def best_grid(folds, primitive):
    """The grid that is best in hindsight."""
    found = {size: in_all_folds(folds, tessellation="grid", cell_size=size, primitive=primitive) for size in SIZES}
    size = max(found, key=lambda tried: found[tried][0])
    tell(f"grid, {primitive}, {size:g} m is best", *found[size])
    return found[size]


def of_field(folds, by):
    from neural_field import neural_field

    began = time.perf_counter()
    log_p = []
    for fold in folds:
        group = fold.train.group if by == "group" else fold.train.vehicle
        log_p.append(neural_field(fold.train, group)(fold.test))
    taken = (time.perf_counter() - began) / len(folds)
    tell("neural field", np.concatenate(log_p).mean(), np.std([p.mean() for p in log_p]), None, taken)


def moved(tracks):
    return replace(tracks, position=tracks.position + np.array([1e6, -1e6]))


def turned(tracks):
    x, y = tracks.position.T
    return replace(tracks, position=np.column_stack([-y, x]), direction=wrap(tracks.direction + np.pi / 2))


def table(logs, by, n_folds, *, also_moved, field):
    rows = rows_to_judge(read_tracks(logs), min_speed=0.5, interval_s=0.5)
    by = by or honest_split(rows)
    folds = split(rows, by=by, n_folds=n_folds, rng=np.random.default_rng(0))
    about = (
        f"{' '.join(Path(log).name for log in logs)}: {len(rows):,} rows, {rows.n_tracks} vehicles, held out by {by}"
    )
    print(f"{about}\n{'':42}   mean log density  cells seconds", file=sys.stderr)
    free = [learn_primitives(f.train, tessellation="grid", n_cells=1, primitive="flat", rng=np.random.default_rng(0))
            for f in folds]  # fmt: skip
    log_p = [
        m.without_places().log_density(f.test.position, f.test.direction, f.test.speed)
        for m, f in zip(free, folds, strict=True)
    ]
    tell("place-free", np.concatenate(log_p).mean(), np.std([p.mean() for p in log_p]))
    for primitive in ("flat", "curved"):
        best = best_grid(folds, primitive)
        if primitive == "curved":
            tell("voronoi, curved", *in_all_folds(folds, tessellation="voronoi"))
        tell(f"joint, {primitive}", *in_all_folds(folds, primitive=primitive))
        half = int(best[2] // 2)
        tell(f"joint, {primitive}, {half} cells", *in_all_folds(folds, n_cells=half, primitive=primitive))
    if field:
        of_field(folds, by)
    if also_moved:
        for name, change in (("moved by (1e6, -1e6) m", moved), ("turned by 90 degrees", turned)):
            there = [f._replace(train=change(f.train), test=change(f.test)) for f in folds]
            tell(f"joint, curved, {name}", *in_all_folds(there))


def speed():
    print("ring traffic           rows    cells   seconds   peak memory of the process [MB]   of the data [MB]")
    for n_vehicles in (1_000, 10_000):
        tracks = ring_traffic(np.random.default_rng(0), n_vehicles=n_vehicles, dt_s=0.25, n_rows=100)
        for label in ("cold or cached", "warm"):
            began = time.perf_counter()
            m = learn_primitives(tracks, n_cells=100, rng=np.random.default_rng(0))
            taken = time.perf_counter() - began
            peak = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024
            data = sum(getattr(tracks, name).nbytes for name in tracks.__slots__ if name != "group") / 1e6
            cells = m.tessellation.n_cells
            print(f"{label:16} {len(tracks):10,} {cells:8} {taken:9.1f} {peak:12.0f} {data:12.0f}", flush=True)


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("logs", nargs="*")
    parser.add_argument("--by", choices=["vehicle", "group"])
    parser.add_argument("--folds", type=int, default=4)
    parser.add_argument("--moved", action="store_true")
    parser.add_argument("--no-field", action="store_true")
    parser.add_argument("--speed", action="store_true")
    parser.add_argument("--json", action="store_true", help="the rows again, on stdout")
    given = parser.parse_args()
    if given.speed:
        speed()
    elif given.logs:
        table(given.logs, given.by, given.folds, also_moved=given.moved, field=not given.no_field)
        if given.json:
            print(json.dumps({"rows": FOUND}, default=float))
    else:
        parser.print_help()


if __name__ == "__main__":
    main()
