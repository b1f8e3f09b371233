"""Columns in another unit are reported, whatever the noise; right ones are not."""

from dataclasses import replace

import numpy as np
import pytest

from dirprim_filter.distributions.angles import wrap
from dirprim_filter.faults import find_faults, wrong_scale
from dirprim_filter.jumps import Scale
from dirprim_filter.tracks import Tracks
from situations import tracks_of


def driven(n_rows=120, *, name, seed, start_s=0.0, lane=0.0, group=0, speed=10.0, accelerating=1.0):
    """Eastward, with accelerations of the driver's own, as every driver has them: 1 m/s2, correlated over a second."""
    rng = np.random.default_rng(seed)
    acceleration = np.zeros(n_rows)
    for i in range(1, n_rows):
        acceleration[i] = 0.9 * acceleration[i - 1] + 0.44 * accelerating * rng.standard_normal()
    pace = np.maximum(speed + 0.1 * np.cumsum(acceleration - acceleration.mean()), 0.0)
    x = np.cumsum(0.1 * pace)
    return Tracks(
        track_id=np.full(n_rows, name), time_ns=np.round((start_s + 0.1 * np.arange(n_rows)) * 1e9).astype(np.int64),
        position=np.column_stack([x, np.full(n_rows, lane)]), direction=np.zeros(n_rows), speed=pace,
        group=np.full(n_rows, group),
    )  # fmt: skip


def traffic():
    """Ten vehicles on one path, two seconds apart, each with accelerations of its own."""
    return [driven(name=f"v{i}", seed=i, start_s=2.0 * i) for i in range(10)]


def bent(**changes):
    """A vehicle on a circle of 30 m at 10 m/s beside the traffic, all with positions that err by half a metre."""
    rng = np.random.default_rng(8)
    angle = np.arange(120) / 30.0
    way = 30.0 * np.column_stack([np.cos(angle), np.sin(angle)])
    circle = tracks_of(way[None], track_id="bent", direction=angle + np.pi / 2, speed=10.0)
    parts = [replace(part, position=part.position + rng.normal(0, 0.5, part.position.shape)) for part in traffic()[:3]]
    whole = Tracks.concatenate([*parts, circle])
    return faults_of(replace(whole, **{name: change(whole) for name, change in changes.items()}))


def faults_of(tracks):
    order = np.lexsort((tracks.time_ns, tracks.vehicle))
    columns = [column[order] for column in (tracks.vehicle, tracks.time_ns, tracks.position)]
    scale = Scale.of(*columns)
    found = find_faults(*columns, direction=tracks.direction[order], speed=tracks.speed[order], scale=scale)
    return list(found.values()) or [wrong for wrong in [wrong_scale(scale)] if wrong]


DEGREES = np.array([10.39, 63.43])
UNITS = {
    "km/h": ({"speed": lambda of: 3.6 * of.speed}, "are they in km/h in place of m/s?"),
    "mph": ({"speed": lambda of: 2.237 * of.speed}, "are they in mph in place of m/s?"),
    "knots": ({"speed": lambda of: 1.944 * of.speed}, "are they in knots in place of m/s?"),
    "another": ({"speed": lambda of: 0.1 * of.speed}, "are they in another unit in place of m/s?"),
    "course in degrees": ({"direction": lambda of: wrap(np.rad2deg(of.direction) + 20.0)}, "are courses in degrees"),
    "course from north": ({"direction": lambda of: np.pi / 2 - of.direction}, "are courses from north, clockwise?"),
    "latitudes": ({"position": lambda of: DEGREES + 9e-6 * of.position}, "degrees"),
    "latitudes far apart": (
        {"position": lambda of: DEGREES + 9e-6 * of.position + 9.0 * of.vehicle[:, None]}, "speeds lead thousands",
    ),
    "latitudes, no speed": (
        {"position": lambda of: DEGREES + 9e-6 * of.position, "speed": lambda of: 1e-5 * of.speed}, "degrees",
    ),
}  # fmt: skip


@pytest.mark.parametrize("unit", UNITS)
def test_columns_in_another_unit_are_reported_and_right_ones_are_not(unit):
    change, said = UNITS[unit]
    (line,) = bent(**change)
    assert said in line
    assert bent() == faults_of(traffic()[0]) == faults_of(traffic()[0][:0]) == []
