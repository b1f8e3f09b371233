"""What a city's map costs, whole and by the tiles that are near vehicles: memory, and processor time.

Decides: from how many cells on `track` holds a part of a map. A learned map is laid out again and again, side by side.

    dirprim learn recordings/roundabout_learn.mcap -o one.mcap
    python tests/benchmarks/city_map.py write one.mcap city.mcap 540
    python tests/benchmarks/city_map.py load city.mcap whole    # or tiles: those near one place
    python tests/benchmarks/city_map.py drive city.mcap tiles recordings/roundabout_track.mcap one.mcap
"""

from __future__ import annotations

import hashlib
import resource
import sys
import time
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path

import numpy as np

from dirprim_filter import load_map, save_map
from dirprim_filter.detections import Detections
from dirprim_filter.distributions import Gamma, VonMisesMixture
from dirprim_filter.estimates import TrackedFrame
from dirprim_filter.filtering import Tracker, Worlds
from dirprim_filter.filtering.particle_filter import ParticleFilter
from dirprim_filter.nearby_map import NearbyMap
from dirprim_filter.primitives.motion import FLOATS, Motion
from dirprim_filter.primitives.primitive_map import PrimitiveMap
from dirprim_filter.recording.map_file import MapFile
from dirprim_filter.recording.playback import stream_detections
from dirprim_filter.replay import replay
from tessellation import VoronoiTessellation

PLACE_S, N_ACROSS = 10.0, 23


def city(one: PrimitiveMap, n: int) -> PrimitiveMap:
    """A map of n places that are all alike, in squares beside each other."""
    position = one.tessellation.centers
    apart, side = apart_of(one), int(np.ceil(np.sqrt(n)))
    shift = apart * np.column_stack([np.arange(n) % side, np.arange(n) // side])

    def rows(column: np.ndarray) -> np.ndarray:
        return np.concatenate([np.tile(column[:-1], (n, *[1] * (column.ndim - 1))), column[-1:]])

    everywhere = (shift[:, None] + position).reshape(-1, 2)
    return PrimitiveMap(
        tessellation=VoronoiTessellation.covering(everywhere, generators=everywhere, reach=3.0),
        direction=VonMisesMixture(
            weight=rows(one.direction.weight), mean_direction=rows(one.direction.mean_direction),
            concentration=rows(one.direction.concentration),
        ),
        speed=Gamma(shape=rows(one.speed.shape), rate=rows(one.speed.rate)),
        n_rows=rows(one.n_rows), n_place_free_modes=one.n_place_free_modes,
        bend=rows(one.bend), gain=rows(one.gain), motion=motion_of(one.motion, one.tessellation.n_cells, n),
    )  # fmt: skip


def motion_of(motion: Motion, n_cells: int, n: int) -> Motion:
    """The manoeuvres of n places; transitions stay within each, place-free ones come last."""
    placed, all_ = motion.n_placed, motion.cell.size
    cut = int(motion.first[placed])

    def rows(column: np.ndarray) -> np.ndarray:
        return np.concatenate([np.tile(column[:placed], (n, *[1] * (column.ndim - 1))), column[placed:]])

    lengths = np.diff(motion.first)
    following = [np.where(motion.following[:cut] < placed, motion.following[:cut] + i * placed,
                          motion.following[:cut] + (n - 1) * placed) for i in range(n)]  # fmt: skip
    last = motion.following[cut:]
    return replace(
        motion,
        cell=np.concatenate([*(motion.cell[:placed] + i * n_cells for i in range(n)), motion.cell[placed:all_]]),
        mode=rows(motion.mode), **{name: rows(getattr(motion, name)) for name in FLOATS},
        first=np.append(0, np.cumsum(rows(lengths))),
        following=np.concatenate([*following, np.where(last < placed, last, last + (n - 1) * placed)]),
        count=np.concatenate([np.tile(motion.count[:cut], n), motion.count[cut:]]),
    )  # fmt: skip


def ready(path: str, *, in_tiles: bool) -> None:
    """Seconds and memory of loading a map, or what is near one place of it, and of all that tracking makes of it."""
    before, began = most_mib(), time.process_time()
    nearby = NearbyMap(MapFile(path) if in_tiles else load_map(path), ahead_s=0.0, noise_m=0.5)
    one = Detections(track_id=np.array(["one"]), time_ns=np.zeros(1, np.int64), position=np.zeros((1, 2)))
    list(nearby.along([one], Worlds(lambda _: Tracker(nearby.part, rng=np.random.default_rng(0)))))
    ParticleFilter(nearby.part)
    print(
        f"{nearby.part.tessellation.n_cells} cells, {Path(path).stat().st_size / 1e6:.0f} MB: ready in "
        f"{time.process_time() - began:.1f} s; held: {now_mib():.0f} MiB, at most {most_mib():.0f}, of which the "
        f"program {before:.0f}",
        flush=True,
    )


def drive(path: str, log: str, one: str, *, in_tiles: bool) -> None:
    """Track a log's vehicles at place after place, `PLACE_S` at each, from one corner of the city to the other."""
    before, began = most_mib(), time.process_time()
    nearby = NearbyMap(MapFile(path) if in_tiles else load_map(path), ahead_s=0.0, noise_m=0.5)
    worlds = Worlds(lambda _: Tracker(nearby.part, rng=np.random.default_rng(0)))
    n_parts, n_cells = 0, [nearby.part.tessellation.n_cells]

    def moved(part: PrimitiveMap) -> None:
        nonlocal n_parts
        n_parts += 1
        n_cells.append(part.tessellation.n_cells)
        worlds.move_to(part)

    nearby.followers.append(moved)
    frames = nearby.along(crossing(log, apart_of(load_map(one))), worlds)
    total = hashlib.sha256()
    n_frames = replay(frames, worlds, [_Digest(total)])
    print(
        f"{n_frames} frames, at most {max(n_cells)} cells in {n_parts} parts: {time.process_time() - began:.1f} s of "
        f"processor; held at the end: {now_mib():.0f} MiB, at most {most_mib():.0f}, of which the program "
        f"{before:.0f}; estimates {total.hexdigest()[:12]}",
    )


class _Digest:
    """An `EstimateSink` that tells runs apart whose estimates differ in a bit."""

    def __init__(self, total: hashlib._Hash) -> None:
        self._total = total

    def write(self, frame: TrackedFrame) -> None:
        """Take the positions of a frame."""
        self._total.update(frame.estimates.position.tobytes())


def crossing(log: str, apart_m: float) -> Iterator[Detections]:
    """The first seconds of a log at each place of the city's diagonal."""
    frames = [f for f in stream_detections(log, topics="/detections") if f.time_ns[0] < PLACE_S * 1e9]
    for place in range(N_ACROSS):
        for frame in frames:
            yield replace(
                frame, time_ns=frame.time_ns + int(place * PLACE_S * 1e9), position=frame.position + place * apart_m,
                track_id=np.array([f"{place}/{name}" for name in frame.track_id.tolist()]),
            )  # fmt: skip


def apart_of(one: PrimitiveMap) -> float:
    """Metres from one place to the next."""
    return float(np.ptp(one.tessellation.centers, axis=0).max()) + 50.0


def most_mib() -> float:
    """The most memory that this process has had."""
    return resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024


def now_mib() -> float:
    """The memory that it has."""
    return int(Path("/proc/self/statm").read_text().split()[1]) * resource.getpagesize() / 2**20


if __name__ == "__main__":
    if sys.argv[1] == "write":
        save_map(city(load_map(sys.argv[2]), int(sys.argv[4])), sys.argv[3], force=True)
    elif sys.argv[1] == "load":
        ready(sys.argv[2], in_tiles=sys.argv[3] == "tiles")
    else:
        drive(sys.argv[2], *sys.argv[4:6], in_tiles=sys.argv[3] == "tiles")
