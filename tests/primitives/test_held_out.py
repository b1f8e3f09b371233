"""Scores of held-out vehicles are those of the maps that would be assembled, one for each share and strength."""

import numpy as np
import pytest

from dirprim_filter.config import LearningConfig
from dirprim_filter.primitives.assembly import Layout, assemble, fit_cells
from dirprim_filter.primitives.borrowing import SHARES, borrow
from dirprim_filter.primitives.held_out import PLACE_FREE_STRENGTHS, HeldOut
from dirprim_filter.primitives.place_free import fit_place_free
from dirprim_filter.primitives.recipe import Recipe, Usual
from dirprim_filter.primitives.rows import TrackRows
from tessellation import GridTessellation


@pytest.mark.parametrize("n_layouts", [1, 3])
def test_a_score_is_the_mean_log_density_by_the_map_of_its_share_and_strength(ring, n_layouts):
    rows = TrackRows.thinned(ring[ring.track_id < 12], interval_s=0.3)
    free = fit_place_free(rows, LearningConfig())
    recipe = Recipe("bic", True, 0.1, Usual(0.0, free.speed_spread), LearningConfig())
    sizes, softness = (9.0, 7.0, 5.0), (0.25, 0.25, 0.0)
    layouts = [
        Layout(GridTessellation.covering(rows.position, cell_size=size), soft)
        for size, soft in zip(sizes[:n_layouts], softness, strict=False)
    ]
    held_out = np.isin(rows.group, (2, 5, 9))
    fold = HeldOut(rows, held_out, free)
    fold.scores(layouts, recipe._replace(prior_strength=1.0))  # another recipe on the same cells changes nothing
    scores = fold.scores(layouts, recipe)
    assert scores.shape == (len(SHARES) if n_layouts > 1 else 1, PLACE_FREE_STRENGTHS.size)

    seen, kept = rows[~held_out], rows[held_out]
    own, *others = layouts
    lenders = [(other.cells, fit_cells(seen, other, recipe)) for other in others]
    for i, share in enumerate(SHARES[: len(scores)]):
        borrowed = borrow(seen, own.cells, lenders, share) if lenders else None
        for j in (0, 5, 12):
            made = assemble(own.cells, fit_cells(seen, own, recipe), free, float(PLACE_FREE_STRENGTHS[j]), borrowed)
            expected = made.log_density(kept.position, kept.direction, kept.speed).mean()
            assert scores[i, j] == pytest.approx(expected, abs=1e-8)
    assert np.unique(scores.round(6)).size == scores.size  # the control: none is another's
