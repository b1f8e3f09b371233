"""Cells lean on their parents, as much as their own vehicles are few; vehicles that weigh more count for more."""

import numpy as np
import pytest

from dirprim_filter import learn_primitives, save_map
from dirprim_filter.config import LearningConfig
from dirprim_filter.primitives.background import learn_background
from dirprim_filter.primitives.fitting import Layout, bounds_of, fit_levels
from dirprim_filter.primitives.learning import assemble
from dirprim_filter.primitives.rows import TrackRows
from hexagons import Hexagons
from situations import ring_traffic, tracks_of
from tessellation import GridTessellation, VoronoiTessellation

LAYOUTS = {
    "grid": lambda at: Layout(GridTessellation.covering(at, cell_size=4.0), 0.0),
    "voronoi": lambda at: Layout(
        VoronoiTessellation.lloyd(at, n_cells=60, rng=np.random.default_rng(0), reach=3.0), 0.25
    ),
    "hexagons": lambda at: Layout(Hexagons.covering(at, width=4.0), 0.0),
}


@pytest.mark.parametrize("name", LAYOUTS)
def test_the_density_is_that_of_the_cell_its_parents_and_the_background_by_their_vehicles(name):
    ring = ring_traffic(np.random.default_rng(0), n_vehicles=16)
    config, strength = LearningConfig(broad_share=0.0), 3.0
    rows = TrackRows.thinned(ring, interval_s=0.2)
    background = learn_background(rows, config, rng=np.random.default_rng(0))
    layout = LAYOUTS[name](rows.position)
    levels = fit_levels(rows, layout, bounds_of(config, curved=True))
    assert len(levels) == 3
    learned = assemble(layout.cells, levels, background, config, strength)
    cell, speed = layout.cells.cell_of(rows.position), np.maximum(rows.speed, 0.01)
    n_rows = [np.bincount(of[cell], minlength=len(fits.center)) for fits, of in levels]
    expected, left = np.zeros(len(rows)), np.ones(len(rows))
    for (fits, of), n in zip(levels, n_rows, strict=True):
        if layout.softness == 0.0:  # all that children have, parents have, each row once
            np.testing.assert_allclose(fits.n_rows, n)
        own = fits.log_density(of[cell], rows.position, rows.direction, speed, float(background.modes.rate[0, -1]))
        share = left * (fits.n_vehicles / (fits.n_vehicles + strength))[of[cell]]
        expected, left = expected + share * np.exp(own), left - share
    expected += left * np.exp(background.log_density(rows, speed))
    found = learned.log_density(rows.position, rows.direction, speed)
    np.testing.assert_allclose(found, np.log(expected), atol=1e-9)


def test_few_vehicles_are_learned_better_with_parents_and_by_the_strength_that_they_choose():
    """Mean log density of vehicles that were not seen; of cells that lean on nothing it is .2 nat lower and more."""
    few, seen = (ring_traffic(np.random.default_rng(seed), n_vehicles=n) for seed, n in ((1, 8), (2, 30)))
    at = seen.position, seen.direction, np.maximum(seen.speed, 0.01)
    cells = GridTessellation.covering(few.position, cell_size=2.0)

    def density(*strengths):
        config = LearningConfig(strengths=strengths)
        learned = learn_primitives(few, tessellation=cells, config=config, rng=np.random.default_rng(0))
        return learned.log_density(*at).mean()

    strengths = (16.0, 8.0, 4.0, 2.0, 1.0)
    chosen, each = density(*strengths), [density(strength) for strength in strengths]
    assert min(each) <= chosen <= max(each)
    assert chosen > density(1e-3) + 0.2
    assert chosen > max(each) - 0.05


N = 40
"""Vehicles, of which every fourth drives to the north."""
CROSSING = np.array([30.0, 30.0])
"""Within one cell of 64 m."""


def learned(weight):
    vehicle, time_s = np.arange(N)[:, None], np.arange(0.0, 4.0, 0.2)
    turned = np.where(vehicle % 4 == 0, np.pi / 2, 0.0)
    way = 8.0 * (time_s - 2.0)[:, None] * np.stack([np.cos(turned), np.sin(turned)], axis=-1)
    time_ns, spread = ((time_s + vehicle) * 1e9).astype(np.int64), np.random.default_rng(0).normal(0.0, 0.05, (N, 1))
    crossing = tracks_of(CROSSING + way, time_ns=time_ns, direction=turned + spread, speed=8.0)
    return learn_primitives(crossing, tessellation="grid", cell_size=64.0, weight=weight, rng=np.random.default_rng(0))


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
