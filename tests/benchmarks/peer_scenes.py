"""What `peers.py` shows to every tracker: unlabelled detections with their truth, and other traffic of the same place.

A scene is a function in `SCENES`, of the number of seeds: `Part`s to be judged, others that settings are chosen by,
tracks that a map is learned from, and what is known of the sensor, which every tracker is given.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass, field
from functools import partial

import numpy as np
from scipy.interpolate import CubicHermiteSpline

from dirprim_filter import Tracks, read_tracks
from dirprim_filter.arrays import BoolArray
from dirprim_filter.cli.demo import in_ring, recordings_folder, with_blind_ring
from dirprim_filter.config import TrackingConfig
from dirprim_filter.detections import Detections
from dirprim_filter.recording.reader import stream_detections
from dirprim_filter.simulation.sensor import detect

RATE_NS = 100_000_000
NOISE_M, MISS_RATE, FALSE_PER_FRAME = 0.5, 0.05, 0.2
"""Of the recordings that ship, see `recordings/README.md`."""


class UnavailableError(RuntimeError):
    """What a scene or a tracker needs is not here; the message says what."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Part:
    """One scene, or one run of it.

    Attributes:
        seen: detections without ids.
        truth: at the instants that are judged.
        is_hidden: (n,) rows of the truth that the sensor cannot see. Left out: none.
    """

    seen: Detections
    truth: Tracks
    is_hidden: BoolArray = field(default_factory=lambda: np.empty(0, np.bool_))

    def __post_init__(self) -> None:
        if not self.is_hidden.size:
            object.__setattr__(self, "is_hidden", np.zeros(len(self.truth), np.bool_))

    def frames(self) -> Iterator[tuple[int, Detections]]:
        """The time and what is detected, at each instant of either, in order."""
        instants = np.union1d(self.truth.time_ns, self.seen.time_ns)
        seen = self.seen[np.argsort(self.seen.time_ns, kind="stable")]
        ends = np.searchsorted(seen.time_ns, instants, side="right")
        starts = np.searchsorted(seen.time_ns, instants, side="left")
        for time_ns, start, end in zip(instants.tolist(), starts.tolist(), ends.tolist(), strict=True):
            yield time_ns, seen[np.arange(start, end)]


@dataclass(frozen=True, slots=True, kw_only=True)
class Fold:
    """A scene: what is judged, and what was known before.

    Attributes:
        judged: parts that intervals are over, one for each seed of the sensor.
        training: parts of other traffic, that all settings are chosen by.
        traffic: what a map is learned from; nothing of it is judged.
        noise_m: standard deviation of a detection in each axis.
        tracking: the true rates of detections, misses and arrivals.
        max_gap_s: how long our tracks may be unseen; others choose.
    """

    judged: tuple[Part, ...]
    training: tuple[Part, ...]
    traffic: Tracks
    noise_m: float
    tracking: TrackingConfig
    max_gap_s: float = 5.0


def recorded(n_seeds: int, *, is_blind: bool) -> Fold:
    """The intersection's recording; the first seed is as it was recorded, others are detected anew."""
    log = recordings_folder() / "intersection_track.mcap"
    truth, traffic = read_tracks(log), read_tracks(recordings_folder() / "intersection_learn.mcap")
    seen = [Detections.concatenate(stream_detections(log)), *(_detected(truth, seed) for seed in range(1, n_seeds))]
    other = at_ten_hertz(traffic, from_s=300.0, to_s=330.0)

    def part(of: Detections, rows: Tracks) -> Part:
        if is_blind:
            return Part(seen=with_blind_ring(of), truth=rows, is_hidden=in_ring(rows.position))
        return Part(seen=of.without_ids(), truth=rows)

    area = float(np.prod(np.ptp(truth.position, axis=0)))
    return Fold(
        judged=tuple(part(of, truth) for of in seen),
        training=(part(_detected(other, 99), other),), traffic=traffic, noise_m=NOISE_M,
        tracking=known(traffic, area=area),
        max_gap_s=6.0 if is_blind else 5.0,
    )  # fmt: skip


def _detected(truth: Tracks, seed: int) -> Detections:
    rng = np.random.default_rng(seed)
    return detect(truth, noise_m=NOISE_M, miss_rate=MISS_RATE, false_per_frame=FALSE_PER_FRAME, rng=rng)


def at_ten_hertz(tracks: Tracks, *, from_s: float, to_s: float) -> Tracks:
    """Rows of a slower log between two times, ten a second: cubic in between, by the positions and velocities."""
    parts = []
    instants = np.arange(round(from_s * 1e9), round(to_s * 1e9), RATE_NS)
    for name in np.unique(tracks.track_id):
        of = tracks[tracks.track_id == name]
        inside = instants[(instants >= of.time_ns[0]) & (instants <= of.time_ns[-1])]
        if len(of) < 2 or not inside.size:
            continue
        velocity = of.speed[:, None] * np.column_stack([np.cos(of.direction), np.sin(of.direction)])
        way = CubicHermiteSpline(of.time_ns * 1e-9, of.position, velocity)
        moved = way.derivative()(inside * 1e-9)
        stands = np.hypot(*moved.T) < 0.1
        last = np.searchsorted(of.time_ns, inside, side="right") - 1
        parts.append(
            Tracks(
                track_id=np.full(inside.size, name), time_ns=inside, position=way(inside * 1e-9),
                direction=np.where(stands, of.direction[last], np.arctan2(moved[:, 1], moved[:, 0])),
                speed=np.hypot(*moved.T),
            )
        )  # fmt: skip
    return Tracks.concatenate(parts)


def known(traffic: Tracks, *, area: float) -> TrackingConfig:
    """What is known of the sensor over an area, and how many vehicles come, by other traffic; per frame of .1 s."""
    n_frames = np.ptp(traffic.time_ns) / RATE_NS
    together = np.unique(traffic.time_ns, return_counts=True)[1].mean()
    return TrackingConfig(
        detection_probability=1.0 - MISS_RATE, clutter_density=FALSE_PER_FRAME / area,
        birth_density=float(traffic.n_tracks / n_frames / area), vehicle_density=float(together) / area,
    )  # fmt: skip


SCENES: dict[str, Callable[[int], Fold]] = {
    "A": partial(recorded, is_blind=False),
    "B": partial(recorded, is_blind=True),
}
