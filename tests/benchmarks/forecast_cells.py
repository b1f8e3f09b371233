"""Do forecasts care how the cells are laid out? `python tests/benchmarks/forecast_cells.py LOG...`.

Shows what a choice of cells by motion, beside that by the density of what is seen, could gain. Joint cells, even ones
and a grid forecast the same held-out vehicles, beside one cell for all places and constant velocity. Joint cells come
first: a gain is the share by which their energy score is below that of others, with its 95 % interval.
"""

from __future__ import annotations

import argparse
import json

import numpy as np

from dirprim_filter import learn_primitives, read_tracks
from dirprim_filter.cli.evaluate.forecast import forecast_object, forecast_text
from dirprim_filter.evaluation.forecast_methods import Forecaster, by_constant_velocity, by_one_cell, futures_of
from dirprim_filter.evaluation.forecasting import evaluate_forecasts
from dirprim_filter.evaluation.splits import honest_split

HORIZONS_S = (1.0, 3.0, 5.0, 8.0)


def by_cells(tessellation, n_cells=None):
    """The map of such cells, as many as learning chooses where no number is given."""

    def fit(train, horizons_s, rng):
        learned = learn_primitives(train, tessellation=tessellation, n_cells=n_cells, rng=rng)
        name = tessellation if n_cells is None else f"{tessellation}, {n_cells} cells"
        return {name: Forecaster(futures_of(learned, horizons_s))}

    return fit


def main() -> None:
    """Print the table."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("logs", nargs="+")
    parser.add_argument("--folds", type=int, default=4)
    parser.add_argument("--json", action="store_true")
    options = parser.parse_args()
    tracks = read_tracks(options.logs)
    cells = (by_cells("joint"), by_cells("joint", 100), by_cells("voronoi"), by_cells("grid"))
    table = evaluate_forecasts(
        tracks, split_by=honest_split(tracks), horizons_s=HORIZONS_S,
        n_folds=options.folds, methods=(*cells, by_one_cell, by_constant_velocity), rng=np.random.default_rng(0),
    )  # fmt: skip
    print(json.dumps(forecast_object(table)) if options.json else forecast_text(table))


if __name__ == "__main__":
    main()
