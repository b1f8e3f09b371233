"""Scores of held-out vehicles are those of the maps that would be assembled, one for each strength."""

import numpy as np
import pytest

from dirprim_filter.config import LearningConfig
from dirprim_filter.primitives.assembly import Layout, assemble, fit_cells
from dirprim_filter.primitives.background import learn_background
from dirprim_filter.primitives.choice import BACKGROUND_STRENGTHS, Fold
from dirprim_filter.primitives.recipe import Recipe, Usual
from dirprim_filter.primitives.rows import TrackRows
from tessellation import GridTessellation


@pytest.mark.parametrize("softness", [0.0, 0.25])
def test_a_score_is_the_mean_log_density_by_the_map_of_its_strength(ring, softness):
    rows = TrackRows.thinned(ring[ring.track_id < 12], interval_s=0.3)
    free = learn_background(rows, LearningConfig(), rng=np.random.default_rng(0))
    recipe = Recipe("bic", True, 0.1, Usual(0.0, free.speed_spread), LearningConfig())
    layout = Layout(GridTessellation.covering(rows.position, cell_size=9.0), softness)
    held_out = np.isin(rows.group, (2, 5, 9))
    scores = Fold.of(rows, held_out, free).scores(layout, fit_cells(rows[~held_out], layout, recipe))
    assert scores.shape == BACKGROUND_STRENGTHS.shape

    seen, kept = rows[~held_out], rows[held_out]
    for j in (0, 5, 12):
        made = assemble(layout.cells, fit_cells(seen, layout, recipe), free, float(BACKGROUND_STRENGTHS[j]))
        expected = made.log_density(kept.position, kept.direction, kept.speed).mean()
        assert scores[j] == pytest.approx(expected, abs=1e-8)
    assert np.unique(scores.round(6)).size == scores.size  # the control: none is another's
