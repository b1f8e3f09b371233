"""A map by hour: the clock's slots, and a map of one of them."""

from dataclasses import replace
from datetime import datetime
from zoneinfo import ZoneInfo

import numpy as np
import pytest

from dirprim_filter.distributions import Gamma, VonMisesMixture
from dirprim_filter.primitives.motion import CREEP
from dirprim_filter.primitives.schedule import Schedule, local_hours, slots_of


def schedule_of(of, *, by="hour", zone="UTC", flow=1.0, pace=1.0):
    """Of a map: the same number in all slots, or arrays."""
    shape = (24 if by == "hour" else 168, of.tessellation.n_cells, of.n_own_modes)
    return Schedule(by=by, zone=zone, flow=np.ones(shape) * flow, pace=np.ones(shape) * pace)


@pytest.mark.parametrize("zone", ["UTC", "Europe/Berlin", "Asia/Kolkata", "America/St_Johns"])
def test_slots_are_hours_by_the_clock(zone):
    time_ns = np.random.default_rng(0).integers(-(10**18), 3 * 10**18, 200) // 10**9 * 10**9
    moments = [datetime.fromtimestamp(t, ZoneInfo(zone)) for t in (time_ns // 10**9).tolist()]
    local = local_hours(time_ns, zone)
    assert slots_of(local, "hour").tolist() == [m.hour for m in moments]
    assert slots_of(local, "week").tolist() == [24 * m.weekday() + m.hour for m in moments]


def test_a_map_is_of_its_slot_alone(ring_map):
    evening = np.ones((24, 1, 1))
    evening[18] = 0.5
    turned = replace(ring_map, schedule=schedule_of(ring_map, zone="Europe/Berlin", pace=evening))
    assert (turned.slot_at(0), ring_map.slot_at(0)) == (1, None)
    own = slice(ring_map.n_own_modes)
    for hour, slower in ((17, 0.5), (16, 1.0)):  # UTC, in winter
        now = turned.at_time(hour * 3600 * 10**9)
        assert now.schedule is None
        np.testing.assert_allclose(now.speed.mean[:-1, own], slower * ring_map.speed.mean[:-1, own])
        np.testing.assert_array_equal(now.speed.mean[-1], ring_map.speed.mean[-1])
        np.testing.assert_allclose(now.direction.weight, ring_map.direction.weight, atol=1e-12)
    assert ring_map.at_time(0) is ring_map


def borrowed_flow(of, flow, cell):
    """The flow of each borrowed mode of a cell: that of its own mode most probable at the borrowed one's means."""
    direction, speed, n = of.direction[cell], of.speed[cell], of.n_own_modes
    found = []
    for b in range(n, n + of.n_borrowed_modes):
        own = VonMisesMixture(
            weight=np.append(direction.weight[:n], 1.0 - direction.weight[:n].sum()),
            mean_direction=np.append(direction.mean_direction[:n], 0.0),
            concentration=np.append(direction.concentration[:n], 0.0),
        )
        of_speed = Gamma(shape=speed.shape[:n], rate=speed.rate[:n]).log_density(speed.mean[b])
        found.append(flow[cell, np.argmax(own.mode_log_density(direction.mean_direction[b])[:n] + of_speed)])
    return found


def test_weights_follow_the_flow_beside_what_is_place_free(ring_map):
    own = ring_map.n_own_modes
    flow = np.random.default_rng(0).uniform(0.2, 3.0, (24, ring_map.tessellation.n_cells, own))
    now = schedule_of(ring_map, flow=flow).applied(ring_map, 3)
    expected = ring_map.direction.weight.copy()
    end = own + ring_map.n_borrowed_modes
    for cell in range(ring_map.tessellation.n_cells):
        share = expected[cell, :end].sum()
        if share > 0:
            of_modes = expected[cell, :end] * np.append(flow[3, cell], borrowed_flow(ring_map, flow[3], cell))
            expected[cell, :end] = share * of_modes / of_modes.sum()
    np.testing.assert_allclose(now.direction.weight, expected, rtol=1e-9)
    for amount in ("visits", "seconds"):
        before, after = (np.bincount(of.motion.cell + 1, getattr(of.motion, amount)) for of in (ring_map, now))
        np.testing.assert_allclose(after, before)
    assert (now.motion.cell == ring_map.motion.cell).all()
    assert not np.allclose(now.motion.count, ring_map.motion.count)


def test_manoeuvres_are_as_frequent_as_what_follows_them(ring_map):
    """Two manoeuvres of a mode go on to two others: they share their mode's visits by the flow of these."""
    n_free = len(ring_map.motion) - ring_map.motion.n_placed
    cell = np.array([0, 0, 1, 2] + [-1] * n_free)
    rows = np.append(np.zeros(4, np.int64), np.arange(ring_map.motion.n_placed, len(ring_map.motion)))
    columns = {name: getattr(ring_map.motion, name)[rows] for name in columns_of(ring_map.motion)}
    columns |= {"cell": cell, "mode": np.zeros(cell.size, np.int64), "visits": np.full(cell.size, 4.0)}
    motion = replace(
        ring_map.motion, **columns,
        first=np.array([0, 1, 2, *[2] * (n_free + 2)]), following=np.array([2, 3]), count=np.array([4.0, 4.0]),
    )  # fmt: skip
    flow = schedule_of(ring_map).flow.copy()
    flow[:, 1], flow[:, 2] = 3.0, 1.0
    small = replace(ring_map, motion=motion)
    now = schedule_of(small, flow=flow).applied(small, 0).motion
    np.testing.assert_allclose(now.visits[:4], [6.0, 2.0, 4.0, 4.0])


def columns_of(motion):
    """Names of those with a row for each manoeuvre."""
    return [name for name in motion.__dataclass_fields__ if np.shape(getattr(motion, name))[:1] == (len(motion),)]


@pytest.mark.parametrize("faster", [0.4, 1.0, 1.7])
def test_who_drives_faster_on_the_same_way_accelerates_more_by_its_square(ring_map, faster):
    now, before = (schedule_of(ring_map, pace=f).applied(ring_map, 0).motion for f in (faster, 1.0))
    placed = slice(before.n_placed)
    speed = np.exp(before.log_pace) - CREEP
    np.testing.assert_allclose((np.exp(now.log_pace) - CREEP)[placed], faster * speed[placed], atol=1e-9)
    for gained in (now, before):  # at the centre, at the mean speed
        gained.acceleration[:, 0] += gained.acceleration[:, 3] * (np.exp(gained.log_pace) - CREEP)
    np.testing.assert_allclose(now.acceleration[placed, 0], faster**2 * before.acceleration[placed, 0], atol=1e-9)
    np.testing.assert_array_equal(now.log_pace[before.n_placed :], before.log_pace[before.n_placed :])


def test_what_is_no_schedule_is_refused(ring_map):
    with pytest.raises(ValueError, match="expected the name of a time zone such as Europe/Berlin, got 'Nowhere'"):
        schedule_of(ring_map, zone="Nowhere")
    with pytest.raises(ValueError, match="by: expected one of hour, week, got 'day'"):
        schedule_of(ring_map, by="day")
    with pytest.raises(ValueError, match="flow: expected positive numbers"):
        schedule_of(ring_map, flow=0.0)
    with pytest.raises(ValueError, match="schedule: expected"):
        replace(ring_map, schedule=Schedule(by="hour", zone="UTC", flow=np.ones((24, 1, 1)), pace=np.ones((24, 1, 1))))
