"""Every knob, its unit, its default, and why."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import MISSING, dataclass, fields, is_dataclass, replace
from types import UnionType
from typing import Any, Literal, TypeVar, get_args, get_origin, get_type_hints

Made = TypeVar("Made")
PLAIN: dict[Any, tuple[type, ...]] = {float: (int, float), int: (int,), bool: (bool,), Mapping: (dict,)}
"""What files hold for fields of a type."""


@dataclass(frozen=True, slots=True, kw_only=True)
class LearningConfig:
    """How primitives are learned.

    Attributes:
        max_modes: most modes a cell may have of its own. A four-arm junction has up to six manoeuvres in one place.
        max_background_modes: most modes of the background model.
        standing_speed: m/s; slower rows have no meaningful direction and make the mode for standing vehicles.
        row_interval_s: seconds; rows of a vehicle nearer than this to its last kept row are left out.
        dbscan_eps: radians, the reach of a neighbourhood (the paper's method for the number of modes).
        dbscan_share: a core point has this share of the cell's rows within reach, and at least three.
        prior_strength: pseudo-vehicles of the usual spreads of direction and of speed in each mode. They bound the
            concentration that one vehicle, whose rows all point one way, would make unbounded. From .02 to .4 held-out
            densities of cars and bicycles differ by .03 nat; a choice by held-out vehicles lost .03.
        parameter_cost: cost of a parameter of a mode, in units of BIC's: BIC counts vehicles, and several rows of one
            hold more information than one row. 1 loses .05 to .1 nat, .25 loses .02.
        strengths: pseudo-vehicles with which its parent enters each cell, and the background model the last parent: the
            candidates, of which held-out vehicles choose.
        broad_share: weight of a mode's tails: a mode of the same mean, of 16 times the variance. Cells know few
            vehicles, and the next drives otherwise: held-out densities gain .01 to .06 nat.
        bend_scale: rad/m, prior standard deviation of a mode's bend: the tightest turns of vehicles have a radius of
            about 5 m, and most do not turn.
        gain_scale: 1/m, prior standard deviation of the gain of log speed: hard braking at 10 m/s halves the speed in
            15 m.
        max_concentration: bound of a mode's concentration: 0.6 degrees of spread.
        max_shape: bound of a mode's gamma shape: 1 % of spread in speed.
        cell_sizes: metres, the grid's candidates when no size is asked for.
        rows_per_cell: rows of an average cell, the candidates for evenly laid out Voronoi cells; the first also gives
            the usual spreads.
    """

    max_modes: int = 6
    max_background_modes: int = 4
    standing_speed: float = 0.3
    row_interval_s: float = 0.2
    dbscan_eps: float = 0.2
    dbscan_share: float = 0.05
    prior_strength: float = 0.1
    parameter_cost: float = 0.5
    strengths: tuple[float, ...] = (16.0, 8.0, 4.0, 2.0, 1.0)
    broad_share: float = 0.05
    bend_scale: float = 0.1
    gain_scale: float = 0.05
    max_concentration: float = 1e4
    max_shape: float = 1e4
    cell_sizes: tuple[float, ...] = (3.0, 4.5, 7.0, 10.0, 15.0)
    rows_per_cell: tuple[float, ...] = (40.0, 8.0, 18.0, 90.0)

    def scaled(self, length: float) -> LearningConfig:
        """The same for data so many times as sparse: its lengths are longer, its slopes less steep."""
        return replace(
            self, bend_scale=self.bend_scale / length, gain_scale=self.gain_scale / length,
            cell_sizes=tuple(length * size for size in self.cell_sizes),
        )  # fmt: skip

    def __post_init__(self) -> None:
        require_positive(self, or_zero=("broad_share",), below_one=("broad_share",))


LEAST_STEP_S = 1e-3
"""Of the motion model: a pause of seconds has thousands of steps then."""


@dataclass(frozen=True, slots=True, kw_only=True)
class FilterConfig:
    """How vehicles are tracked. What may be 0 is off then.

    Figures are of the ablation in `docs/results.md`.

    Attributes:
        n_particles: samples for each vehicle.
        noise_m: metres, standard deviation of a measured position in each axis.
        outlier_probability: share of measured positions that are wrong: their errors have a tail six times as wide.
            Lost vehicles are found again without it too.
        direction_noise: radians, standard deviation of a measured direction: some degrees, for usual detectors.
        speed_noise: m/s, standard deviation of a measured speed.
        motion_outlier_probability: share of measured directions and speeds that are outliers: detectors confuse
            front and rear, and give standing vehicles any course.
        resample_below: resample when the effective sample size falls below this share of the particles; 0 is never, and
            they are not drawn given measurements either.
        innovation_outlier_rate: 1/s, how often a vehicle leaves its motion model for a moment and is a metre or two off
            it: a belief that is sure of what its vehicle did not do, such as to stop, or to drive back, is not lost.
        own_way_rate: 1/s, how often a vehicle in motion leaves the map's manoeuvres and goes its own way, until it
            enters a cell of which a manoeuvre fits it, or to other motion of the background within seconds: what a map
            of few vehicles does not know. Straight on, by the background's own acceleration.
        step_s: seconds, the step of the motion model: a vehicle at 15 m/s passes 1.5 m in it. Who is measured seldom is
            moved in longer ones, see `particle_filter.longest_step_s`.
        max_gap_s: seconds without a measurement after which a belief ends.
        interaction: "leader": in forecasts vehicles respond to the vehicle ahead, as far as the map's vehicles did;
            "none": each is forecast as if alone. Without leaders the energy score of Lankershim at 5 s is .569 m, with
            them .427 m.
    """

    n_particles: int = 1000
    noise_m: float = 0.5
    outlier_probability: float = 1e-3
    direction_noise: float = 0.1
    speed_noise: float = 0.5
    motion_outlier_probability: float = 0.05
    resample_below: float = 0.5
    innovation_outlier_rate: float = 0.03
    own_way_rate: float = 0.05
    step_s: float = 0.1
    max_gap_s: float = 5.0
    interaction: Literal["none", "leader"] = "leader"

    def __post_init__(self) -> None:
        shares = ("outlier_probability", "motion_outlier_probability")
        may_be_off = (*shares, "resample_below", "innovation_outlier_rate", "own_way_rate")
        require_positive(self, skip=("interaction",), or_zero=may_be_off, below_one=shares)
        if self.step_s < LEAST_STEP_S:
            raise ValueError(
                f"step_s: expected at least {LEAST_STEP_S:g} s, got {self.step_s}: a frame has so many steps"
            )
        if self.interaction not in ("none", "leader"):
            raise ValueError(f"interaction: expected 'none' or 'leader', got {self.interaction!r}")
        if self.resample_below > 1:
            raise ValueError(f"resample_below: expected a share of the particles, got {self.resample_below}")


@dataclass(frozen=True, slots=True, kw_only=True)
class TrackingConfig:
    """How a tracker distinguishes vehicles from false detections, and one vehicle from another.

    Attributes:
        detection_probability: of a vehicle in sight, in each frame.
        clutter_density: false detections per square metre in each frame: one in a square of 100 m. Labelled or not, the
            odds that a first detection is a vehicle are those expected there to this, see `filtering.existence`.
        birth_density: new vehicles per square metre in each frame, anywhere: one in a hundred frames. On a map more are
            expected where trajectories begin.
        vehicle_density: vehicles per square metre to expect before the first frame: as many as false detections. On a
            map it is corrected by those that are found, and they are expected where vehicles were.
        occlusion_rate: 1/s, how often a vehicle is occluded, as by a lorry or a tree.
        reappearance_rate: 1/s, how fast it comes back: after three seconds.
        departure_rate: 1/s, how often a vehicle leaves for good, anywhere; with an id less often where `max_gap_s` is
            over 5 s. On a map more do where trajectories end. Without it autoferry's HOTA falls by 1.1 ± .9 hundredths
            (five seeds).
        gate: squared Mahalanobis distance beyond which a detection is not assigned to a track; one in 3,000 of its own
            is excluded.
        confirm_above: probability of existence from which on a track is reported.
        report_above: probability of existence below which a confirmed track is not reported, until it rises again.
        forget_below: a track ends below this share of the existence that a first detection gives.
        lost_after: consecutive measurements that a belief does not explain, after which it is reinitialised at the
            last: a single one may be an outlier. Of a labelled track, one after more than a second without any.
    """

    detection_probability: float = 0.9
    clutter_density: float = 1e-4
    birth_density: float = 1e-6
    vehicle_density: float = 1e-4
    occlusion_rate: float = 0.05
    reappearance_rate: float = 0.33
    departure_rate: float = 0.01
    gate: float = 16.0
    confirm_above: float = 0.9
    report_above: float = 0.5
    forget_below: float = 0.05
    lost_after: int = 2

    def __post_init__(self) -> None:
        shares = ("detection_probability", "confirm_above", "report_above", "forget_below")
        require_positive(self, or_zero=("occlusion_rate", "departure_rate"), below_one=shares)
        if not self.report_above <= self.confirm_above:
            most = f"confirm_above, {self.confirm_above}"
            raise ValueError(f"report_above: expected at most {most}, got {self.report_above}")


LARGEST = 1e9
"""Of a configuration's numbers: thirty years in seconds, whose nanoseconds still fit into int64."""


def require_positive(
    config: Any, *, skip: tuple[str, ...] = (), or_zero: tuple[str, ...] = (), below_one: tuple[str, ...] = ()
) -> None:
    """Every number of a configuration is positive and at most `LARGEST`, or None; some may be 0, some are below 1.

    Of several at least one is given, and all are such.

    Raises:
        ValueError: names the first that is not.
    """
    for name in config.__dataclass_fields__:
        value = getattr(config, name)
        if name in skip or value is None:
            continue
        numbers = value if isinstance(value, tuple) else (value,)
        expected = ""
        if not (numbers and all(number > 0 or (name in or_zero and number == 0) for number in numbers)):
            expected = "at least 0" if name in or_zero else "a positive number"
        elif name in below_one and max(numbers) >= 1:
            expected = "a share below 1"
        elif max(numbers) > LARGEST:
            expected = f"at most {LARGEST:g}"
        if expected:
            raise ValueError(f"{name}: expected {expected}, got {value}")


def from_table(kind: type[Made], table: object, *, where: str = "") -> Made:
    """A dataclass from the names and values of a file; its fields that are dataclasses have tables of their own.

    Raises:
        ValueError: a name that is unknown or missing, a value of another type, or what the class refuses.
    """
    prefix = f"{where}: " if where else ""
    if not isinstance(table, Mapping):
        raise ValueError(f"{prefix}expected a table of names and values, got {table!r}")  # noqa: TRY004 - a file's, no caller's
    hints, made = get_type_hints(kind), dict(table)
    for name, value in table.items():
        if name not in hints:
            raise ValueError(f"{prefix}{name}: expected one of {', '.join(hints)}")
        may_be_none = isinstance(hints[name], UnionType)
        wanted = get_args(hints[name])[0] if may_be_none else hints[name]
        if value is None and may_be_none:
            continue
        if isinstance(wanted, type) and is_dataclass(wanted):
            made[name] = from_table(wanted, value, where=name)
        elif type(value) not in PLAIN.get(get_origin(wanted) or wanted, (type(value),)):
            raise ValueError(f"{prefix}{name}: expected a value of type {wanted.__name__}, got {value!r}")
    for f in fields(kind):  # type: ignore[arg-type]
        if f.name not in table and f.default is MISSING and f.default_factory is MISSING:
            raise ValueError(f"{prefix}{f.name}: expected a value, got none")
    try:
        return kind(**made)
    except ValueError as error:
        raise ValueError(f"{prefix}{error}") from error
