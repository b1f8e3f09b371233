"""The sums of a store's recordings, read when they are needed: memory does not grow with the store."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Self, TypeVar

from dirprim_filter.primitives.leader_learning import LeaderSums
from dirprim_filter.store.lattice import Lattice
from dirprim_filter.store.store import Store
from dirprim_filter.store.summary import as_leader_sums
from dirprim_filter.store.table import Counts, read_counts, read_summary
from dirprim_filter.store.tallies import Tally

Part = TypeVar("Part")
SUMMED_AT_ONCE = 200_000
"""Keys of recordings in memory, beside those of the sum."""


@dataclass(frozen=True, slots=True, kw_only=True)
class StoredSums:
    """What a map is learned from, as `Summary` has it: the same for the same recordings.

    Attributes:
        lattice: what is counted on.
        digest: SHA-256 of the names of the recordings, which are hashes of their rows, and of how they were counted.
        recordings: their files, and in which `when`s there are steps of each, ascending.
        whens: see `Summary.whens`.
        passed: see `Summary`.
        leader: see `Summary`.
    """

    lattice: Lattice
    digest: str
    recordings: list[tuple[Path, list[int]]]
    whens: Tally
    passed: Tally
    leader: Tally

    @classmethod
    def of(cls, store: Store) -> Self:
        """Reads all but the steps.

        Raises:
            RecordingError: a recording is damaged.
            OSError: one cannot be read.
        """
        rows = store.rows()
        counts = Counts.none()
        recordings: list[tuple[Path, list[int]]] = []
        for parts in _by_size(_counts(store, rows, recordings), _n_passed):
            counts = Counts.total([counts, *parts])
        return cls(
            lattice=store.config.lattice, digest=store.digest, recordings=recordings, whens=counts.whens,
            passed=counts.passed, leader=counts.leader,
        )  # fmt: skip

    @property
    def leader_sums(self) -> LeaderSums:
        """What the response to leaders is learned from."""
        return as_leader_sums(self.leader)

    def steps_of(self, first: int, last: int) -> Tally:
        """The steps of some `when`s, both included.

        Raises:
            RecordingError: a recording is damaged.
            OSError: one cannot be read.
        """
        total = Tally.none(4, 9)
        wanted = (path for path, whens in self.recordings if any(first <= when <= last for when in whens))
        for parts in _by_size((read_summary(path).steps_of(first, last) for path in wanted), len):
            total = Tally.total([total, *parts])
        return total


def _counts(store: Store, rows: list[str], recordings: list[tuple[Path, list[int]]]) -> Iterator[Counts]:
    """What recordings count beside steps; adds each to the list."""
    for path in map(store.recording, rows):
        counts = read_counts(path, store.config.lattice)
        recordings.append((path, counts.whens.key[:, 0].tolist()))
        yield counts


def _n_passed(counts: Counts) -> int:
    return len(counts.passed)


def _by_size(parts: Iterable[Part], size: Callable[[Part], int]) -> Iterator[list[Part]]:
    """The same in lists of about `SUMMED_AT_ONCE` keys."""
    some: list[Part] = []
    n = 0
    for part in parts:
        some.append(part)
        n += size(part)
        if n >= SUMMED_AT_ONCE:
            yield some
            some, n = [], 0
    if some:
        yield some
