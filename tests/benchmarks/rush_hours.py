"""What maps by the hour are worth: a junction where demand and speeds turn in rush hours, and one where nothing turns.

Decides: what `docs/fleet.md` says of `--by`. Its peer is the map of all day. Both have the same cells, and are judged
on days that follow: by the mean log density of their rows, and by the energy score of rollouts of vehicles 15 m
before the turn.

    python tests/benchmarks/rush_hours.py [--vehicles 3] [--days 4] [--seeds 3]
"""

from __future__ import annotations

import argparse
from dataclasses import replace

import numpy as np

from dirprim_filter import forecast
from dirprim_filter.primitives import PrimitiveMap
from dirprim_filter.primitives.schedule import HOUR_NS
from dirprim_filter.store import Summary, learn_from_summary
from dirprim_filter.tracks import Tracks
from tessellation import GridTessellation

RUSH = (7, 8, 16, 17)
"""In the first two nearly all turn left, in the others nearly all go straight on; and all drive half as fast."""
STEP_S, RADIUS_M, WAY_M = 0.2, 10.0, 90.0
DAYS_OF_TEST, VEHICLES_OF_TEST = 4, 6.0
HORIZON_S, STARTS, N_SAMPLES = 6.0, 150, 50


def vehicle(speed: float, *, left: bool, rng: np.random.Generator) -> Tracks:
    """One that comes from the west, and turns to the north after 40 m or goes on."""
    t = np.arange(0.0, 60.0, STEP_S)
    pace = speed * (1.0 + 0.1 * np.sin(0.6 * t + rng.uniform(0.0, 6.0)))
    along = np.cumsum(pace) * STEP_S
    angle = np.clip((along - 40.0) / RADIUS_M, 0.0, np.pi / 2) * left
    beyond = np.maximum(along - 40.0 - angle * RADIUS_M, 0.0)
    straight = np.minimum(along, 40.0) - 40.0
    position = np.column_stack([
        straight + RADIUS_M * np.sin(angle) + beyond * np.cos(angle),
        RADIUS_M * (1.0 - np.cos(angle)) + beyond * np.sin(angle),
    ])  # fmt: skip
    offset = rng.normal(0.0, 0.4)
    driven = Tracks(
        track_id=np.zeros(t.size, np.int64), time_ns=(t * 1e9).astype(np.int64),
        position=position + offset * np.column_stack([-np.sin(angle), np.cos(angle)]),
        direction=angle + rng.normal(0.0, 0.05, t.size), speed=pace,
    )  # fmt: skip
    return driven[along < WAY_M]


def day(number: int, n_vehicles: float, *, turns: bool, rng: np.random.Generator) -> Tracks:
    """About so many vehicles an hour."""
    parts: list[Tracks] = []
    for hour in np.repeat(np.arange(24), rng.poisson(n_vehicles, 24)).tolist():
        rush = turns and hour in RUSH
        share = (0.9 if hour < 12 else 0.1) if rush else 0.3
        speed = max(rng.normal(9.0, 1.2), 2.0) * (0.5 if rush else 1.0)
        one = vehicle(speed, left=rng.random() < share, rng=rng)
        begin_ns = (24 * number + hour) * HOUR_NS + int(rng.integers(3000)) * 10**9
        parts.append(replace(one, track_id=one.track_id + len(parts), time_ns=one.time_ns + begin_ns))
    return Tracks.concatenate(parts)


def log_density(learned: PrimitiveMap, rows: Tracks) -> np.ndarray:
    """(n,) of each row, by its hour."""
    found, hour = np.empty(len(rows)), rows.time_ns // HOUR_NS
    for each in np.unique(hour).tolist():
        own = rows[hour == each]
        now = learned.at_time(each * HOUR_NS)
        found[hour == each] = now.log_density(own.position, own.direction, own.speed)
    return found


def errors(learned: PrimitiveMap, test: Tracks, *, by_hour: bool, rng: np.random.Generator) -> np.ndarray:
    """(2,) energy score of rollouts of vehicles of rush hours, and of others, `HORIZON_S` on."""
    found: dict[bool, list[float]] = {True: [], False: []}
    for number in range(test.n_tracks):
        own = test[test.vehicle == number]
        at, later = np.flatnonzero(own.position[:, 0] > -15.0)[0], round(HORIZON_S / STEP_S)
        is_rush = int(own.time_ns[0] // HOUR_NS) % 24 in RUSH
        if at + later >= len(own) or len(found[is_rush]) >= STARTS:
            continue
        paths = forecast(
            learned.at_time(int(own.time_ns[at])) if by_hour else learned, position=own.position[at],
            direction=float(own.direction[at]), speed=float(own.speed[at]), horizon_s=HORIZON_S, dt_s=HORIZON_S,
            n_samples=N_SAMPLES, rng=np.random.default_rng(number),
        )[:, -1]  # fmt: skip
        off = np.linalg.norm(paths - own.position[at + later], axis=1).mean()
        apart = np.linalg.norm(paths[:, None] - paths, axis=2).sum() / (N_SAMPLES * (N_SAMPLES - 1))
        found[is_rush].append(off - 0.5 * apart)
    return np.array([np.mean(found[True]), np.mean(found[False])])


def scores(seed: int, n_vehicles: float, n_days: int, *, turns: bool) -> np.ndarray:
    """Nat gained in rush hours, in others and in all; and by what share forecasts are better in the former two."""
    rng = np.random.default_rng(seed)
    days = [day(i, n_vehicles, turns=turns, rng=rng) for i in range(n_days)]
    test = Tracks.concatenate([
        replace(each, track_id=each.track_id + 10_000 * i)
        for i, each in enumerate(
            day(n_days + i, VEHICLES_OF_TEST, turns=turns, rng=rng) for i in range(DAYS_OF_TEST)
        )
    ])  # fmt: skip
    cells = GridTessellation.covering(np.concatenate([each.position for each in days]), cell_size=8.0)
    learned = learn_from_summary(
        Summary.total([Summary.of(each) for each in days]), by="hour", tessellation=cells,
        rng=np.random.default_rng(seed),
    )  # fmt: skip
    gained = log_density(learned, test) - log_density(replace(learned, schedule=None), test)
    rush = np.isin(test.time_ns // HOUR_NS % 24, RUSH)
    by_hour, all_day = (errors(learned, test, by_hour=each, rng=rng) for each in (True, False))
    return np.concatenate([[gained[rush].mean(), gained[~rush].mean(), gained.mean()], 1.0 - by_hour / all_day])


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--vehicles", type=float, default=3.0, help="an hour")
    parser.add_argument("--days", type=int, default=4, help="that are learned from")
    parser.add_argument("--seeds", type=int, default=3)
    given = parser.parse_args()
    for turns in (True, False):
        found = np.array([scores(seed, given.vehicles, given.days, turns=turns) for seed in range(given.seeds)])
        rush, rest, every, *better = found.mean(axis=0)
        print(
            f"{'demand turns' if turns else 'nothing turns'}: nat {rush:+.3f} in rush hours, {rest:+.3f} in others, "
            f"{every:+.3f} in all ({found[:, 2].min():+.3f} at least); energy scores {better[0]:+.1%} and "
            f"{better[1]:+.1%} better",
            flush=True,
        )
