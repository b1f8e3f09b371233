"""Forecasts of vehicles by the beliefs of a tracker that saw their positions until then.

This is what `dirprim track --forecast` does, at the instants of cases. From a point, the course and speed of a
vehicle's last half second, 90 % regions at 1 s held .66 to .74 of the truth: the start was taken to be known, and was a
quarter of a second old.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from dirprim_filter.arrays import FloatArray
from dirprim_filter.config import FilterConfig, TrackingConfig
from dirprim_filter.detections import Detections
from dirprim_filter.estimates import TrackedFrame
from dirprim_filter.evaluation.forecast_cases import Cases, mean_log_energy
from dirprim_filter.evaluation.settings import Axis, Choice, choose
from dirprim_filter.filtering import Tracker
from dirprim_filter.forecasting import Forecaster
from dirprim_filter.instants import LONGEST_UNSEEN_S
from dirprim_filter.primitives._leader import ALONE
from dirprim_filter.primitives.primitive_map import PrimitiveMap
from dirprim_filter.replay import replay
from dirprim_filter.tracks import Tracks

NOISE = Axis("noise_m", 0.1)
"""Of a log's rows; they are tracks already, so it is small."""
MOST_VEHICLES, MOST_SECONDS, MOST_OF_EACH_S, N_SAMPLES = 50, 5000.0, 500.0, 16
"""Of the training vehicles by which the noise is chosen, in all and of each, and rollouts of each case. Ships are seen
for an hour each."""
AT_ONCE = 50
"""So many vehicles that go alone are tracked together."""
ALL = TrackingConfig(confirm_above=1e-9, report_above=1e-9, forget_below=1e-9)
"""Every row is of a vehicle."""


def forecast_beliefs(
    primitive_map: PrimitiveMap, cases: Cases, n_samples: int, rng: np.random.Generator, *,
    horizons_s: tuple[float, ...], noise_m: float = NOISE.start, leaders: bool = False,
) -> FloatArray:  # fmt: skip
    """Rollouts of cases.

    Args:
        primitive_map: how vehicles move at each place.
        cases: n, at rows of their log.
        n_samples: of each case.
        rng: seeds beliefs and rollouts.
        horizons_s: (n_horizons,) ascending, seconds ahead.
        noise_m: metres, standard deviation of the log's positions in each axis.
        leaders: whether sample p of all vehicles seen in the last quarter of a second is one scene.

    Returns:
        (n, n_samples, n_horizons, 2) metres.
    """
    config = FilterConfig(noise_m=noise_m, interaction="leader" if leaders else "none")
    leaders = leaders and primitive_map.motion.leader is not None
    log, vehicle, seeds = cases.log, cases.log.vehicle, rng.integers(2**63, size=2)
    seen = Detections.of(log) if leaders else _begun_at_once(log)
    path = np.empty((cases.row.size, n_samples, len(horizons_s), 2))
    for group in np.unique(cases.group).tolist():
        vehicles = np.unique(cases.vehicle[cases.group == group])
        alone = np.split(vehicles, range(AT_ONCE, vehicles.size, AT_ONCE))
        for part in [vehicles] if leaders else alone:
            own = np.isin(cases.vehicle, part)
            tracked = seen[log.group == group if leaders else np.isin(vehicle, part)].in_one_group()
            belief, rollout = map(np.random.default_rng, seeds)
            tracker = Tracker(
                primitive_map, config=config, tracking=ALL, unseen_s=LONGEST_UNSEEN_S if leaders else 0.0, rng=belief
            )  # fmt: skip
            forecaster = _CaseForecaster(
                primitive_map, cases.name[own].tolist(), seen.time_ns[cases.row[own]].tolist(), horizons_s,
                config=config, n_samples=n_samples, rng=rollout,
            )  # fmt: skip
            replay(tracked.frames(), tracker, [forecaster])
            path[own] = forecaster.path
    return path


def _begun_at_once(log: Tracks) -> Detections:
    """Rows of vehicles of which none matters to another: all from the same time on, where these are fewer frames."""
    since_ns = log.time_ns - log.time_ns[log.first_rows][log.vehicle]
    seen, n_frames = Detections.of(log), np.unique(log.time_ns).size
    return replace(seen, time_ns=since_ns) if np.unique(since_ns).size < n_frames else seen


class _CaseForecaster(Forecaster):
    """Forecasts vehicles (n,) by their names at instants of their own; -> `path`, as far as their frames have come."""

    def __init__(
        self, primitive_map: PrimitiveMap, names: Sequence[str], times_ns: Sequence[int],
        horizons_s: tuple[float, ...], *, config: FilterConfig, n_samples: int, rng: np.random.Generator,
    ) -> None:  # fmt: skip
        super().__init__(primitive_map, (), n_samples=n_samples, config=config, rng=rng)
        self._dt_s = np.diff(horizons_s, prepend=0.0)
        self.path = np.empty((len(names), n_samples, self._dt_s.size, 2))
        self._due: dict[int, dict[str, int]] = {}
        for case, (name, time_ns) in enumerate(zip(names, times_ns, strict=True)):
            self._due.setdefault(time_ns, {})[name] = case

    def write(self, frame: TrackedFrame) -> None:
        """Forecast those whose time it is."""
        if due := self._due.get(frame.time_ns):
            row = {name: i for i, name in enumerate(frame.names)}
            asked = np.array([row[name] for name in due])
            is_there = frame.estimates.unseen_s <= LONGEST_UNSEEN_S
            scene = np.sort(asked) if self._response is ALONE else np.flatnonzero(is_there)
            self.path[[*due.values()]] = self.paths(frame, scene)[np.searchsorted(scene, asked)]


def chosen_noise(
    primitive_map: PrimitiveMap, known: Cases, horizons_s: tuple[float, ...], *, rng: np.random.Generator
) -> tuple[Choice, ...]:
    """The noise with which training vehicles are forecast best, as rivals' settings are chosen; none of few cases."""
    since_ns = known.log.time_ns - known.log.time_ns[known.log.first_rows][known.log.vehicle]
    if since_ns.max(initial=0) > MOST_OF_EACH_S * 1e9:
        known = Cases.of(known.log[since_ns <= MOST_OF_EACH_S * 1e9], horizons_s=horizons_s)
    log, vehicle, seed = known.log, known.log.vehicle[known.row], rng.integers(2**63)
    some = rng.permutation(np.unique(vehicle))[:MOST_VEHICLES]
    seconds = np.cumsum([1e-9 * np.ptp(log.time_ns[log.vehicle == v]) for v in some])
    cases = known.some(np.isin(vehicle, some[seconds <= MOST_SECONDS]))
    if np.isnan(mean_log_energy(np.zeros((cases.row.size, 2, len(horizons_s), 2)), cases.later)):
        return ()

    def score(values: tuple[float, ...]) -> float:
        drawn = np.random.default_rng(seed)
        path = forecast_beliefs(primitive_map, cases, N_SAMPLES, drawn, horizons_s=horizons_s, noise_m=values[0])
        return -mean_log_energy(path, cases.later)

    return choose([NOISE], score)
