"""How much density each method gives to what held-out vehicles did (the paper's Table I).

Source: Senanayake et al. 2020, Table I: the mean density of held-out directions, and of speeds. A mean density grows
without bound where angles repeat, so the mean log density leads: a proper score, which a method cannot raise by being
sure of itself. Directions and speeds of one method are those of one model: speed is
p(speed | position) = sum_m w_m Gamma(speed; m), and jointly p(direction, speed | position).

All methods learn from the same rows and are judged by the same rows. A rival's settings are chosen in each fold by the
mean log density (of direction and speed, where it has both) of training vehicles, or groups, that are held out from it
for that; it then learns from all of the training part. The uninformative speed knows the range of all speeds.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any, Literal, NamedTuple, get_args, get_type_hints

import numpy as np

from dirprim_filter.arrays import FloatArray, IntArray
from dirprim_filter.evaluation.density_rivals import DirectionModel, Fit, Method, MotionModel, Uninformative, rivals
from dirprim_filter.evaluation.intervals import Interval, clustered, interval, mean
from dirprim_filter.evaluation.settings import Choice, choose
from dirprim_filter.evaluation.splits import Fold, SplitBy, honest_split, split, thinned
from dirprim_filter.evaluation.steps import StepCount
from dirprim_filter.primitives import PrimitiveMap, learn_primitives
from dirprim_filter.track_ids import vehicle_numbers
from dirprim_filter.tracks import Tracks

PRIMITIVE_KINDS: tuple[Any, ...] = get_args(get_type_hints(learn_primitives)["primitive"])
"""What `learn_primitives` can learn, the default first: each is a row of the table."""
ONE_CELL, WITHOUT_MAP = "one cell", "without the map"
INNER_FOLDS = 4
"""A fourth of the training part chooses a rival's settings."""

Quantity = Literal["direction", "speed", "joint"]


@dataclass(frozen=True, slots=True, kw_only=True)
class DensityScore:
    """Densities of all held-out rows.

    Attributes:
        mean_log: mean natural log of the density, nat, with its interval over vehicles or groups.
        mean: mean density.
        behind: mean log density of the first method less this one's, nat, paired; NaN where the first has none.
    """

    mean_log: Interval
    mean: float
    behind: Interval


@dataclass(frozen=True, slots=True, kw_only=True)
class MethodScore:
    """What one method gave to the held-out rows.

    Attributes:
        name: of the method.
        direction: per radian.
        speed: per m/s; None for a method without speeds.
        joint: of direction and speed together, per radian and m/s; None for a method without speeds.
        settings: what was chosen in each fold, and the range that was searched; empty for what is no rival.
    """

    name: str
    direction: DensityScore
    speed: DensityScore | None
    joint: DensityScore | None
    settings: tuple[tuple[Choice, ...], ...]


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
        methods: what to compare; left out, `all_methods`. The first is compared with each of the others.
        progress: called with the number of steps done, and their total.
        rng: deals the folds and feeds the methods; what one draws changes no other's.

    Raises:
        ValueError: no row is left, or nothing can be held out.
    """
    kept = rows_to_judge(tracks, min_speed=min_speed, interval_s=interval_s)
    by = split_by or honest_split(kept)
    folds = split(kept, by=by, n_folds=n_folds, rng=rng)
    asked = all_methods(max_speed=float(kept.speed.max())) if methods is None else methods
    steps = StepCount(len(asked) * len(folds), progress)
    children = rng.spawn(len(asked))
    found = [_judged(method, folds, by, child, steps) for method, child in zip(asked, children, strict=True)]
    group = np.concatenate([fold.test.group for fold in folds])
    vehicle = vehicle_numbers(np.concatenate([fold.test.track_id for fold in folds]), group)
    cluster = group if by == "group" else vehicle
    return DensityTable(
        methods=tuple(
            _method_score(method.name, judged, found[0], cluster) for method, judged in zip(asked, found, strict=True)
        ),
        split_by=by,
        n_folds=len(folds),
        n_rows=len(kept),
        n_vehicles=kept.n_tracks,
        n_held_out=cluster.size,
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
        Method(ONE_CELL, _learner(n_cells=1)),
        Method(WITHOUT_MAP, _fit_without_map),
        *rivals(),
        Method("uninformative", lambda _train, _values, _rng: Uninformative(max_speed=max_speed)),
    ]


def clusters(table: DensityTable) -> str:
    """What intervals are over."""
    return "groups" if table.split_by == "group" else "vehicles"


def conclusion(table: DensityTable) -> str:
    """One sentence: what the first method gains over the same model without the map, and over the best rivals."""
    rivals = [row for row in table.methods if row.settings]
    without_map = [row.joint for row in table.methods if row.name == WITHOUT_MAP]
    gains = [
        *_gain("", [(score, "the same model without the map") for score in without_map]),
        *_gain("", [(row.joint, f"the best rival, {row.name}") for row in rivals]),
        *_gain("in direction alone ", [(row.direction, f"the best rival, {row.name}") for row in rivals]),
    ]
    return (
        f"the map gives held-out motion {', '.join(gains) or 'nothing that is compared'} (95 % over {clusters(table)})"
    )


def _gain(of: str, scores: Sequence[tuple[DensityScore | None, str]]) -> list[str]:
    """The first method's gain over the best of the scores, if there are any."""
    known = [(score, name) for score, name in scores if score is not None]
    if not known:
        return []
    best, over = max(known, key=lambda scored: scored[0].mean_log.value)
    value, low, high, _ = best.behind
    sure = "" if best.behind.is_apart else ", not distinguishable"
    return [f"{of}{value:+.2f} nat ({low:.2f} to {high:.2f}{sure}) over {over}"]


class Judged(NamedTuple):
    """What one method gave to the held-out rows."""

    log_density: dict[Quantity, FloatArray]  # (n,) each, in order of the folds
    settings: tuple[tuple[Choice, ...], ...]  # of each fold, if it has any


def _judged(method: Method, folds: Sequence[Fold], by: SplitBy, rng: np.random.Generator, steps: StepCount) -> Judged:
    settings, log_density = [], []
    for fold, child in zip(folds, rng.spawn(len(folds)), strict=True):
        chosen = _chosen(method, fold.train, by, child) if method.settings else ()
        model = method.fit(fold.train, tuple(choice.chosen for choice in chosen), child)
        log_density.append(_log_densities(model, fold.test))
        settings.append(chosen)
        steps.add()
    joined = {name: np.concatenate([fold[name] for fold in log_density]) for name in log_density[0]}
    return Judged(joined, tuple(settings) if method.settings else ())


def _chosen(method: Method, train: Tracks, by: SplitBy, rng: np.random.Generator) -> tuple[Choice, ...]:
    """Settings by training vehicles, or groups where these are held out, that are held out once more."""
    n_parts = {"group": np.unique(train.group).size, "vehicle": train.n_tracks}
    inner_by = next(kind for kind in (by, "vehicle", "random") if n_parts.get(kind, 2) > 1)
    inner = split(train, by=inner_by, n_folds=INNER_FOLDS, rng=rng)[0]
    seed = int(rng.integers(2**63))

    def mean_log_density(values: tuple[float, ...]) -> float:
        found = _log_densities(method.fit(inner.train, values, np.random.default_rng(seed)), inner.test)
        return float(found.get("joint", found["direction"]).mean())

    return choose(method.settings, mean_log_density)


def _log_densities(model: DirectionModel, test: Tracks) -> dict[Quantity, FloatArray]:
    """The held-out rows' log densities, of what the model has."""
    found: dict[Quantity, FloatArray] = {"direction": model.direction_log_density(test.position, test.direction)}
    if isinstance(model, MotionModel):
        found["speed"] = model.speed_log_density(test.position, test.speed)
        found["joint"] = model.log_density(test.position, test.direction, test.speed)
    return found


def _method_score(name: str, judged: Judged, first: Judged, cluster: IntArray) -> MethodScore:
    def score(quantity: Quantity) -> DensityScore:
        log_p = judged.log_density[quantity]
        of_first = first.log_density.get(quantity, np.full(log_p.shape, np.nan))
        return DensityScore(
            mean_log=mean_over(cluster, log_p),
            mean=float(np.exp(log_p).mean()),
            behind=mean_over(cluster, of_first - log_p),
        )

    has_speed = "speed" in judged.log_density
    return MethodScore(
        name=name,
        direction=score("direction"),
        speed=score("speed") if has_speed else None,
        joint=score("joint") if has_speed else None,
        settings=judged.settings,
    )


def mean_over(cluster: IntArray, value: FloatArray) -> Interval:
    """The mean over rows with its interval over clusters. (n,), (n,)."""
    return interval(clustered(cluster, [value, np.ones_like(value)]), mean)


def _learner(**options: Any) -> Fit:
    return lambda train, _values, rng: learn_primitives(train, rng=rng, **options)


def _fit_without_map(train: Tracks, _values: tuple[float, ...], rng: np.random.Generator) -> PrimitiveMap:
    one_cell = learn_primitives(train, tessellation="grid", n_cells=1, primitive="flat", rng=rng)
    return one_cell.without_places()
