"""Learning a map of directional primitives from tracks.

Source: Senanayake et al. 2020, section III. Beyond it: direction and speed are fitted together, the number of modes by
BIC; cells are learned jointly with what happens in them (the paper's section VI); modes that few vehicles drive lean on
what is usual, and cells that know little on the background model.
"""

from __future__ import annotations

import logging
from collections.abc import Callable, Iterable
from dataclasses import replace
from os import PathLike
from typing import Literal

import numpy as np

from dirprim_filter.arrays import FloatArray, require
from dirprim_filter.config import LearningConfig
from dirprim_filter.primitives.background import learn_background
from dirprim_filter.primitives.cell_model import assemble, fit_cells
from dirprim_filter.primitives.fitting import bounds_of
from dirprim_filter.primitives.layouts import TRIAL_ROWS, Progress, lay_out, leaning
from dirprim_filter.primitives.leader_learning import learn_leader
from dirprim_filter.primitives.motion_learning import learn_motion
from dirprim_filter.primitives.primitive_map import PrimitiveMap
from dirprim_filter.primitives.rows import TrackRows
from dirprim_filter.tracks import Tracks
from tessellation import Tessellation
from tessellation.gates import residents

logger = logging.getLogger(__name__)

CellsRule = Literal["joint", "voronoi", "grid"]
ModesRule = Literal["bic", "dbscan"]
STAGES = ("cells", "how much each leans on what is usual", "primitives", "how vehicles go on")
"""What is learned, one after the other."""


def learn_primitives(
    tracks: Tracks | Iterable[Tracks],
    *,
    tessellation: CellsRule | Tessellation = "joint",
    cell_size: float | None = None,
    n_cells: int | None = None,
    modes: ModesRule = "bic",
    primitive: Literal["curved", "flat"] = "curved",
    config: LearningConfig | None = None,
    weight: FloatArray | None = None,
    progress: Progress | None = None,
    stage: Callable[[int], None] | None = None,
    rng: np.random.Generator,
) -> PrimitiveMap:
    """Learn how vehicles move at each place.

    Args:
        tracks: observed motion, at once or in parts.
        tessellation: "joint" for Voronoi cells learned together with the primitives, "voronoi" for such by positions
            alone, "grid" for square cells where there are data, or cells that are given: each learns from what is in
            it alone.
        cell_size: metres, side of the grid's cells, or of squares as many as there shall be Voronoi cells; learned from
            held-out vehicles if absent.
        n_cells: about how many cells there shall be, instead of `cell_size`.
        modes: "bic" fits direction and speed together and counts modes by BIC; "dbscan" is the paper's recipe.
        primitive: "curved", a mode's mean direction and log mean speed vary linearly across the cell where BIC says
            so; "flat", constant in a cell as in the paper. With "dbscan" cells are flat.
        config: every other knob.
        weight: (n_tracks,) positive, how many vehicles each stands for: where some were drawn with a known
            probability, its inverse. Of no place, only the primitive takes it into account.
        progress: called with the number of cells and the held-out objective while cells are learned.
        stage: called with the number of each of `STAGES` as it begins.
        rng: chooses the held-out vehicles and the first cells.

    Returns:
        The map; the same for the same tracks and the same state of `rng`.

    Raises:
        ValueError: no rows, or options that do not exist or exclude each other.
        TypeError: no tracks, no configuration, or no generator.
    """
    require("rng", rng, np.random.Generator)
    config = require("config", LearningConfig() if config is None else config, LearningConfig)
    if isinstance(tracks, Tracks | str | PathLike):
        tracks = require("tracks", tracks, Tracks)
    else:
        tracks = Tracks.concatenate(require("tracks", part, Tracks) for part in tracks)
    _check_options(
        tracks, tessellation=tessellation, cell_size=cell_size, n_cells=n_cells, modes=modes, primitive=primitive
    )
    rows = TrackRows.thinned(tracks, interval_s=config.row_interval_s, weight=weight)
    config = config.scaled(rows.scale.length)
    background = learn_background(rows, config, rng=rng.spawn(1)[0])  # what it draws changes no cell
    begin = stage or (lambda _: None)
    begin(0)
    at_once = modes == "bic"
    bounds = bounds_of(
        config, speed_spread=background.speed_spread, curved=at_once and primitive == "curved",
        parameter_cost=config.parameter_cost, with_speed=at_once,
    )  # fmt: skip
    layout = lay_out(
        rows, tessellation, bounds, background, config, cell_size=cell_size, n_cells=n_cells, progress=progress, rng=rng
    )
    begin(1)
    bounds = leaning(rows.some(TRIAL_ROWS, rng=rng), layout, bounds, background)
    begin(2)
    learned = assemble(layout.cells, fit_cells(rows, layout, bounds), background, config)
    logger.info("learned %d cells from %d vehicles", layout.cells.n_cells, rows.n_vehicles)
    n_rows = residents(layout.cells.cell_of(rows.position), layout.cells.centers).start
    begin(3)
    return replace(
        learned,
        motion=replace(learn_motion(learned, rows, background, rng=rng), leader=learn_leader(tracks)),
        n_rows=np.append(np.diff(n_rows), len(rows)),
    )


def _check_options(
    tracks: Tracks,
    *,
    tessellation: object,
    cell_size: float | None,
    n_cells: int | None,
    modes: str,
    primitive: str,
) -> None:
    if len(tracks) == 0:
        raise ValueError("tracks: expected at least one row, got none")
    if isinstance(tessellation, str) and tessellation not in ("joint", "voronoi", "grid"):
        raise ValueError(f"tessellation: expected 'joint', 'voronoi', 'grid' or a Tessellation, got {tessellation!r}")
    if modes not in ("bic", "dbscan"):
        raise ValueError(f"modes: expected 'bic' or 'dbscan', got {modes!r}")
    if primitive not in ("curved", "flat"):
        raise ValueError(f"primitive: expected 'curved' or 'flat', got {primitive!r}")
    given = [name for name, value in (("cell_size", cell_size), ("n_cells", n_cells)) if value is not None]
    if len(given) > 1 or (given and not isinstance(tessellation, str)):
        raise ValueError("tessellation, cell_size, n_cells: at most one of them can decide the cells")
    if n_cells is not None and n_cells < 1:
        raise ValueError(f"n_cells: expected at least 1, got {n_cells}")
