"""What a tracking experiment is: all that its result follows from, beside the log and the map."""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from typing import Literal, get_args

from dirprim_filter.config import FilterConfig, TrackingConfig, require_positive
from dirprim_filter.evaluation.metrics.comparison import SIMILARITY_M

Method = Literal["prior", "place-free", "one cell", "constant velocity"]
"""The map, the same filter without the map, the same learning with a single cell; and the Kalman filter."""
METHODS: tuple[Method, ...] = get_args(Method)
CONSTANT_VELOCITY: Method = "constant velocity"
SMOOTHED: tuple[Method, ...] = ("prior", "place-free", CONSTANT_VELOCITY)
"""Those whose smoother is evaluated beside them."""


@dataclass(frozen=True, slots=True, kw_only=True)
class TrackingExperiment:
    """All that a result follows from, beside the log and the map.

    Attributes:
        noise_m: metres, standard deviation of a reported position in each axis.
        miss_rate: probability that a vehicle is not reported in a frame.
        false_per_frame: mean number of false detections in a frame, anywhere among the tracks.
        gap_s: seconds for which each vehicle is out of sight once; 0 for never. Vehicles watched for less than that and
            two seconds before and after it have no gap.
        with_ids: the sensor names its vehicles; false detections then have names of their own.
        learn: share of the vehicles, or groups, that a map is learned from where none is given; the others are tracked.
        n_seeds: number of runs, each with random numbers of its own.
        seed: of the first.
        similarity_m: metres, from which an estimate and a vehicle are not similar at all.
        methods: which are compared.
        smooth: beside each method that has a smoother what that says, and the best smoother of constant velocity.
        filter: parameters of the filters; the noise is the sensor's, and tracks survive a gap.
        tracking: parameters of association. Default: the true ones of the sensor.
    """

    noise_m: float = 0.5
    miss_rate: float = 0.0
    false_per_frame: float = 0.0
    gap_s: float = 3.0
    with_ids: bool = True
    learn: float = 0.7
    n_seeds: int = 5
    seed: int = 0
    similarity_m: float = SIMILARITY_M
    methods: tuple[Method, ...] = METHODS
    smooth: bool = False
    filter: FilterConfig = field(default_factory=FilterConfig)
    tracking: TrackingConfig | None = None

    def __post_init__(self) -> None:
        object.__setattr__(self, "methods", tuple(self.methods))
        unknown = [name for name in self.methods if name not in METHODS]
        if unknown or not self.methods:
            raise ValueError(f"methods: expected some of {', '.join(METHODS)}, got {', '.join(unknown) or 'none'}")
        others = ("with_ids", "methods", "smooth", "filter", "tracking")
        or_zero = ("miss_rate", "false_per_frame", "gap_s", "seed")
        require_positive(self, skip=others, or_zero=or_zero, below_one=("miss_rate", "learn"))
        lasting_s = max(self.filter.max_gap_s, self.gap_s + 1.0)  # else the end of a gap has no estimate to judge
        object.__setattr__(self, "filter", replace(self.filter, noise_m=self.noise_m, max_gap_s=lasting_s))
