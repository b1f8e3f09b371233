"""A sensor's model, measured against the truth."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np
from scipy.spatial import KDTree

from dirprim_filter.arrays import BoolArray, FloatArray, IntArray
from dirprim_filter.course import MOVING_FROM
from dirprim_filter.detections import Detections
from dirprim_filter.evaluation.calibration.gauss_markov import ErrorFit, fit_errors
from dirprim_filter.evaluation.calibration.pairing import APART_M, Scene, TruthRows, find_lag
from dirprim_filter.filtering.association import Pairs
from dirprim_filter.sensor import WIDE, AxisError, Sensor
from dirprim_filter.track_ids import as_texts
from dirprim_filter.tracks import Tracks

LATENCY_S = (0.0, 1.0)
"""A lag between these is a sensor's; any other is of the clocks."""
MOST_MOVED_S = 0.5
"""By which a round of matching and measuring may move the lag."""
LEAST_SPREAD = 0.05
"""Of speeds, over their mean, from which on the error's slope over speed is looked at."""
GATES_M = (2.0, 8.0)
GATE_SPREADS = 6.0
"""So many spreads from the truth a detection is of something else, between `GATES_M`."""
FEWEST = 30
"""Pairs of detections and true positions."""
LATENCY_KNOWN_S = 0.15
"""Standard error of a latency beyond which it and the bias along the course cannot be separated."""
OUTLIER = 8.0
"""Robust standard deviations from which on an error is none of the sensor's usual ones."""
MAD = 1.4826
"""From the median absolute deviation to a Gaussian's standard deviation."""
FEWEST_FRAMES = 30
"""Fewest frames in which a vehicle may be seen or missed, of all vehicles together."""
FASTEST = 20.0
"""m/s: a stray detection continues in the next frame if one is within the distance of this speed."""
GOING_ON = 0.3
"""Share of stray detections that continue in the next frame beyond chance, above which they are of vehicles."""


class Measured(NamedTuple):
    """A number and its standard error."""

    value: float
    error: float


@dataclass(frozen=True, slots=True, kw_only=True)
class Errors:
    """The usual errors of pairs of moving vehicles. (n,) rows, vehicle after vehicle, ascending in time.

    Attributes:
        time_s: seconds.
        is_first: where a vehicle's begin.
        speed: m/s, true.
        along: metres, from the truth at the time less the lag.
        across: likewise.
        n_outliers: errors that are not among them.
    """

    time_s: FloatArray
    is_first: BoolArray
    speed: FloatArray
    along: FloatArray
    across: FloatArray
    n_outliers: int

    def fit(self, error: FloatArray, *, with_speed: bool = False) -> ErrorFit:
        """Of one axis: a bias, and if wished a coefficient of -speed: seconds by which the lag is too small."""
        columns = [np.ones(self.speed.size), -self.speed]
        return fit_errors(error, np.column_stack(columns[: 1 + with_speed]), self.time_s, self.is_first)


@dataclass(frozen=True, slots=True, kw_only=True)
class Calibration:
    """What was measured.

    Attributes:
        sensor: the model.
        clock_offset_s: seconds by which the sensor's clock is ahead of the truth's, as far as that is no latency.
        n_detections: all.
        n_pairs: of them, those of true vehicles.
        n_vehicles: true vehicles that were detected.
        unknown: what the data do not determine, and why.
    """

    sensor: Sensor
    clock_offset_s: float
    n_detections: int
    n_pairs: int
    n_vehicles: int
    unknown: tuple[str, ...]


def calibrate(detections: Detections, truth: Tracks) -> Calibration:
    """Measure a sensor against the truth.

    Args:
        detections: what it reported.
        truth: where vehicles were, on the same plane; not all need be in it.

    Raises:
        ValueError: truth and detections have no time or no vehicle in common, or there are too few pairs.
    """
    scene = Scene(detections, truth)
    lag_s, gate_m = find_lag(scene), GATES_M[1]
    for last in (False, False, True):
        rows = scene.truth_at(lag_s)
        pairs = scene.matched(rows, gate_m=gate_m)
        errors = _errors(scene, rows, pairs)
        n = errors.time_s.size
        if n < FEWEST:
            raise ValueError(
                f"truth: expected at least {FEWEST} detections of moving vehicles in it, got {n}: is it of this place "
                "and time?"
            )
        if not last:
            moved, spread = _by_least_squares(errors)
            lag_s, gate_m = lag_s + moved, float(np.clip(GATE_SPREADS * spread, *GATES_M))
    across, along = errors.fit(errors.across), errors.fit(errors.along, with_speed=True)
    unknown: list[str] = []
    found = _reports(scene, rows, pairs, errors, unknown)
    clock_offset_s = 0.0
    if along.mean_se[1] > LATENCY_KNOWN_S:  # the bias takes it up
        along, clock_offset_s = errors.fit(errors.along), lag_s
        unknown.append("latency_s: vehicles drive too alike; it is in along.bias_m, which holds at their speed")
    else:
        lag_s += float(along.mean[1])
        if LATENCY_S[0] - WIDE * along.mean_se[1] <= lag_s < LATENCY_S[1]:
            found["latency_s"] = Measured(max(lag_s, 0.0), float(along.mean_se[1]))
        else:
            clock_offset_s = lag_s
            unknown.append("latency_s: the clocks differ, and latency cannot be separated from their difference")
    return Calibration(
        sensor=_sensor(found, {"along": along, "across": across}), clock_offset_s=clock_offset_s,
        n_detections=len(detections), n_pairs=int(pairs.one.size),
        n_vehicles=int(np.unique(rows.vehicle[pairs.one]).size), unknown=tuple(unknown),
    )  # fmt: skip


def _errors(scene: Scene, rows: TruthRows, pairs: Pairs) -> Errors:
    order = np.lexsort((rows.frame[pairs.one], rows.vehicle[pairs.one]))
    order = order[rows.speed[pairs.one[order]] >= MOVING_FROM]
    row = pairs.one[order]
    error, course = scene.detections.position[pairs.other[order]] - rows.position[row], rows.course[row]
    along = (error * course).sum(axis=1)
    across = course[:, 0] * error[:, 1] - course[:, 1] * error[:, 0]
    usual = _within(along) & _within(across)
    row = row[usual]
    return Errors(
        time_s=scene.frame_s[rows.frame[row]], is_first=np.diff(rows.vehicle[row], prepend=-1) != 0,
        speed=rows.speed[row], along=along[usual], across=across[usual], n_outliers=int((~usual).sum()),
    )  # fmt: skip


def _within(error: FloatArray) -> BoolArray:
    off = np.abs(error - np.median(error)) if error.size else error
    return np.asarray(off <= OUTLIER * MAD * max(float(np.median(off)), 1e-3)) if error.size else np.ones(0, np.bool_)


def _by_least_squares(errors: Errors) -> tuple[float, float]:
    """By how much the lag is wrong, seconds, and the larger spread of both axes, metres."""
    slope = np.column_stack([np.ones(errors.speed.size), -errors.speed])
    found = np.linalg.lstsq(slope, errors.along, rcond=None)[0]
    differ = errors.speed.std() > LEAST_SPREAD * errors.speed.mean()
    moved = float(np.clip(found[1], -MOST_MOVED_S, MOST_MOVED_S)) if differ else 0.0
    return moved, max(float((errors.along - slope @ found).std()), float(errors.across.std()))


def _reports(
    scene: Scene, rows: TruthRows, pairs: Pairs, errors: Errors, unknown: list[str]
) -> dict[str, Measured]:  # fmt: skip
    """How often vehicles are reported, and where there is none; what is not known is added to `unknown`."""
    is_hit = np.zeros(rows.frame.size, np.bool_)
    is_hit[pairs.one] = True
    n_all = errors.time_s.size + errors.n_outliers
    astray = share(errors.n_outliers, n_all) if scene.are_named(rows) else None
    found = {
        "detection_probability": (detection_probability(rows, is_hit), "vehicles are seen in too few frames"),
        "clutter_density": (
            clutter(scene, rows, pairs.other),
            "stray detections continue from frame to frame: the truth does not contain all vehicles",
        ),
        "outlier_share": (astray, "the truth's ids are not the detections', so a far detection cannot be assigned"),
    }
    unknown += [f"{name}: {why}" for name, (number, why) in found.items() if number is None]
    return {name: number for name, (number, _) in found.items() if number is not None}


def _sensor(found: dict[str, Measured], fits: dict[str, ErrorFit]) -> Sensor:
    """The model of these numbers, with half the widths of their intervals."""
    uncertainty = {name: WIDE * number.error for name, number in found.items()}
    axes = {}
    for name, fit in fits.items():
        axis = {
            "bias_m": Measured(float(fit.mean[0]), float(fit.mean_se[0])),
            "spread_m": Measured(max(fit.spread, 1e-3), fit.spread_se),
        }
        if fit.share:
            axis["correlated_share"] = Measured(fit.share, fit.share_se)
            axis["correlation_s"] = Measured(fit.lasts_s, fit.lasts_se)
        axes[name] = AxisError(**{own: number.value for own, number in axis.items()})
        uncertainty |= {f"{name}.{own}": WIDE * number.error for own, number in axis.items()}
    numbers: dict[str, Any] = {name: number.value for name, number in found.items()}
    return Sensor(**numbers, along=axes["along"], across=axes["across"], uncertainty=uncertainty)


def share(n: float, of: float) -> Measured:
    """A share by its count, with half a count to either side so that none is certain."""
    value = (n + 0.5) / (of + 1.0)
    return Measured(value, float(np.sqrt(value * (1.0 - value) / (of + 1.0))))


def detection_probability(rows: TruthRows, is_hit: BoolArray) -> Measured | None:
    """Of a vehicle between its first and its last detection; misses in a row count as fewer. None of too few frames.

    Args:
        rows: (n,) vehicles at the frames.
        is_hit: (n,) whether each was detected.
    """
    order = np.lexsort((rows.frame, rows.vehicle))
    of_vehicles = np.split(is_hit[order], np.flatnonzero(np.diff(rows.vehicle[order])) + 1)
    # the ends are where they are because they were seen; of vehicles never seen, a sensor may not report their kind
    hits = [hit[np.argmax(hit) + 1 : hit.size - 1 - np.argmax(hit[::-1])] for hit in of_vehicles if hit.any()]
    n = sum(of.size for of in hits)
    if n < FEWEST_FRAMES:
        return None
    found = share(sum(int(of.sum()) for of in hits), n)
    off = [of - found.value for of in hits]
    variance = sum(float((of**2).sum()) for of in off) / n
    product = sum(float((of[1:] * of[:-1]).sum()) for of in off) / max(n - len(off), 1)
    correlation = float(np.clip(product / variance, 0.0, 0.95)) if variance > 0 else 0.0
    return Measured(found.value, found.error * float(np.sqrt((1.0 + correlation) / (1.0 - correlation))))


def clutter(scene: Scene, rows: TruthRows, detected: IntArray) -> Measured | None:
    """Stray detections per square metre of the truth's bounding box, and frame.

    Args:
        scene: detections beside the truth.
        rows: vehicles at the frames.
        detected: detections that are of vehicles.

    Returns:
        None where stray detections continue from frame to frame: the truth does not contain all vehicles.
    """
    low, high = rows.position.min(axis=0), rows.position.max(axis=0)
    area = float(np.prod(np.maximum(high - low, 1.0)))
    covered = np.unique(rows.frame)
    position = scene.detections.position
    stray = np.isin(scene.frame_of, covered) & ((position >= low) & (position <= high)).all(axis=1)
    stray[detected] = False
    if scene.are_named(rows):  # at the ends of the truth as well
        stray &= ~np.isin(as_texts(scene.detections.track_id), scene.names)
    if _go_on(scene, position[stray], scene.frame_of[stray], area):
        return None
    n, exposure = int(stray.sum()), area * covered.size
    return Measured((n + 0.5) / exposure, float(np.sqrt(n + 1.0)) / exposure)


def _go_on(scene: Scene, position: FloatArray, frame: IntArray, area: float) -> bool:
    """Whether more of the detections than by chance have another near them in the next frame."""
    if position.shape[0] < FEWEST_FRAMES:
        return False
    step_s = float(np.median(np.diff(scene.frame_s))) if scene.frame_s.size > 1 else 0.0
    reach = 0.5 + FASTEST * max(step_s, 0.0)
    tree = KDTree(np.column_stack([position, frame * APART_M]))
    distance, _ = tree.query(np.column_stack([position, (frame + 1) * APART_M]), distance_upper_bound=reach)
    per_frame = position.shape[0] / max(np.unique(frame).size, 1)
    by_chance = 1.0 - np.exp(-per_frame * np.pi * reach**2 / area)
    return bool(np.isfinite(distance).mean() > by_chance + GOING_ON)
