"""How fast are tracking and reading? `python tests/benchmarks/speed.py {step,read}`.

step: predict, weigh and resample 100,000 particles on a map; and `dirprim track` at its defaults, by the clock and with
    its start, of a minute of 100 vehicles at 10 Hz: how many times faster than they drove.
read: 200,000 messages of 60 bytes on 50 topics, beside the stock library in turn, thousands a second.

Milliseconds of processor time, the least of several runs.
"""

from __future__ import annotations

import subprocess
import sys
import tempfile
import time
from collections import deque
from collections.abc import Callable
from pathlib import Path

import numpy as np
from mcap.reader import make_reader
from mcap.writer import CompressionType, Writer

sys.path.insert(0, str(Path(__file__).parents[1]))

from dirprim_filter import learn_primitives, write_tracks
from dirprim_filter.config import FilterConfig
from dirprim_filter.detections import Detections
from dirprim_filter.filtering import ParticleFilter
from dirprim_filter.recording import save_map
from dirprim_filter.recording.scan import scan
from situations import ring_traffic


def least_ms(*works: Callable[[], object], runs: int) -> list[float]:
    """The least milliseconds of each, taking turns, after a run that compiles."""
    found = [np.inf] * len(works)
    for i in range(runs + 1):
        for k, work in enumerate(works):
            began = time.process_time()
            work()
            found[k] = min(found[k], 1e3 * (time.process_time() - began)) if i else np.inf
    return found


def step(n: int = 100_000, n_vehicles: int = 100, seconds: float = 60.0) -> None:
    learned = learn_primitives(
        ring_traffic(np.random.default_rng(0)), tessellation="grid", cell_size=6.0, rng=np.random.default_rng(0)
    )
    ours = ParticleFilter(learned, FilterConfig(n_particles=n // n_vehicles, resample_below=1.0))
    ours.reserve(n_vehicles)
    slot, angle = np.arange(n_vehicles), np.linspace(0, 6, n_vehicles)
    place = 20.0 * np.column_stack([np.cos(angle), np.sin(angle)])
    measured = Detections(track_id=slot, time_ns=np.zeros(n_vehicles, np.int64), position=place)
    ours.begin(slot, np.arange(n_vehicles, dtype=np.uint64), measured)

    def whole() -> None:
        ours.predict(slot, np.full(n_vehicles, 0.1))
        ours.weigh(slot, measured)
        ours.resample(slot)

    print(f"whole step {least_ms(whole, runs=15)[0]:.2f} ms")
    traffic = ring_traffic(np.random.default_rng(1), n_vehicles=n_vehicles, n_rows=round(10 * seconds))
    with tempfile.TemporaryDirectory() as folder:
        log, of, out = (str(Path(folder) / name) for name in ("log.mcap", "map.mcap", "out.mcap"))
        write_tracks(traffic, log, detections=Detections.of(traffic))
        save_map(learned, of)
        command = [sys.executable, "-m", "dirprim_filter", "track", log, "--map", of, "-o", out, "--force"]
        taken = []
        for _ in range(3):
            began = time.perf_counter()
            subprocess.run(command, check=True, capture_output=True)
            taken.append(time.perf_counter() - began)
        print(f"whole log {seconds / min(taken):.1f} x real time")


def read(n: int = 200_000, n_topics: int = 50, size: int = 60) -> None:
    rng = np.random.default_rng(0)
    data = [rng.bytes(size // 2) + bytes(size - size // 2) for _ in range(200)]
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "log.mcap"
        with path.open("wb") as file:
            writer = Writer(file, compression=CompressionType.ZSTD)
            writer.start()
            channels = [writer.register_channel(f"/t{i}", "blob", 0) for i in range(n_topics)]
            for i in range(n):
                writer.add_message(channels[i % n_topics], i * 100_000, data[i % 200], i * 100_000, i)
            writer.finish()

        def ours() -> None:
            with scan(path) as log:
                deque(log, maxlen=0)
                assert not log.damage

        def stock() -> None:
            with path.open("rb") as file:
                deque(make_reader(file, validate_crcs=True).iter_messages(), maxlen=0)

        own, theirs = (n / ms for ms in least_ms(ours, stock, runs=3))
        print(f"messages {own:.0f} k/s {theirs:.0f} k/s")


if __name__ == "__main__":
    {"step": step, "read": read}[sys.argv[1]]()
