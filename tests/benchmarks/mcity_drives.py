"""Mcity's roadside detections of eight drives, of which four have RTK-GPS truth, and what tracks them.

Of drives 3, 4, 13 and 14 one is left out in turn: the sensor is calibrated on the other three, and the map is learned
from the detections of all other drives, less the bias.
"""

from __future__ import annotations

import runpy
from collections.abc import Callable, Iterable, Iterator
from dataclasses import replace
from functools import cache
from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np
from paired_errors import RowErrors, likeliest
from pyarrow import parquet

from dirprim_filter import PrimitiveMap, Tracks, learn_primitives
from dirprim_filter.config import FilterConfig, TrackingConfig
from dirprim_filter.detections import Detections
from dirprim_filter.estimates import EstimateList, Estimates
from dirprim_filter.evaluation.calibration import calibrate, self_calibrate
from dirprim_filter.filtering import ConstantVelocityKalman, Tracker
from dirprim_filter.origin import Origin
from dirprim_filter.recording.tables import Table, read_named
from dirprim_filter.replay import replay
from dirprim_filter.sensor import Sensor, without_bias

DATA = Path(__file__).parents[2] / "../shared/data/mcity_roadside"
ORIGIN = Origin.parse("42.300947,-83.698649")
VEHICLES = {str(label) for label in range(2, 8)}
WITH_TRUTH = {3: "3", 4: "4", 13: "13_c", 14: "14_c"}
DRIVES = (1, 2, 3, 4, 11, 12, 13, 14)
GATE_M = 5.0
Method = Callable[[int], Estimates]
"""By the seed."""


MCITY = runpy.run_path(str(Path(__file__).parents[2] / "docs/examples/mcity.py"))["mcity"]


def table_of(name: str) -> Table:
    """The rows of a file of the data set."""
    with TemporaryDirectory() as folder:
        path = Path(folder) / "rows.parquet"
        parquet.write_table(MCITY(DATA / name), path)
        return read_named(path, origin=ORIGIN)


@cache
def detected(drive: int) -> Tracks:
    """Detections of vehicles, each drive a group."""
    table = table_of(f"dets/detection_{drive}.json")
    vehicles = {str(name) for name, label in table.labels.items() if label in VEHICLES}
    rows = table.tracks[np.array([str(name) in vehicles for name in table.tracks.track_id])]
    return replace(rows, group=np.full(len(rows), drive))


@cache
def true(drive: int) -> Tracks:
    """Where the instrumented vehicles were."""
    rows = table_of(f"gts/gps_data_{WITH_TRUTH[drive]}.json").tracks
    return replace(rows, group=np.full(len(rows), drive))


def in_one_group(parts: Iterable[Tracks]) -> Tracks:
    """Drives together: names are of their drive."""
    return Tracks.concatenate(
        replace(part, track_id=np.array([f"{part.group[0]}/{name}" for name in part.track_id])) for part in parts
    )


@cache
def calibrated(without: int) -> Sensor:
    """The sensor by the truth of all drives but one."""
    drives = [drive for drive in WITH_TRUTH if drive != without]
    return calibrate(Detections.of(in_one_group(map(detected, drives))), in_one_group(map(true, drives))).sensor


def tracked(seen: Detections, tracker: Tracker) -> Estimates:
    """All estimates of a log, instant after instant."""
    kept = EstimateList()
    replay(seen.frames(), tracker, [kept])
    return kept.all()


def without_own_bias(found: Estimates, sensor: Sensor) -> Estimates:
    """Estimates of a filter that knows no bias, moved by it along their own course."""
    along = np.column_stack([np.cos(found.direction), np.sin(found.direction)])
    across = np.column_stack([-along[:, 1], along[:, 0]])
    off = sensor.along.bias_m * along + sensor.across.bias_m * across
    return replace(found, position=found.position - off)


def kalman(acceleration: float, noise_m: float, sensor: Sensor, seen: Detections) -> Estimates:
    """What constant velocity with white noise says, less the sensor's latency and bias, as ours has them."""
    config = replace(configured(sensor)[0], noise_m=noise_m)
    model = ConstantVelocityKalman(acceleration_density=acceleration, config=config)
    tracker = Tracker(model, config=config, tracking=configured(sensor)[1], sensor=sensor, rng=np.random.default_rng(0))
    return without_own_bias(tracked(seen, tracker), sensor)


def configured(sensor: Sensor) -> tuple[FilterConfig, TrackingConfig]:
    """What a sensor determines; the rest at its defaults."""
    return sensor.informs(FilterConfig(), TrackingConfig())


def corrected(drive: int) -> RowErrors:
    """Detections less the latency and, by the true course, the bias that other drives show: no filter's doing."""
    sensor = calibrated(drive)
    late = RowErrors.of(Detections.of(detected(drive)), true(drive), gate_m=GATE_M, lag_s=sensor.latency_s)
    return late.less(sensor.along.bias_m, sensor.across.bias_m)


def of_instrumented(drive: int) -> Detections:
    """The detections of those vehicles whose truth is known."""
    seen = Detections.of(detected(drive))
    near = RowErrors.of(seen, true(drive), gate_m=GATE_M)
    return seen[np.isin(seen.track_id, np.unique(seen.track_id[near.column]))]


@cache
def log_density(drive: int, acceleration: float, noise_m: float) -> float:
    """Of a drive's truth under a rival's estimates; latency and bias as the other drives show them."""
    found = kalman(acceleration, noise_m, calibrated(drive), of_instrumented(drive))
    return RowErrors.of(found, true(drive), gate_m=GATE_M).log_density()


def fitted(without: int) -> tuple[float, ...]:
    """Acceleration, m^2/s^3, and noise of constant velocity.

    Those under which the truth of all drives but one is likeliest, which the filters on a map are not shown. Latency
    and bias of each of these drives are of all others, the one left out among them: a little in the rival's favour.
    """
    return likeliest(
        lambda at: sum(log_density(drive, *at) for drive in WITH_TRUTH if drive != without), acceleration=0.5, noise=1.0
    )


@cache
def maps(drive: int, seed: int) -> tuple[PrimitiveMap, PrimitiveMap]:
    """Of all other drives: less the bias, and as a user who knows no bias learns it."""
    others = [detected(other) for other in DRIVES if other != drive]
    fair = in_one_group(without_bias(of, calibrated(drive)) for of in others)
    rng = np.random.default_rng(seed)
    return learn_primitives(fair, rng=rng), learn_primitives(in_one_group(others), rng=rng)


def methods(drive: int) -> Iterator[tuple[str, Method]]:
    """What is compared on a drive."""
    seen, sensor = Detections.of(detected(drive)), calibrated(drive)
    config, tracking = configured(sensor)

    def by(model: Callable[[int], PrimitiveMap]) -> Method:
        return lambda seed: tracked(
            seen, Tracker(model(seed), config=config, tracking=tracking, sensor=sensor, rng=np.random.default_rng(seed))
        )

    yield "constant velocity", lambda _: kalman(*fitted(drive), sensor, seen)
    yield "without the map", by(lambda seed: maps(drive, seed)[0].without_places())
    yield "with the map", by(lambda seed: maps(drive, seed)[0])
    yield "as a user runs it", lambda seed: by_default(seen, maps(drive, seed)[1], seed)


def by_default(seen: Detections, learned: PrimitiveMap, seed: int) -> Estimates:
    """As `dirprim track`: the noise is learned from the log, where it shows; else it is the default."""
    try:
        sensor = self_calibrate(seen, rng=np.random.default_rng(0)).sensor
    except ValueError:
        sensor = None
    rng = np.random.default_rng(seed)
    return tracked(seen, Tracker(learned, sensor=sensor, rng=rng))
