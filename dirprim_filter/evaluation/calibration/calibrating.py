"""A sensor's model, measured against the truth."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from dirprim_filter.arrays import BoolArray, FloatArray, IntArray
from dirprim_filter.detections import Detections
from dirprim_filter.evaluation.calibration.gauss_markov import ErrorFit, autocorrelation, fit_errors
from dirprim_filter.evaluation.calibration.pairing import Scene, TruthRows, find_lag
from dirprim_filter.evaluation.calibration.reports import Reported, clutter, detection_probability, share
from dirprim_filter.filtering.association import Pairs
from dirprim_filter.sensor import AxisError, Sensor
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
MOVING_FROM = 0.5
"""m/s: of slower vehicles the way has no direction."""
FEWEST = 30
"""Pairs of detections and true positions."""
LATENCY_KNOWN_S = 0.15
"""Standard error of a latency beyond which it and the bias along the way cannot be separated."""
WIDE = 2.58
"""Standard errors in half of a 99 % interval."""
OUTLIER = 8.0
"""Robust standard deviations from which on an error is none of the sensor's usual ones."""
MAD = 1.4826
"""From the median absolute deviation to a Gaussian's standard deviation."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Errors:
    """The errors that a calibration was learned from. (n,) rows, vehicle after vehicle, ascending in time.

    Attributes:
        time_s: seconds.
        is_first: where a vehicle's begin.
        speed: m/s, true.
        along: metres, from the truth at the time less the latency.
        across: likewise.
        lag_s: (m,) seconds between two errors.
        along_correlation: (m,) of errors so far apart, NaN of none.
        across_correlation: likewise.
    """

    time_s: FloatArray
    is_first: BoolArray
    speed: FloatArray
    along: FloatArray
    across: FloatArray
    lag_s: FloatArray
    along_correlation: FloatArray
    across_correlation: FloatArray


@dataclass(frozen=True, slots=True, kw_only=True)
class Calibration:
    """What was measured.

    Attributes:
        sensor: the model.
        errors: what it was learned from.
        clock_offset_s: seconds by which the sensor's clock is ahead of the truth's, as far as that is no latency.
        n_detections: all.
        n_pairs: of them, those of true vehicles.
        n_vehicles: true vehicles that were detected.
        unknown: what the data do not determine, and why.
    """

    sensor: Sensor
    errors: Errors
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
        paired = _PairedErrors.of(scene, rows, pairs)
        if paired.usual.sum() < FEWEST:
            raise ValueError(
                f"truth: expected at least {FEWEST} detections of moving vehicles in it, got {paired.usual.sum()}: "
                "is it of this place and time?"
            )
        if not last:
            moved, spread = paired.ordinary()
            lag_s, gate_m = lag_s + moved, float(np.clip(GATE_SPREADS * spread, *GATES_M))
    along = paired.fit("along", np.ones(paired.speed.size), -paired.speed)
    is_known = bool(along.coefficients_se[1] <= LATENCY_KNOWN_S)
    if is_known:
        lag_s += float(along.coefficients[1])
    else:  # the bias takes it up
        along = paired.fit("along", np.ones(paired.speed.size))
    across = paired.fit("across", np.ones(paired.speed.size))
    return _calibration(Reported(scene, rows, pairs), paired, (along, across), lag_s)


@dataclass(frozen=True, slots=True, kw_only=True)
class _PairedErrors:
    """Errors of all pairs of moving vehicles, vehicle after vehicle, and which of them are usual."""

    vehicle: IntArray
    time_s: FloatArray
    speed: FloatArray
    along: FloatArray
    across: FloatArray
    usual: BoolArray

    @classmethod
    def of(cls, scene: Scene, rows: TruthRows, pairs: Pairs) -> _PairedErrors:
        row, detection = pairs
        order = np.lexsort((rows.frame[row], rows.vehicle[row]))
        row, detection = row[order], detection[order]
        moving = rows.speed[row] >= MOVING_FROM
        row, detection = row[moving], detection[moving]
        error, course = scene.detections.position[detection] - rows.position[row], rows.course[row]
        along = (error * course).sum(axis=1)
        across = course[:, 0] * error[:, 1] - course[:, 1] * error[:, 0]
        usual = _within(along) & _within(across)
        return cls(
            vehicle=rows.vehicle[row], time_s=scene.frame_s[rows.frame[row]], speed=rows.speed[row], along=along,
            across=across, usual=usual,
        )  # fmt: skip

    @property
    def is_first(self) -> BoolArray:
        """Of the usual rows, where a vehicle's begin."""
        return np.asarray(np.diff(self.vehicle[self.usual], prepend=-1) != 0)

    def ordinary(self) -> tuple[float, float]:
        """By ordinary least squares: by how much the lag is wrong, and the larger spread of both axes."""
        along, speed = self.along[self.usual], self.speed[self.usual]
        slope = np.column_stack([np.ones(speed.size), -speed])
        found = np.linalg.lstsq(slope, along, rcond=None)[0]
        moved = (
            float(np.clip(found[1], -MOST_MOVED_S, MOST_MOVED_S)) if speed.std() > LEAST_SPREAD * speed.mean() else 0.0
        )
        return moved, max(float((along - slope @ found).std()), float(self.across[self.usual].std()))

    def fit(self, name: str, *regressors: FloatArray) -> ErrorFit:
        """The model of the usual errors along one axis."""
        columns = np.column_stack([column[self.usual] for column in regressors])
        return fit_errors(getattr(self, name)[self.usual], columns, self.time_s[self.usual], self.is_first)


def _within(error: FloatArray) -> BoolArray:
    if error.size == 0:
        return np.ones(0, np.bool_)
    off = np.abs(error - np.median(error))
    return np.asarray(off <= OUTLIER * MAD * max(float(np.median(off)), 1e-3))


def _calibration(
    reported: Reported, paired: _PairedErrors, fits: tuple[ErrorFit, ErrorFit], lag_s: float
) -> Calibration:
    """All that was found, and what was not."""
    along, across = fits
    scene = reported.scene
    unknown: list[str] = []
    uncertainty: dict[str, float] = {}
    is_latency = along.coefficients.size > 1 and LATENCY_S[0] - WIDE * along.coefficients_se[1] <= lag_s < LATENCY_S[1]
    if along.coefficients.size == 1:
        unknown.append("latency_s: vehicles drive too alike; it is in along.bias_m, which holds at their speed")
    elif is_latency:
        uncertainty["latency_s"] = WIDE * float(along.coefficients_se[1])
    else:
        unknown.append("latency_s: the clocks differ, and latency cannot be separated from their difference")
    seen = detection_probability(reported)
    false, why = clutter(reported)
    astray = share(int((~paired.usual).sum()), paired.usual.size) if reported.are_named else None
    if astray is None:
        unknown.append("outlier_share: the truth's ids are not the detections', so a far detection cannot be assigned")
    if false is None:
        unknown.append(f"clutter_density: {why}")
    for name, found in (("detection_probability", seen), ("clutter_density", false), ("outlier_share", astray)):
        if found is not None:
            uncertainty[name] = WIDE * found.error
    axes = {}
    for name, fit in (("along", along), ("across", across)):
        axes[name] = AxisError(
            bias_m=float(fit.coefficients[0]), spread_m=max(fit.spread, 1e-3), correlated_share=fit.share,
            correlation_s=fit.correlation_s if fit.share else 1.0,
        )  # fmt: skip
        uncertainty[f"{name}.bias_m"] = WIDE * float(fit.coefficients_se[0])
        uncertainty[f"{name}.spread_m"] = WIDE * float(fit.spread_se)
        if fit.share:
            uncertainty[f"{name}.correlated_share"] = WIDE * float(fit.share_se)
            uncertainty[f"{name}.correlation_s"] = WIDE * float(fit.correlation_se)
    sensor = Sensor(
        latency_s=max(lag_s, 0.0) if is_latency else 0.0, along=axes["along"], across=axes["across"],
        detection_probability=None if seen is None else seen.value,
        clutter_density=None if false is None else false.value,
        outlier_share=None if astray is None else astray.value, sight=reported.sight, uncertainty=uncertainty,
    )  # fmt: skip
    return Calibration(
        sensor=sensor, errors=_errors(paired, along, across), clock_offset_s=0.0 if is_latency else lag_s,
        n_detections=len(scene.detections), n_pairs=int(reported.pairs.one.size),
        n_vehicles=int(np.unique(reported.rows.vehicle[reported.pairs.one]).size), unknown=tuple(unknown),
    )  # fmt: skip


LAGS_S = np.arange(0.0, 3.01, 0.1)


def _errors(paired: _PairedErrors, along: ErrorFit, across: ErrorFit) -> Errors:
    time_s, is_first = paired.time_s[paired.usual], paired.is_first
    correlation = [autocorrelation(fit.residual, time_s, is_first, LAGS_S, within_s=0.03) for fit in (along, across)]
    return Errors(
        time_s=time_s, is_first=is_first, speed=paired.speed[paired.usual],
        along=along.residual + along.coefficients[0], across=across.residual + across.coefficients[0],
        lag_s=LAGS_S, along_correlation=correlation[0], across_correlation=correlation[1],
    )  # fmt: skip
