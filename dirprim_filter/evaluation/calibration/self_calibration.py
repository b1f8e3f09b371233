"""A sensor's errors from its own detections, without a truth: maximum likelihood over all ways that vehicles may go.

What differs from detection to detection is seen; what moves all detections of a vehicle alike is not: a bias, a
latency, an error that outlasts the pieces of track that are looked at. Pieces of the tracks of moving vehicles are
unrolled along smooth ways. Along the way, and across it, the error is a first-order Gauss-Markov process and white
noise, as in `Sensor`; the vehicle's acceleration is another such process. How hard a driver accelerates differs from
piece to piece: the likelihood is the mean over that, for if each piece took the size that suits it best, motion would
explain a part of the errors. A Kalman filter of place, speed, acceleration and lasting error computes it.

Detections without ids are tracked first, see `own_tracks`.

Source: Singer, Estimating Optimal Tracking Filter Performance for Manned Maneuvering Targets, 1970, for the
acceleration; Schweppe, Evaluation of likelihood functions for Gaussian signals, 1965.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from functools import partial
from typing import TYPE_CHECKING, NamedTuple

import numpy as np
from scipy.optimize import minimize
from scipy.special import logsumexp

from dirprim_filter.arrays import BoolArray, FloatArray, IntArray
from dirprim_filter.course import MOVING_FROM, motion_of
from dirprim_filter.detections import NO_ID, Detections
from dirprim_filter.evaluation.calibration._kernels import misfits
from dirprim_filter.sensor import WIDE, AxisError, Sensor
from dirprim_filter.track_ids import vehicle_numbers

if TYPE_CHECKING:
    from dirprim_filter.evaluation.calibration.own_tracks import OwnTracks

SPREAD, SHARE, LASTS, SIZE, HOLDS, DIFFER = range(6)
"""Parameters: of the error log standard deviation, logit of the share that lasts, log seconds that it lasts; of the
acceleration log standard deviation, log seconds, and standard deviation of the log between pieces."""
ANYWHERE, ANY_SPEED = 1e4, 1e3
"""Variances, m^2 and (m/s)^2, of a place and a speed that are not known."""
NODES, WEIGHTS = np.polynomial.hermite_e.hermegauss(5)
LONGEST, FEWEST = 50, 12
"""Detections of a piece."""
LEAST_STEP_S = 0.09
"""Detections nearer in time are passed over: pieces would be too short to separate errors that last from white ones."""
LONGEST_PAUSE_S = 1.0
BEND_S, MOST_BENDS = 1.6, 3
"""Seconds of a piece for each degree of the polynomial in time whose course it is unrolled by, and the highest degree:
of short pieces a course that bends would follow the errors that last."""
STRAYS = 6.0
"""Robust standard deviations from the middle of its neighbours, from which on a detection is left out."""
MAD = 1.4826
MOST_PIECES, FEWEST_PIECES, FEWEST_ROWS, LONGEST_GAP_S = 400, 8, 100, 1800.0
LONGEST_LASTING_S = 2.0
"""Errors that last longer cannot be separated from a vehicle's own path within a piece."""
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
Mcity's drives NEES is then 2.0, and was 12.8 with 0.5 m of white noise."""
START = np.array([math.log(0.5), 0.0, math.log(0.5), 0.0, math.log(1.5), 0.7])
RANGE: tuple[tuple[float, float], ...] = (
    (-4.0, math.log(1e3)), (-5.0, 5.0), (math.log(0.05), math.log(LONGEST_LASTING_S)),
    (-4.0, 2.0), (0.0, 1.5), (0.05, 1.5),
)  # fmt: skip
"""Of each parameter; drivers hold an acceleration for a second or longer."""
MOST_STEPS = 80
UNSEEN = (
    "latency_s, along.bias_m, across.bias_m: detections that are all late or off look as if vehicles were there, and "
    "no covariance of an estimate contains that"
)


@dataclass(frozen=True, slots=True, kw_only=True)
class SelfCalibration:
    """What was learned.

    Attributes:
        sensor: the errors, without bias and latency.
        n_pieces: pieces of track that they were learned from.
        n_detections: in them.
        unknown: what cannot be seen without a truth, and why.
        tracks: of detections without ids; None with ids.
    """

    sensor: Sensor
    n_pieces: int
    n_detections: int
    unknown: tuple[str, ...]
    tracks: OwnTracks | None = None


def self_calibrate(detections: Detections, *, rng: np.random.Generator) -> SelfCalibration:
    """Learn how a sensor errs from what it reports of vehicles in motion; without ids also misses, clutter and births.

    Args:
        detections: of a few minutes. If none has an id they are tracked, else those that have one count.
        rng: which pieces of track are looked at, where there are many.

    Raises:
        ValueError: the few detections with ids show no noise, or nothing can be tracked.
    """
    named = detections[detections.track_id != NO_ID]
    if len(named):
        found = _of_pieces(pieces_of(named, n_most=MOST_PIECES, rng=rng)) or _of_rows(named)
        uncounted = "detection_probability, clutter_density, outlier_share: a truth is needed to count them"
        return replace(found, unknown=(*found.unknown, uncounted))
    from dirprim_filter.evaluation.calibration.own_tracks import own_tracks  # noqa: PLC0415 - ids do without a tracker

    tracks = own_tracks(detections)
    seen = tracks.seen[tracks.seen.track_id != NO_ID]
    white = SelfCalibration(
        sensor=Sensor.white(tracks.noise.value), n_pieces=0, n_detections=len(seen), unknown=(UNSEEN,)
    )
    found = _of_pieces(pieces_of(seen, n_most=MOST_PIECES, rng=rng)) or white
    counted = {name: getattr(tracks, name) for name in ("detection_probability", "clutter_density")}
    uncertainty = {name: WIDE * number.error for name, number in counted.items()}
    sensor = replace(
        found.sensor, **{name: number.value for name, number in counted.items()},
        uncertainty={**found.sensor.uncertainty, **uncertainty},
    )  # fmt: skip
    return replace(found, sensor=sensor, tracks=tracks)


def _of_rows(named: Detections) -> SelfCalibration:
    """White noise alone, of few vehicles or rows that come seldom: what a smoother of constant velocity leaves.

    Raises:
        ValueError: there are too few rows, or too little of it to be told from turning and braking.
    """
    vehicle = vehicle_numbers(named.track_id, named.group)
    motion = motion_of(vehicle, named.time_ns, named.position, longest_gap_s=LONGEST_GAP_S)
    if len(named) < FEWEST_ROWS or not motion.noise > SMOOTH.along.spread_m:
        raise ValueError(
            f"expected at least {FEWEST_PIECES} pieces of track of moving vehicles, of {FEWEST} detections each: state "
            "the noise, or calibrate the sensor against a truth"
        )
    few = "correlated_share: rows of so few vehicles, or so seldom ones, do not show what lasts of errors"
    return SelfCalibration(
        sensor=Sensor.white(motion.noise), n_pieces=np.unique(vehicle).size, n_detections=len(named),
        unknown=(UNSEEN, few),
    )  # fmt: skip


def _of_pieces(pieces: Pieces) -> SelfCalibration | None:
    """The errors in these pieces of track; None if there are too few."""
    n = pieces.length.size
    errors = [_likeliest_error(pieces, position) for position in (pieces.along, pieces.across)] if n else []
    found = partial(SelfCalibration, n_pieces=n, n_detections=int(pieces.length.sum()))
    if any(of[SHARE] > np.log(1.0 / LEAST_WHITE - 1.0) for of in errors):
        unknown = (
            "all errors: these detections are as smooth as ways are, as a filter leaves them; bias and latency are "
            "taken to be of usual sizes, and are in every covariance"
        )
        return found(sensor=SMOOTH, unknown=(unknown,))
    if n < FEWEST_PIECES:
        return None
    along, across = errors
    too_long = [name for name, at in (("along", along), ("across", across)) if _lasts_too_long(at)]
    return found(
        sensor=Sensor(along=_axis(along), across=_axis(across)),
        unknown=(
            UNSEEN,
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


class Pieces(NamedTuple):
    """Detections of vehicles in motion. (w, n) pieces, the longest first, padded where they are shorter.

    Attributes:
        step_s: (w, n) seconds since the row before.
        along: (w, n) metres along the course from the first row.
        across: (w, n) metres across it, to the left.
        length: (w,) rows.
    """

    step_s: FloatArray
    along: FloatArray
    across: FloatArray
    length: IntArray


def pieces_of(named: Detections, *, n_most: int, rng: np.random.Generator) -> Pieces:
    """At most so many pieces, drawn from all that there are.

    Args:
        named: detections with ids.
        n_most: how many.
        rng: which.
    """
    vehicle = vehicle_numbers(named.track_id, named.group)
    order = np.lexsort((named.time_ns, vehicle))
    vehicle, time_s, place = vehicle[order], (named.time_ns[order] - named.time_ns.min()) * 1e-9, named.position[order]
    slot = np.floor(time_s / LEAST_STEP_S)
    kept = (np.diff(slot, prepend=-1.0) != 0) | (np.diff(vehicle, prepend=-1) != 0)
    vehicle, time_s, place = vehicle[kept], time_s[kept], place[kept]
    kept = ~_strays(vehicle, time_s, place)
    vehicle, time_s, place = vehicle[kept], time_s[kept], place[kept]
    begins = np.flatnonzero((np.diff(vehicle, prepend=-1) != 0) | (np.diff(time_s, prepend=-np.inf) > LONGEST_PAUSE_S))
    cuts = [np.arange(start, end, LONGEST) for start, end in zip(begins, [*begins[1:], time_s.size], strict=True)]
    rows = np.split(np.arange(time_s.size), np.concatenate(cuts)[1:])
    unrolled = [_unrolled(time_s[of], place[of]) for of in rows if of.size >= FEWEST]
    found = [of for of in unrolled if of is not None]
    chosen = sorted((found[i] for i in rng.permutation(len(found))[:n_most]), key=len, reverse=True)
    columns = np.zeros((3, len(chosen), LONGEST))
    for i, of in enumerate(chosen):
        columns[:, i, : len(of)] = of.T
    return Pieces(columns[0], columns[1], columns[2], np.array([len(of) for of in chosen], np.int64))


def _strays(vehicle: IntArray, time_s: FloatArray, place: FloatArray) -> BoolArray:
    """(n,) detections far from where their neighbours in time put them; the worst of three, as one moves the others."""
    before, after = time_s[1:-1] - time_s[:-2], time_s[2:] - time_s[1:-1]
    inner = (vehicle[2:] == vehicle[:-2]) & (before + after <= 2.0 * LONGEST_PAUSE_S)
    share = (after / np.where(inner, before + after, np.inf))[:, None]
    off = np.zeros(time_s.size)
    off[1:-1] = np.where(inner, np.hypot(*(place[1:-1] - share * place[:-2] - (1.0 - share) * place[2:]).T), 0.0)
    usual = MAD * float(np.median(off[1:-1][inner])) if inner.any() else 0.0
    around = np.maximum(np.append(off[1:], 0.0), np.append(0.0, off[:-1]))
    return np.asarray((off > STRAYS * max(usual, 1e-3)) & (off >= around))


def _unrolled(time_s: FloatArray, place: FloatArray) -> FloatArray | None:
    """(n, 3) steps in seconds, metres along and across: steps turned by the smooth way's course; None if it stands."""
    middle = 0.5 * (time_s[0] + time_s[-1])
    degree = int(np.clip(round((time_s[-1] - time_s[0]) / BEND_S), 1, MOST_BENDS))
    way = np.polynomial.polynomial.polyfit(time_s - middle, place, degree)
    slope = np.polynomial.polynomial.polyder(way)
    between = 0.5 * (time_s[1:] + time_s[:-1]) - middle
    velocity = np.polynomial.polynomial.polyval(between, slope).T
    speed = np.hypot(*velocity.T)
    if speed.min() < MOVING_FROM:
        return None
    unit, moved = velocity / speed[:, None], np.diff(place, axis=0)
    along, across = (moved * unit).sum(axis=1), unit[:, 0] * moved[:, 1] - unit[:, 1] * moved[:, 0]
    steps = np.column_stack([np.diff(time_s), np.cumsum(along), np.cumsum(across)])
    return np.concatenate([np.zeros((1, 3)), steps])


def log_evidence(step_s: FloatArray, position: FloatArray, length: IntArray, parameters: FloatArray) -> float:
    """Natural log of the density of all pieces, along one axis.

    Args:
        step_s: (w, n) seconds since the row before.
        position: (w, n) metres.
        length: (w,) rows of each piece, descending.
        parameters: (6,) as named above.
    """
    variance, share = np.exp(2.0 * parameters[SPREAD]), 1.0 / (1.0 + np.exp(-parameters[SHARE]))
    lasting, white = variance * share, variance * (1.0 - share)
    moving = np.exp(2.0 * (parameters[SIZE] + parameters[DIFFER] * NODES))
    held, kept = (np.ascontiguousarray(np.exp(-step_s / np.exp(parameters[of])).T) for of in (HOLDS, LASTS))
    start = np.column_stack(np.broadcast_arrays(ANYWHERE, ANY_SPEED, moving, lasting))
    shape = (position.shape[1], NODES.size, length.size)
    off, spread = np.zeros(shape), np.full(shape, 1.0 / (2.0 * np.pi))  # of a row that is not there 0 is subtracted
    columns = (np.ascontiguousarray(of.T) for of in (step_s, position))
    misfits(*columns, length, held, kept, start, white, off, spread)
    log_p = -(0.5 * (off**2 / spread + np.log(2.0 * np.pi * spread))).sum(axis=0)
    return float(logsumexp(log_p, axis=0, b=(WEIGHTS / WEIGHTS.sum())[:, None]).sum())
