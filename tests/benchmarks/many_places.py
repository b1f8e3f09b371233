"""Learning a map of several places, kilometres apart, from a store: time, and memory of the client and of its workers.

The recordings' roundabout at each place, each recording of 100,000 rows at 2 Hz (its traffic again and again, each time
a little elsewhere).

    python tests/benchmarks/many_places.py 4 --logs 5 --workers 2
    python tests/benchmarks/many_places.py 4 --logs 5 --workers 2 --tessellation grid
"""

from __future__ import annotations

import argparse
import os
import subprocess
import sys
import tempfile
import time
from dataclasses import replace
from pathlib import Path

import numpy as np
from fleet import ROOT, children_of, children_s, n_steps, repeated, write_entry

from dirprim_filter import read_tracks
from dirprim_filter.store.config import StoreConfig
from dirprim_filter.store.store import Store

APART_M = 2000.0
N_ROWS = 100_000
MOST = "VmHWM"


def store_of(path: Path, n_places: int, n_logs: int) -> Store:
    """A store of so many recordings of each place."""
    tracks, store = read_tracks(ROOT / "recordings" / "roundabout_learn.mcap"), Store.create(path, StoreConfig())
    for place in range(n_places):
        for i in range(n_logs):
            made = repeated(tracks, N_ROWS, first=n_logs * place + i)
            there = made.position + APART_M * np.array([place % 2, place // 2])
            write_entry(store, replace(made, position=there), f"{place}_{i}.mcap")
    return store


def watched(command: list[str]) -> tuple[int, float, dict[int, float]]:
    """Run a command. -> its process, seconds, and the most memory of each process that it started, MiB."""
    began, most = time.perf_counter(), dict[int, float]()
    process = subprocess.Popen(command, env=os.environ | {"PYTHONPATH": str(ROOT)})
    while process.poll() is None:
        for pid in descendants(process.pid):
            most[pid] = max(most.get(pid, 0.0), most_mib(pid))
        time.sleep(0.2)
    if process.returncode:
        sys.exit(process.returncode)
    return process.pid, time.perf_counter() - began, most


def descendants(pid: int) -> list[int]:
    """A process, and those that it started."""
    return [pid, *(each for child in children_of(pid) for each in descendants(child))]


def most_mib(pid: int) -> float:
    """The most memory that a process has had; 0 of one that is gone."""
    try:
        lines = Path(f"/proc/{pid}/status").read_text().splitlines()
    except OSError:
        return 0.0
    return next((int(line.split()[1]) / 1024 for line in lines if line.startswith(MOST)), 0.0)


def main(n_places: int, n_logs: int, n_workers: int, tessellation: str) -> None:
    """Learn, and print."""
    with tempfile.TemporaryDirectory() as folder:
        store, learned = store_of(Path(folder) / "store", n_places, n_logs), Path(folder) / "map.mcap"
        print(f"{n_places} places, {n_places * n_logs} recordings, {n_steps(store)} steps", flush=True)
        command = [sys.executable, "-m", "dirprim_filter.cli", "learn", str(store.path), "-o", str(learned)]
        used = children_s()
        pid, took, most = watched([*command, "--tessellation", tessellation, "--workers", str(n_workers)])
    client, others = most.pop(pid), sorted(most.values())[-3:]
    print(
        f"{took:.0f} s, {children_s() - used:.0f} s of processor time; the client took at most {client:.0f} MiB, the "
        f"largest of its workers {', '.join(f'{each:.0f}' for each in others[::-1])} MiB"
    )


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("places", type=int)
    parser.add_argument("--logs", type=int, default=5, help="of each place")
    parser.add_argument("--workers", type=int, default=2)
    parser.add_argument("--tessellation", default="joint")
    given = parser.parse_args()
    main(given.places, given.logs, given.workers, given.tessellation)
