"""What a store in an object store costs: requests, and the processor time of this process.

Decides: that entries of the manifest come from a bundle of them, else many at a time, and are kept by their marks, and
that recordings are copied. Its peer is the same on a folder. `moto` plays the object store in another process, and is
slower than most: how long it all takes says little.

    python tests/benchmarks/remote_store.py 5000
"""

from __future__ import annotations

import os
import socket
import subprocess
import sys
import tempfile
import time
from collections import Counter
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from dirprim_filter import read_tracks, write_tracks
from dirprim_filter.store import Store, learn_from_store
from dirprim_filter.store.adding import add_logs
from dirprim_filter.store.config import StoreConfig
from dirprim_filter.store.log_files import find_logs

ROOT = Path(__file__).parents[2]
URL = "s3://bucket/fleet"
NEW = 10


@contextmanager
def played() -> Iterator[Counter[str]]:
    """An object store with an empty bucket; how many requests of each kind there were."""
    import s3fs

    with socket.socket() as free:
        free.bind(("127.0.0.1", 0))
        port = free.getsockname()[1]
    os.environ.update(AWS_ACCESS_KEY_ID="none", AWS_SECRET_ACCESS_KEY="none")  # noqa: S106
    os.environ["AWS_ENDPOINT_URL"] = f"http://127.0.0.1:{port}"
    server = subprocess.Popen(
        [sys.executable, "-m", "moto.server", "-H", "127.0.0.1", "-p", str(port)],
        stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL,
    )  # fmt: skip
    asked: Counter[str] = Counter()
    call = s3fs.S3FileSystem._call_s3

    async def counting(files: Any, method: str, *given: Any, **options: Any) -> Any:
        asked[method] += 1
        return await call(files, method, *given, **options)

    s3fs.S3FileSystem._call_s3 = counting
    try:
        for _ in range(100):
            with suppress(ConnectionRefusedError), socket.create_connection(("127.0.0.1", port)):
                break
            time.sleep(0.1)
        s3fs.S3FileSystem().mkdir("bucket")
        yield asked
    finally:
        server.terminate()
        server.wait()


def known(store: Store, folder: Path, n_logs: int) -> None:
    """Let a store have so many logs, all of one recording."""
    log = folder / "0.mcap"
    if not log.exists():
        write_tracks(read_tracks(ROOT / "recordings" / "roundabout_track.mcap")[:200], log)
    add_logs(store, find_logs([str(log)]))
    (entry,) = store.entries()
    entries = []
    for i in range(1, n_logs):
        copy = folder / f"{i}.mcap"
        copy.touch()
        entries.append(replace(entry, url=str(copy.resolve()), size=0, mark=str(copy.stat().st_mtime_ns)))
    store.folder.write({one.file_of(one.url): one.to_json() for one in entries})


def measured(what: str, asked: Counter[str], work: Callable[[], object]) -> None:
    """Print the processor time that some work took, of how long, and its requests."""
    asked.clear()
    began, began_s = time.process_time(), time.perf_counter()
    work()
    took, took_s = time.process_time() - began, time.perf_counter() - began_s
    each = ", ".join(f"{n} {kind}" for kind, n in sorted(asked.items()))
    print(f"  {what}: {took:.1f} s of {took_s:.1f} s, {asked.total()} requests ({each})", flush=True)


def main(n_logs: int) -> None:
    """Of so many known logs."""
    with tempfile.TemporaryDirectory() as name, played() as asked:
        folder, new = Path(name) / "logs", Path(name) / "new"
        folder.mkdir(), new.mkdir()
        tracks = read_tracks(ROOT / "recordings" / "roundabout_learn.mcap")
        for i in range(NEW):
            write_tracks(replace(tracks, time_ns=tracks.time_ns + i)[: 2000 + i], new / f"{i}.mcap")
        for path in (Path(name) / "store", URL):
            known(Store.create(path, StoreConfig()), folder, n_logs)
            store, logs, others = Store.open(path), find_logs([f"{folder}/*.mcap"]), find_logs([f"{new}/*.mcap"])
            print(f"{path}:")
            measured(f"add {n_logs} known logs, first", asked, lambda: add_logs(store, logs))  # noqa: B023
            store = Store.open(path)
            measured(f"add {n_logs} known logs, again", asked, lambda: add_logs(store, logs))  # noqa: B023
            store = Store.open(path)
            measured("what counts", asked, store.recorded)
            measured("what counts, again", asked, store.recorded)
            measured(f"add {NEW} logs", asked, lambda: add_logs(store, others))  # noqa: B023
            learn = {"tessellation": "grid", "cell_size": 10.0, "rng": np.random.default_rng(0)}
            measured("learn", asked, lambda: learn_from_store(store, **learn))  # noqa: B023


if __name__ == "__main__":
    main(int(sys.argv[1]) if len(sys.argv) > 1 else 1000)
