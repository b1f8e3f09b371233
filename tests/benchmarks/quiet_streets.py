"""What a map knows of quiet streets beside busy ones, where far more steps are stored than are learned from at once.

Four simulated roundabouts on a square kilometre; to two of them one vehicle in twenty comes. A sixteenth of the steps
is learned from at once. Decides: that blocks of many steps are divided (`store.blocks`); its peer does not divide them.
Judged on another log of each place: log density of rows in motion, in nat, and the share of them without a cell.

    python tests/benchmarks/quiet_streets.py
"""

from __future__ import annotations

import tempfile
from dataclasses import replace
from pathlib import Path

import numpy as np
from fleet import n_steps, write_entry

from dirprim_filter import Tracks
from dirprim_filter.evaluation.splits import thinned
from dirprim_filter.simulation.traffic import simulate
from dirprim_filter.store import blocks, updating
from dirprim_filter.store.config import StoreConfig
from dirprim_filter.store.learning import GOLDEN
from dirprim_filter.store.store import Store
from dirprim_filter.store.updating import learn_from_store

PLACES = {"busy": [(256.0, 256.0), (768.0, 256.0)], "quiet": [(256.0, 768.0), (768.0, 768.0)]}
SHARES = {"busy": 1.0, "quiet": 0.05}
"""Of the vehicles."""
N_LOGS, LOG_S, HOUR_NS = 2, 600.0, 3600 * 10**9
LEARNED = 16
"""A part of the steps."""
MIN_SPEED = 0.5


def log_at(place: tuple[float, float], seed: int) -> Tracks:
    """Ten minutes of a roundabout there."""
    log = simulate("roundabout", duration_s=LOG_S, seed=seed)
    return replace(log, position=log.position + place, time_ns=log.time_ns + seed * HOUR_NS)


def main() -> None:
    """Two seeds of each."""
    tests: dict[str, list[Tracks]] = {kind: [] for kind in PLACES}
    with tempfile.TemporaryDirectory() as folder:
        store = Store.create(Path(folder) / "store", StoreConfig())
        for k, (kind, place) in enumerate((kind, place) for kind, places in PLACES.items() for place in places):
            for seed in range(10 * k, 10 * k + N_LOGS):
                log = log_at(place, seed)
                write_entry(store, log[(log.vehicle * GOLDEN) % 1.0 < SHARES[kind]], str(seed))
            rows = thinned(log_at(place, 10 * k + N_LOGS), interval_s=0.2)
            tests[kind].append(rows[rows.speed > MIN_SPEED])
        updating.MOST_STEPS = blocks.MOST_STEPS = n_steps(store) // LEARNED
        for seed in range(2):
            for name, most in (("divided", blocks.MOST_THINNED), ("one block", np.inf)):
                blocks.MOST_THINNED, before = most, blocks.MOST_THINNED
                learned = learn_from_store(store, min_vehicles=1, rng=np.random.default_rng(seed))
                blocks.MOST_THINNED = before
                print(f"seed {seed}, {name}: {learned.tessellation.n_cells} cells", end="")
                for kind, every in tests.items():
                    rows = Tracks.concatenate(every)
                    density = learned.log_density(rows.position, rows.direction, rows.speed).mean()
                    outside = (learned.tessellation.cell_of(rows.position) < 0).mean()
                    print(f"; {kind} places {density:.2f} nat, {outside:.0%} of rows without a cell", end="")
                print(flush=True)


if __name__ == "__main__":
    main()
