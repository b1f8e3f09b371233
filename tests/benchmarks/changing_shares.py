"""What looking for changes is worth, and what it costs, in how the vehicles of a cell share themselves out.

Decides: the constants of `store.regimes`. Its peers: all vehicles alike, each halved by its age, and the last day
alone. Two modes; 120 days are seen, and shares are judged by the seven that follow: nat lost on knowing them.

    python tests/benchmarks/changing_shares.py [--half-life 10] [--seeds 20]
"""

from __future__ import annotations

import argparse

import numpy as np

from dirprim_filter.store.regimes import Periods, still_so

DAYS, AHEAD, HOUR_S = 120, 7, 3600.0
SLOWLY = 4.0
"""Times the half-life, by which vehicles are left out before changes are looked for, as learning does."""
day = np.arange(DAYS + AHEAD)
weekend = (day - DAYS) % 7 >= 5
SHARES = {
    "always .3": np.full(day.size, 0.3),
    "days differ, by .15": np.clip(0.4 + 0.15 * np.random.default_rng(5).standard_normal(day.size), 0.05, 0.95),
    "weekends .5, else .1": np.where(weekend, 0.5, 0.1),
    "drifts from .2 to .8": 0.2 + 0.6 * np.minimum(day / DAYS, 1.0),
    "0, since 10 days 1": (day >= DAYS - 10).astype(float),
    "0, since 2 days 1": (day >= DAYS - 2).astype(float),
    ".1, since 10 days .6": np.where(day >= DAYS - 10, 0.6, 0.1),
    ".1, for 15 days .9, till 5 days ago": np.where((day >= DAYS - 20) & (day < DAYS - 5), 0.9, 0.1),
}
"""Of the second mode."""


def lost(share: np.ndarray, n_vehicles: float, half_life_days: float, seed: int) -> list[float]:
    """By all, by age, by the last day, by regimes."""
    rng = np.random.default_rng(seed)
    came = np.repeat(np.arange(DAYS), rng.poisson(n_vehicles, DAYS))
    mode = (rng.random(came.size) < share[came]).astype(int)
    age_days = DAYS - came - 0.5
    left = rng.random(came.size) < 0.5 ** (age_days / (SLOWLY * half_life_days))
    periods = Periods.of((24 * age_days[left]).astype(int), half_life_days * 24 * HOUR_S)
    held = still_so(
        np.zeros(int(left.sum()), int), mode[left], periods.of_vehicle, change=periods.change, n_modes=3
    )  # a cell has a mode more, of those that stand
    usual = np.bincount(mode, minlength=2) / mode.size
    counts = (
        np.bincount(mode, minlength=2), np.bincount(mode, 0.5 ** (age_days / half_life_days), 2),
        np.bincount(mode[came == DAYS - 1], minlength=2), np.bincount(mode[left], held, 2),
    )  # fmt: skip
    return [beyond_entropy(share[DAYS:], (count + usual) / (count.sum() + 1.0)) for count in counts]


def beyond_entropy(share: np.ndarray, found: np.ndarray) -> float:
    """Kullback-Leibler divergence, the mean over days."""
    true = np.column_stack([1.0 - share, share])
    ratio = np.divide(true, np.maximum(found, 1e-9), out=np.ones(true.shape), where=true > 0)
    return float((true * np.log(ratio)).sum(axis=1).mean())


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--half-life", type=float, default=10.0, help="days")
    parser.add_argument("--seeds", type=int, default=20)
    given = parser.parse_args()
    print("| share of the second mode | vehicles a day | all | by age | last day | by regimes |")
    print("|---|---|---|---|---|---|")
    for name, share in SHARES.items():
        for n in (6, 30, 300):
            mean = np.mean([lost(share, n, given.half_life, seed) for seed in range(given.seeds)], axis=0)
            print(f"| {name} | {n} | " + " | ".join(f"{each:.3f}" for each in mean) + " |", flush=True)
