"""Vehicles that weigh more count for more of what vehicles do, and for no more evidence."""

import numpy as np
import pytest

from dirprim_filter import Tracks, learn_primitives, save_map

N = 40
"""Vehicles, of which every fourth drives to the north."""
CROSSING = np.array([30.0, 30.0])
"""Within one cell of 64 m."""


def crossing():
    t = np.arange(0.0, 4.0, 0.2)
    vehicle, time_s = np.repeat(np.arange(N), t.size), np.tile(t, N)
    turned = np.where(vehicle % 4 == 0, np.pi / 2, 0.0)
    spread = np.repeat(np.random.default_rng(0).normal(0.0, 0.05, N), t.size)
    way = 8.0 * (time_s - 2.0)
    return Tracks(
        track_id=vehicle, time_ns=((time_s + vehicle) * 1e9).astype(np.int64), speed=np.full(vehicle.size, 8.0),
        direction=turned + spread,
        position=CROSSING + np.column_stack([way * np.cos(turned), way * np.sin(turned)]),
    )  # fmt: skip


def learned(weight):
    return learn_primitives(
        crossing(), tessellation="grid", cell_size=64.0, weight=weight, rng=np.random.default_rng(0)
    )


def north(primitives):
    of = primitives.primitive_at(CROSSING).direction
    return of.weight[np.abs(of.mean_direction - np.pi / 2) < 0.5].sum()


def test_of_equal_weights_the_map_is_that_of_none(tmp_path):
    files = [tmp_path / f"{name}.mcap" for name in ("none", "ones", "threes")]
    for file, weight in zip(files, (None, np.ones(N), np.full(N, 4.0)), strict=True):
        save_map(learned(weight), file)
    assert len({file.read_bytes() for file in files}) == 1


def test_shares_transitions_and_visits_follow_the_weights():
    weight = np.where(np.arange(N) % 4 == 0, 3.0, 1.0)  # as many of either, by weight
    assert north(learned(weight)) == pytest.approx(0.5, abs=0.01)
    assert north(learned(None)) == pytest.approx(0.25, abs=0.01)  # the negative control
    motion = learned(weight).motion
    placed = slice(motion.n_placed)
    of_course = np.abs(motion.course[placed] - np.pi / 2) < 0.7
    visits = motion.visits[placed]
    assert visits[of_course].sum() / visits.sum() == pytest.approx(0.5, abs=1e-9)
