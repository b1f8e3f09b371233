"""What forgetting is worth: a one-way street turns around, two others stay as they are.

Decides: what `docs/fleet.md` says of `--half-life`. Its peers are the map of all days and that of the last day alone.
All have the same cells, and are judged by the mean log density of the rows of ten days that follow.

    python tests/benchmarks/reversed_flow.py [--vehicles 6] [--seeds 3] [--days-before 60] [--days-since 10]
"""

from __future__ import annotations

import argparse
from dataclasses import replace

import numpy as np

from dirprim_filter.store import Fading, Summary, learn_from_summary
from dirprim_filter.tracks import Tracks
from tessellation import GridTessellation

STREETS = {"turned around": 0.0, "one-way": 60.0, "both ways": 120.0}
"""Metres north of the first; from west to east."""
LENGTH_M, STEP_S = 80.0, 0.2
HALF_LIFE_DAYS, DAYS_OF_TEST = 10, 10
DAY_NS = 24 * 3600 * 10**9


def vehicle(north: float, way: int, rng: np.random.Generator) -> Tracks:
    """One that drives along a street, eastward (1) or westward (-1)."""
    t = np.arange(0.0, 9.0, STEP_S)
    speed = np.maximum(rng.normal(9.0, 1.5) + 1.5 * np.sin(0.6 * t + rng.uniform(0.0, 6.0)), 0.5)
    along = np.cumsum(speed) * STEP_S
    offset = rng.normal(0.0, 0.5) + 0.2 * np.sin(t + rng.uniform(0.0, 6.0))
    driven = Tracks(
        track_id=np.zeros(t.size, np.int64), time_ns=(t * 1e9).astype(np.int64),
        position=np.column_stack([along if way > 0 else LENGTH_M - along, north + offset]),
        direction=(0.0 if way > 0 else np.pi) + rng.normal(0.0, 0.05, t.size), speed=speed,
    )  # fmt: skip
    return driven[along < LENGTH_M]


def day(number: int, n_vehicles: float, *, turned: bool, rng: np.random.Generator) -> Tracks:
    """The traffic of a day, about so many vehicles on each street."""
    parts = []
    for name, north in STREETS.items():
        for _ in range(rng.poisson(n_vehicles)):
            way = int(rng.choice([-1, 1])) if name == "both ways" else (-1 if turned and name == "turned around" else 1)
            one = vehicle(north - 1.75 * way * (name == "both ways"), way, rng)
            parts.append(replace(one, track_id=one.track_id + len(parts), time_ns=one.time_ns + number * DAY_NS))
    return Tracks.concatenate(parts)


def scores(seed: int, n_vehicles: float, days_before: int, days_since: int) -> dict[str, list[float]]:
    """Mean log density on each street, by map."""
    rng, last = np.random.default_rng(seed), days_before + days_since
    days = [day(i, n_vehicles, turned=i >= days_before, rng=rng) for i in range(last)]
    test = [day(last + i, n_vehicles, turned=True, rng=rng) for i in range(DAYS_OF_TEST)]
    position, direction, speed = (
        np.concatenate([getattr(each, name) for each in test]) for name in ("position", "direction", "speed")
    )
    cells = GridTessellation.covering(np.concatenate([each.position for each in days]), cell_size=8.0)
    total, of_last = Summary.total([Summary.of(each) for each in days]), Summary.of(days[-1])
    fading = Fading(half_life_s=HALF_LIFE_DAYS * 86400.0, now_ns=int(days[-1].time_ns[-1]))
    found = {}
    for name, sums, faded in (("all days", total, None), ("half-life", total, fading), ("last day", of_last, None)):
        learned = learn_from_summary(
            sums, min_vehicles=1, fading=faded, tessellation=cells, rng=np.random.default_rng(seed)
        )
        density = learned.log_density(position, direction, speed)
        found[name] = [float(density[abs(position[:, 1] - north) < 20.0].mean()) for north in STREETS.values()]
    return found


def described(gained: np.ndarray) -> str:
    """Mean, least and most of (seeds, streets), and of all streets."""
    gained = np.column_stack([gained, gained.mean(axis=1)])
    columns = zip((*STREETS, "all streets"), gained.mean(axis=0), gained.min(axis=0), gained.max(axis=0), strict=True)
    return ", ".join(f"{street} {mean:+.3f} ({least:+.3f} to {most:+.3f})" for street, mean, least, most in columns)


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--vehicles", type=float, default=6.0, help="on each street a day")
    parser.add_argument("--seeds", type=int, default=3)
    parser.add_argument("--days-before", type=int, default=60, help="the street turned around")
    parser.add_argument("--days-since", type=int, default=HALF_LIFE_DAYS, help="it did")
    given = parser.parse_args()
    runs = [scores(seed, given.vehicles, given.days_before, given.days_since) for seed in range(given.seeds)]
    for peer in ("all days", "last day"):
        gained = np.array([run["half-life"] for run in runs]) - [run[peer] for run in runs]
        print(f"a half-life of {HALF_LIFE_DAYS} days, beside {peer}: {described(gained)}")
