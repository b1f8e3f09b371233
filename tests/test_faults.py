"""Planted faults are found, with their ids; vehicles that queue, follow or reverse a little are none."""

import re
from dataclasses import replace
from itertools import combinations

import numpy as np
import pytest

from dirprim_filter.distributions.angles import wrap
from dirprim_filter.faults import find_faults
from dirprim_filter.tracks import Tracks
from situations import ring_traffic


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


def found(*parts):
    return find_faults(Tracks.concatenate(parts))


def test_vehicles_that_follow_each_other_on_one_path_are_no_fault():
    assert found(*traffic()) == []


def test_vehicles_in_a_queue_are_no_copies():
    n = 200
    queue = [
        Tracks(track_id=np.full(n, i), time_ns=100_000_000 * np.arange(n), position=np.tile([6.0 * i, 0.0], (n, 1)),
               direction=np.zeros(n), speed=np.zeros(n))
        for i in range(8)
    ]  # fmt: skip
    assert found(*queue) == []


@pytest.mark.parametrize("error_m", [0.0, 0.01])
def test_a_vehicle_twice_at_the_same_instants_is_reported_with_both_ids(error_m):
    vehicles = traffic()
    noise = np.random.default_rng(5).normal(0, error_m, vehicles[3].position.shape)
    twice = replace(vehicles[3], track_id=np.full(120, "w"), position=vehicles[3].position + noise)
    assert found(*vehicles, twice) == ["vehicles that are copies of others at the same instants (1): w of v3"]
    assert found(*vehicles, twice[:8]) == []  # 0.8 s may be chance
    beside = replace(twice, position=vehicles[3].position + np.array([0.0, 0.2]))
    assert found(*vehicles, beside) == []


def test_copies_in_another_group_are_another_world():
    vehicles = traffic()
    elsewhere = replace(vehicles[3], group=np.ones(120, np.int64))
    assert found(*vehicles, elsewhere) == []
    both = [replace(v, group=np.full(len(v), 4)) for v in (*vehicles, replace(elsewhere, track_id=["w"] * 120))]
    assert found(*both) == ["vehicles that are copies of others at the same instants (1): 4/w of 4/v3"]


def test_a_vehicle_that_drives_back_and_forth_and_one_that_jumps_are_reported():
    vehicles = traffic()
    x = vehicles[2].position[:, 0].copy()
    x[50:] -= np.clip(2.0 * np.arange(70), 0.0, 14.0)  # 10 m/s back for 0.7 s
    back = replace(vehicles[2], position=np.column_stack([x, np.zeros(120)]))
    jumped = replace(vehicles[5], position=vehicles[5].position + np.where(np.arange(120) < 60, 0.0, 9.0)[:, None])
    faults = found(*vehicles[:2], back, *vehicles[3:5], jumped, *vehicles[6:])
    back_m, jump_m = (float(re.search(rf"\(1\): {name} \((\d+) m\)", "".join(faults))[1]) for name in ("v2", "v5"))
    assert (back_m, jump_m) == (pytest.approx(7.0, abs=2.0), pytest.approx(9.0 * np.sqrt(2), abs=1.5))
    assert [line.split(":")[0] for line in faults] == [
        "vehicles that move against their own heading (1)", "vehicles that jump (1)",
    ]  # fmt: skip
    parking = replace(vehicles[2], position=np.column_stack([np.minimum(x, x[0] + 30.0), np.zeros(120)]))
    assert find_faults(parking[:40]) == []


def test_noise_of_half_a_metre_is_neither_a_jump_nor_a_way_back():
    rng = np.random.default_rng(4)
    noisy = ring_traffic(rng, n_vehicles=40, n_rows=300)
    noisy = replace(noisy, position=noisy.position + rng.normal(0, 0.5, noisy.position.shape))
    assert not any("jump" in line or "copies" in line for line in find_faults(noisy))


def test_a_pause_is_no_jump():
    vehicle = driven(name="a", seed=0)
    assert found(vehicle[(vehicle.time_ns < 2e9) | (vehicle.time_ns > 9e9)]) == []
    assert find_faults(vehicle[:0]) == []
    assert find_faults(vehicle[:1]) == []


def test_what_is_found_is_what_a_comparison_of_all_pairs_finds():
    rng = np.random.default_rng(2)
    vehicles = [driven(name=i, seed=i, start_s=round(rng.uniform(0, 20), 1), lane=3.0 * (i % 3)) for i in range(30)]
    vehicles += [replace(vehicles[i], track_id=np.full(120, 100 + i)) for i in (4, 9, 17)]
    expected = set()
    for a, b in combinations(vehicles, 2):
        _, i, j = np.intersect1d(a.time_ns, b.time_ns, return_indices=True)
        near = (np.abs(a.position[i] - b.position[j]) <= 0.05).all(axis=1).sum()
        if near * 0.1 >= 1.0:
            expected.add((str(b.track_id[0]), str(a.track_id[0])))
    assert expected == {("104", "4"), ("109", "9"), ("117", "17")}
    assert found(*vehicles)[-1].endswith("(3): " + ", ".join(" of ".join(pair) for pair in sorted(expected)))


def test_who_drives_backwards_is_found_by_the_heading_where_the_direction_is_the_course():
    own = driven(name="v", seed=1)
    turned = replace(own, heading=np.full(len(own), np.pi))
    assert found(own) == []
    assert found(turned)[0].startswith("vehicles that move against their own heading (1): v (")


def bent(**changes):
    """A vehicle on a circle of 30 m at 10 m/s beside the traffic, all with positions that err by half a metre."""
    rng = np.random.default_rng(8)
    angle = np.arange(120) / 30.0
    circle = Tracks(
        track_id=np.full(120, "bent"), time_ns=100_000_000 * np.arange(120),
        position=30.0 * np.column_stack([np.cos(angle), np.sin(angle)]), direction=angle + np.pi / 2,
        speed=np.full(120, 10.0),
    )  # fmt: skip
    parts = [replace(part, position=part.position + rng.normal(0, 0.5, part.position.shape)) for part in traffic()[:3]]
    whole = Tracks.concatenate([*parts, circle])
    return find_faults(replace(whole, **{name: change(whole) for name, change in changes.items()}))


DEGREES = np.array([10.39, 63.43])
UNITS = {
    "km/h": ({"speed": lambda of: 3.6 * of.speed}, "are they in km/h in place of m/s?"),
    "mph": ({"speed": lambda of: 2.237 * of.speed}, "are they in mph in place of m/s?"),
    "knots": ({"speed": lambda of: 1.944 * of.speed}, "are they in knots in place of m/s?"),
    "another": ({"speed": lambda of: 0.1 * of.speed}, "are they in another unit in place of m/s?"),
    "course in degrees": ({"direction": lambda of: wrap(np.rad2deg(of.direction) + 20.0)}, "are courses in degrees"),
    "course from north": ({"direction": lambda of: np.pi / 2 - of.direction}, "are courses in degrees, or from north?"),
    "latitudes": ({"position": lambda of: DEGREES + 9e-6 * of.position}, "degrees"),
    "latitudes, no speed": (
        {"position": lambda of: DEGREES + 9e-6 * of.position, "speed": lambda of: 1e-5 * of.speed}, "degrees",
    ),
}  # fmt: skip


@pytest.mark.parametrize("unit", UNITS)
def test_columns_in_another_unit_are_reported_and_right_ones_are_not(unit):
    change, said = UNITS[unit]
    line, *others = bent(**change)
    assert said in line
    assert all(other.startswith("vehicles that ") for other in others)
    assert bent() == []
