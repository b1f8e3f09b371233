"""Is a real sensor's vehicle tracked better than it is detected? Mcity's roadside detections against RTK-GPS truth.

Of drives 3, 4, 13 and 14 one is left out in turn: the sensor is calibrated on the other three, the map is learned from
the detections of all other drives, and the drive left out is tracked. Decides whether a sensor's model is worth having:
the tracked vehicle's RMSE is to be at most 0.6 of the raw one's, its NEES 1.5 to 3 where 2 is right.

    python tests/benchmarks/mcity.py [--drives 3 4 13 14] [--seeds 1]

An error is of the true position at the stated time, interpolated; `ahead` and `left` are its means in the vehicle's
axes. `corrected` are the raw detections less the calibrated latency and bias, by the true speed: no filter's doing.
Estimates are taken while seen, and in brackets with those that coast. The white row is of no sensor's model: the round
noise is as wide as the calibrated errors are in both axes together.
"""

from __future__ import annotations

import argparse
import logging
import sys
from collections.abc import Iterable, Iterator
from dataclasses import dataclass, replace
from functools import cache
from pathlib import Path

import numpy as np

sys.path.insert(0, str(Path(__file__).parents[1]))

from dirprim_filter import Tracks, learn_primitives
from dirprim_filter.arrays import FloatArray
from dirprim_filter.config import FilterConfig, TrackingConfig
from dirprim_filter.detections import Detections
from dirprim_filter.estimates import Estimates
from dirprim_filter.evaluation.calibration import calibrate
from dirprim_filter.evaluation.calibration.pairing import Scene
from dirprim_filter.filtering import Tracker
from dirprim_filter.filtering.kalman import ConstantVelocityKalman
from dirprim_filter.filtering.sensed_particles import knobs_of
from dirprim_filter.recording.schemas.field_mapping import FieldMapping
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
ACCELERATION_DENSITY = 1.0
"""m^2/s^3, of the constant velocity that all is compared with."""


@dataclass(frozen=True, slots=True)
class Errors:
    """Of estimates: (n, 2) metres ahead and to the left, (n,) normalised squares, and how many true rows there are."""

    off: FloatArray
    squared: FloatArray
    n_true: int

    def __str__(self) -> str:
        rmse = float(np.sqrt((self.off**2).sum(axis=1).mean()))
        ahead, left = self.off.mean(axis=0)
        return (
            f"{rmse:5.2f} {ahead:+6.2f} {left:+6.2f} {self.off[:, 0].std():5.2f} {self.off[:, 1].std():5.2f} "
            f"{self.squared.mean():6.2f} {self.off.shape[0] / self.n_true:5.2f}"
        )

    @property
    def rmse(self) -> float:
        """Metres."""
        return float(np.sqrt((self.off**2).sum(axis=1).mean()))


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


def told_apart(parts: Iterable[Tracks]) -> Tracks:
    """Drives together: names are of their drive."""
    return Tracks.concatenate(
        replace(part, track_id=np.array([f"{part.group[0]}/{name}" for name in part.track_id])) for part in parts
    )


def calibrated(drives: Iterable[int]) -> Sensor:
    """The sensor by the truth of some drives."""
    drives = list(drives)
    return calibrate(Detections.of(told_apart(map(detected, drives))), told_apart(map(true, drives))).sensor


def errors_of(seen: Detections, truth: Tracks, latency_s: float = 0.0, covariance: FloatArray | None = None) -> Errors:
    """Of positions against the truth `latency_s` before their time, assigned by place."""
    scene = Scene(seen, truth)
    rows = scene.truth_at(latency_s)
    row, other = scene.matched(rows, gate_m=GATE_M)
    off, course = scene.detections.position[other] - rows.position[row], rows.course[row]
    across = np.column_stack([-course[:, 1], course[:, 0]])
    told = np.column_stack([(off * course).sum(axis=1), (off * across).sum(axis=1)])
    squared = np.full(row.size, np.nan)
    if covariance is not None:
        squared = np.einsum("ni,ni->n", off, np.linalg.solve(covariance[other], off[..., None])[..., 0])
    return Errors(told, squared, rows.frame.size)


def tracked(seen: Detections, tracker: Tracker) -> Estimates:
    """All estimates of a log, instant after instant."""
    kept: list[Estimates] = []

    class Keep:
        def write(self, frame) -> None:  # type: ignore[no-untyped-def]
            kept.append(frame.estimates)

    replay(seen.frames(), tracker, [Keep()])
    return Estimates.concatenate(kept)


def models(drive: int, sensor: Sensor, seed: int) -> Iterator[tuple[str, Tracker]]:
    """What is compared."""
    known = knobs_of(sensor)
    tracking = TrackingConfig(**{name: known[name] for name in known if name in TrackingConfig.__dataclass_fields__})
    config = FilterConfig(**{name: known[name] for name in known if name in FilterConfig.__dataclass_fields__})
    white = replace(config, noise_m=float(np.sqrt(0.5 * (sensor.along.spread_m**2 + sensor.across.spread_m**2))))
    others = told_apart(without_bias(detected(other), sensor) for other in DRIVES if other != drive)
    learned = learn_primitives(others, rng=np.random.default_rng(seed))
    cv = ConstantVelocityKalman(acceleration_density=ACCELERATION_DENSITY, config=white)
    for name, model, of, by in (
        ("cv, white", cv, None, white),
        ("cv, white, latency", cv, replace(sensor), white),
        ("prior, white", learned, None, white),
        ("place-free", learned.without_places(), sensor, config),
        ("prior", learned, sensor, config),
    ):
        yield name, Tracker(model, config=by, tracking=tracking, sensor=of, rng=np.random.default_rng(seed))


def main() -> None:
    """Print a table for each drive."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--drives", type=int, nargs="+", default=list(WITH_TRUTH))
    parser.add_argument("--seeds", type=int, default=1)
    given = parser.parse_args()
    logging.disable(logging.WARNING)
    for drive in given.drives:
        sensor = calibrated(other for other in WITH_TRUTH if other != drive)
        seen, truth = Detections.of(detected(drive)), true(drive)
        told = {name: value for name, value in sensor.numbers().items() if value is not None}
        print(f"drive {drive}: {', '.join(f'{name} {value:.3g}' for name, value in told.items())}")
        print(f"{'':20s} ratio  rmse  ahead   left along  acr.   nees  seen")
        raw = errors_of(seen, truth)
        print(f"{'raw':20s} {1.0:5.2f} {raw}")
        late = errors_of(seen, truth, sensor.latency_s)
        fair = replace(late, off=late.off - [sensor.along.bias_m, sensor.across.bias_m])
        print(f"{'corrected':20s} {fair.rmse / raw.rmse:5.2f} {fair}")
        for seed in range(given.seeds):
            for name, tracker in models(drive, sensor, seed):
                found = tracked(seen, tracker)
                for what, rows in (("", found.unseen_s == 0.0), ("  and coasting", found.unseen_s >= 0.0)):
                    shown = Detections(
                        track_id=found.track_id[rows],
                        time_ns=found.time_ns[rows],
                        position=found.position[rows],
                        group=np.full(int(rows.sum()), drive),
                    )
                    errors = errors_of(shown, truth, covariance=found.covariance[rows])
                    print(f"{what or name:20s} {errors.rmse / raw.rmse:5.2f} {errors}", flush=True)


if __name__ == "__main__":
    main()
