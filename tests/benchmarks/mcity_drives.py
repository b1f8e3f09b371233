"""Mcity's roadside detections of eight drives, of which four have RTK-GPS truth, and what tracks them.

Of drives 3, 4, 13 and 14 one is left out in turn: the sensor is calibrated on the other three, and the map is learned
from the detections of all other drives, less the bias.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator
from dataclasses import replace
from functools import cache
from pathlib import Path

import numpy as np
from paired_errors import RowErrors, likeliest

from dirprim_filter import PrimitiveMap, Tracks, learn_primitives
from dirprim_filter.config import FilterConfig, TrackingConfig
from dirprim_filter.detections import Detections
from dirprim_filter.estimates import EstimateList, Estimates
from dirprim_filter.evaluation.calibration import calibrate, self_calibrate
from dirprim_filter.evaluation.calibration.pairing import Scene
from dirprim_filter.filtering import BayesFilter, ConstantVelocityKalman, InteractingModels, Tracker
from dirprim_filter.recording.schemas.family import FieldMapping
from dirprim_filter.recording.tables import read_json
from dirprim_filter.recording.transforms.geodesy import Origin
from dirprim_filter.replay import replay
from dirprim_filter.sensor import Sensor, without_bias

DATA = Path(__file__).parents[2] / "../shared/data/mcity_roadside"
ORIGIN = Origin.parse("42.300947,-83.698649")
FIELDS = "time_s=.timestamp,id=.objs[].id,latitude=.objs[].lat,longitude=.objs[].lon"
VEHICLES = {str(label) for label in range(2, 8)}
WITH_TRUTH = {3: "3", 4: "4", 13: "13_c", 14: "14_c"}
DRIVES = (1, 2, 3, 4, 11, 12, 13, 14)
GATE_M = 5.0
SYNTHETIC_M = 0.35
"""Of white noise on true positions: about as wide as the sensor's own spread."""
TRUE_POSITIONS = f"true positions + {SYNTHETIC_M:g} m"
Method = Callable[[int], Estimates]
"""By the seed."""


@cache
def detected(drive: int) -> Tracks:
    """Detections of vehicles, each drive a group."""
    table = read_json(
        DATA / f"dets/detection_{drive}.json", FieldMapping.parse(f"{FIELDS},label=.objs[].classType"), origin=ORIGIN
    )
    vehicles = {str(name) for name, label in table.labels.items() if label in VEHICLES}
    rows = table.tracks[np.array([str(name) in vehicles for name in table.tracks.track_id])]
    return replace(rows, group=np.full(len(rows), drive))


@cache
def true(drive: int) -> Tracks:
    """Where the instrumented vehicles were."""
    rows = read_json(DATA / f"gts/gps_data_{WITH_TRUTH[drive]}.json", FieldMapping.parse(FIELDS), origin=ORIGIN).tracks
    return replace(rows, group=np.full(len(rows), drive))


def in_one_world(parts: Iterable[Tracks]) -> Tracks:
    """Drives together: names are of their drive."""
    return Tracks.concatenate(
        replace(part, track_id=np.array([f"{part.group[0]}/{name}" for name in part.track_id])) for part in parts
    )


@cache
def calibrated(without: int) -> Sensor:
    """The sensor by the truth of all drives but one."""
    drives = [drive for drive in WITH_TRUTH if drive != without]
    return calibrate(Detections.of(in_one_world(map(detected, drives))), in_one_world(map(true, drives))).sensor


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


def kalman(make: Callable[[FilterConfig], BayesFilter], noise_m: float, sensor: Sensor, seen: Detections) -> Estimates:
    """What a filter of white noise says, with the sensor's latency and bias taken off as ours has them."""
    config = replace(configured(sensor)[0], noise_m=noise_m)
    tracker = Tracker(
        make(config), config=config, tracking=configured(sensor)[1], sensor=sensor, rng=np.random.default_rng(0)
    )
    return without_own_bias(tracked(seen, tracker), sensor)


def configured(sensor: Sensor) -> tuple[FilterConfig, TrackingConfig]:
    """What a sensor determines; the rest at its defaults."""
    return sensor.informs(FilterConfig(), TrackingConfig())


def constant_velocity(acceleration: float) -> Callable[[FilterConfig], BayesFilter]:
    """By m^2/s^3."""
    return lambda config: ConstantVelocityKalman(acceleration_density=acceleration, config=config)


def interacting(acceleration: float, turn: float) -> Callable[[FilterConfig], BayesFilter]:
    """By m^2/s^3 and rad^2/s^3."""
    return lambda config: InteractingModels(
        straight=acceleration, acceleration_density=acceleration, turn_density=turn, config=config
    )


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
def log_density(drive: int, model: str, noise_m: float, *densities: float) -> float:
    """Of a drive's truth under a rival's estimates; latency and bias as the other drives show them."""
    make = constant_velocity(*densities) if model == "constant velocity" else interacting(*densities)
    found = kalman(make, noise_m, calibrated(drive), of_instrumented(drive))
    return RowErrors.of(found, true(drive), gate_m=GATE_M).log_density()


def fitted(without: int) -> tuple[tuple[float, ...], tuple[float, ...]]:
    """Noise, then acceleration of constant velocity; then turn as well, with that noise, of interacting models.

    Those under which the truth of all drives but one is likeliest, which the filters on a map are not shown. Latency
    and bias of each of these drives are of all others, the one left out among them: a little in the rivals' favour.
    """

    def likelihood(model: str) -> Callable[[tuple[float, ...]], float]:
        return lambda at: sum(log_density(drive, model, *at) for drive in WITH_TRUTH if drive != without)

    straight = likeliest(likelihood("constant velocity"), acceleration=0.5, noise=1.0)
    of_turns = likelihood("interacting models")
    turning = likeliest(lambda at: of_turns((straight[0], *at)), noise=straight[1], turn=0.03)
    return straight, (straight[0], *turning)


@cache
def maps(drive: int, seed: int) -> tuple[PrimitiveMap, PrimitiveMap, PrimitiveMap]:
    """Of all other drives: less the bias, the same with one cell, and as a user who knows no bias learns it."""
    others = [detected(other) for other in DRIVES if other != drive]
    fair = in_one_world(without_bias(of, calibrated(drive)) for of in others)
    rng = np.random.default_rng(seed)
    one_cell = learn_primitives(fair, tessellation="grid", n_cells=1, rng=np.random.default_rng(seed))
    return learn_primitives(fair, rng=rng), one_cell, learn_primitives(in_one_world(others), rng=rng)


def methods(drive: int) -> Iterator[tuple[str, Method]]:
    """What is compared on a drive."""
    seen, sensor = Detections.of(detected(drive)), calibrated(drive)
    straight, turning = fitted(drive)
    config, tracking = configured(sensor)

    def by(model: Callable[[int], PrimitiveMap]) -> Method:
        return lambda seed: tracked(
            seen, Tracker(model(seed), config=config, tracking=tracking, sensor=sensor, rng=np.random.default_rng(seed))
        )

    yield "constant velocity", lambda _: kalman(constant_velocity(*straight[1:]), straight[0], sensor, seen)
    yield "interacting models", lambda _: kalman(interacting(*turning[1:]), turning[0], sensor, seen)
    yield "without the map", by(lambda seed: maps(drive, seed)[0].without_places())
    yield "one cell", by(lambda seed: maps(drive, seed)[1])
    yield "with the map", by(lambda seed: maps(drive, seed)[0])
    yield "as a user runs it", lambda seed: by_default(seen, maps(drive, seed)[2], seed)
    synthetic = true_positions(drive)
    plain = FilterConfig(noise_m=SYNTHETIC_M)

    def on_truth(model: Callable[[int], PrimitiveMap]) -> Method:
        return lambda seed: tracked(
            synthetic(seed), Tracker(model(seed), config=plain, rng=np.random.default_rng(seed))
        )

    yield f"{TRUE_POSITIONS}, without the map", on_truth(lambda seed: maps(drive, seed)[0].without_places())
    yield f"{TRUE_POSITIONS}, with the map", on_truth(lambda seed: maps(drive, seed)[0])


def by_default(seen: Detections, learned: PrimitiveMap, seed: int) -> Estimates:
    """As `dirprim track`: the noise is learned from the log, where it shows; else it is the default."""
    try:
        sensor = self_calibrate(seen, rng=np.random.default_rng(0)).sensor
    except ValueError:
        sensor = None
    rng = np.random.default_rng(seed)
    return tracked(seen, Tracker(learned, sensor=sensor, rng=rng))


def true_positions(drive: int) -> Callable[[int], Detections]:
    """By the seed: where the instrumented vehicles were at the frames, with white noise."""
    scene = Scene(Detections.of(detected(drive)), true(drive))
    rows = scene.truth_at(0.0)
    first_ns = int(detected(drive).time_ns.min())

    def sense(seed: int) -> Detections:
        noise = SYNTHETIC_M * np.random.default_rng(seed).standard_normal(rows.position.shape)
        return Detections(
            track_id=scene.names[rows.vehicle], position=rows.position + noise,
            time_ns=first_ns + np.round(scene.frame_s[rows.frame] * 1e9).astype(np.int64),
            group=np.full(rows.frame.size, drive),
        )  # fmt: skip

    return sense
