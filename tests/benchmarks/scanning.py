"""Reading MCAP against the stock library: the decision to have a scan of our own.

Usage: python tests/benchmarks/scanning.py. Prints messages a second of processor time, the best of several runs that
take turns, for 200,000 messages of 60 bytes on 50 topics, and as many of lengths from 1 to 119 bytes. Wanted: reading
with checksums 2.5 million/s and 12 times the stock reader. As columns: what `Scan.parts` gives, as
`info` and `recover` read, with no Python object for each message.
"""

from __future__ import annotations

import tempfile
import time
from collections import deque
from collections.abc import Callable, Iterable
from pathlib import Path

import numpy as np
from mcap.reader import make_reader
from mcap.writer import CompressionType, Writer

from dirprim_filter.recording.scan import scan

N, N_TOPICS, SIZE = 200_000, 50, 60
RUNS = 5


def payloads(rng: np.random.Generator, sizes: Iterable[int]) -> list[bytes]:
    return [rng.bytes(size // 2) + bytes(size - size // 2) for size in sizes]


def write_stock(
    path: Path, data: list[bytes], *, n: int = N, jitter_ns: int = 0, compression=CompressionType.ZSTD
) -> None:
    rng = np.random.default_rng(1)
    jitter = rng.integers(0, jitter_ns + 1, n).tolist()
    with path.open("wb") as file:
        writer = Writer(file, compression=compression)
        writer.start()
        channels = [writer.register_channel(f"/t{i}", "blob", 0) for i in range(N_TOPICS)]
        for i in range(n):
            time_ns = i * 100_000 + jitter[i]
            writer.add_message(channels[i % N_TOPICS], time_ns, data[i % 200], time_ns, i)
        writer.finish()


def read_stock(path: Path) -> None:
    with path.open("rb") as file:
        deque(make_reader(file, validate_crcs=True).iter_messages(), maxlen=0)


def read_ours(path: Path) -> None:
    with scan(path) as log:
        deque(log, maxlen=0)
        assert not log.damage


def read_columns(path: Path) -> None:
    with scan(path) as log:
        assert sum(len(columns) for _, columns in log.parts()) == N
        assert not log.damage


def compare(what: str, ours: Callable[[], None], stock: Callable[[], None], n: int) -> None:
    best = [np.inf, np.inf]
    for _ in range(RUNS):
        for i, run in enumerate((ours, stock)):
            begun = time.process_time()
            run()
            best[i] = min(best[i], time.process_time() - begun)
    rates = [n / seconds / 1000 for seconds in best]
    print(f"{what:44} {rates[0]:8.0f} k/s {rates[1]:8.0f} k/s {rates[0] / rates[1]:6.1f} times")


def main() -> None:
    rng = np.random.default_rng(0)
    data = payloads(rng, [SIZE] * 200)
    unlike = payloads(rng, rng.integers(1, 2 * SIZE, 200).tolist())
    with tempfile.TemporaryDirectory() as folder:
        small = Path(folder) / "small.mcap"
        print(f"{'':44} {'ours':>12} {'stock':>12}")
        for name, options in {
            "read in order of time, zstd": {},
            "read in order of time, lz4": {"compression": CompressionType.LZ4},
            "read in order of time, chunks overlap 50 ms": {"jitter_ns": 50_000_000},
        }.items():
            write_stock(small, data, **options)
            compare(name, lambda: read_ours(small), lambda: read_stock(small), N)
        write_stock(small, unlike)
        compare("read in order of time, unlike lengths", lambda: read_ours(small), lambda: read_stock(small), N)
        compare("read as columns, unlike lengths", lambda: read_columns(small), lambda: read_stock(small), N)


if __name__ == "__main__":
    main()
