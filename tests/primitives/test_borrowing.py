"""What cells borrow: laws, and a slow oracle."""

from __future__ import annotations

import numpy as np
import pytest

from dirprim_filter.config import LearningConfig
from dirprim_filter.primitives.assembly import Layout, assemble, fit_cells
from dirprim_filter.primitives.borrowing import borrow
from dirprim_filter.primitives.place_free import fit_place_free
from dirprim_filter.primitives.recipe import Recipe, Usual
from dirprim_filter.primitives.rows import TrackRows
from dirprim_filter.tracks import Tracks
from situations import ring_traffic
from tessellation import GridTessellation

SHARE = 0.4


@pytest.fixture(scope="module")
def ring():
    """Rows on a ring, a fifth of them standing."""
    rng = np.random.default_rng(0)
    tracks = ring_traffic(rng, n_vehicles=30, dt_s=0.5, n_rows=40)
    stands = rng.random(len(tracks)) < 0.2
    speed = np.where(stands, 0.0, tracks.speed)
    return Tracks(
        track_id=tracks.track_id, time_ns=tracks.time_ns, position=tracks.position, direction=tracks.direction,
        speed=speed,
    )  # fmt: skip


@pytest.fixture(scope="module")
def parts(ring):
    """The rows, two layouts whose borders differ, what their cells hold, and the place-free primitive."""
    config = LearningConfig()
    rows = TrackRows.thinned(ring, interval_s=0.2)
    free = fit_place_free(rows, config)
    recipe = Recipe("bic", True, 0.1, Usual(0.0, free.speed_spread), config)
    layouts = [Layout(GridTessellation.covering(rows.position, cell_size=size), 0.0) for size in (9.0, 7.0)]
    return rows, layouts, [fit_cells(rows, layout, recipe) for layout in layouts], free


def test_a_cell_mixes_its_own_modes_with_those_of_overlapping_cells(parts):
    rows, (own, other), (fitted, lent), free = parts
    strength = 1e-12
    borrowed = borrow(rows, own.cells, [(other.cells, lent)], SHARE)
    found = assemble(own.cells, fitted, free, strength, borrowed)
    alone, others = assemble(own.cells, fitted, free, strength), assemble(other.cells, lent, free, strength)
    home, there = own.cells.cell_of(rows.position), other.cells.cell_of(rows.position)
    for i in range(0, len(rows), 97):
        place, direction, speed = rows.position[i], rows.direction[i], max(rows.speed[i], 0.05)
        density = 0.0
        for lender, n in zip(*np.unique(there[home == home[i]], return_counts=True), strict=True):
            offset = place - others.centers[lender]
            modes = others.direction[lender], others.speed[lender]
            turned = modes[0].mean_direction + others.bend[lender] @ offset
            grown = np.exp(-others.gain[lender] @ offset)
            of_direction = np.exp(modes[0].concentration * (np.cos(direction - turned) - 1.0))
            of_direction /= 2.0 * np.pi * np.array([np.i0(k) * np.exp(-k) if k < 700 else (2 * np.pi * k) ** -0.5
                                                    for k in modes[0].concentration])  # fmt: skip
            of_speed = np.exp(type(modes[1])(shape=modes[1].shape, rate=modes[1].rate * grown).log_density(speed))
            density += n / (home == home[i]).sum() * float((modes[0].weight * of_direction * of_speed).sum())
        expected = (1.0 - SHARE) * np.exp(alone.log_density(place, direction, speed)) + SHARE * density
        # What a cell borrows is cut to its heaviest modes: at most a few hundredths of the borrowed share are missing.
        assert np.exp(found.log_density(place, direction, speed)) == pytest.approx(expected, rel=0.05)


def test_borrowed_densities_integrate_to_one(parts):
    rows, (own, other), (fitted, lent), free = parts
    found = assemble(own.cells, fitted, free, 0.3, borrow(rows, own.cells, [(other.cells, lent)] * 2, SHARE))
    assert found.n_borrowed_modes > 0
    assert found.direction.weight.sum(axis=1) == pytest.approx(1.0)
    assert not found.direction.weight[-1, found.n_own_modes : found.n_own_modes + found.n_borrowed_modes].any()
    assert found.own_weight.sum(axis=1) == pytest.approx(
        1.0 - found.direction.weight[:-1, -found.n_place_free_modes :].sum(axis=1)
    )


def test_layouts_of_the_same_cells_lend_what_there_is(parts):
    """The negative control: who borrows from itself has what it had."""
    rows, (own, _), (fitted, _), free = parts
    alone = assemble(own.cells, fitted, free, 0.3)
    twice = assemble(own.cells, fitted, free, 0.3, borrow(rows, own.cells, [(own.cells, fitted)], SHARE))
    at = rows.position[::50], rows.direction[::50], np.maximum(rows.speed[::50], 0.05)
    assert twice.log_density(*at) == pytest.approx(alone.log_density(*at), abs=1e-3)


def test_cells_without_rows_borrow_nothing(parts):
    rows, (own, other), (fitted, lent), _ = parts
    few = rows[own.cells.cell_of(rows.position) == 0]
    borrowed = borrow(few, own.cells, [(other.cells, lent)], SHARE)
    assert borrowed.modes.weight[0].sum() + borrowed.standing[0] == pytest.approx(1.0)
    assert not borrowed.modes.weight[1:].any()
    assert not borrowed.standing[1:].any()
    assert fitted.weight.shape[0] == borrowed.standing.size
