"""A map of a store: `learn_primitives` of the rows of each block, and of those around it; then all blocks as one.

What a block's map follows from has a hash, by which it is kept in the store: what did not change is not learned again.
"""

from __future__ import annotations

import hashlib
import json
from collections import defaultdict
from collections.abc import Callable, Iterator
from dataclasses import asdict, replace
from functools import cache, partial
from itertools import groupby
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

import dirprim_filter
import tessellation
from dirprim_filter.config import LearningConfig
from dirprim_filter.primitives.learning import learn_primitives
from dirprim_filter.primitives.primitive_map import PrimitiveMap
from dirprim_filter.recording.map_file import encoded, map_of
from dirprim_filter.store.blocks import Block
from dirprim_filter.store.files import Contents, File
from dirprim_filter.store.folder import FITS
from dirprim_filter.store.joining import joined
from dirprim_filter.store.rows import LATEST_MS, StoredRows
from dirprim_filter.store.sampling import MOST_ROWS, Ageing, Hours, Recording, drawn, sample_of
from dirprim_filter.store.store import DamagedFileError, GoneError, Store
from dirprim_filter.store.workers import Workers
from tessellation import GridTessellation

CODE = (
    "arrays.py", "config.py", "tracks.py", "course.py", "distributions/**/*.py", "primitives/**/*.py", "store/**/*.py",
)  # fmt: skip
"""Of the package, what a block's map follows from, beside the tessellation."""
MOST_RESTARTS = 20
"""Times that learning restarts while others take logs out."""

Progress = Callable[[int, int], None]


class Learned(NamedTuple):
    """A map, and what came of its blocks."""

    primitive_map: PrimitiveMap
    n_blocks: int
    n_fitted: int  # of them; the others were known
    n_logs: int
    n_rows: int
    digest: str  # of the recordings and of how they were learned from
    damaged: list[str]  # what could not be read, a line each


class Recipe(NamedTuple):
    """How blocks are learned."""

    options: dict[str, Any]  # of `learn_primitives`
    min_vehicles: int
    ageing: Ageing | None
    hours: Hours | None
    seed: int


class Task(NamedTuple):
    """A block to learn."""

    block: Block
    files: list[File]  # of one recording after the other
    recipe: Recipe

    @property
    def key(self) -> str:
        """Of all that the block's map follows from."""
        options, *chosen = self.recipe
        values = [asdict(value) if isinstance(value, LearningConfig) else value for value in options.values()]
        holds = [(file.recording, file.digest, file.halo) for file in self.files]
        text = json.dumps([self.block, holds, list(options), values, chosen, MOST_ROWS, code_version()])
        return hashlib.sha256(text.encode()).hexdigest()


class Done(NamedTuple):
    """What came of it."""

    block: Block
    data: bytes  # the map, as the message of a map file; none where no row is left
    fitted: bool
    damaged: list[str]


def learn_from_store(
    store: Store, *, min_vehicles: int = 1, half_life_s: float | None = None, now_ns: int | None = None,
    hours: Hours | None = None, workers: Workers | None = None, done: Progress | None = None, seed: int = 0,
    **options: Any,
) -> Learned:  # fmt: skip
    """Learn a map: the same for the same recordings, in whatever order they came and whoever does the work.

    Args:
        store: of logs.
        min_vehicles: rows where fewer vehicles passed the same way are left out.
        half_life_s: seconds, after which a vehicle counts half; left out, all count alike. A block ages as it is seen
            anew: from its last recording on, or from `now_ns` if that is earlier.
        now_ns: nanoseconds since 1970-01-01.
        hours: of the day, in which vehicles count; left out, all do.
        workers: who learn blocks; left out, this process.
        done: called with how many blocks are done, and of how many.
        seed: of what `learn_primitives` draws.
        options: of `learn_primitives`; what it calls is called in this process alone.

    Raises:
        ValueError: there is nothing to learn from, or options as for `learn_primitives`.
        RecordingError: the store cannot be read.
    """
    if min_vehicles < 1:
        raise ValueError(f"min_vehicles: expected at least 1, got {min_vehicles}")
    now_ms = LATEST_MS if now_ns is None else now_ns // 1_000_000
    recipe = Recipe(options, min_vehicles, None if half_life_s is None else Ageing(half_life_s, now_ms), hours, seed)
    for _ in range(MOST_RESTARTS):
        contents = store.contents()
        try:
            return _learned(store, contents, recipe, workers or Workers(), done)
        except GoneError as error:
            gone = error
    raise gone


def _learned(store: Store, contents: Contents, recipe: Recipe, workers: Workers, progress: Progress | None) -> Learned:
    by_block = files_of_blocks(contents)
    n_rows = {block: sum(file.n_rows for file in files if not file.halo) for block, files in by_block.items()}
    if not sum(n_rows.values()):
        raise ValueError(f"{store}: expected logs to learn from, the store is empty; see `dirprim store add`")
    blocks = sorted((block for block in by_block if n_rows[block]), key=lambda block: (-n_rows[block], block))
    done: list[Done] = []
    calls: dict[str, Any] = {name: recipe.options[name] for name in ("progress", "stage") if name in recipe.options}
    recipe = recipe._replace(options={k: v for k, v in recipe.options.items() if k not in calls})

    def report(each: Done) -> None:
        done.append(each)
        if progress is not None:
            progress(len(done), len(blocks))

    def task_of(block: Block) -> Task:
        own = _recipe_of(recipe, by_block[block], n_rows[block] / sum(n_rows.values()))
        return Task(block, by_block[block], own)

    chosen = recipe.options.get("tessellation") == "grid" and len(blocks) > 1
    if chosen and recipe.options.get("n_cells") is not None:
        raise ValueError(
            f"{store}: is of {len(blocks)} blocks, whose squares are of one size; give --cell-size instead"
        )
    if chosen and recipe.options.get("cell_size") is None:  # the block with the most rows chooses it for all
        first = fitted(task_of(blocks[0]), store=store, calls=calls)
        report(first)
        found = map_of(first.data).tessellation if first.data else None
        if isinstance(found, GridTessellation):
            recipe = recipe._replace(options=recipe.options | {"cell_size": found.cell_size})
    tasks = [task_of(block) for block in blocks[len(done) :]]
    work = partial(fitted, store=store, calls=calls if workers.in_process else {})
    for each in workers.each(work, tasks, [f"fit-{task.key}" for task in tasks]):
        report(each)
    maps = {each.block: map_of(each.data) for each in sorted(done, key=lambda each: each.block) if each.data}
    if not maps:
        raise ValueError(
            f"{store}: expected places that {recipe.min_vehicles} vehicles passed the same way, got none; add logs, or "
            "ask for fewer vehicles or other hours"
        )
    holds = [[entry.recording, *sorted(file.digest for file in entry.files)] for entry in contents.recordings()]
    digest = hashlib.sha256(json.dumps(holds).encode()).hexdigest()
    return Learned(
        replace(joined(maps), origin=store.origin), len(blocks), sum(each.fitted for each in done),
        len(contents.entries), sum(n_rows.values()), digest,
        sorted({*contents.damaged, *(line for each in done for line in each.damaged)}),
    )  # fmt: skip


def _recipe_of(recipe: Recipe, files: list[File], share: float) -> Recipe:
    """Of a block that has such a share of all rows."""
    n_cells, ageing = recipe.options.get("n_cells"), recipe.ageing
    if ageing is not None:
        ageing = ageing._replace(now_ms=min(ageing.now_ms, max(file.end_ms for file in files)))
    options = recipe.options if n_cells is None else recipe.options | {"n_cells": max(1, round(n_cells * share))}
    return recipe._replace(options=options, ageing=ageing)


def files_of_blocks(contents: Contents) -> dict[Block, list[File]]:
    """Of each block, one recording after the other."""
    found: defaultdict[Block, list[File]] = defaultdict(list)
    for entry in contents.recordings():
        for file in entry.files:
            found[file.block].append(file)
    return found


def fitted(task: Task, *, store: Store, calls: dict[str, Any]) -> Done:
    """A block's map: the one that is known by its key, or else a new one, known from now on.

    Raises:
        GoneError: a log was taken out meanwhile.
        RecordingError: the store cannot be read or written.
    """
    path = f"{FITS}/{task.block}/{task.key}.arrow"
    known = store.get(path)
    if known is not None and hashlib.sha256(known[32:]).digest() == known[:32]:
        return Done(task.block, known[32:], False, [])
    damaged: list[str] = []
    recipe = task.recipe
    left = drawn(_recordings(store, task.files, recipe.hours, damaged))
    tracks, weight = sample_of(left, min_vehicles=recipe.min_vehicles, ageing=recipe.ageing)
    data = b""
    if len(tracks):
        rng = np.random.default_rng(recipe.seed)
        data = encoded(learn_primitives(tracks, weight=weight, rng=rng, **recipe.options, **calls))
    if not damaged:
        store.put(path, hashlib.sha256(data).digest() + data)
    return Done(task.block, data, True, damaged)


def _recordings(store: Store, files: list[File], hours: Hours | None, damaged: list[str]) -> Iterator[Recording]:
    """The rows of each recording, inside and around a block; one that is damaged is left out, and named."""
    for name, own in groupby(files, key=lambda file: file.recording):
        try:
            rows = StoredRows.together([store.read(file) for file in own])
        except DamagedFileError as error:
            damaged.append(str(error))
        else:
            yield Recording.of(name, rows if hours is None else hours.of(rows))


@cache
def code_version() -> str:
    """A hash of the code that a block's map follows from."""
    digest = hashlib.sha256()
    for package, names in ((dirprim_filter, CODE), (tessellation, ("**/*.py",))):
        (root,) = package.__path__
        for path in sorted(each for name in names for each in Path(root).glob(name)):
            digest.update(path.read_bytes())
    return digest.hexdigest()
