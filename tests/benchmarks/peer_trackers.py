"""The trackers that `peers.py` compares, behind one function each: ours three ways, motpy and norfair.

A tracker takes the frames of a `Part` and settings, and returns what it reports at each instant: confirmed tracks, also
those that coast, each under an id of its own. Its `axes` are what is chosen on training data.
"""

from __future__ import annotations

import json
import os
import shutil
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from functools import cache, partial
from pathlib import Path

import numpy as np
from mcity_drives import without_own_bias
from peer_scenes import Fold, Part, UnavailableError

from dirprim_filter.arrays import FloatArray
from dirprim_filter.config import FilterConfig, TrackingConfig
from dirprim_filter.estimates import Estimates
from dirprim_filter.evaluation.settings import Axis
from dirprim_filter.evaluation.tracked_rows import TrackedRows
from dirprim_filter.filtering import BayesFilter, ConstantVelocityKalman, Tracker
from dirprim_filter.primitives.primitive_map import PrimitiveMap
from dirprim_filter.sensor import Sensor

Settings = Mapping[str, float]
START_SPEED_M_S = 10.0
"""Prior standard deviation of a velocity, for all."""
HALF_DECADE = 10.0**0.5
"""Between neighbouring values of settings whose scale is not known."""
UNKNOWN = np.full((2, 2), np.nan)


@dataclass(frozen=True, slots=True)
class Tracked:
    """What a tracker reports, and the processor's seconds that it took."""

    rows: TrackedRows
    seconds: float


@dataclass(frozen=True, slots=True)
class Peer:
    """A tracker.

    Attributes:
        track: a part by settings.
        axes: the settings to choose; none where nothing is. Whole numbers are rounded from what is chosen.
        after: the tracker whose choice is taken over; settings that they share are searched on from there.
    """

    track: Callable[[Part, Settings], Tracked]
    axes: tuple[Axis, ...]
    after: str = ""


class Reported:
    """Rows as they come, with the time that passes."""

    def __init__(self) -> None:
        self._rows: list[tuple[str, int, FloatArray, FloatArray]] = []
        self._since = time.process_time()

    def add(self, name: str, time_ns: int, place: FloatArray, covariance: FloatArray = UNKNOWN) -> None:
        """One track at one instant."""
        self._rows.append((name, time_ns, np.array(place, np.float64), np.array(covariance, np.float64)))

    def done(self) -> Tracked:
        """All rows."""
        seconds = time.process_time() - self._since
        name, time_ns, place, covariance = zip(*self._rows, strict=True) if self._rows else ((),) * 4
        rows = TrackedRows(
            track_id=np.array(name, np.str_), time_ns=np.array(time_ns, np.int64),
            position=np.reshape(place, (-1, 2)), covariance=np.reshape(covariance, (-1, 2, 2)),
        )  # fmt: skip
        return Tracked(rows, seconds)


def ours(fold: Fold, learned: PrimitiveMap) -> dict[str, Peer]:
    """Our tracker on the map, on that without its places, and on a Kalman filter of constant velocity.

    Where vehicles leave is what the map knows; without it how often they do is chosen, as others choose when to delete.
    """
    config = FilterConfig(noise_m=fold.noise_m, max_gap_s=fold.max_gap_s)

    def by_map(primitives: PrimitiveMap, sensor: Sensor | None, part: Part, settings: Settings) -> Tracked:
        return _followed(part, primitives, config, replace(fold.tracking, **settings), sensor)

    def by_kalman(part: Part, settings: Settings) -> Tracked:
        model = ConstantVelocityKalman(acceleration_density=settings["acceleration"], config=config)
        tracking = replace(fold.tracking, departure_rate=settings["departure_rate"])
        return _followed(part, model, config, tracking, fold.sensor)

    leaves = Axis("departure_rate", fold.tracking.departure_rate, HALF_DECADE)
    by_noise = Peer(partial(by_map, learned, None), ())
    return {
        "ours, with the map": Peer(partial(by_map, learned, fold.sensor), ()),
        **({} if fold.sensor is None else {"ours, with the map, the noise alone known": by_noise}),
        "ours, without the map": Peer(partial(by_map, learned.without_places(), fold.sensor), (leaves,)),
        "ours, constant velocity": Peer(by_kalman, (Axis("acceleration", 1.0, HALF_DECADE), leaves)),
    }


def _followed(
    part: Part, model: PrimitiveMap | BayesFilter, config: FilterConfig, tracking: TrackingConfig, sensor: Sensor | None
) -> Tracked:
    tracker = Tracker(model, config=config, tracking=tracking, sensor=sensor, rng=np.random.default_rng(0))
    since = time.process_time()
    found = Estimates.concatenate([tracker.step(seen, time_ns=time_ns) for time_ns, seen in part.frames()])
    if sensor is not None and isinstance(model, ConstantVelocityKalman):
        found = without_own_bias(found, sensor)
    return Tracked(TrackedRows.of(found), time.process_time() - since)


def motpy(fold: Fold) -> dict[str, Peer]:
    """motpy: boxes of one size about the detections, Kalman filters, the overlap of boxes.

    Raises:
        UnavailableError: it is not installed.
    """
    try:
        from motpy import Detection, MultiObjectTracker
    except ImportError as error:
        raise UnavailableError("motpy is not installed: the extra `peers`") from error

    def track(part: Part, settings: Settings) -> Tracked:
        half, reported = 0.5 * settings["box"], Reported()
        tracker = MultiObjectTracker(
            dt=step_s_of(part),
            model_spec={
                "order_pos": 1, "dim_pos": 2, "order_size": 0, "dim_size": 2, "q_var_pos": settings["acceleration"],
                "q_var_size": 1e-6, "r_var_pos": fold.noise_m**2, "r_var_size": 1.0, "p_cov_p0": START_SPEED_M_S**2,
            },
            matching_fn_kwargs={"min_iou": 1e-3},
            tracker_kwargs={"max_staleness": settings["deleted_after"]},
            active_tracks_kwargs={
                "max_staleness_to_positive_ratio": settings["stale_share"],
                "min_steps_alive": round(settings["confirmed_after"]),
            },
        )  # fmt: skip
        for time_ns, seen in part.frames():
            boxes = [Detection(np.concatenate([place - half, place + half])) for place in seen.position]
            for found in tracker.step(boxes):
                reported.add(found.id, time_ns, 0.5 * (found.box[:2] + found.box[2:]))
        return reported.done()

    axes = (
        Axis("acceleration", 10.0, HALF_DECADE), Axis("box", 4.0, 1.5), Axis("deleted_after", 10.0, 1.5, 1.0),
        Axis("stale_share", 1.0), Axis("confirmed_after", 3.0, 1.5, 1.0),
    )  # fmt: skip
    return {"motpy": Peer(track, axes)}


def step_s_of(part: Part) -> float:
    """The usual time between frames, for trackers that know but one."""
    return float(np.median(np.diff([time_ns for time_ns, _ in part.frames()]))) * 1e-9


def norfair(fold: Fold) -> dict[str, Peer]:
    """norfair, in a process and an environment of its own: it needs an older numpy.

    Raises:
        UnavailableError: uv, or the packages, cannot be had.
    """
    worker = _worker()

    def track(part: Part, settings: Settings) -> Tracked:
        return worker.track(
            part, dict(settings) | {"noise_m": fold.noise_m, "step_s": step_s_of(part), "speed_m_s": START_SPEED_M_S}
        )

    axes = (
        Axis("acceleration", 10.0, HALF_DECADE), Axis("gate_m", 4.0, 1.5), Axis("deleted_after", 10.0, 1.5, 3.0),
        Axis("confirmed_after", 3.0, 1.5, 1.0),
    )  # fmt: skip
    return {"norfair": Peer(track, axes)}


@cache
def _worker() -> _Worker:
    return _Worker(Path(__file__).with_name("peer_norfair.py"))


class _Worker:
    """A process that tracks, part after part: files in, files out."""

    def __init__(self, script: Path) -> None:
        uv = shutil.which("uv") or shutil.which("uv", path=str(Path(sys.executable).parent))
        if uv is None:
            raise UnavailableError("norfair needs numpy 1 in an environment of its own: uv is not installed")
        alone = [uv, "run", "-q", "--isolated", "--no-project", "--python", sys.executable]
        needs = ["--with", "norfair==2.3.0", "--with", "numpy<2"]
        self._folder = tempfile.TemporaryDirectory()
        self._process = subprocess.Popen(
            [*alone, *needs, "python", str(script)], stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True,
            env={name: value for name, value in os.environ.items() if name != "PYTHONPATH"},
        )  # fmt: skip
        if self._answer() != "ready":
            raise UnavailableError("norfair 2.3.0 cannot be installed beside numpy 1 here")

    def _answer(self) -> str:
        return (self._process.stdout.readline() if self._process.stdout else "").strip()

    def track(self, part: Part, settings: Mapping[str, float]) -> Tracked:
        given, answer = (Path(self._folder.name) / name for name in ("given.npz", "answer.npz"))
        frames = list(part.frames())
        np.savez(
            given, instants=np.array([time_ns for time_ns, _ in frames], np.int64),
            n_seen=np.array([len(seen) for _, seen in frames]),
            position=np.concatenate([np.empty((0, 2)), *(seen.position for _, seen in frames)]),
        )  # fmt: skip
        request = {"given": str(given), "answer": str(answer), "settings": settings}
        if self._process.stdin:
            print(json.dumps(request), file=self._process.stdin, flush=True)
        seconds = float(self._answer())
        with np.load(answer) as found:
            rows = TrackedRows(
                track_id=found["track_id"], time_ns=found["time_ns"], position=found["position"].reshape(-1, 2)
            )
        return Tracked(rows, seconds)
