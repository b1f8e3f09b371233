"""A sensor's errors from its own detections, without a truth: maximum likelihood over all ways that vehicles may go.

What differs from detection to detection is seen; what moves all detections of a vehicle alike is not: a bias, a
latency, an error that outlasts the pieces of track that are looked at.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from scipy.optimize import minimize

from dirprim_filter.arrays import FloatArray
from dirprim_filter.detections import NO_ID, Detections
from dirprim_filter.evaluation.calibration.evidence import LASTS, SHARE, SPREAD, log_evidence
from dirprim_filter.evaluation.calibration.pieces import Pieces, pieces_of
from dirprim_filter.sensor import WIDE, AxisError, Sensor

MOST_PIECES, FEWEST_PIECES = 400, 8
LONGEST_LASTING_S = 2.0
"""Errors that last longer cannot be told from a vehicle's own way within a piece."""
LEAST_SHARE = 0.1
"""Of the variance; a smaller share that lasts is no finding."""
LEAST_GAIN = 4.6
"""Nat: a hundredth of logs without errors that last gain so much by the two parameters of some (Wilks 1938)."""
LEAST_WHITE = 0.01
"""Of the variance; detections with less of it are smooth as ways are: a filter ran over them."""
SMOOTH = Sensor(
    along=AxisError(spread_m=0.2), across=AxisError(spread_m=0.2),
    uncertainty={"along.bias_m": 0.5 * WIDE, "across.bias_m": 0.5 * WIDE, "latency_s": 0.1 * WIDE},
)  # fmt: skip
"""Of detections that a filter ran over: little noise, half a metre of bias and a tenth of a second of latency. On
Mcity's drives NEES is then 2.0, and was 12.8 with 0.5 m of white noise (`tests/benchmarks/real_sensors.py mcity`)."""
START = np.array([math.log(0.5), 0.0, math.log(0.5), 0.0, math.log(1.5), 0.7])
RANGE: tuple[tuple[float, float], ...] = (
    (-4.0, 2.0), (-5.0, 5.0), (math.log(0.05), math.log(LONGEST_LASTING_S)), (-4.0, 2.0), (0.0, 1.5), (0.05, 1.5),
)  # fmt: skip
"""Of each parameter; drivers hold an acceleration for a second or longer."""
MOST_STEPS = 80


@dataclass(frozen=True, slots=True, kw_only=True)
class SelfCalibration:
    """What was learned.

    Attributes:
        sensor: the errors, without bias and latency.
        n_pieces: pieces of track that they were learned from.
        n_detections: in them.
        unknown: what cannot be seen without a truth, and why.
    """

    sensor: Sensor
    n_pieces: int
    n_detections: int
    unknown: tuple[str, ...]


def self_calibrate(detections: Detections, *, rng: np.random.Generator) -> SelfCalibration:
    """Learn how a sensor errs from what it reports of vehicles in motion.

    Args:
        detections: with ids: of a few minutes.
        rng: which pieces of track are looked at, where there are many.

    Raises:
        ValueError: detections have no ids, or too few are of vehicles in motion.
    """
    named = detections[detections.track_id != NO_ID]
    if len(named) == 0:
        raise ValueError("expected detections with ids, to learn from how the same vehicle is seen again; got none")
    pieces = pieces_of(named, n_most=MOST_PIECES, rng=rng)
    n = pieces.length.size
    errors = [_likeliest_error(pieces, position) for position in (pieces.along, pieces.across)] if n else []
    if any(of[SHARE] > np.log(1.0 / LEAST_WHITE - 1.0) for of in errors):
        return SelfCalibration(
            sensor=SMOOTH, n_pieces=n, n_detections=int(pieces.length.sum()),
            unknown=(
                "all errors: these detections are as smooth as ways are, as a filter leaves them; bias and latency are "
                "taken to be of usual sizes, and are in every covariance",
            ),
        )  # fmt: skip
    if n < FEWEST_PIECES:
        raise ValueError(
            f"expected at least {FEWEST_PIECES} pieces of track of moving vehicles, got {n}: state the noise, or "
            "calibrate the sensor against a truth"
        )
    along, across = errors
    too_long = [name for name, at in (("along", along), ("across", across)) if _lasts_too_long(at)]
    return SelfCalibration(
        sensor=Sensor(along=_axis(along), across=_axis(across)),
        n_pieces=n, n_detections=int(pieces.length.sum()),
        unknown=(
            "latency_s, along.bias_m, across.bias_m: detections that are all late or off look as if vehicles were "
            "there, and no covariance of an estimate contains that",
            "detection_probability, clutter_density, outlier_share: a truth is needed to count them",
            *(f"{name}: errors that last {LONGEST_LASTING_S:g} s or longer look like the vehicle's own way"
              for name in too_long),
        ),
    )  # fmt: skip


def _likeliest_error(pieces: Pieces, position: FloatArray) -> FloatArray:
    """The likeliest parameters of one axis; that errors last must be likelier by `LEAST_GAIN` than that they do not."""
    found, log_p = likeliest(pieces, position)
    if found[SHARE] < np.log(LEAST_SHARE / (1.0 - LEAST_SHARE)):
        return found
    white, log_p_white = likeliest(pieces, position, start=found, white=True)
    return white if log_p - log_p_white < LEAST_GAIN else found


def likeliest(
    pieces: Pieces, position: FloatArray, *, start: FloatArray = START, white: bool = False
) -> tuple[FloatArray, float]:
    """The parameters of one axis, and the natural log of the density; of white errors, if wished."""
    bounds = [*RANGE]
    if white:
        bounds[SHARE] = bounds[SHARE][0], bounds[SHARE][0]
    n = pieces.length.size

    def cost(parameters: FloatArray) -> float:
        return -log_evidence(pieces.step_s, position, pieces.length, parameters) / n

    found = minimize(
        cost, start, method="L-BFGS-B", bounds=bounds, options={"maxiter": MOST_STEPS, "ftol": 1e-8, "eps": 1e-5}
    )
    return np.asarray(found.x, np.float64), -n * float(found.fun)


def _axis(at: FloatArray) -> AxisError:
    spread, share, lasts_s = float(np.exp(at[SPREAD])), float(1.0 / (1.0 + np.exp(-at[SHARE]))), np.exp(at[LASTS])
    if _lasts_too_long(at):
        return AxisError(spread_m=spread * float(np.sqrt(1.0 - share)))
    if share < LEAST_SHARE:
        return AxisError(spread_m=spread)
    return AxisError(spread_m=spread, correlated_share=share, correlation_s=float(lasts_s))


def _lasts_too_long(at: FloatArray) -> bool:
    return bool(np.exp(at[LASTS]) > 0.98 * LONGEST_LASTING_S and at[SHARE] > np.log(LEAST_SHARE / (1.0 - LEAST_SHARE)))
