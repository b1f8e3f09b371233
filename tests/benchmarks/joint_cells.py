"""Is it worth it to learn cells jointly with the primitives? `python tests/benchmarks/joint_cells.py LOG...`.

Defends `tessellation="joint"` as the default: beside it stand square cells of every size, of which the best is picked
in hindsight, which flatters them; Voronoi cells by positions alone; flat primitives; one cell; and the model without
the map. What is compared is the mean log density of direction and speed of held-out vehicles, or groups, of all folds,
of rows at the rate that `learn` sees, faster than 0.5 m/s. `difference` is that of joint, curved
cells less the row's, with its 95 % interval over vehicles or groups.
"""

from __future__ import annotations

import argparse
import json

import numpy as np

from dirprim_filter import learn_primitives, read_tracks
from dirprim_filter.config import LearningConfig
from dirprim_filter.evaluation.density import Method, evaluate_density

SIZES = (2.0, 3.0, 4.5, 7.0, 10.0, 15.0)


def table(tracks, n_folds):
    """The rows by their names."""
    n_cells = {}

    def method(name, *, without_map=False, **options):
        def fit(train, _values, rng):
            learned = learn_primitives(train, rng=rng, **options)
            n_cells.setdefault(name, []).append(learned.tessellation.n_cells)
            return learned.without_places() if without_map else learned

        return Method(name, fit)

    grids = {
        f"grid, {primitive}, {size:g} m is best": {"tessellation": "grid", "cell_size": size, "primitive": primitive}
        for primitive in ("curved", "flat") for size in SIZES
    }  # fmt: skip
    methods = [
        method("joint, curved"), method("voronoi, curved", tessellation="voronoi"),
        *(method(name, **options) for name, options in grids.items()),
        method("joint, flat", primitive="flat"), method("one cell", n_cells=1),
        method("without the map", without_map=True, primitive="flat", tessellation="grid", n_cells=1),
    ]  # fmt: skip
    every_s = LearningConfig().row_interval_s
    scores = evaluate_density(
        tracks, n_folds=n_folds, interval_s=every_s, methods=methods, rng=np.random.default_rng(0)
    )
    found = {
        row.name: {"mean": row.joint.mean_log.value, "cells": np.mean(n_cells[row.name]),
                   "difference": row.joint.behind.value, "low": row.joint.behind.low, "high": row.joint.behind.high}
        for row in scores.methods
    }  # fmt: skip
    for primitive in ("curved", "flat"):
        names = [name for name, options in grids.items() if options["primitive"] == primitive]
        best = max(names, key=lambda name: found[name]["mean"])
        found = {name: row for name, row in found.items() if name == best or name not in names}
    return found


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("logs", nargs="+")
    parser.add_argument("--folds", type=int, default=4)
    parser.add_argument("--json", action="store_true")
    given = parser.parse_args()
    rows = table(read_tracks(given.logs), given.folds)
    print(json.dumps({"rows": rows}, default=float, indent=None if given.json else 1))
