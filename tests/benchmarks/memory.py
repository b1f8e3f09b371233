"""Memory and patience on long logs: the decision to map files, and to keep of a batch its columns alone.

Usage: python tests/benchmarks/memory.py [MIB [TRANSFORMS]]. Writes a log of so many MiB (left out, 2048) of Autoware's
tracked objects on a vehicle, and of the vehicle's transforms (left out, 5 million), without compression, as nothing of
it may be small by chance; then, each in a process of its own, scans it, reads its tracks, streams its detections, and
asks `dirprim info` about it. Prints the height of memory beyond what the same process needs for a small log, and beyond
the columns of the tracks and the transforms. Wanted: less than 100 MB beyond the columns for 2 GB, and `dirprim info`
on 1 GB with an index in less than 0.5 s.
"""

from __future__ import annotations

import os
import subprocess
import sys
import tempfile
import time
from pathlib import Path

import numpy as np
from mcap.reader import make_reader
from mcap.writer import CompressionType, Writer

sys.path.insert(0, str(Path(__file__).parent))
sys.path.insert(0, str(Path(__file__).parents[1] / "recording"))
from decoding import N_OBJECTS, TRACKED, tracked
from ros_messages import full_definition, header, write_ros2_log

N_FRAMES, STEP_NS = 100, 100_000_000
VEHICLE = "base_link"
BATCH = 500
"""Transforms of a message."""
RUN = """
import resource, sys
from collections import deque
from dataclasses import fields
import numpy as np
from dirprim_filter.recording.container.log import Log
from dirprim_filter.recording.transforms.transform_tree import TransformTree
from dirprim_filter.recording.reader import read_tracks, stream_detections
from dirprim_filter.recording.scan import scan
def height():
    return resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024
def columns(*values):
    arrays = (getattr(value, f.name) for value in values for f in fields(value))
    return sum(a.nbytes for a in arrays if isinstance(a, np.ndarray) and any(a.strides)) / (1 << 20)
def edges(path):
    with Log(path) as log:
        return columns(*TransformTree.of_log(log).edges.values())
what = {
    "scan": lambda path: (deque(scan(path), maxlen=0), 0)[1],
    "tracks": lambda path: columns(read_tracks(path, topics="/objects")),
    "transforms": edges,
    "detections": lambda path: (deque(stream_detections(path, topics="/objects"), maxlen=0), 0)[1],
}[sys.argv[1]]
what(sys.argv[2])
before = height()
own = what(sys.argv[3])
print(own, height() - before)
"""


def payloads(folder: Path) -> tuple[object, list[bytes]]:
    """A schema and messages of it, as mcap-ros2-support writes them."""
    frames = (
        {"header": header(k * STEP_NS, VEHICLE), "objects": [tracked(k, i) for i in range(N_OBJECTS)]}
        for k in range(N_FRAMES)
    )
    path = write_ros2_log(folder / "few.mcap", (("/objects", k, TRACKED, frame) for k, frame in enumerate(frames)))
    with path.open("rb") as file:
        (schema,) = make_reader(file).get_summary().schemas.values()
        return schema, [message.data for _, _, message in make_reader(file).iter_messages()]


def transforms(first: int, step_ns: int) -> bytes:
    """A `tf2_msgs/msg/TFMessage` in CDR: where the vehicle is in the map, `BATCH` times."""
    texts = [("map_size", "<u4"), ("map", "S4"), ("name_size", "<u4"), ("name", "S10")]
    place = [("translation", "<f8", 3), ("rotation", "<f8", 4)]
    stamp = [("sec", "<i4"), ("nanosec", "<u4")]
    kinds = [np.dtype([*stamp, *texts, ("pad", "S1", pad), *place]) for pad in (6, 2)]  # floats stand at multiples of 8
    parts, number = [], first + np.arange(BATCH)
    for kind, of in zip(kinds, (number[:1], number[1:]), strict=True):
        rows = np.zeros(len(of), kind)
        rows["sec"], rows["nanosec"] = np.divmod(of * step_ns, 10**9)
        rows["map_size"], rows["map"], rows["name_size"], rows["name"] = 4, b"map", 10, VEHICLE.encode()
        rows["translation"][:, 0], rows["rotation"][:, 3] = of, 1.0
        parts.append(rows.tobytes())
    return b"\0\1\0\0" + BATCH.to_bytes(4, "little") + b"".join(parts)


def write(path: Path, schema: object, data: list[bytes], n_bytes: int, n_transforms: int) -> int:
    """-> the number of messages of objects."""
    n_batches = max(n_transforms // BATCH, 1)
    n = max((n_bytes - n_batches * len(transforms(0, 1))) // len(data[0]), n_batches)
    step_ns = n * STEP_NS // (n_batches * BATCH)
    with path.open("wb") as file:
        writer = Writer(file, compression=CompressionType.NONE)
        writer.start()
        channel = writer.register_channel(
            "/objects", "cdr", writer.register_schema(schema.name, schema.encoding, schema.data)
        )
        definition = full_definition("tf2_msgs/TFMessage").encode()
        tf = writer.register_channel(
            "/tf", "cdr", writer.register_schema("tf2_msgs/msg/TFMessage", "ros2msg", definition)
        )
        every = n // n_batches
        for k in range(n):
            writer.add_message(channel, k * STEP_NS, data[k % len(data)], k * STEP_NS)
            if k % every == 0 and k // every < n_batches:
                writer.add_message(tf, k * STEP_NS, transforms(k // every * BATCH, step_ns), k * STEP_NS)
        writer.finish()
    return n


def info_seconds(path: Path) -> tuple[float, float]:
    """Of the whole process: by the clock on the wall, and of the processor."""
    used, begun = os.times(), time.perf_counter()
    subprocess.run([sys.executable, "-m", "dirprim_filter.cli", "info", path], capture_output=True, check=True)
    wall, now = time.perf_counter() - begun, os.times()
    return wall, now.children_user + now.children_system - used.children_user - used.children_system


def main(mib: int = 2048, n_transforms: int = 5_000_000) -> None:
    """Print the table."""
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        schema, data = payloads(folder)
        small, long = folder / "small.mcap", folder / "long.mcap"
        write(small, schema, data, 1 << 24, BATCH)
        n = write(long, schema, data, mib << 20, n_transforms)
        print(
            f"{long.stat().st_size >> 20} MiB, {n} messages of {N_OBJECTS} objects, {n_transforms} transforms; in MiB"
        )
        print(f"{'what':32}{'columns':>12}{'beyond a small log':>22}{'beyond the columns':>22}")
        of_transforms = 0.0
        for what in ("scan", "transforms", "detections", "tracks"):
            reported = subprocess.run(
                [sys.executable, "-c", RUN, what, small, long], capture_output=True, text=True, check=True
            ).stdout
            own, more = map(float, reported.split())
            of_transforms = own if what == "transforms" else of_transforms
            own += of_transforms if what in ("detections", "tracks") else 0.0  # these read them too
            print(f"{what:32}{own:12.0f}{more:22.0f}{more - own:22.0f}")
        wall, processor = zip(*(info_seconds(long) for _ in range(5)), strict=True)
        print(f"dirprim info by the index: {min(wall):.2f} s, of the processor {min(processor):.2f} s")


if __name__ == "__main__":
    main(*map(int, sys.argv[1:]))
