"""The trackers that `peers.py` compares: ours three ways, and those of installed packages, behind one function each.

A tracker takes the frames of a `Part` and settings, and returns what it reports at each instant: confirmed tracks, also
those that coast, each under an id of its own. Its `knobs` are what is chosen on training data.
"""

from __future__ import annotations

import json
import os
import shutil
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from datetime import datetime, timedelta
from functools import cache, partial
from pathlib import Path
from typing import Any

import numpy as np
from peer_scenes import Fold, Part, UnavailableError

from dirprim_filter.arrays import FloatArray
from dirprim_filter.config import FilterConfig, TrackingConfig
from dirprim_filter.estimates import EstimateList
from dirprim_filter.evaluation.tracked_rows import TrackedRows
from dirprim_filter.filtering import BayesFilter, ConstantVelocityKalman, Tracker
from dirprim_filter.primitives import PrimitiveMap

Settings = Mapping[str, float]
START_SPEED_M_S = 10.0
"""Prior standard deviation of a velocity, for all."""


@dataclass(frozen=True, slots=True)
class Knob:
    """A setting to be chosen: where the search starts, and the factor or the whole number that it goes by.

    Attributes:
        start: the first value.
        factor: between neighbouring values; 0: they are whole numbers, one apart.
        least: no value is below it.
        most: nor above it.
    """

    start: float
    factor: float = 10.0**0.5
    least: float = 0.0
    most: float = float("inf")

    def beside(self, value: float) -> list[float]:
        """The two neighbours of a value, where there are two."""
        pair = (value - 1.0, value + 1.0) if self.factor == 0.0 else (value / self.factor, value * self.factor)
        return [float(f"{of:.6g}") for of in pair if self.least <= of <= self.most]


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
        knobs: by name; none where nothing is to be chosen.
        after: the tracker whose choice is taken over, where they share settings; knobs are searched on from there.
    """

    track: Callable[[Part, Settings], Tracked]
    knobs: Mapping[str, Knob]
    after: str = ""


class Reported:
    """Rows as they come, with the time that passes."""

    def __init__(self) -> None:
        self._rows: list[tuple[str, int, float, float, float, float, float]] = []
        self._since = time.process_time()

    def add(self, name: str, time_ns: int, place: FloatArray, covariance: FloatArray | None = None) -> None:
        """One track at one instant."""
        (xx, xy), (_, yy) = np.full((2, 2), np.nan) if covariance is None else covariance
        self._rows.append((name, time_ns, *np.ravel(place)[:2].tolist(), float(xx), float(xy), float(yy)))

    def done(self) -> Tracked:
        """All rows."""
        seconds = time.process_time() - self._since
        names, times, *columns = zip(*self._rows, strict=True) if self._rows else ((),) * 7
        x, y, xx, xy, yy = (np.array(column, np.float64) for column in columns)
        rows = TrackedRows(
            track_id=np.array(names, np.str_), time_ns=np.array(times, np.int64), position=np.column_stack([x, y]),
            covariance=np.stack([xx, xy, xy, yy], axis=-1).reshape(-1, 2, 2),
        )  # fmt: skip
        return Tracked(rows, seconds)


# --- Ours ----------------------------------------------------------------------------------------------


def ours(fold: Fold, learned: PrimitiveMap) -> dict[str, Peer]:
    """Our tracker on the map, on that without its places, and on filterpy's Kalman filter of constant velocity.

    Where vehicles leave is what the map knows; without it how often they do is chosen, as others choose when to delete.
    """
    config = FilterConfig(noise_m=fold.noise_m, max_gap_s=fold.max_gap_s)

    def by_map(primitives: PrimitiveMap, part: Part, settings: Settings) -> Tracked:
        return _followed(part, primitives, config, replace(fold.tracking, **settings))

    def by_kalman(part: Part, settings: Settings) -> Tracked:
        model = ConstantVelocityKalman(acceleration_density=settings["acceleration"], config=config)
        tracking = replace(fold.tracking, departure_rate=settings["departure_rate"])
        return _followed(part, model, config, tracking)

    leaves = {"departure_rate": Knob(fold.tracking.departure_rate)}
    return {
        "ours, with the map": Peer(partial(by_map, learned), {}),
        "ours, without the map": Peer(partial(by_map, learned.without_places()), leaves),
        "ours, constant velocity": Peer(by_kalman, {"acceleration": Knob(1.0)} | leaves),
    }


def _followed(part: Part, model: PrimitiveMap | BayesFilter, config: FilterConfig, tracking: TrackingConfig) -> Tracked:
    tracker = Tracker(model, config=config, tracking=tracking, rng=np.random.default_rng(0))
    kept, since = EstimateList(), time.process_time()
    for time_ns, seen in part.frames():
        tracker.predict(seen, time_ns=time_ns)
        tracker.weigh()
        kept.write(tracker.frame())
        tracker.resample()
    return Tracked(TrackedRows.of(kept.all()), time.process_time() - since)


# --- Stone Soup ----------------------------------------------------------------------------------------

START = datetime(2026, 1, 1)
NS_PER_US = 1000


def stone_soup(fold: Fold) -> dict[str, Peer]:
    """Global nearest neighbour, joint probabilistic data association, and the Gaussian mixture PHD filter.

    Raises:
        UnavailableError: it is not installed.
    """
    try:
        import stonesoup  # noqa: F401
    except ImportError as error:
        raise UnavailableError("stonesoup is not installed: the extra `peers`") from error
    gate, deleted = Knob(4.0, 1.3), Knob(10.0, 1.5, 1.0)
    first = "Stone Soup GNN"
    return {
        first: Peer(
            partial(_by_association, fold, is_joint=False),
            {"acceleration": Knob(1.0), "gate": gate, "deleted_after": deleted, "confirmed_after": Knob(2.0, 0.0, 2.0)},
        ),
        "Stone Soup JPDA": Peer(
            partial(_by_association, fold, is_joint=True),
            {"gate": gate, "deleted_after": deleted, "widest": Knob(10.0, 2.0)}, after=first,
        ),
        "Stone Soup GM-PHD": Peer(
            partial(_by_phd, fold),
            {"gate": gate, "merged_below": Knob(8.0, 2.0), "pruned_below": Knob(1e-5, 1e2, most=1e-2)}, after=first,
        ),
    }  # fmt: skip


def _kalman(fold: Fold, acceleration: float) -> tuple[Any, Any, Any, Any]:
    """Stone Soup's predictor, updater and measurement of constant velocity, and the belief that a track starts from."""
    from stonesoup.models.measurement.linear import LinearGaussian
    from stonesoup.models.transition.linear import CombinedLinearGaussianTransitionModel, ConstantVelocity
    from stonesoup.predictor.kalman import KalmanPredictor
    from stonesoup.types.state import GaussianState
    from stonesoup.updater.kalman import KalmanUpdater

    motion = CombinedLinearGaussianTransitionModel([ConstantVelocity(acceleration), ConstantVelocity(acceleration)])
    measured = LinearGaussian(ndim_state=4, mapping=(0, 2), noise_covar=fold.noise_m**2 * np.eye(2))
    first = GaussianState(np.zeros((4, 1)), np.diag([0.0, START_SPEED_M_S**2] * 2), timestamp=START)
    return KalmanPredictor(motion), KalmanUpdater(measured), measured, first


def _stone_frames(part: Part, measured: Any) -> list[tuple[datetime, set[Any]]]:
    from stonesoup.models.measurement.linear import LinearGaussian
    from stonesoup.types.detection import Detection

    frames = []
    for time_ns, seen in part.frames():
        at = START + timedelta(microseconds=time_ns // NS_PER_US)
        by_row = [
            measured if np.isnan(own[0, 0]) else LinearGaussian(ndim_state=4, mapping=(0, 2), noise_covar=own)
            for own in seen.covariance
        ]
        frames.append(
            (
                at,
                {
                    Detection(place[:, None], timestamp=at, measurement_model=model)
                    for place, model in zip(seen.position, by_row, strict=True)
                },
            )
        )
    return frames


def _by_association(fold: Fold, part: Part, settings: Settings, *, is_joint: bool) -> Tracked:
    from stonesoup.dataassociator.neighbour import GNNWith2DAssignment
    from stonesoup.dataassociator.probability import JPDAwithEHM2
    from stonesoup.deleter.error import CovarianceBasedDeleter
    from stonesoup.deleter.multi import CompositeDeleter
    from stonesoup.deleter.time import UpdateTimeStepsDeleter
    from stonesoup.hypothesiser.distance import DistanceHypothesiser
    from stonesoup.hypothesiser.probability import PDAHypothesiser
    from stonesoup.initiator.simple import MultiMeasurementInitiator
    from stonesoup.measures import Mahalanobis
    from stonesoup.tracker.simple import MultiTargetMixtureTracker, MultiTargetTracker

    predictor, updater, measured, first = _kalman(fold, settings["acceleration"])
    nearest = GNNWith2DAssignment(
        DistanceHypothesiser(predictor, updater, measure=Mahalanobis(), missed_distance=settings["gate"])
    )
    initiator = MultiMeasurementInitiator(
        first, deleter=UpdateTimeStepsDeleter(2), data_associator=nearest, updater=updater, measurement_model=measured,
        min_points=round(settings["confirmed_after"]),
    )  # fmt: skip
    deleter = UpdateTimeStepsDeleter(round(settings["deleted_after"]))
    if is_joint:
        gate = float(-np.expm1(-0.5 * settings["gate"] ** 2))  # chi squared of two degrees of freedom
        likely = PDAHypothesiser(
            predictor, updater, clutter_spatial_density=fold.tracking.clutter_density,
            prob_detect=fold.tracking.detection_probability, prob_gate=min(gate, 1.0 - 1e-9),
        )  # fmt: skip
        wide = CovarianceBasedDeleter(2.0 * settings["widest"] ** 2, mapping=[0, 2])
        tracker = MultiTargetMixtureTracker(
            initiator, CompositeDeleter([deleter, wide], intersect=False), _stone_frames(part, measured),
            JPDAwithEHM2(likely), updater,
        )  # fmt: skip
    else:
        tracker = MultiTargetTracker(initiator, deleter, _stone_frames(part, measured), nearest, updater)
    return _listened(part, tracker)


def _by_phd(fold: Fold, part: Part, settings: Settings) -> Tracked:
    from stonesoup.hypothesiser.distance import DistanceHypothesiser
    from stonesoup.hypothesiser.gaussianmixture import GaussianMixtureHypothesiser
    from stonesoup.measures import Mahalanobis
    from stonesoup.mixturereducer.gaussianmixture import GaussianMixtureReducer
    from stonesoup.tracker.pointprocess import PointProcessMultiTargetTracker
    from stonesoup.types.state import TaggedWeightedGaussianState
    from stonesoup.updater.pointprocess import PHDUpdater

    predictor, updater, measured, _ = _kalman(fold, settings["acceleration"])
    told, low = fold.tracking, part.truth.position.min(axis=0)
    extent = np.ptp(part.truth.position, axis=0)
    middle, half = low + 0.5 * extent, 0.5 * extent
    born = TaggedWeightedGaussianState(
        np.array([[middle[0]], [0.0], [middle[1]], [0.0]]),
        np.diag([half[0] ** 2, START_SPEED_M_S**2, half[1] ** 2, START_SPEED_M_S**2]),
        weight=max(told.birth_density * float(np.prod(extent)), 1e-3), tag=TaggedWeightedGaussianState.BIRTH,
        timestamp=START,
    )  # fmt: skip
    near = DistanceHypothesiser(predictor, updater, measure=Mahalanobis(), missed_distance=settings["gate"])
    tracker = PointProcessMultiTargetTracker(
        detector=_stone_frames(part, measured), birth_component=born,
        hypothesiser=GaussianMixtureHypothesiser(near, order_by_detection=True),
        updater=PHDUpdater(
            updater, clutter_spatial_density=told.clutter_density, prob_detection=told.detection_probability,
            prob_survival=0.99,
        ),
        reducer=GaussianMixtureReducer(
            prune_threshold=settings["pruned_below"], merge_threshold=settings["merged_below"],
            max_number_components=100,
        ),
        extraction_threshold=0.9,
    )  # fmt: skip
    return _listened(part, tracker)


def _listened(part: Part, tracker: Iterable[tuple[datetime, set[Any]]]) -> Tracked:
    reported = Reported()
    for (time_ns, _), (_, tracks) in zip(part.frames(), tracker, strict=True):
        for track in tracks:
            state = track.state
            reported.add(track.id, time_ns, state.mean[[0, 2], 0], state.covar[np.ix_([0, 2], [0, 2])])
    return reported.done()


# --- motpy and norfair ---------------------------------------------------------------------------------


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

    knobs = {
        "acceleration": Knob(10.0), "box": Knob(4.0, 1.5), "deleted_after": Knob(10.0, 1.5, 1.0),
        "stale_share": Knob(1.0, 2.0), "confirmed_after": Knob(3.0, 0.0, 1.0),
    }  # fmt: skip
    return {"motpy": Peer(track, knobs)}


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
            part,
            dict(settings) | {"noise_m": fold.noise_m, "step_s": step_s_of(part), "speed_m_s": START_SPEED_M_S},
        )

    knobs = {
        "acceleration": Knob(10.0), "gate_m": Knob(4.0, 1.5), "deleted_after": Knob(10.0, 1.5, 3.0),
        "confirmed_after": Knob(2.0, 0.0, 0.0, 8.0),
    }  # fmt: skip
    return {"norfair": Peer(track, knobs)}


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
        given, told = (Path(self._folder.name) / name for name in ("given.npz", "told.npz"))
        frames = list(part.frames())
        np.savez(
            given, instants=np.array([time_ns for time_ns, _ in frames], np.int64),
            n_seen=np.array([len(seen) for _, seen in frames]),
            position=np.concatenate([np.empty((0, 2)), *(seen.position for _, seen in frames)]),
        )  # fmt: skip
        request = {"given": str(given), "told": str(told), "settings": settings}
        if self._process.stdin:
            print(json.dumps(request), file=self._process.stdin, flush=True)
        seconds = float(self._answer())
        with np.load(told) as found:
            rows = TrackedRows(
                track_id=found["track_id"], time_ns=found["time_ns"], position=found["position"].reshape(-1, 2)
            )
        return Tracked(rows, seconds)


PACKAGES: Sequence[Callable[[Fold], dict[str, Peer]]] = (stone_soup, motpy, norfair)
