"""What a store costs, by the path that users take.

Decides: that rows are encoded as in `store.rows`, and that learning holds a sample of a block (`store.sampling`).

    python tests/benchmarks/fleet.py columns 10000000
    python tests/benchmarks/fleet.py logs 20
    python tests/benchmarks/fleet.py learn 100000000 [--workers 2]
    python tests/benchmarks/fleet.py known 10000
"""

from __future__ import annotations

import argparse
import os
import resource
import tempfile
import time
from dataclasses import replace
from pathlib import Path
from uuid import uuid4

import numpy as np

from dirprim_filter import Tracks, read_tracks, write_tracks
from dirprim_filter.store import add_logs, find_logs, learn_from_store
from dirprim_filter.store.config import StoreConfig
from dirprim_filter.store.files import File
from dirprim_filter.store.rows import StoredRows
from dirprim_filter.store.store import Store
from dirprim_filter.store.workers import Workers

ROOT = Path(__file__).parents[2]
ROWS, SIDE = 100_000, 7
"""Of a recording; and places in a row, of as many rows of them."""
TO_LEARN = {"distinct": 32, "side": 4}
"""Recordings that differ, and places in a row, where learning is measured, which reads whatever is there."""
PLACE_M, ANYWHERE_M = 2048.0, 512.0
"""Between the middles of blocks with a place; and a place lies anywhere in its block, at most so far east and north."""


def most_mib(who: int) -> float:
    """Most memory of this process, or of any that it waited for."""
    return resource.getrusage(who).ru_maxrss / 1024


def processor_s() -> float:
    """Of this process and those that it waited for."""
    return sum(os.times()[:4])


def repeated(tracks: Tracks, n_rows: int, seed: int, side: int = SIDE) -> Tracks:
    """So many rows of the same vehicles again and again, of each time a little elsewhere, one after the other."""
    n, rng = -(-n_rows // len(tracks)), np.random.default_rng(seed)
    place, lasts = seed % side**2, int(np.ptp(tracks.time_ns)) + 10**9
    middle = PLACE_M * np.array(divmod(place, side))
    middle += np.random.default_rng(place).uniform(-ANYWHERE_M, ANYWHERE_M, 2)
    parts = [
        replace(
            tracks, track_id=tracks.vehicle + i * tracks.n_tracks, time_ns=tracks.time_ns + i * lasts,
            position=tracks.position + rng.normal(0.0, 0.1, 2) + middle,
        )
        for i in range(n)
    ]  # fmt: skip
    return Tracks.concatenate(parts)[:n_rows]


def store_of_columns(path: Path, n_rows: int, *, distinct: int = 1 << 30, side: int = SIDE) -> tuple[Store, float]:
    """A store of so many rows, in recordings of `ROWS`; -> it, and the processor time to write and commit them.

    Recordings after the first so many have the bytes of earlier ones, by links, under names of their own.
    """
    log = replace(tracks := read_tracks(ROOT / "recordings/roundabout_learn.mcap"), track_id=tracks.vehicle)
    store, took_s = Store.create(path, StoreConfig(), "map"), 0.0
    written: list[list[File]] = []
    for i in range(min(distinct, -(-n_rows // ROWS))):
        tracks = repeated(log, ROWS, i, side)
        began_s = processor_s()
        written.append(store.write(StoredRows.of(tracks), log=f"/{i}", mark="0", status="whole"))
        store.commit(lambda _: (written[-1], []))
        took_s += processor_s() - began_s
    copies = [linked(path, file, i) for i in range(distinct, -(-n_rows // ROWS)) for file in written[i % distinct]]
    store.commit(lambda _: (copies, []))
    return store, took_s


def linked(path: Path, file: File, i: int) -> File:
    """The same rows as those of another recording."""
    name = f"rows/{uuid4().hex}-{file.digest}.parquet"
    (path / name).hardlink_to(path / file.path)
    return file._replace(path=name, log=f"/{i}", recording=f"{i:064x}")


def columns(n_rows: int) -> None:
    """Rows a second from columns, and bytes a row, those included that are kept near borders a second time."""
    with tempfile.TemporaryDirectory() as folder:
        store, took_s = store_of_columns(Path(folder) / "store", n_rows)
        files = [file for entry in store.contents().entries.values() for file in entry.files]
        kept, n_bytes = sum(file.n_rows for file in files), sum(file.size for file in files)
    print(
        f"{n_rows:,} rows: {n_rows / took_s:,.0f} a second of processor time; {n_bytes / kept:.2f} bytes each, "
        f"{kept / n_rows:.2f} times each, so {n_bytes / n_rows:.2f} bytes"
    )


def logs(n_logs: int) -> None:
    """Rows a second from MCAP logs, by one process."""
    log = read_tracks(ROOT / "recordings/roundabout_learn.mcap")
    with tempfile.TemporaryDirectory() as folder:
        for i in range(n_logs):
            write_tracks(repeated(log, ROWS, i), Path(folder) / f"{i}.mcap")
        found = find_logs([f"{folder}/*.mcap"])
        began_s, began = time.monotonic(), processor_s()
        added = add_logs(Path(folder) / "store", found)
        assert not [receipt.error for receipt in added.receipts if receipt.error]
        print(
            f"{n_logs * ROWS / (time.monotonic() - began_s):,.0f} rows a second, "
            f"{n_logs * ROWS / (processor_s() - began):,.0f} a second of processor time"
        )


def learn(n_rows: int, n_workers: int) -> None:
    """Time and memory of learning."""
    with tempfile.TemporaryDirectory() as folder:
        store, _ = store_of_columns(Path(folder) / "store", n_rows, **TO_LEARN)
        began_s, began = time.monotonic(), processor_s()
        found = learn_from_store(store, workers=Workers(n_workers), tessellation="grid", cell_size=8.0)
        print(
            f"{n_rows:,} rows, {found.n_blocks} blocks, {found.primitive_map.tessellation.n_cells} cells: "
            f"{time.monotonic() - began_s:.1f} s, {processor_s() - began:.1f} s of processor time; at most "
            f"{most_mib(resource.RUSAGE_SELF):.0f} MiB, workers {most_mib(resource.RUSAGE_CHILDREN):.0f} MiB"
        )


def known(n_logs: int) -> None:
    """How long it takes to skip logs that a store knows."""
    with tempfile.TemporaryDirectory() as folder:
        write_tracks(read_tracks(ROOT / "recordings/roundabout_track.mcap"), Path(folder) / "log.mcap")
        (log,) = find_logs([f"{folder}/log.mcap"])
        where = f"{folder}/store"
        store = add_logs(where, [log]).store
        assert store is not None
        (file,) = store.contents().entries[log.url].files
        every = [(f"/logs/{i}.mcap", f"{i:032x}") for i in range(n_logs)]
        for i in range(0, n_logs, 100):
            files = [file._replace(log=url, path=f"rows/{n}-{file.digest}.parquet") for url, n in every[i : i + 100]]
            store.commit(lambda _, files=files: (files, []))
        asked = [type(log)(url=url, name=url, version=log.version) for url, _ in every]
        began_s, began = time.monotonic(), processor_s()
        assert add_logs(where, asked).known == n_logs
        print(
            f"{n_logs} known logs: {time.monotonic() - began_s:.2f} s, {processor_s() - began:.2f} s of processor time"
        )


if __name__ == "__main__":
    parser = argparse.ArgumentParser()
    parser.add_argument("what", choices=("columns", "logs", "learn", "known"))
    parser.add_argument("n", type=int)
    parser.add_argument("--workers", type=int, default=1)
    given = parser.parse_args()
    if given.what == "learn":
        learn(given.n, given.workers)
    else:
        {"columns": columns, "logs": logs, "known": known}[given.what](given.n)
