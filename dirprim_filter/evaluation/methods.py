"""What a tracking experiment compares: one tracker on several motion models, and no tracker at all."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Literal, get_args

import numpy as np

from dirprim_filter.config import FilterConfig
from dirprim_filter.detections import Detections
from dirprim_filter.evaluation.rivals import RIVALS, Rival, fitted
from dirprim_filter.filtering import BayesFilter
from dirprim_filter.filtering.particle_filter import bayes_filter_of
from dirprim_filter.primitives import PrimitiveMap, learn_primitives
from dirprim_filter.sensor import Sensor
from dirprim_filter.tracks import Tracks

RAW: Literal["raw detections"] = "raw detections"
"""No filter: what is reported is the estimate."""
OnMap = Literal["prior", "place-free", "one cell"]
"""The map, the same filter without the map, and the same learning with a single cell."""
Method = Literal[OnMap, Rival, "raw detections"]
METHODS: tuple[Method, ...] = (*get_args(OnMap), *RIVALS, RAW)
SMOOTHED: tuple[Method, ...] = ("prior", "place-free", "constant velocity")
"""Those whose smoother is evaluated beside them."""
MakeFilter = Callable[[], BayesFilter]


def filters(
    methods: tuple[Method, ...], maps: Mapping[Method, PrimitiveMap], seen: Detections, train: Tracks,
    config: FilterConfig, *, sensor: Sensor | None = None,
) -> dict[Method, MakeFilter]:  # fmt: skip
    """What makes the filter of each method that has one.

    Args:
        methods: which.
        maps: of those on a map, see `maps_of`.
        seen: labelled detections of training vehicles, to which the Kalman filters are fitted.
        train: the motion of these.
        config: measurements and particles.
        sensor: errors of the measurements, for those on a map; None: the noise of `config`.

    Raises:
        ValueError: no training vehicle has two rows near in time.
    """

    def particles(on: PrimitiveMap) -> MakeFilter:
        return lambda: bayes_filter_of(on, config, sensor)

    made: dict[Method, MakeFilter] = {name: particles(maps[name]) for name in methods if name in maps}
    return made | {name: fitted(name, seen, train, config) for name in RIVALS if name in methods}


def maps_of(
    methods: tuple[Method, ...], given: PrimitiveMap | None, train: Tracks, *, rng: np.random.Generator,
    one_cell_rng: np.random.Generator,
) -> dict[Method, PrimitiveMap]:  # fmt: skip
    """The maps of the methods that have one: given, or learned from the training vehicles.

    Args:
        methods: which.
        given: a map; None: it is learned.
        train: what the others are learned from.
        rng: feeds the learning of the map.
        one_cell_rng: feeds that of a single cell.
    """
    maps: dict[Method, PrimitiveMap] = {}
    if {"prior", "place-free"}.intersection(methods):
        learned = given or learn_primitives(train, rng=rng)
        maps = {"prior": learned, "place-free": learned.without_places()}
    if "one cell" in methods:
        maps["one cell"] = learn_primitives(train, tessellation="grid", n_cells=1, rng=one_cell_rng)
    return maps
