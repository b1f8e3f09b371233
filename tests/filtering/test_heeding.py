"""Cues weigh what vehicles are about to do: Eq. 4 over the journeys that they may follow."""

from dataclasses import replace

import numpy as np
import pytest
from scipy import stats

from dirprim_filter import forecast
from dirprim_filter.config import FilterConfig
from dirprim_filter.detections import Detections
from dirprim_filter.filtering.particle_filter import ParticleFilter
from dirprim_filter.primitives.cues import TURN_LEFT, TURN_RIGHT, Cue
from dirprim_filter.primitives.journeys import Journeys
from dirprim_filter.primitives.rows import TrackRows
from dirprim_filter.tracks import Tracks
from situations import one_cell_map

ONLY_JOURNEYS = {"place_free_share": 1e-9, "forecast_place_free_share": 1e-9}


def crossing(*, left, right, straight):
    """So many vehicles that come from the west at 10 m/s and, 10 m on, turn a quarter or go straight on."""
    t = 0.1 * np.arange(71)
    parts = []
    for i, way in enumerate([1.0] * left + [-1.0] * right + [0.0] * straight):
        direction = way * np.pi / 2 * np.clip((t - 1.0) / 1.5, 0.0, 1.0)
        velocity = 10.0 * np.column_stack([np.cos(direction), np.sin(direction)])
        position = np.vstack([np.zeros(2), np.cumsum(0.1 * velocity, axis=0)[:-1]])
        parts.append(
            Tracks(
                track_id=np.full(t.size, i), time_ns=(t * 1e9).round().astype(np.int64), position=position,
                direction=direction, speed=np.full(t.size, 10.0),
            )
        )  # fmt: skip
    rows = TrackRows.thinned(Tracks.concatenate(parts), interval_s=0.05)
    return replace(one_cell_map(), journeys=replace(Journeys.of(rows), strength=1e-9))


def turned_by(primitive_map, cue):
    """Shares of 4,000 futures that went right, straight on and left."""
    paths = forecast(
        primitive_map, position=(0.0, 0.0), direction=0.0, speed=10.0, horizon_s=4.0, n_samples=4000, cue=cue,
        config=FilterConfig(forget_rate=1e-9, **ONLY_JOURNEYS), rng=np.random.default_rng(0),
    )  # fmt: skip
    north = paths[:, -1, 1]
    return np.array([(north < -5).mean(), (np.abs(north) <= 5).mean(), (north > 5).mean()])


@pytest.mark.parametrize("cue", [TURN_LEFT, TURN_RIGHT, Cue(turn=[0.0, np.pi / 2], concentration=[4.0, 1.0])])
def test_of_three_ways_each_is_taken_as_eq_4_says(cue):
    prior = np.array([0.2, 0.5, 0.3])
    ways = crossing(right=4, straight=10, left=6)
    np.testing.assert_allclose(turned_by(ways, None), prior, atol=4 * 0.5 / np.sqrt(4000))
    told = cue.belief(0.0)
    angle = np.array([-np.pi / 2, 0.0, np.pi / 2])
    density = sum(
        w * stats.vonmises(k, loc=m).pdf(angle)
        for w, m, k in zip(told.weight, told.mean_direction, told.concentration, strict=True)
    )
    expected = prior * density / (prior @ density)
    np.testing.assert_allclose(turned_by(ways, cue), expected, atol=0.04)
    assert np.abs(expected - prior).max() > 0.1


def test_a_cue_that_tells_nothing_changes_nothing_and_has_the_density_of_the_circle():
    filter_ = ParticleFilter(crossing(right=2, straight=2, left=2), FilterConfig(n_particles=500, **ONLY_JOURNEYS))
    slot = np.zeros(1, np.int64)
    here = Detections(track_id=np.array(["a"]), time_ns=np.zeros(1, np.int64), position=np.array([[5.0, 0.0]]))
    filter_.begin(slot, np.array([3], np.uint64), here)
    filter_.predict(slot, np.array([0.1]))
    before = filter_.belief.cloud.weight[0].copy()
    assert filter_.heed(slot, Cue(turn=1.0, concentration=0.0))[0] == pytest.approx(-np.log(2 * np.pi))
    np.testing.assert_allclose(filter_.belief.cloud.weight[0], before, rtol=1e-9)
    evidence = filter_.heed(slot, TURN_LEFT)[0]
    assert np.isfinite(evidence)
    assert filter_.belief.cloud.weight[0].sum() == pytest.approx(1.0)
    assert np.abs(np.log(filter_.belief.cloud.weight[0] / before)).max() > 0.5


def test_on_modes_alone_a_cue_weighs_the_turn_to_the_mode():
    filter_ = ParticleFilter(one_cell_map(mean=0.4), FilterConfig(n_particles=50))
    slot = np.zeros(1, np.int64)
    here = Detections(track_id=np.array(["a"]), time_ns=np.zeros(1, np.int64), position=np.zeros((1, 2)))
    filter_.begin(slot, np.array([3], np.uint64), here)
    filter_.belief.cloud.direction[0] = np.linspace(-1, 1, 50)
    filter_.belief.cloud.mode[0], filter_.belief.cloud.cell[0] = 0, 0
    filter_.heed(slot, Cue(turn=0.0, concentration=3.0))
    weight = np.exp(3.0 * np.cos(0.4 - np.linspace(-1, 1, 50)))
    np.testing.assert_allclose(filter_.belief.cloud.weight[0], weight / weight.sum(), rtol=1e-6)
