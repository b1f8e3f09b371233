"""What are borrowed modes worth? `python tests/benchmarks/borrowing.py LOG... [--vehicles N]`.

Defends `primitives.borrowing`: the mean log density of held-out vehicles by the default's map, and by one whose cells
borrow nothing, with the standard error of the difference over vehicles. Rows every 0.5 s, faster than 0.5 m/s, four
folds of vehicles; `--vehicles` draws so many first.
"""

from __future__ import annotations

import argparse
import sys

import numpy as np

from dirprim_filter import learn_primitives, read_tracks
from dirprim_filter.evaluation.density import rows_to_judge
from dirprim_filter.evaluation.splits import split
from dirprim_filter.primitives import choice


def scores(train, test, n_layouts):
    """Log densities of the held-out rows, and of the map its cells and borrowed modes."""
    choice.N_LAYOUTS, before = n_layouts, choice.N_LAYOUTS
    try:
        learned = learn_primitives(train, rng=np.random.default_rng(0))
    finally:
        choice.N_LAYOUTS = before
    borrowed = learned.direction.weight[:-1, learned.n_own_modes : learned.n_own_modes + learned.n_borrowed_modes]
    return learned.log_density(test.position, test.direction, test.speed), learned.tessellation.n_cells, borrowed


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("logs", nargs="+")
    parser.add_argument("--vehicles", type=int, help="so many, drawn at random")
    parser.add_argument("--seed", type=int, default=1, help="of that draw")
    given = parser.parse_args()
    rows = rows_to_judge(read_tracks(given.logs), min_speed=0.5, interval_s=0.5)
    if given.vehicles:
        some = np.random.default_rng(given.seed).permutation(np.unique(rows.vehicle))[: given.vehicles]
        rows = rows[np.isin(rows.vehicle, some)]
    found = {0: [], choice.N_LAYOUTS: []}
    vehicle, n_cells, share, modes = [], [], [], []
    for fold in split(rows, by="vehicle", n_folds=4, rng=np.random.default_rng(0)):
        vehicle.append(fold.test.track_id)
        for n_layouts, of in found.items():
            log_p, n, borrowed = scores(fold.train, fold.test, n_layouts)
            of.append(log_p)
        n_cells.append(n)
        share.append(borrowed.sum(axis=1).mean())
        modes.append((borrowed > 0).sum(axis=1).mean())
    alone, with_others = (np.concatenate(of) for of in found.values())
    _, number, n_rows = np.unique(np.concatenate(vehicle), return_inverse=True, return_counts=True)
    gain = np.bincount(number, with_others - alone) / n_rows.mean()
    error = gain.std(ddof=1) / np.sqrt(gain.size)
    print(f"{rows.n_tracks} vehicles, {len(rows):,} rows, {np.mean(n_cells):.0f} cells", file=sys.stderr)
    print(f"its own modes alone {alone.mean():.3f} nat, with borrowed ones {with_others.mean():.3f}: "
          f"{(with_others - alone).mean():+.3f} +- {error:.3f}")  # fmt: skip
    print(f"each cell borrows {np.mean(modes):.1f} modes, {np.mean(share):.0%} of its weight")


if __name__ == "__main__":
    main()
