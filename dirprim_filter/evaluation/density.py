"""How much density each method gives to what held-out vehicles did (the paper's Table I).

Source: Senanayake et al. 2020, Table I: the mean density of held-out directions, and of speeds. A mean density grows
without bound where angles repeat, so the mean log density stands beside it: a proper score, which a method cannot raise
by being sure of itself. Directions and speeds of one method are those of one model: speed is
p(speed | position) = sum_m w_m Gamma(speed; m), and jointly p(direction, speed | position).

All methods learn from the same rows and are judged by the same rows. Baselines get the benefit of every doubt: of the
settings in `DGM_SETTINGS` and `GP_SUBSETS` those are shown that give **the held-out rows**, in hindsight, the greatest
mean log density and, where it is another one, the greatest mean density; no method of ours is granted that. The
uninformative speed knows the range of all speeds.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from itertools import product
from typing import Any, Literal, NamedTuple, Protocol, get_args, get_type_hints, runtime_checkable

import numpy as np

from dirprim_filter.arrays import FloatArray
from dirprim_filter.config import LearningConfig
from dirprim_filter.evaluation.baselines.directional_grid_map import DirectionalGridMap
from dirprim_filter.evaluation.baselines.gaussian_process import DirectionalGaussianProcess
from dirprim_filter.evaluation.baselines.uninformative import Uninformative
from dirprim_filter.evaluation.splits import Fold, SplitBy, honest_split, split, thinned
from dirprim_filter.evaluation.steps import StepCount
from dirprim_filter.primitives import PrimitiveMap, learn_primitives
from dirprim_filter.tracks import Tracks

PRIMITIVE_KINDS: tuple[Any, ...] = get_args(get_type_hints(learn_primitives)["primitive"])
"""What `learn_primitives` can learn: each is a row of the table."""
DGM_SETTINGS = tuple(product(LearningConfig().cell_sizes, (100.0, 1e3, 1e4)))
"""Cell size, metres, and bound of the concentration."""
GP_ROWS = 500
GP_SUBSETS: tuple[Literal["random", "informative"], ...] = ("random", "informative")
"""How the rows of the Gaussian process are chosen."""

Quantity = Literal["direction", "speed", "joint"]


@runtime_checkable
class DirectionModel(Protocol):
    """Whatever predicts directions."""

    def direction_log_density(self, position: FloatArray, direction: FloatArray) -> FloatArray:
        """Natural log of p(direction | position), per radian. (n, 2), (n,) -> (n,)."""
        ...


@runtime_checkable
class MotionModel(DirectionModel, Protocol):
    """Whatever predicts directions and speeds."""

    def speed_log_density(self, position: FloatArray, speed: FloatArray) -> FloatArray:
        """Natural log of p(speed | position), per m/s. (n, 2), (n,) -> (n,)."""
        ...

    def log_density(self, position: FloatArray, direction: FloatArray, speed: FloatArray) -> FloatArray:
        """Natural log of p(direction, speed | position), per radian and m/s. (n, 2), (n,), (n,) -> (n,)."""
        ...


class MapModel(NamedTuple):
    """A map of primitives as a `MotionModel`."""

    learned: PrimitiveMap

    def direction_log_density(self, position: FloatArray, direction: FloatArray) -> FloatArray:
        """Natural log of p(direction | position), per radian. (n, 2), (n,) -> (n,)."""
        return self.learned.direction_log_density(position, direction)

    def speed_log_density(self, position: FloatArray, speed: FloatArray) -> FloatArray:
        """Natural log of the mixture of gammas that holds there, per m/s. (n, 2), (n,) -> (n,)."""
        return self.learned.speed_log_density(position, speed)

    def log_density(self, position: FloatArray, direction: FloatArray, speed: FloatArray) -> FloatArray:
        """Natural log of p(direction, speed | position), per radian and m/s. (n, 2), (n,), (n,) -> (n,)."""
        return self.learned.log_density(position, direction, speed)


Fit = Callable[[Tracks, np.random.Generator], Mapping[str, DirectionModel]]
"""Learns from tracks one model for each setting, by the setting's name."""


class Method(NamedTuple):
    """A row of the table."""

    name: str
    fit: Fit


@dataclass(frozen=True, slots=True, kw_only=True)
class DensityScore:
    """Densities of held-out rows, pooled over the folds.

    Attributes:
        mean: mean density.
        std: its standard deviation over rows.
        fold_std: the standard deviation of the folds' means; NaN for one fold.
        mean_log: mean natural log of the density.
        fold_log_std: the standard deviation of the folds' mean logs; NaN for one fold.
    """

    mean: float
    std: float
    fold_std: float
    mean_log: float
    fold_log_std: float


@dataclass(frozen=True, slots=True, kw_only=True)
class MethodScore:
    """What one method gave to the held-out rows.

    Attributes:
        name: of the method; "..., densest" for the setting of the greatest mean density, where it is not that of
            the greatest mean log density.
        setting: which one was best in hindsight; empty for a method that has but one.
        direction: per radian.
        speed: per m/s; None for a method without speeds.
        joint: of direction and speed together, per radian and m/s; None for a method without speeds.
    """

    name: str
    setting: str
    direction: DensityScore
    speed: DensityScore | None
    joint: DensityScore | None


@dataclass(frozen=True, slots=True, kw_only=True)
class DensityTable:
    """Table I.

    Attributes:
        methods: the rows, in the order in which they were asked for.
        split_by: how rows were held out.
        n_folds: how many times.
        n_rows: rows in all, after thinning and without slow ones.
        n_vehicles: vehicles that they belong to.
        n_held_out: rows that were held out, over all folds.
    """

    methods: tuple[MethodScore, ...]
    split_by: SplitBy
    n_folds: int
    n_rows: int
    n_vehicles: int
    n_held_out: int


def evaluate_density(
    tracks: Tracks,
    *,
    split_by: SplitBy | None = None,
    n_folds: int = 5,
    min_speed: float = 0.5,
    interval_s: float | None = None,
    methods: Sequence[Method] | None = None,
    progress: Callable[[int, int], None] | None = None,
    rng: np.random.Generator,
) -> DensityTable:
    """Learn from a part of the tracks by every method, and score each by the other part.

    Args:
        tracks: observed motion.
        split_by: how rows are held out; left out, by group if there are several, else by vehicle.
        n_folds: how many times.
        min_speed: m/s; rows that are not faster count for nothing, neither here nor there: their direction is the
            body's. 0.5 in the paper; 0 leaves out the rows at rest.
        interval_s: keep only rows of a vehicle at least so far apart; left out, all.
        methods: what to compare; left out, `all_methods`.
        progress: called with the number of steps done, and their total.
        rng: deals the folds and feeds the methods; what one draws changes no other's.

    Raises:
        ValueError: no row is left, or nothing can be held out.
    """
    kept = rows_to_judge(tracks, min_speed=min_speed, interval_s=interval_s)
    by = split_by or honest_split(kept)
    folds = split(kept, by=by, n_folds=n_folds, rng=rng)
    chosen = all_methods(max_speed=float(kept.speed.max())) if methods is None else methods
    children = rng.spawn(len(chosen))
    steps = StepCount(len(chosen) * len(folds), progress)
    return DensityTable(
        methods=tuple(
            row for method, child in zip(chosen, children, strict=True) for row in _scores(method, folds, child, steps)
        ),
        split_by=by,
        n_folds=len(folds),
        n_rows=len(kept),
        n_vehicles=kept.n_tracks,
        n_held_out=sum(len(fold.test) for fold in folds),
    )


def rows_to_judge(tracks: Tracks, *, min_speed: float, interval_s: float | None) -> Tracks:
    """The rows of vehicles in motion, thinned.

    Raises:
        ValueError: none is left.
    """
    moving = tracks[tracks.speed > min_speed]
    kept = moving if interval_s is None or len(moving) == 0 else thinned(moving, interval_s=interval_s)
    if len(kept) == 0:
        raise ValueError(f"tracks: expected rows faster than {min_speed} m/s, got none among {len(tracks)}")
    return kept


def all_methods(*, max_speed: float) -> list[Method]:
    """Every row of the table.

    Args:
        max_speed: m/s, of all rows: given to the uninformative baseline.
    """
    return [
        *(Method(f"primitive, {kind}", _learner(primitive=kind)) for kind in PRIMITIVE_KINDS),
        Method("primitive, the paper's", _learner(primitive="flat", tessellation="grid", modes="dbscan")),
        Method("DGM", _fit_grid_maps),
        Method("GP", _fit_processes),
        Method("place-free", _fit_place_free),
        Method("uninformative", lambda _train, _rng: {"": Uninformative(max_speed=max_speed)}),
    ]


def _learner(**options: Any) -> Fit:
    return lambda train, rng: {"": MapModel(learn_primitives(train, rng=rng, **options))}


def _fit_place_free(train: Tracks, rng: np.random.Generator) -> dict[str, DirectionModel]:
    one_cell = learn_primitives(train, tessellation="grid", n_cells=1, primitive="flat", rng=rng)
    return {"": MapModel(one_cell.without_places())}


def _fit_grid_maps(train: Tracks, _rng: np.random.Generator) -> dict[str, DirectionModel]:
    return {
        f"cells of {size:g} m, concentration up to {bound:g}": DirectionalGridMap.fit(
            train.position, train.direction, cell_size=size, max_concentration=bound
        )
        for size, bound in DGM_SETTINGS
    }


def _fit_processes(train: Tracks, rng: np.random.Generator) -> dict[str, DirectionModel]:
    return {
        f"{GP_ROWS} {subset} rows": DirectionalGaussianProcess.fit(
            train.position, train.direction, n_rows=GP_ROWS, subset=subset, rng=rng
        )
        for subset in GP_SUBSETS
    }


def _scores(method: Method, folds: Sequence[Fold], rng: np.random.Generator, steps: StepCount) -> list[MethodScore]:
    """The rows of one method: its setting that is best in log density, and the densest if that is another."""
    found: dict[str, list[dict[Quantity, FloatArray]]] = {}
    for fold, child in zip(folds, rng.spawn(len(folds)), strict=True):
        for setting, model in method.fit(fold.train, child).items():
            found.setdefault(setting, []).append(_log_densities(model, fold.test))
        steps.add()
    direction = {setting: _summary([fold["direction"] for fold in log_p]) for setting, log_p in found.items()}
    best = max(found, key=lambda setting: direction[setting].mean_log)
    densest = max(found, key=lambda setting: direction[setting].mean)
    shown = {method.name: best} | ({f"{method.name}, densest": densest} if densest != best else {})
    return [_method_score(name, setting, found[setting]) for name, setting in shown.items()]


def _method_score(name: str, setting: str, log_p: list[dict[Quantity, FloatArray]]) -> MethodScore:
    has_speed = "speed" in log_p[0]
    return MethodScore(
        name=name,
        setting=setting,
        direction=_summary([fold["direction"] for fold in log_p]),
        speed=_summary([fold["speed"] for fold in log_p]) if has_speed else None,
        joint=_summary([fold["joint"] for fold in log_p]) if has_speed else None,
    )


def _log_densities(model: DirectionModel, test: Tracks) -> dict[Quantity, FloatArray]:
    """The held-out rows' log densities, of what the model has."""
    found: dict[Quantity, FloatArray] = {"direction": model.direction_log_density(test.position, test.direction)}
    if isinstance(model, MotionModel):
        found["speed"] = model.speed_log_density(test.position, test.speed)
        found["joint"] = model.log_density(test.position, test.direction, test.speed)
    return found


def _summary(log_density: list[FloatArray]) -> DensityScore:
    """What the folds' rows have been given. log_density: for each fold (n_rows of the fold,)."""
    density = np.exp(np.concatenate(log_density))
    return DensityScore(
        mean=float(density.mean()),
        std=float(density.std()),
        fold_std=_std([float(np.exp(fold).mean()) for fold in log_density]),
        mean_log=float(np.concatenate(log_density).mean()),
        fold_log_std=_std([float(fold.mean()) for fold in log_density]),
    )


def _std(values: Sequence[float]) -> float:
    return float(np.std(values, ddof=1)) if len(values) > 1 else float("nan")
