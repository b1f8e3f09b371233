"""What a store costs, by the path that users take, and what a half-life is worth where a street turns around.

Decides: that rows are kept as they are (`store.rows`), and that age is a weight (`store.sampling`). The peers of the
latter are all days alike, and the last day alone.

    python tests/benchmarks/fleet.py columns 10000000
    python tests/benchmarks/fleet.py logs 20
    python tests/benchmarks/fleet.py learn 10000000 [--workers 2]
    python tests/benchmarks/fleet.py known 10000
    python tests/benchmarks/fleet.py rounding
    python tests/benchmarks/fleet.py turned [--vehicles 6] [--seeds 3]
"""

from __future__ import annotations

import argparse
import os
import resource
import tempfile
import time
from dataclasses import replace
from pathlib import Path

import numpy as np

from dirprim_filter import Tracks, learn_primitives, read_tracks, write_tracks
from dirprim_filter.store import add_logs, find_logs, learn_from_store
from dirprim_filter.store.config import StoreConfig
from dirprim_filter.store.rows import Rows
from dirprim_filter.store.store import Store
from dirprim_filter.store.workers import Workers

ROOT = Path(__file__).parents[2]
ROWS, PLACE_M, SIDE = 100_000, 1500.0, 4
"""Of a recording; and between places, each in a block of its own, of which there are 16."""
DAY_NS = 86_400 * 10**9
STREETS = {"turned": 0.0, "one way": 150.0, "both ways": 300.0}


def most_mib(who: int = resource.RUSAGE_SELF) -> float:
    """Most memory of this process, or of any that it waited for."""
    return resource.getrusage(who).ru_maxrss / 1024


def processor_s() -> float:
    """Of this process and those that it waited for."""
    return sum(os.times()[:4])


def repeated(tracks: Tracks, n_rows: int, seed: int) -> Tracks:
    """So many rows of the same vehicles again and again, of each time a little elsewhere, one after the other."""
    n, rng = -(-n_rows // len(tracks)), np.random.default_rng(seed)
    lasts = int(np.ptp(tracks.time_ns)) + 10**9
    parts = [
        replace(
            tracks, track_id=tracks.vehicle + i * tracks.n_tracks, time_ns=tracks.time_ns + i * lasts,
            position=tracks.position + rng.normal(0.0, 0.1, 2) + PLACE_M * np.array([seed % SIDE, seed // SIDE % SIDE]),
        )
        for i in range(n)
    ]  # fmt: skip
    return Tracks.concatenate(parts)[:n_rows]


def store_of_columns(path: Path, n_rows: int) -> tuple[Store, float]:
    """A store of so many rows, in recordings of `ROWS`; -> it, and the processor time to write and commit them."""
    log = replace(tracks := read_tracks(ROOT / "recordings/roundabout_learn.mcap"), track_id=tracks.vehicle)
    store, took_s = Store.create(path, StoreConfig(), "map"), 0.0
    for i in range(-(-n_rows // ROWS)):
        tracks = repeated(log, ROWS, i)
        began_s = processor_s()
        files = store.write(Rows.of(tracks), log=f"/{i}", mark="0", status="whole")
        store.commit(lambda _, files=files: (files, []))
        took_s += processor_s() - began_s
    return store, took_s


def columns(n_rows: int) -> None:
    """Rows a second from columns, and bytes a row."""
    with tempfile.TemporaryDirectory() as folder:
        store, took_s = store_of_columns(Path(folder) / "store", n_rows)
        size = sum(entry.size for entry in store.contents().entries.values())
    print(f"{n_rows:,} rows: {n_rows / took_s:,.0f} a second, {size / n_rows:.2f} bytes each; {most_mib():.0f} MiB")


def logs(n_logs: int) -> None:
    """Rows a second from MCAP logs, by one process and by two."""
    log = read_tracks(ROOT / "recordings/roundabout_learn.mcap")
    with tempfile.TemporaryDirectory() as folder:
        for i in range(n_logs):
            write_tracks(repeated(log, ROWS, i), Path(folder) / f"{i}.mcap")
        found = find_logs([f"{folder}/*.mcap"])
        for n in (1, 2):
            began_s, began = time.monotonic(), processor_s()
            added = add_logs(Path(folder) / f"store{n}", found, workers=Workers(n))
            assert not [receipt.error for receipt in added.receipts if receipt.error]
            print(
                f"{n} processes: {n_logs * ROWS / (time.monotonic() - began_s):,.0f} rows a second, "
                f"{n_logs * ROWS / (processor_s() - began):,.0f} a second of processor time"
            )


def learn(n_rows: int, n_workers: int) -> None:
    """Time and memory of learning."""
    with tempfile.TemporaryDirectory() as folder:
        store, _ = store_of_columns(Path(folder) / "store", n_rows)
        before, began_s, began = most_mib(), time.monotonic(), processor_s()
        found = learn_from_store(store, workers=Workers(n_workers), tessellation="grid", cell_size=8.0)
        print(
            f"{n_rows:,} rows, {found.n_blocks} blocks, {found.primitive_map.tessellation.n_cells} cells: "
            f"{time.monotonic() - began_s:.1f} s, {processor_s() - began:.1f} s of processor time; at most "
            f"{most_mib():.0f} MiB ({before:.0f} before), workers {most_mib(resource.RUSAGE_CHILDREN):.0f} MiB"
        )
        began_s = time.monotonic()
        assert learn_from_store(store, tessellation="grid", cell_size=8.0).n_fitted == 0
        print(f"again, where nothing changed: {time.monotonic() - began_s:.1f} s")


def known(n_logs: int) -> None:
    """How long it takes to skip logs that a store knows."""
    with tempfile.TemporaryDirectory() as folder:
        write_tracks(read_tracks(ROOT / "recordings/roundabout_track.mcap"), Path(folder) / "log.mcap")
        (log,) = find_logs([f"{folder}/log.mcap"])
        where = os.environ.get("STORE", f"{folder}/store")
        store = add_logs(where, [log]).store
        assert store is not None
        (file,) = store.contents().entries[log.url].files
        every = [(f"/logs/{i}.mcap", f"{i:032x}") for i in range(n_logs)]
        for i in range(0, n_logs, 100):
            files = [file._replace(log=url, path=f"rows/{n}-{file.digest}.parquet") for url, n in every[i : i + 100]]
            store.commit(lambda _, files=files: (files, []))
        asked = [type(log)(url=url, size=log.size, mark=log.mark) for url, _ in every]
        began_s, began = time.monotonic(), processor_s()
        assert add_logs(where, asked).known == n_logs
        print(
            f"{n_logs} known logs: {time.monotonic() - began_s:.2f} s, {processor_s() - began:.2f} s of processor time"
        )


def rounding() -> None:
    """What whole numbers lose: log density of the held-out log by maps of a store, and of the log itself."""
    with tempfile.TemporaryDirectory() as folder:
        for scene in ("roundabout", "intersection"):
            log, test = (ROOT / f"recordings/{scene}_{name}.mcap" for name in ("learn", "track"))
            store = add_logs(Path(folder) / scene, find_logs([str(log)])).store
            assert store is not None
            seen = read_tracks(test)
            size = sum(entry.size / entry.n_rows for entry in store.contents().entries.values())
            for tessellation in ("grid", "joint"):
                options = {"tessellation": tessellation, "cell_size": 8.0 if tessellation == "grid" else None}
                of_log = learn_primitives(read_tracks(log), rng=np.random.default_rng(0), **options)
                of_store = learn_from_store(store, **options).primitive_map
                density = [
                    float(m.log_density(seen.position, seen.direction, seen.speed).mean()) for m in (of_log, of_store)
                ]
                print(f"{scene}, {tessellation}: {density[0]:.3f} nat, of a store {density[1]:.3f}; {size:.2f} bytes")


def street_of(day: int, rng: np.random.Generator, n_vehicles: int, back: dict[str, float]) -> Tracks:
    """A day of three streets of 80 m; `back` is the share that drives to the west."""
    t, parts = np.arange(0.0, 8.0, 0.2), []
    for k, (name, north) in enumerate(STREETS.items()):
        turned, speed = rng.random(n_vehicles) < back[name], rng.uniform(8.0, 10.0, n_vehicles)
        way = speed[:, None] * t
        east = np.where(turned[:, None], 80.0 - way, way)
        side = north + np.where(turned, 4.0, 0.0) + rng.normal(0.0, 0.3, n_vehicles)
        parts.append(Tracks(
            track_id=k * n_vehicles + np.repeat(np.arange(n_vehicles), t.size),
            time_ns=np.tile((np.round(t * 10) * 1e8).astype(np.int64), n_vehicles)
            + np.repeat(np.arange(n_vehicles), t.size) * 10 * 10**9 + day * DAY_NS,
            position=np.column_stack([east.ravel(), np.repeat(side, t.size)]),
            direction=np.repeat(np.where(turned, np.pi, 0.0), t.size), speed=np.repeat(speed, t.size),
        ))  # fmt: skip
    return Tracks.concatenate(parts)


def turned(n_vehicles: int, n_seeds: int) -> None:
    """Of 60 days and 10 since a one-way street turned around, what maps know of the ten days to come."""
    before = {"turned": 0.0, "one way": 0.0, "both ways": 0.4}
    since = before | {"turned": 1.0}
    score: dict[str, list[list[float]]] = {"half-life of ten days": [], "all days alike": [], "the last day alone": []}
    for seed in range(n_seeds):
        rng = np.random.default_rng(seed)
        days = [street_of(day, rng, n_vehicles, before if day < 60 else since) for day in range(80)]
        test = Tracks.concatenate([replace(day, track_id=day.track_id + 10_000 * i) for i, day in enumerate(days[70:])])
        with tempfile.TemporaryDirectory() as folder:
            store = Store.create(Path(folder) / "store", StoreConfig(), "map")
            last = Store.create(Path(folder) / "last", StoreConfig(), "map")
            for i, day in enumerate(days[:70]):
                for into in (store, last) if i == 69 else (store,):
                    files = into.write(Rows.of(day), log=f"/{i}", mark="0", status="whole")
                    into.commit(lambda _, files=files: (files, []))
            for name, of, half_life_s in zip(score, (store, store, last), (864_000.0, None, None), strict=True):
                learned = learn_from_store(of, half_life_s=half_life_s).primitive_map
                density = learned.log_density(test.position, test.direction, test.speed)
                places = [np.abs(test.position[:, 1] - north - 2.0) < 10.0 for north in STREETS.values()]
                score[name].append([float(density[place].mean()) for place in places])
    for name, found in score.items():
        print(
            f"{name}: "
            + ", ".join(f"{street} {d:.2f}" for street, d in zip(STREETS, np.mean(found, axis=0), strict=True))
        )


if __name__ == "__main__":
    parser = argparse.ArgumentParser()
    parser.add_argument("what", choices=("columns", "logs", "learn", "known", "rounding", "turned"))
    parser.add_argument("n", type=int, nargs="?", default=0)
    parser.add_argument("--workers", type=int, default=1)
    parser.add_argument("--vehicles", type=int, default=6)
    parser.add_argument("--seeds", type=int, default=3)
    given = parser.parse_args()
    if given.what == "learn":
        learn(given.n, given.workers)
    elif given.what == "turned":
        turned(given.vehicles, given.seeds)
    elif given.what == "rounding":
        rounding()
    else:
        {"columns": columns, "logs": logs, "known": known}[given.what](given.n)
