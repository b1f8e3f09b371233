"""A sensor's model from its own detections, without a truth: maximum likelihood over all ways that vehicles may go.

What differs from detection to detection is seen; what moves all detections of a vehicle alike is not: a bias, a
latency, an error that outlasts the pieces of track that are looked at.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from scipy.optimize import minimize

from dirprim_filter.arrays import FloatArray
from dirprim_filter.course import motion_of
from dirprim_filter.detections import NO_ID, Detections
from dirprim_filter.evaluation.calibration import reports
from dirprim_filter.evaluation.calibration.blindness import Surveyed, between_detections, clearly_seen, learn_sight
from dirprim_filter.evaluation.calibration.evidence import SHARE, log_evidence
from dirprim_filter.evaluation.calibration.pairing import frames_of
from dirprim_filter.evaluation.calibration.windows import (
    LONGEST_PAUSE_S,
    Windows,
    windows_of,
    without_strays,
)
from dirprim_filter.sensor import AxisError, Sensor
from dirprim_filter.sight import Sight
from dirprim_filter.track_ids import vehicle_numbers

MOST_WINDOWS = 400
FEWEST_WINDOWS = 8
LONGEST_LASTING_S = 2.0
"""Errors that last longer cannot be told from a vehicle's own way within a window."""
LONGEST_PAUSE = 10.5
"""Frames: in so many in a row a vehicle is missed by chance; in more it is hidden. At least `LONGEST_PAUSE_S`."""
LEAST_SHARE = 0.1
"""Of the variance; a smaller share that lasts is no finding."""
LEAST_GAIN = 4.6
"""Nat: a hundredth of logs without errors that last gain so much by the two parameters of some (Wilks 1938)."""
LEAST_WHITE = 0.01
"""Of the variance; detections with less of it are smooth as ways are: a filter ran over them."""
FIRST_ERROR = (np.log(0.5), 0.0, np.log(0.5))
FIRST_ACCELERATION = (0.0, np.log(1.5))
ERROR_RANGE = ((-4.0, 2.0), (-5.0, 5.0), (np.log(0.05), np.log(LONGEST_LASTING_S)))
ACCELERATION_RANGE = ((-4.0, 2.0), (0.0, 1.5))
"""Of log m/s^2 and log seconds: drivers hold an acceleration for a second or longer."""
DRIVERS_DIFFER, DIFFERENCE_RANGE = 0.7, (0.05, 1.5)
"""Standard deviation of the log of a window's acceleration: one drives straight on, another brakes and turns."""
MOST_STEPS = 80


@dataclass(frozen=True, slots=True, kw_only=True)
class SelfCalibration:
    """What was learned.

    Attributes:
        sensor: the model, without bias and latency.
        n_windows: pieces of track that the errors were learned from.
        n_detections: in them.
        unknown: what cannot be seen without a truth, and why.
    """

    sensor: Sensor
    n_windows: int
    n_detections: int
    unknown: tuple[str, ...]


def self_calibrate(detections: Detections, *, rng: np.random.Generator) -> SelfCalibration:
    """Learn how a sensor errs from what it reports of vehicles in motion.

    Args:
        detections: with ids: of a few minutes.
        rng: which pieces of track are looked at, where there are many.

    Raises:
        ValueError: detections have no ids, too few are of vehicles in motion, or they are as smooth as ways are.
    """
    named = detections[detections.track_id != NO_ID]
    if len(named) == 0:
        raise ValueError("expected detections with ids, to learn from how the same vehicle is seen again; got none")
    usual, n_stray, n_judged = without_strays(named)
    windows = windows_of(usual, n_most=MOST_WINDOWS, rng=rng)
    n_windows = windows.known.shape[0]
    if n_windows < FEWEST_WINDOWS:
        raise ValueError(
            f"expected at least {FEWEST_WINDOWS} pieces of track of moving vehicles, got {n_windows}: state the noise, "
            "or calibrate the sensor against a truth"
        )
    along, across, lasting = _errors(windows)
    reported = _reported(named)
    unknown = [
        "latency_s, along.bias_m, across.bias_m: detections that are all late or off look as if vehicles were there",
        *lasting, *reported.why,
    ]  # fmt: skip
    return SelfCalibration(
        sensor=Sensor(
            along=along, across=across, detection_probability=reported.detection_probability,
            clutter_density=reported.clutter_density, sight=reported.sight,
            outlier_share=reports.share(n_stray, n_judged).value if n_stray else None,
        ),
        n_windows=n_windows, n_detections=int(windows.known.sum()), unknown=tuple(unknown),
    )  # fmt: skip


def _errors(windows: Windows) -> tuple[AxisError, AxisError, list[str]]:
    """The likeliest errors along and across, and where they last too long to be seen.

    That errors of an axis last must be likelier by `LEAST_GAIN` than that they do not.
    """
    first = (*FIRST_ERROR, *FIRST_ERROR, *FIRST_ACCELERATION, *FIRST_ACCELERATION, DRIVERS_DIFFER)
    found, log_p = _likeliest(windows, np.array(first))
    for share in (SHARE, 3 + SHARE):
        if found[share] > np.log(LEAST_SHARE / (1.0 - LEAST_SHARE)):
            white, log_p_white = _likeliest(windows, found, white=share)
            if log_p - log_p_white < LEAST_GAIN:
                found, log_p = white, log_p_white
    if max(found[1], found[4]) > np.log(1.0 / LEAST_WHITE - 1.0):
        raise ValueError(
            "expected detections that scatter, got such as smooth as ways are, as a filter leaves them: their errors "
            "cannot be told from motion; state the noise, or calibrate the sensor against a truth"
        )
    along, across = _axis(found[:3]), _axis(found[3:6])
    lines = [
        f"{name}: errors that last {LONGEST_LASTING_S:g} s or longer look like the vehicle's own way"
        for name, at in (("along", found[:3]), ("across", found[3:6]))
        if _lasts_too_long(at)
    ]
    return along, across, lines


def _likeliest(windows: Windows, start: FloatArray, *, white: int | None = None) -> tuple[FloatArray, float]:
    """The parameters, and the natural log of the density; of one axis, if its share is given, errors do not last."""
    bounds: list[tuple[float, float]] = [
        *ERROR_RANGE,
        *ERROR_RANGE,
        *ACCELERATION_RANGE,
        *ACCELERATION_RANGE,
        DIFFERENCE_RANGE,
    ]
    if white is not None:
        bounds[white] = (bounds[white][0], bounds[white][0])
    n = len(windows.known)

    def cost(parameters: FloatArray) -> float:
        return -log_evidence(windows, parameters) / n

    found = minimize(
        cost, start, method="L-BFGS-B", bounds=bounds, options={"maxiter": MOST_STEPS, "ftol": 1e-8, "eps": 1e-5}
    )
    return np.asarray(found.x, np.float64), -n * float(found.fun)


def _axis(at: FloatArray) -> AxisError:
    spread, lasting, time_s = np.exp(at[0]), 1.0 / (1.0 + np.exp(-at[1])), np.exp(at[2])
    if _lasts_too_long(at):
        return AxisError(spread_m=float(spread * np.sqrt(1.0 - lasting)))
    if lasting < LEAST_SHARE:
        return AxisError(spread_m=float(spread))
    return AxisError(spread_m=float(spread), correlated_share=float(lasting), correlation_s=float(time_s))


def _lasts_too_long(at: FloatArray) -> bool:
    return bool(np.exp(at[2]) > 0.98 * LONGEST_LASTING_S and at[1] > np.log(LEAST_SHARE / (1.0 - LEAST_SHARE)))


class _Reported(NamedTuple):
    """How often and where vehicles are reported; None where it is not known, and why."""

    detection_probability: float | None
    clutter_density: float | None
    sight: Sight | None
    why: tuple[str, ...] = ()


def _reported(named: Detections) -> _Reported:
    frames = frames_of(named)
    number = {key: i for i, key in enumerate(map(tuple, frames.tolist()))}
    frame = np.array([number[key] for key in zip(named.group.tolist(), named.time_ns.tolist(), strict=True)], np.int64)
    vehicle = vehicle_numbers(named.track_id, named.group)
    order = np.lexsort((frame, vehicle))
    steps = np.diff(frame[order])[np.diff(vehicle[order]) == 0]
    if steps.size == 0 or np.median(steps) > 1:
        why = "frames are not of all vehicles, so none says that one was missed"
        return _Reported(None, None, None, (f"detection_probability, clutter_density, sight: {why}",))
    motion = motion_of(vehicle, named.time_ns, named.position)
    velocity = motion.speed[:, None] * np.column_stack([np.cos(motion.direction), np.sin(motion.direction)])
    frame_s: FloatArray = np.asarray(frames[:, 1] * 1e-9, np.float64)
    passages, gap_s = between_detections(vehicle, frame, named.position, velocity, frame_s)
    sight = learn_sight(passages)
    by_chance = gap_s <= max(LONGEST_PAUSE_S, LONGEST_PAUSE * float(np.median(np.diff(frame_s))))
    usual = passages[by_chance & clearly_seen(sight, passages.position)]
    first = np.unique(vehicle).size  # they are where they are because they were seen
    is_single = np.bincount(vehicle)[vehicle] == 1
    place = named.position[~is_single]
    surveyed = Surveyed(sight, place, place.min(axis=0), place.max(axis=0))
    n_false = int((is_single & surveyed.contains(named.position)).sum())
    return _Reported(
        reports.share(int(usual.is_hit.sum()) - first, usual.is_hit.size - first).value,
        (n_false + 0.5) / (surveyed.area * len(frames)), sight,
    )  # fmt: skip
