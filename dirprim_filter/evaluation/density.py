"""How much density each method gives to what held-out vehicles did (the paper's Table I).

Source: Senanayake et al. 2020, Table I: the mean density of held-out directions, and of speeds. A mean density grows
without bound where angles repeat, so the mean log density leads: a proper score, which a method cannot raise by being
sure of itself. Directions and speeds of one method are those of one model: speed is
p(speed | position) = sum_m w_m Gamma(speed; m), and jointly p(direction, speed | position).

All methods learn from the same rows and are judged by the same rows. A rival's settings are chosen in each fold by the
mean log density of training vehicles, or groups, that are held out from it
for that; it then learns from all of the training part. The uninformative speed knows the range of all speeds. Limits of
settings are those of the data: logs do not know positions better than to a decimetre, nor courses than to 1e-4 rad
(those of SUMO are rounded to .01 degrees); where directions repeat exactly the likelihood grows without bound as modes
grow narrow.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any, NamedTuple, get_args, get_type_hints

import numpy as np

from dirprim_filter.arrays import FloatArray
from dirprim_filter.course import MOVING_FROM
from dirprim_filter.distributions.angles import TWO_PI
from dirprim_filter.evaluation.baselines.directional_grid_map import DirectionalGridMap
from dirprim_filter.evaluation.baselines.gaussian_process import DirectionalGaussianProcess
from dirprim_filter.evaluation.intervals import Interval, mean_over
from dirprim_filter.evaluation.settings import Axis, Choice, choose
from dirprim_filter.evaluation.splits import Fold, SplitBy, honest_split, split, steps, thinned
from dirprim_filter.evaluation.without_map import background_motion
from dirprim_filter.primitives.learning import learn_primitives
from dirprim_filter.track_ids import vehicle_numbers
from dirprim_filter.tracks import Tracks

Fit = Callable[[Tracks, tuple[float, ...], np.random.Generator], Any]
"""Learns from tracks, with values of the settings, a model of directions, or of directions and speeds."""


def log_densities(model: Any, test: Tracks) -> dict[str, FloatArray]:
    """(n,) natural logs of `direction`, per radian, and, of a model that has them, `speed`, per m/s, and `joint`."""
    found = {"direction": model.direction_log_density(test.position, test.direction)}
    if hasattr(model, "log_density"):
        found["speed"] = model.speed_log_density(test.position, test.speed)
        found["joint"] = model.log_density(test.position, test.direction, test.speed)
    return found


class Method(NamedTuple):
    """A row of the table.

    Attributes:
        name: of the row.
        fit: learns its model.
        settings: to choose by held-out training vehicles; of our own methods, which choose for themselves, none.
    """

    name: str
    fit: Fit
    settings: tuple[Axis, ...] = ()


PRIMITIVE_KINDS: tuple[Any, ...] = get_args(get_type_hints(learn_primitives)["primitive"])
"""What `learn_primitives` can learn, the default first: each is a row of the table."""
WITHOUT_MAP = "without the map"


def all_methods(*, max_speed: float) -> list[Method]:
    """Every row of the table.

    Args:
        max_speed: m/s, of all rows: given to the uninformative baseline.
    """
    return [
        *(Method(f"primitive, {kind}", _learner(primitive=kind)) for kind in PRIMITIVE_KINDS),
        Method("primitive, the paper's", _learner(primitive="flat", tessellation="grid", modes="dbscan")),
        Method("one cell", _learner(n_cells=1)),
        Method(WITHOUT_MAP, lambda train, _values, rng: background_motion(train, rng=rng)),
        *rivals(),
        Method("uninformative", lambda _train, _values, _rng: Uninformative(max_speed=max_speed)),
    ]


def rivals() -> list[Method]:
    """Published methods, of direction alone."""
    return [
        Method(
            "DGM", _fit(DirectionalGridMap.fit, "cell_size", "max_concentration", "pseudo_count"),
            (
                Axis("cell size, m", start=3.0, factor=1.5, least=0.1),
                Axis("greatest concentration", start=1e3, factor=3.0, most=1e8),
                Axis("pseudo-count, rows", start=1.0, factor=3.0),
            ),
        ),
        Method(
            "GP", _fit(DirectionalGaussianProcess.fit, "length", "noise", rng=True),
            (Axis("length, m", start=10.0, least=0.1), Axis("noise", start=0.1, least=1e-4)),
        ),
    ]  # fmt: skip


def _fit(fit: Callable[..., Any], *names: str, rng: bool = False) -> Fit:
    """Fits to positions and directions, with the settings of these names."""

    def learn(train: Tracks, values: tuple[float, ...], own: np.random.Generator) -> Any:
        settings = dict(zip(names, values, strict=True)) | ({"rng": own} if rng else {})
        return fit(train.position, train.direction, **settings)

    return learn


def _learner(**options: Any) -> Fit:
    return lambda train, _values, rng: learn_primitives(train, rng=rng, **options)


@dataclass(frozen=True, slots=True, kw_only=True)
class Uninformative:
    """1 / (2 pi) = 0.159 for every direction, and a uniform density of speed from 0 to `max_speed`, m/s."""

    max_speed: float

    def direction_log_density(self, position: FloatArray, direction: FloatArray) -> FloatArray:
        """Natural log of p(direction | position), per radian. (..., 2), (...) -> (...)."""
        return np.full(np.broadcast_shapes(position.shape[:-1], direction.shape), -np.log(TWO_PI))

    def speed_log_density(self, position: FloatArray, speed: FloatArray) -> FloatArray:
        """Natural log of p(speed | position), per m/s; -inf out of range. (..., 2), (...) -> (...)."""
        inside = (speed >= 0) & (speed <= self.max_speed)
        shape = np.broadcast_shapes(position.shape[:-1], speed.shape)
        return np.broadcast_to(np.where(inside, -np.log(self.max_speed), -np.inf), shape)

    def log_density(self, position: FloatArray, direction: FloatArray, speed: FloatArray) -> FloatArray:
        """Natural log of p(direction, speed | position), per radian and m/s. (..., 2), (...), (...) -> (...)."""
        return self.direction_log_density(position, direction) + self.speed_log_density(position, speed)


INNER_FOLDS = 4
"""A fourth of the training part chooses a rival's settings."""


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
        interval_s: keep only rows of a vehicle at least so far apart; left out, all.
        methods: what to compare; left out, `all_methods`. The first is compared with each of the others.
        progress: called with the number of steps done, and their total.
        rng: deals the folds and feeds the methods; what one draws changes no other's.

    Raises:
        ValueError: no row is left, or nothing can be held out.
    """
    kept = rows_to_judge(tracks, interval_s=interval_s)
    by = split_by or honest_split(kept)
    folds = split(kept, by=by, n_folds=n_folds, rng=rng)
    asked = all_methods(max_speed=float(kept.speed.max())) if methods is None else methods
    done = steps(len(asked) * len(folds), progress)
    group = np.concatenate([fold.test.group for fold in folds])
    vehicle = vehicle_numbers(np.concatenate([fold.test.track_id for fold in folds]), group)
    cluster = group if by == "group" else vehicle
    rows: list[MethodScore] = []
    first: dict[str, FloatArray] = {}
    for method, own in zip(asked, rng.spawn(len(asked)), strict=True):
        log_p, settings = _judged(method, folds, by, own, done)
        first = first or log_p
        unknown = np.full(cluster.shape, np.nan)
        scores = {
            quantity: DensityScore(
                mean_log=mean_over(cluster, values), mean=float(np.exp(values).mean()),
                behind=mean_over(cluster, first.get(quantity, unknown) - values),
            )
            for quantity, values in log_p.items()
        }  # fmt: skip
        rows.append(
            MethodScore(
                name=method.name, direction=scores["direction"], speed=scores.get("speed"), joint=scores.get("joint"),
                settings=settings,
            )
        )  # fmt: skip
    return DensityTable(
        methods=tuple(rows), split_by=by, n_folds=len(folds), n_rows=len(kept), n_vehicles=kept.n_tracks,
        n_held_out=cluster.size,
    )  # fmt: skip


def rows_to_judge(tracks: Tracks, *, interval_s: float | None) -> Tracks:
    """The rows of vehicles in motion, thinned.

    Raises:
        ValueError: none is left.
    """
    moving = tracks[tracks.speed > MOVING_FROM]
    kept = moving if interval_s is None or len(moving) == 0 else thinned(moving, interval_s=interval_s)
    if len(kept) == 0:
        raise ValueError(f"tracks: expected rows faster than {MOVING_FROM} m/s, got none among {len(tracks)}")
    return kept


def clusters(table: DensityTable) -> str:
    """What intervals are over."""
    return "groups" if table.split_by == "group" else "vehicles"


def conclusion(table: DensityTable) -> str:
    """One sentence: what the first method gains over the same model without the map, and over the best rivals."""
    rivals = [row for row in table.methods if row.settings]
    without_map = [row.joint for row in table.methods if row.name == WITHOUT_MAP]
    gains = [
        *_gain("", [(score, "the same model without the map") for score in without_map]),
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
    sure = "" if best.behind.is_apart else ", not distinguishable"
    return [f"{of}{best.behind.value:+.2f} nat ({best.behind.ends('.2f')}{sure}) over {over}"]


def _judged(
    method: Method, folds: Sequence[Fold], by: SplitBy, rng: np.random.Generator, done: Callable[[], None]
) -> tuple[dict[str, FloatArray], tuple[tuple[Choice, ...], ...]]:
    """The log densities of the held-out rows, (n,) each, in order of the folds, and each fold's settings, if any."""
    settings, log_p = [], []
    for fold, own in zip(folds, rng.spawn(len(folds)), strict=True):
        chosen = _chosen(method, fold.train, by, own) if method.settings else ()
        log_p.append(log_densities(method.fit(fold.train, tuple(of.chosen for of in chosen), own), fold.test))
        settings.append(chosen)
        done()
    joined = {name: np.concatenate([fold[name] for fold in log_p]) for name in log_p[0]}
    return joined, tuple(settings) if method.settings else ()


def _chosen(method: Method, train: Tracks, by: SplitBy, rng: np.random.Generator) -> tuple[Choice, ...]:
    """Settings by training vehicles, or groups where these are held out, that are held out once more."""
    n_parts = {"group": np.unique(train.group).size, "vehicle": train.n_tracks}
    inner_by = next(kind for kind in (by, "vehicle", "random") if n_parts.get(kind, 2) > 1)
    inner = split(train, by=inner_by, n_folds=INNER_FOLDS, rng=rng)[0]
    seed = int(rng.integers(2**63))

    def mean_log_density(values: tuple[float, ...]) -> float:
        found = log_densities(method.fit(inner.train, values, np.random.default_rng(seed)), inner.test)
        return float(found["direction"].mean())

    return choose(method.settings, mean_log_density)
