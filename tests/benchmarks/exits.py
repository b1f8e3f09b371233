"""Which exit will it take? What a turn signal adds to the prior: `python tests/benchmarks/exits.py LOG...`.

Defends `ParticleFilter.weigh_by_cue`: Eq. 4 as a weight of what particles are about to do. Held-out vehicles are seen
once (position to 0.5 m, direction to 0.05 rad, speed to 0.5 m/s) at each second of their last fifteen before they leave
the scene; an exit's probability is the weight of the particles that come nearest to it, of all exits, when they are
moved on until they are near one. The signal is what an honest
driver gives: left or right where the vehicle turns by more than 30 degrees within the next 4 s, else none. Beside it
stand a signal of the wrong side, which must harm, and the turn itself. That is no bound of what a cue can say: a
manoeuvre knows the mean turn of its vehicles, from which that of one vehicle differs with its pace, so a cue that is
sure of it to 8 degrees (concentration 50) is worse than the plain signal, and one of concentration 5 as good.
Cross-entropies in nat, means over vehicles, and their differences to no cue with 95 % intervals over vehicles; seeds
differ in the half that is held out.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from rows_of_logs import print_rows
from scipy.spatial import cKDTree
from sklearn.cluster import DBSCAN

from dirprim_filter import FilterConfig, learn_primitives
from dirprim_filter.detections import Detections
from dirprim_filter.evaluation.density import mean_over
from dirprim_filter.evaluation.splits import split
from dirprim_filter.filtering.particle_filter import ParticleFilter
from dirprim_filter.primitives.cues import TURN_LEFT, TURN_RIGHT, Cue
from dirprim_filter.primitives.motion_sums import AHEAD_S
from dirprim_filter.track_ids import qualified_names

EXIT_M, FEWEST, NEAR_M = 8.0, 5, 12.0
AHEAD_OF_EXIT_S, LOOK_S = 25.0, 0.5
LAST_S, LEAST_TURN, FLOOR = 15.0, np.deg2rad(30.0), 1e-3
NO_CUE, TURN = "no cue", "the turn within 4 s"
CONCENTRATION = 5.0


class Cases(NamedTuple):
    """Instants of held-out vehicles."""

    vehicle: np.ndarray
    motion: np.ndarray  # (n, 4) position, direction, speed
    turn: np.ndarray  # (n,) radians within the next 4 s
    exit: np.ndarray  # (n,)


def exits_of(tracks):
    """Centres of the places where tracks end, but those that more pass through: there tracks are only cut."""
    _, first = np.unique(tracks.vehicle, return_index=True)  # rows are in order of time
    _, last = np.unique(tracks.vehicle[::-1], return_index=True)
    starts, ends = tracks.position[first], tracks.position[len(tracks) - 1 - last]
    label = DBSCAN(eps=EXIT_M, min_samples=FEWEST).fit_predict(ends)
    centers = np.array([ends[label == k].mean(axis=0) for k in range(label.max() + 1)])

    def near(position, center):
        return np.hypot(*(position - center).T) < NEAR_M

    def is_exit(center):
        passes = np.zeros(len(ends), np.bool_)
        passes[tracks.vehicle[near(tracks.position, center)]] = True
        ends_here = near(ends, center)
        return (passes & ~ends_here & ~near(starts, center)).sum() < ends_here.sum()

    return centers[[is_exit(center) for center in centers]]


def cases_of(tracks, centers):
    """One a second, of vehicles that end at an exit."""
    tree, parts = cKDTree(centers), []
    for vehicle in range(tracks.n_tracks):
        own = tracks[tracks.vehicle == vehicle]
        time_s = (own.time_ns - own.time_ns[-1]) * 1e-9
        away, exit_ = tree.query(own.position[-1])
        moving = own.speed > 0.5
        if away > NEAR_M or moving.sum() < 2:
            continue
        course = np.interp(time_s, time_s[moving], np.unwrap(own.direction[moving]))
        for t in np.arange(-LAST_S, -AHEAD_S):
            i = np.searchsorted(time_s, t)
            if time_s[0] <= t and moving[i]:
                turn = np.interp(time_s[i] + AHEAD_S, time_s, course) - course[i]
                parts.append((vehicle, [*own.position[i], own.direction[i], own.speed[i]], turn, exit_))
    return Cases(*(np.array(column) for column in zip(*parts, strict=True)))


def signals(turn):
    """Cues, and which cases each is given in."""
    return (TURN_LEFT, np.flatnonzero(turn > LEAST_TURN)), (TURN_RIGHT, np.flatnonzero(turn < -LEAST_TURN))


def turned(cases):
    """A cue for each case, of the turn itself."""
    return [(Cue(turn=turn, concentration=CONCENTRATION), np.array([i])) for i, turn in enumerate(cases.turn)]


def cross_entropies(learned, cases, cues, *, exits, rng):
    """(n,) by the name of the cue; all weigh the same particles, which are moved on once."""
    n, particles = len(cases.turn), ParticleFilter(learned, FilterConfig(n_particles=500))
    noisy = cases.motion + rng.normal(size=(n, 4)) * [0.5, 0.5, 0.05, 0.5]
    seen = Detections(
        track_id=np.arange(n).astype(str), time_ns=np.zeros(n, np.int64), position=noisy[:, :2],
        direction=noisy[:, 2], speed=np.maximum(noisy[:, 3], 0.0),
    )  # fmt: skip
    slot = np.arange(n)
    particles.reserve(n)
    particles.begin(slot, rng.integers(2**63, size=n, dtype=np.uint64), seen)
    particles.predict(slot, np.full(n, 0.1))  # now they follow manoeuvres

    def moved_on():
        """(n, P) the exit that each particle is the first to come near; -1 for none."""
        exit_of = np.full((n, particles.config.n_particles), -1)
        tree = cKDTree(exits)
        for _ in range(int(AHEAD_OF_EXIT_S / LOOK_S)):
            particles.predict(slot, np.full(n, LOOK_S))
            away, near = tree.query(particles.cloud.position[:n])
            exit_of = np.where((exit_of < 0) & (away < NEAR_M), near, exit_of)
        return exit_of

    def surprise(weight, exit_of):
        of_exit = np.stack([(weight * (exit_of == k)).sum(axis=1) for k in range(len(exits))], axis=1)
        unknown = weight.sum(axis=1) - of_exit.sum(axis=1)
        p = (1 - FLOOR) * (of_exit + unknown[:, None] / len(exits)) + FLOOR / len(exits)
        return -np.log(p[slot, cases.exit])

    weight = particles.cloud.weight
    before, after = weight[:n].copy(), {}
    for name, given_cues in cues.items():
        for cue, given in given_cues:
            if given.size:
                particles.weigh_by_cue(given, cue)
        after[name] = weight[:n].copy()
        weight[:n] = before
    exit_of = moved_on()
    return {name: surprise(found, exit_of) for name, found in after.items()}


def of_seed(tracks, seed):
    """Of each case of a held-out half: its vehicle's name, and cross-entropies by the name of the cue."""
    fold = split(tracks, by="vehicle", n_folds=2, rng=np.random.default_rng(seed))[0]
    learned = learn_primitives(fold.train, rng=np.random.default_rng(seed))
    centers = exits_of(fold.train)
    cases = cases_of(fold.test, centers)
    cases = Cases(*(column[np.abs(cases.turn) > LEAST_TURN] for column in cases))
    cues = {NO_CUE: (), "signal": signals(cases.turn), "wrong side": signals(-cases.turn), TURN: turned(cases)}
    found = cross_entropies(learned, cases, cues, exits=centers, rng=np.random.default_rng([seed, 1]))
    names = qualified_names(fold.test.track_id, fold.test.group)[fold.test.first_rows]
    return names[cases.vehicle], found


def table(tracks, n_seeds):
    """Cross-entropies, means over vehicles, and their difference to no cue with its interval over vehicles."""
    parts = [of_seed(tracks, seed) for seed in range(n_seeds)]
    vehicle = np.concatenate([names for names, _ in parts])
    _, number = np.unique(vehicle, return_inverse=True)

    def of_vehicles(name):
        value = np.concatenate([found[name] for _, found in parts])
        return np.bincount(number, value) / np.bincount(number)

    rows, before = {}, of_vehicles(NO_CUE)
    for name in parts[0][1]:
        value = of_vehicles(name)
        less = mean_over(np.arange(value.size), value - before)
        rows[name] = {"mean": value.mean(), "difference": less.value, "low": less.low, "high": less.high,
                      "vehicles": value.size, "instants": number.size}  # fmt: skip
    return rows


if __name__ == "__main__":
    print_rows(__doc__, table, seeds=5)
