"""What a store costs: what binning loses, bytes, speed, memory, and workers that are killed.

Decides: the lattice of `store.lattice.Lattice`. Its peer is the map learned from the rows themselves.

    python tests/benchmarks/fleet.py fidelity recordings/roundabout_learn.mcap [--cells 200]
    python tests/benchmarks/fleet.py speed
    python tests/benchmarks/fleet.py memory 1000000
    python tests/benchmarks/fleet.py columns 100000000
    python tests/benchmarks/fleet.py workers 16
    python tests/benchmarks/fleet.py cluster 64 [--log-s .4]
    python tests/benchmarks/fleet.py tiled ../shared/data/town03/roundabout.csv [--tiles 2 --seeds 4]
    python tests/benchmarks/fleet.py year roundabout [--logs 4]
    python tests/benchmarks/fleet.py killing
    python tests/benchmarks/fleet.py known 10000
    python tests/benchmarks/fleet.py update 16
"""

from __future__ import annotations

import argparse
import os
import resource
import shutil
import subprocess
import sys
import tempfile
import time
from dataclasses import replace
from pathlib import Path

import numpy as np

from dirprim_filter import learn_primitives, read_tracks, write_tracks
from dirprim_filter.evaluation.forecast_cases import HORIZONS_S, Cases
from dirprim_filter.evaluation.forecast_methods import futures_of
from dirprim_filter.evaluation.splits import honest_split, split, thinned
from dirprim_filter.recording.tables import read_csv
from dirprim_filter.simulation.traffic import simulate
from dirprim_filter.store import adding, blocks, updating
from dirprim_filter.store.adding import add_logs, hash_of_rows
from dirprim_filter.store.compacting import compacted
from dirprim_filter.store.config import StoreConfig
from dirprim_filter.store.learning import MIN_VEHICLES, MOST_STEPS, learn_from_summary
from dirprim_filter.store.log_files import LogFile, find_logs
from dirprim_filter.store.manifest import Entry
from dirprim_filter.store.recorded_ways import EVERYWHERE, sampled
from dirprim_filter.store.steps import HERE
from dirprim_filter.store.store import Store
from dirprim_filter.store.summary import Summary
from dirprim_filter.store.table import read_counts
from dirprim_filter.store.tiles import tiles_of
from dirprim_filter.store.updating import learn_from_store, update_map
from dirprim_filter.store.workers import ClusterWorkers, LocalWorkers
from dirprim_filter.tracks import Tracks
from tessellation import VoronoiTessellation

ROOT = Path(__file__).parents[2]
N_SAMPLES = 100
LANE_M = 3.5
FRAME = "map"
LOG_S = 600.0
KEPT = (70, 35, 17)
"""Vehicles a month."""
N_TESTS = 3
"""Logs of the month that follows."""
DAY_NS = 24 * 3600 * 10**9


def fidelity(log: str, cells: int, seeds: int) -> None:
    """Held-out log density and energy score in the same cells, learned from rows and from a store of them.

    Half of the vehicles each; every fifth of those held out is forecast.
    """
    tracks = read_csv(log).tracks if log.endswith(".csv") else read_tracks(log)
    learners = {
        "rows": learn_primitives,
        "store": lambda train, **how: learn_from_summary(Summary.of(train), min_vehicles=1, **how),
        "store, 5 vehicles": lambda train, **how: learn_from_summary(Summary.of(train), **how),
    }
    found: dict[str, list[np.ndarray]] = {name: [] for name in learners}
    for fold in split(tracks, by=honest_split(tracks), n_folds=2, rng=np.random.default_rng(0)):
        for seed in range(seeds):
            position = thinned(fold.train, interval_s=0.2).position
            even = VoronoiTessellation.lloyd(position, n_cells=cells, rng=np.random.default_rng(seed), reach=3.0)
            for name, learn in learners.items():
                learned = learn(fold.train, tessellation=even, rng=np.random.default_rng(seed))
                found[name].append(scored(learned, fold.test, seed))
    rows = np.mean(found["rows"], axis=0)
    for name, scores in found.items():
        mean = np.mean(scores, axis=0)
        more = zip(HORIZONS_S, mean[1:] / rows[1:] - 1, strict=True)
        worse = " ".join(f"{horizon:g} s {energy:+.1%}" for horizon, energy in more)
        print(f"{log} {name}: log density {mean[0]:.3f} ({mean[0] - rows[0]:+.3f}); energy score {worse}", flush=True)


def scored(learned, test: Tracks, seed: int) -> np.ndarray:
    """Mean log density of the test's rows in motion, and the energy score at each horizon."""
    rows = thinned(test[test.speed > 0.5], interval_s=0.2)
    density = learned.log_density(rows.position, rows.direction, rows.speed).mean()
    cases = Cases.of(test[test.vehicle % 5 == 0], horizons_s=HORIZONS_S)
    path = futures_of(learned, HORIZONS_S)(cases, N_SAMPLES, np.random.default_rng(seed))
    off = np.linalg.norm(path - cases.later[:, None], axis=-1).mean(axis=1)
    apart = sum(np.linalg.norm(path - np.roll(path, i, axis=1), axis=-1).mean(axis=1) for i in range(1, N_SAMPLES))
    return np.append(density, np.nanmean(off - 0.5 * apart / (N_SAMPLES - 1), axis=0))


def update(n_places: int) -> None:
    """A log of one of many places is added to a store, and the map fitted anew there: processor time."""
    tracks = read_tracks(ROOT / "recordings" / "roundabout_learn.mcap")
    new = read_tracks(ROOT / "recordings" / "roundabout_track.mcap")
    with tempfile.TemporaryDirectory() as folder:
        store = Store.create(Path(folder) / "store", StoreConfig())
        for i in range(n_places):
            place = np.array([500.0 * (i % 8), 500.0 * (i // 8)])
            write_tracks(replace(tracks, position=tracks.position + place), Path(folder) / f"{i}.mcap")
        add_logs(store, find_logs([f"{folder}/*.mcap"]))
        begun = time.process_time()
        cells = VoronoiTessellation.lloyd(
            everywhere(store).position, n_cells=150 * n_places, rng=np.random.default_rng(0), reach=3.0
        )
        learned = learn_from_store(store, tessellation=cells, rng=np.random.default_rng(0))
        learning_s, begun = time.process_time() - begun, time.process_time()
        write_tracks(new, path := Path(folder) / "new.mcap")
        add_logs(store, find_logs([str(path)]))
        adding_s, begun = time.process_time() - begun, time.process_time()
        done = update_map(learned, store)
        updating_s = time.process_time() - begun
    rows = thinned(new, interval_s=0.2)
    before, after = (m.log_density(rows.position, rows.direction, rows.speed).mean() for m in (learned, done[0]))
    print(
        f"{n_places} places, {learned.tessellation.n_cells} cells: learned in {learning_s:.1f} s; a log of {len(new)} "
        f"rows added in {adding_s:.2f} s, {done.n_cells} cells fitted anew in {updating_s:.2f} s; its log density "
        f"{before:.3f}, then {after:.3f}"
    )


def repeated(tracks: Tracks, n_rows: int, first: int = 0) -> Tracks:
    """The traffic of a log again and again, one time after the other and each a little elsewhere."""
    k = max(n_rows // len(tracks), 1)
    lasts, shift = int(np.ptp(tracks.time_ns)) + 10**10, np.random.default_rng(first).uniform(-0.5, 0.5, (k, 2))
    return Tracks(
        track_id=np.concatenate([tracks.vehicle + i * tracks.n_tracks for i in range(k)]),
        time_ns=np.concatenate([tracks.time_ns + (first + i) * lasts for i in range(k)]),
        position=np.concatenate([tracks.position + move for move in shift]),
        direction=np.tile(tracks.direction, k),
        speed=np.tile(tracks.speed, k),
    )


def speed() -> None:
    """Rows a second of one core, from columns (the median of nine times) and from a log, and bytes a row."""
    tracks = read_tracks(ROOT / "recordings" / "roundabout_track.mcap")
    with tempfile.TemporaryDirectory() as folder:
        for n_rows in (100_000, 1_000_000):
            many = repeated(tracks, n_rows)
            Summary.of(many[:1000])
            took = []
            for _ in range(9):
                began = time.process_time()
                Summary.of(many)
                took.append(time.process_time() - began)
            from_columns = float(np.median(took))
            log = Path(folder) / f"{n_rows}.mcap"
            said = "not measured"
            if n_rows <= 100_000:
                write_tracks(many, log)
                store = Store.create(Path(folder) / "store", StoreConfig())
                began = time.process_time()
                add_logs(store, find_logs([str(log)]))
                said = f"{len(many) / (time.process_time() - began) / 1e6:.2f} M rows/s"
                size = sum(path.stat().st_size for path in (store.path / "recordings").iterdir())
                said += f", {size / len(many):.2f} bytes a row"
            print(f"{len(many)} rows: from columns {len(many) / from_columns / 1e6:.2f} M rows/s; from a log {said}")
        for path in sorted((ROOT / "recordings").glob("*.mcap")):
            store = Store.create(Path(folder) / path.stem, StoreConfig())
            add_logs(store, find_logs([str(path)]))
            (entry,) = store.entries()
            print(f"{path.name}: {store.recording(entry.rows).stat().st_size / entry.n_rows:.2f} bytes a row")


def year(scene: str, n_logs: int) -> None:
    """A year of simulated traffic, whole and with each month made one: bytes, and what maps of the same cells lose.

    Judged on logs of the thirteenth month: log density of their rows in motion, and energy scores of a fifth of their
    vehicles.
    """
    logs = [simulate(scene, duration_s=LOG_S, seed=i) for i in range(12 * n_logs + N_TESTS)]
    logs, tests = logs[:-N_TESTS], logs[-N_TESTS:]
    places = np.concatenate([thinned(log, interval_s=0.2).position for log in logs[:4]])
    even = VoronoiTessellation.lloyd(places, n_cells=150, rng=np.random.default_rng(0), reach=3.0)
    km = len(np.unique(np.floor(places), axis=0)) / LANE_M / 1000.0
    with tempfile.TemporaryDirectory() as folder:
        whole = Store.create(Path(folder) / "whole", StoreConfig())
        for i, log in enumerate(logs):
            begin_ns = (31 * (i // n_logs) + 1) * DAY_NS + i % n_logs * 3600 * 10**9
            write_entry(whole, replace(log, time_ns=log.time_ns + begin_ns), f"{i}.mcap")
        rows = None
        for n_vehicles in (None, *KEPT):
            store = whole
            if n_vehicles is not None:
                store = Store.open(Path(shutil.copytree(whole.path, Path(folder) / str(n_vehicles))))
                compacted(store, before_ns=14 * 31 * DAY_NS, n_vehicles=n_vehicles)
            size = sum(path.stat().st_size for path in (store.path / "recordings").iterdir())
            learned = learn_from_store(store, tessellation=even, rng=np.random.default_rng(0))
            scores = np.mean([scored(learned, test, 0) for test in tests], axis=0)
            rows = scores if rows is None else rows
            worse = " ".join(
                f"{horizon:g} s {energy:+.1%}"
                for horizon, energy in zip(HORIZONS_S, scores[1:] / rows[1:] - 1, strict=True)
                if horizon in {1, 3, 5, 8}
            )  # fmt: skip
            print(
                f"{scene}, {n_vehicles or 'all'} vehicles a month: {n_steps(store)} steps, "
                f"{size / 1e6:.2f} MB, {size / 1e6 / km:.2f} MB for each of {km:.2f} km of lanes; log density "
                f"{scores[0]:.3f} ({scores[0] - rows[0]:+.3f}); energy score {worse}", flush=True,
            )  # fmt: skip


def tiled(log: str, n_tiles: int, n_seeds: int) -> None:
    """Held-out log density and energy score of cells laid out whole, and in blocks of so many times 128 m.

    Half of the vehicles each; by each seed borders lie elsewhere. In blocks held-out vehicles choose at half of the
    places. Layouts differ by chance as well: how much of the difference that may be, its standard error says.
    """
    tracks = read_csv(log).tracks if log.endswith(".csv") else read_tracks(log)
    blocks.BLOCK_TILES, counted = n_tiles, updating.n_steps_left
    found: dict[str, list[np.ndarray]] = {"whole": [], "in blocks": []}
    for seed in range(n_seeds):
        away = np.random.default_rng(seed).uniform(0.0, 128.0 * n_tiles, 2)
        moved = replace(tracks, position=tracks.position + away)
        for fold in split(moved, by=honest_split(moved), n_folds=2, rng=np.random.default_rng(0)):
            with tempfile.TemporaryDirectory() as folder:
                store = Store.create(Path(folder) / "store", StoreConfig())
                write_entry(store, fold.train, "log")
                updating.MOST_STEPS = n_steps(store)
                for name, every in found.items():
                    more = 1.0 if name == "in blocks" else 0.0  # than are learned from at once
                    updating.n_steps_left = lambda *given, more=more: counted(*given) + more
                    learned = learn_from_store(store, min_vehicles=1, rng=np.random.default_rng(seed))
                    every.append(np.append(scored(learned, fold.test, 0), learned.tessellation.n_cells))
        whole, tiles = (np.array(each) for each in found.values())
        gain = tiles[:, 0] - whole[:, 0]
        worse = " ".join(f"{s:g} s {each - 1:+.1%}" for s, each in zip(HORIZONS_S, ratio(tiles, whole), strict=True))
        print(
            f"{log}, {seed + 1} seeds: {whole[:, -1].mean():.0f} cells, {tiles[:, -1].mean():.0f} in blocks; log "
            f"density {whole[:, 0].mean():.3f}, {gain.mean():+.3f} in blocks, standard error of the difference "
            f"{gain.std(ddof=1) / np.sqrt(gain.size):.3f}; energy score {worse}", flush=True,
        )  # fmt: skip


def ratio(tiles: np.ndarray, whole: np.ndarray) -> np.ndarray:
    """Of the mean energy scores."""
    return tiles[:, 1:-1].mean(axis=0) / whole[:, 1:-1].mean(axis=0)


def everywhere(store: Store) -> Tracks:
    """The pseudo-vehicles that cells are laid out by."""
    (sample,) = sampled(store, [EVERYWHERE], most_rows=MOST_STEPS, min_vehicles=MIN_VEHICLES)
    return sample.ways.visible().tracks


def n_steps(store: Store) -> int:
    """In all recordings."""
    return sum(int(read_counts(store.recording(rows), store.config.lattice).whens.value.sum()) for rows in store.rows())


def memory(n_rows: int) -> None:
    """The most memory of counting recordings of 100,000 rows each, made one by one, and of learning from all."""
    tracks = read_tracks(ROOT / "recordings" / "roundabout_track.mcap")
    with tempfile.TemporaryDirectory() as folder:
        store = Store.create(Path(folder) / "store", StoreConfig())
        done, began = 0, time.perf_counter()
        while done < n_rows:
            made = repeated(tracks, 100_000, first=done)
            write_entry(store, made, f"{done}.mcap")
            done += len(made)
        said = f"{done} rows: counted with at most {most_mib():.0f} MiB in {time.perf_counter() - began:.0f} s"
        began = time.perf_counter()
        shown = everywhere(store)
        took = time.perf_counter() - began
        print(
            f"{said}; {len(shown)} of {n_steps(store)} steps chosen with at most {most_mib():.0f} MiB in {took:.0f} s",
            flush=True,
        )
        learn_primitives(shown, tessellation="grid", cell_size=8.0, rng=np.random.default_rng(0))
        print(f"a map of cells of 8 m learned with at most {most_mib():.0f} MiB")


def most_mib() -> float:
    """The most memory that this process has had."""
    return resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024


def write_entry(store: Store, tracks: Tracks, name: str) -> None:
    """Put tracks into a store, as if they had come from a log."""
    summary = Summary.of(tracks, frame=FRAME)
    entry = Entry(
        url=name, size=0, mark="0", rows=hash_of_rows(tracks), n_rows=len(tracks), n_vehicles=tracks.n_tracks,
        start_ns=int(tracks.time_ns[0]), end_ns=int(tracks.time_ns[-1]), n_squares=0,
        tiles=tiles_of(summary.steps.key[:, HERE]).tolist(), config=store.config.digest, status="whole",
    )  # fmt: skip
    store.check_frame(name, FRAME)
    store.write_recording(entry.rows, summary)
    store.record(entry)


def columns(n_rows: int) -> None:
    """Rows a second, and the most memory, of recordings of a million rows each from columns, made one by one."""
    tracks = read_tracks(ROOT / "recordings" / "roundabout_track.mcap")
    done, took = 0, 0.0
    while done < n_rows:
        made = repeated(tracks, 1_000_000, first=done // len(tracks))
        began = time.process_time()
        Summary.of(made)
        took += time.process_time() - began
        done += len(made)
        if done % 10_000_000 < len(made) or done >= n_rows:
            print(f"{done} rows: {done / took / 1e6:.2f} M rows/s, at most {most_mib():.0f} MiB", flush=True)


def workers(n_logs: int) -> None:
    """Rows a second of `dirprim store add` from logs of 100,000 rows each, by one process and by two; their memory."""
    tracks = read_tracks(ROOT / "recordings" / "roundabout_track.mcap")
    with tempfile.TemporaryDirectory() as folder:
        for i in range(n_logs):
            write_tracks(repeated(tracks, 100_000, first=i), Path(folder) / f"{i}.mcap")
        found, took = find_logs([f"{folder}/*.mcap"]), []
        for n in (1, 2):
            store = Store.create(Path(folder) / f"store{n}", StoreConfig())
            add_logs(store, found[:1])  # the first log is always added by this process
            began, of_client, of_workers = time.perf_counter(), time.process_time(), children_s()
            add_logs(store, found, workers=LocalWorkers(n))
            took.append(time.perf_counter() - began)
            of_client, of_workers = time.process_time() - of_client, children_s() - of_workers
            n_rows = sum(entry.n_rows for entry in store.entries()[1:])
            print(
                f"processes {n}: {n_rows / took[-1] / 1e6:.3f} M rows/s, {took[-1]:.1f} s with their start; processor "
                f"time of workers {of_workers:.1f} s, of the client {of_client:.1f} s",
                flush=True,
            )
    of_worker = resource.getrusage(resource.RUSAGE_CHILDREN).ru_maxrss / 1024
    print(
        f"{n_rows} rows: a worker took at most {of_worker:.0f} MiB; the client, which made the logs, {most_mib():.0f}"
    )
    print(
        f"two are {took[0] / took[1]:.2f} times as fast as one; load {os.getloadavg()[0]:.1f} on {os.cpu_count()} cores"
    )


def cluster(n_workers: int, log_s: float) -> None:
    """How busy so many workers would be, by a scheduler and a client that are real and logs that are not.

    A log takes a worker so many seconds, in which it sleeps; then it counts what is known beforehand. Workers are
    threads of this process, eight of each of Dask's, so that a few cores do: what they do besides sleeping, they do one
    after the other.
    """
    import dask
    import distributed

    tracks, n_logs = read_tracks(ROOT / "recordings" / "roundabout_track.mcap"), int(20 * n_workers)
    with tempfile.TemporaryDirectory() as folder:
        first, *rest = (Path(folder) / f"{i:05}.mcap" for i in range(n_logs + 1))
        write_tracks(tracks[:100], first)
        for log in rest:
            log.touch()
        store = Store.create(Path(folder) / "store", StoreConfig())
        add_logs(store, find_logs([str(first)]))
        (entry,) = store.entries()

        def counted(log: LogFile, store: Store, frame: str | None, before: Entry | None) -> Entry:
            time.sleep(log_s)
            made = replace(entry, url=log.url, size=log.size, mark=log.mark)
            store.record(made)
            return made

        adding._counted = counted
        quiet = {"distributed.worker.profile.enabled": False}  # of all threads, which are those of all workers
        with (
            dask.config.set(quiet),
            distributed.LocalCluster(
                n_workers=n_workers // 8, threads_per_worker=8, processes=False, dashboard_address=None
            ) as workers,
        ):
            began, busy = time.perf_counter(), time.process_time()
            done = add_logs(store, find_logs([f"{folder}/*.mcap"]), workers=ClusterWorkers(workers.scheduler_address))
            took, busy = time.perf_counter() - began, time.process_time() - busy
    best = log_s * n_logs / n_workers
    print(
        f"{len(done.receipts)} logs of {log_s:g} s by {n_workers} workers: {took:.1f} s, at best {best:.1f}: "
        f"{best / took:.0%}; all else together {busy / n_logs * 1e3:.1f} ms of processor time a log"
    )


def children_s() -> float:
    """Processor time of the processes that this one started and that ended."""
    used = resource.getrusage(resource.RUSAGE_CHILDREN)
    return used.ru_utime + used.ru_stime


def killing() -> None:
    """`dirprim store add --workers 4`, of which one is killed after a tenth, a half and nine tenths of the logs.

    The store is that of one process. A task is run again where two processes opened its log.
    """
    tracks, n_logs = read_tracks(ROOT / "recordings" / "roundabout_track.mcap"), 40
    folder = Path(tempfile.mkdtemp())
    for i in range(n_logs):
        write_tracks(repeated(tracks, len(tracks), first=i), folder / f"{i}.mcap")
    command = [sys.executable, "-m", "dirprim_filter.cli", "store", "add"]
    logs, one = str(folder / "*.mcap"), folder / "one"
    subprocess.run([*command, str(one), logs], check=True)
    (folder / "watch").mkdir()
    (folder / "watch" / "sitecustomize.py").write_text(NOTES_OPENED)
    for share in (0.1, 0.5, 0.9):
        other, opened = folder / f"killed at {share}", folder / f"opened {share}"
        path = os.pathsep.join([str(folder / "watch"), str(ROOT)])
        begun = subprocess.Popen(
            [*command, str(other), logs, "--workers", "4"],
            env=os.environ | {"PYTHONPATH": path, "NOTE_OPENED": str(opened)},
        )
        while len(list(other.glob("logs/*.json"))) < share * n_logs:
            time.sleep(0.02)
        done = len(list(other.glob("logs/*.json")))
        workers = children_of(begun.pid)
        inside = [pid for worker in workers for pid in children_of(worker)]
        os.kill((inside or workers)[-1], 9)
        code = begun.wait()
        same = all((other / p.relative_to(one)).read_bytes() == p.read_bytes() for p in one.glob("recordings/*"))
        left = len(list(other.rglob("*.part")))
        n_again = len(set(opened.read_text().splitlines())) - n_logs
        print(
            f"one of 4 killed after {done} of {n_logs} logs: exit {code}, same bytes: {same}, left over: {left}; "
            f"{n_again} tasks run again, {n_again / n_logs:.1%}", flush=True,
        )  # fmt: skip
    shutil.rmtree(folder)


NOTES_OPENED = """
import os, sys
def note(event, given):
    if event == "open" and str(given[0]).endswith(".mcap"):
        with_line = os.open(os.environ["NOTE_OPENED"], os.O_APPEND | os.O_CREAT | os.O_WRONLY)
        os.write(with_line, f"{os.getpid()} {given[0]}\\n".encode())
        os.close(with_line)
sys.addaudithook(note)
"""
"""Run by every process as it starts: notes which logs it opens."""


def children_of(pid: int) -> list[int]:
    """Of a process."""
    found = subprocess.run(["pgrep", "-P", str(pid)], stdout=subprocess.PIPE, text=True, check=False)
    return [int(line) for line in found.stdout.split()]


def known(n_logs: int) -> None:
    """Adding logs that the store knows: they are found and looked up, and none is opened."""
    with tempfile.TemporaryDirectory() as folder:
        store, log = Store.create(Path(folder) / "store", StoreConfig()), Path(folder) / "0.mcap"
        write_tracks(read_tracks(ROOT / "recordings" / "roundabout_track.mcap")[:100], log)
        add_logs(store, find_logs([str(log)]))
        (entry,) = store.entries()
        for i in range(1, n_logs):
            copy = log.with_name(f"{i}.mcap")
            copy.touch()
            stat = copy.stat()
            known = replace(entry, url=str(copy.resolve()), size=0, mark=str(stat.st_mtime_ns))
            store.folder.write({known.file_of(known.url): known.to_json()})
        began = time.perf_counter()
        added = add_logs(store, find_logs([f"{folder}/*.mcap"]))
        print(f"{added.known} known logs of {n_logs}: {time.perf_counter() - began:.1f} s")


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument(
        "what",
        choices=[
            *("fidelity", "speed", "memory", "columns", "workers", "cluster"),
            *("killing", "known", "update", "year", "tiled"),
        ],
    )
    parser.add_argument("of", nargs="?")
    parser.add_argument("--cells", type=int, default=120)
    parser.add_argument("--seeds", type=int, default=1)
    parser.add_argument("--logs", type=int, default=4, help="a month")
    parser.add_argument("--tiles", type=int, default=1, help="of 128 m, side of a block")
    parser.add_argument("--log-s", type=float, default=0.4, help="that a worker takes for a log")
    given = parser.parse_args()
    if given.what == "fidelity":
        fidelity(given.of or str(ROOT / "recordings" / "roundabout_learn.mcap"), given.cells, given.seeds)
    elif given.what == "tiled":
        tiled(given.of or str(ROOT / "recordings" / "roundabout_learn.mcap"), given.tiles, given.seeds)
    elif given.what == "year":
        year(given.of or "roundabout", given.logs)
    elif given.what == "memory":
        memory(int(given.of or 1_000_000))
    elif given.what == "columns":
        columns(int(given.of or 10_000_000))
    elif given.what == "workers":
        workers(int(given.of or 16))
    elif given.what == "cluster":
        cluster(int(given.of or 64), given.log_s)
    elif given.what == "update":
        update(int(given.of or 16))
    elif given.what == "known":
        known(int(given.of or 10_000))
    else:
        {"speed": speed, "killing": killing}[given.what]()
