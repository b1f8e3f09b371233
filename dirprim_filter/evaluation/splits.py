"""Held-out splits of tracks, and how far an evaluation has come.

A random share of rows, as in the paper, leaks: rows of one vehicle a tenth of a second apart fall on both sides. Rows
are therefore held out by vehicle, and by group where the log knows groups, unless the paper's split is asked for.
"""

from __future__ import annotations

from collections.abc import Callable
from itertools import count
from typing import Literal, NamedTuple

import numpy as np

from dirprim_filter.arrays import IntArray
from dirprim_filter.tracks import Tracks

SplitBy = Literal["vehicle", "group", "random"]

PAPERS_SHARE = 0.1
"""Of the rows, held out in one fold of a random split."""


class Fold(NamedTuple):
    """What to learn from, and what to be judged by."""

    train: Tracks
    test: Tracks


def honest_split(tracks: Tracks) -> SplitBy:
    """By group if the log has more than one, else by vehicle."""
    return "group" if np.unique(tracks.group).size > 1 else "vehicle"


def split(tracks: Tracks, *, by: SplitBy, n_folds: int, rng: np.random.Generator) -> list[Fold]:
    """Folds of which no two hold out the same row.

    Args:
        tracks: what to split.
        by: "vehicle" and "group" deal whole vehicles or groups to `n_folds` folds at random; "random" holds out
            another tenth of the rows in each fold, whosever they are.
        n_folds: how many; with fewer vehicles or groups than that, one fold for each.
        rng: deals.

    Raises:
        ValueError: nothing can be held out: there are fewer than two vehicles, groups or rows, or `n_folds` is
            below one (below two for whole vehicles or groups) or, for random tenths, above ten.
    """
    part = _parts(tracks, by, n_folds, rng)
    return [Fold(tracks[part != i], tracks[part == i]) for i in range(int(part.max()) + 1)]


def held_out(tracks: Tracks, *, share: float, rng: np.random.Generator) -> Fold:
    """A share to learn from, and the rest to be judged by: whole groups where there are several, else whole vehicles.

    Raises:
        ValueError: there is only one.
    """
    by = honest_split(tracks)
    column = tracks.group if by == "group" else tracks.vehicle
    kinds = np.unique(column)
    if kinds.size < 2:
        raise ValueError(f"tracks: expected at least two {by}s, got {kinds.size}: give a map to track it with")
    n_train = int(np.clip(round(share * kinds.size), 1, kinds.size - 1))
    is_train = np.isin(column, rng.permutation(kinds)[:n_train])
    return Fold(tracks[is_train], tracks[~is_train])


def thinned(tracks: Tracks, *, interval_s: float) -> Tracks:
    """The first row of each vehicle in every `interval_s` since its first: rows of 10 Hz repeat each other.

    Raises:
        ValueError: `interval_s` is not positive.
    """
    if not interval_s > 0:
        raise ValueError(f"interval_s: expected a positive time in seconds, got {interval_s}")
    vehicle = tracks.vehicle
    interval = (tracks.time_ns - tracks.time_ns[tracks.first_rows][vehicle]) // max(round(interval_s * 1e9), 1)
    _, kept = np.unique(np.column_stack([vehicle, interval]), axis=0, return_index=True)
    return tracks[np.sort(kept)]


def _parts(tracks: Tracks, by: SplitBy, n_folds: int, rng: np.random.Generator) -> IntArray:
    """(n,) the fold that holds out each row; -1 for none."""
    if by == "random":
        return _random_tenths(len(tracks), n_folds, rng)
    column = {"vehicle": tracks.vehicle, "group": tracks.group}.get(by)
    if column is None:
        raise ValueError(f"by: expected 'vehicle', 'group' or 'random', got {by!r}")
    if n_folds < 2:
        raise ValueError(f"n_folds: expected at least 2 to split by {by}, got {n_folds}")
    kinds, kind = np.unique(column, return_inverse=True)
    if kinds.size < 2:
        raise ValueError(f"tracks: expected at least two to split by {by}, got {kinds.size}; split otherwise")
    dealt = np.arange(kinds.size) % min(n_folds, kinds.size)
    return np.asarray(rng.permutation(dealt)[kind], dtype=np.int64)


def _random_tenths(n_rows: int, n_folds: int, rng: np.random.Generator) -> IntArray:
    if not 1 <= n_folds <= round(1 / PAPERS_SHARE):
        raise ValueError(f"n_folds: expected 1 to {round(1 / PAPERS_SHARE)} to hold out random tenths, got {n_folds}")
    size = max(round(PAPERS_SHARE * n_rows), 1)
    if n_rows < 2 or size * n_folds > n_rows:
        raise ValueError(f"tracks: expected enough rows for {n_folds} random tenths, got {n_rows}")
    part = np.full(n_rows, -1, np.int64)
    part[rng.permutation(n_rows)[: size * n_folds]] = np.repeat(np.arange(n_folds), size)
    return part


def steps(total: int, progress: Callable[[int, int], None] | None) -> Callable[[], None]:
    """To be called at each of so many steps: calls `progress` with the number of steps done, and their total."""
    done = count(1)
    return lambda: None if progress is None else progress(next(done), total)
