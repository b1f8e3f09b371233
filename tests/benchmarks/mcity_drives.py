"""Mcity's roadside detections of several drives, some with RTK-GPS truth: sensor and map of those left over.

A drive with truth is left out in turn: the sensor is calibrated on the others of these, and the map is learned from the
detections of all other drives, less the bias.
"""

from __future__ import annotations

import runpy
from collections.abc import Iterable
from dataclasses import replace
from functools import cache
from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np
from pyarrow import parquet

from dirprim_filter import PrimitiveMap, Tracks, learn_primitives
from dirprim_filter.config import FilterConfig, TrackingConfig
from dirprim_filter.detections import Detections
from dirprim_filter.estimates import Estimates
from dirprim_filter.evaluation.calibration.calibrating import calibrate
from dirprim_filter.origin import Origin
from dirprim_filter.recording.tables import Table, read_named
from dirprim_filter.sensor import Sensor, without_bias

DATA = Path(__file__).parents[2] / "../shared/data/mcity_roadside"
ORIGIN = Origin.parse("42.300947,-83.698649")
VEHICLES = {str(label) for label in range(2, 8)}
GATE_M = 5.0


def drives() -> list[int]:
    """All that were recorded."""
    return sorted(int(path.stem.removeprefix("detection_")) for path in (DATA / "dets").glob("detection_*.json"))


def with_truth() -> dict[int, str]:
    """The drives of instrumented vehicles, and what their file is called: one that was cut is preferred."""
    names = sorted(path.stem.removeprefix("gps_data_") for path in (DATA / "gts").glob("gps_data_*.json"))
    return {int(name.removesuffix("_c")): name for name in names if name.removesuffix("_c").isdigit()}


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
    rows = table_of(f"gts/gps_data_{with_truth()[drive]}.json").tracks
    return replace(rows, group=np.full(len(rows), drive))


def in_one_group(parts: Iterable[Tracks]) -> Tracks:
    """Drives together: names are of their drive."""
    return Tracks.concatenate(
        replace(part, track_id=np.array([f"{part.group[0]}/{name}" for name in part.track_id])) for part in parts
    )


@cache
def calibrated(without: int) -> Sensor:
    """The sensor by the truth of all drives but one."""
    others = [drive for drive in with_truth() if drive != without]
    return calibrate(Detections.of(in_one_group(map(detected, others))), in_one_group(map(true, others))).sensor


def without_own_bias(found: Estimates, sensor: Sensor) -> Estimates:
    """Estimates of a filter that knows no bias, moved by it along their own course."""
    along = np.column_stack([np.cos(found.direction), np.sin(found.direction)])
    across = np.column_stack([-along[:, 1], along[:, 0]])
    off = sensor.along.bias_m * along + sensor.across.bias_m * across
    return replace(found, position=found.position - off)


def configured(sensor: Sensor) -> tuple[FilterConfig, TrackingConfig]:
    """What a sensor determines; the rest at its defaults."""
    return sensor.informs(FilterConfig(), TrackingConfig())


def traffic(without: int) -> Tracks:
    """Detections of all other drives, less the bias."""
    return in_one_group(without_bias(detected(of), calibrated(without)) for of in drives() if of != without)


@cache
def fair_map(drive: int, seed: int) -> PrimitiveMap:
    """Of that traffic."""
    return learn_primitives(traffic(drive), rng=np.random.default_rng(seed))
