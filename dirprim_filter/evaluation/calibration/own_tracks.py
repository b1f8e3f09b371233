"""What a log without ids shows of its sensor and its scene: the evidence of a tracker of constant velocity.

White noise and acceleration are those under which the log is likeliest; detection probability, clutter and births
follow from what the tracker expects of each hit and miss, by expectation maximisation. Its tracks then serve as ids.

Source: Dempster, Laird and Rubin, Maximum Likelihood from Incomplete Data via the EM Algorithm, 1977; Singh, Whiteley
and Godsill, Approximate Likelihood Estimation of Static Parameters in Multi-Target Models, 2011.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np

from dirprim_filter.arrays import FloatArray
from dirprim_filter.config import FilterConfig, TrackingConfig
from dirprim_filter.detections import NO_ID, Detections
from dirprim_filter.evaluation.calibration.calibrating import Measured, share
from dirprim_filter.evaluation.settings import Axis, choose
from dirprim_filter.filtering import ConstantVelocityKalman, Tracker

MOST_SEARCHED, MOST_FRAMES = 100, 600
"""Frames of all groups together: those that are tracked some ten times, for noise and acceleration, and all."""
NOISE = Axis("noise_m", 0.5, least=1e-3, most=1e3)
ACCELERATION = Axis("acceleration_density", 1.0, factor=8.0, least=1e-5, most=1e4)
STARTS = ((0.5, 1.0), (8.0, 1 / 64), (64.0, 64.0))
"""Metres and m^2/s^3; the likeliest is climbed from: where noise is far too small no track lasts, nor near there."""
N_MAXIMISED = 2
"""Steps of expectation maximisation once noise and acceleration are found."""
FALSE, NEW = 0.3, 0.02
"""Shares of the detections that are of no vehicle, and the first of one, before anything is known."""
FAR = 0.01
"""Quantile of places, beyond which by half the width between both the box ends that clutter is counted in."""
LEAST_GAIN = 1.0
"""Nat for each detection of a vehicle, by which tracks must be likelier than that all are clutter: a few false ones are
in a row by chance, which gains .3 to .6."""


@dataclass(frozen=True, slots=True, kw_only=True)
class OwnTracks:
    """What was found.

    Attributes:
        seen: detections under the names of the tracks that they were assigned to, without an id where to none.
        noise: metres, standard deviation in each axis.
        acceleration_density: m^2/s^3, of white acceleration.
        tracking: detection probability, clutter, births and density of vehicles.
        detection_probability: of them, with its standard error.
        clutter_density: likewise.
        log_density: natural log of the density of all detections, per detection.
    """

    seen: Detections
    noise: Measured
    acceleration_density: float
    tracking: TrackingConfig
    detection_probability: Measured
    clutter_density: Measured
    log_density: float

    @property
    def n_true(self) -> int:
        """Detections of vehicles."""
        return int(np.count_nonzero(self.seen.track_id != NO_ID))


def own_tracks(detections: Detections, *, noise_m: float | None = None) -> OwnTracks:
    """Track the first frames of a log under the parameters of greatest evidence.

    Args:
        detections: of a few minutes; their ids are not looked at. Where they state covariances, these count.
        noise_m: of the detections that state none, if it is known.

    Raises:
        ValueError: nothing moves from frame to frame as vehicles do.
    """
    if len(detections):
        few, scene = (_Scene.of(detections.without_ids(), n_most=n) for n in (MOST_SEARCHED, MOST_FRAMES))
        density, tried = few.n_detections / few.exposure, dict[tuple[float, ...], OwnTracks]()
        unknown = TrackingConfig(
            clutter_density=FALSE * density, birth_density=NEW * density, vehicle_density=(1.0 - FALSE) * density
        )  # fmt: skip

        def log_density(values: tuple[float, ...]) -> float:
            tried[values] = few.tracked(values[0], values[1], unknown)
            return tried[values].log_density

        known = NOISE if noise_m is None else Axis("noise_m", noise_m, least=noise_m, most=noise_m)
        start = max(((noise_m or first, density) for first, density in STARTS), key=log_density)
        axes = known._replace(start=start[0]), ACCELERATION._replace(start=start[1])
        noise, acceleration = (of.chosen for of in choose(axes, log_density))
        by_noise = {n: of.log_density for (n, a), of in tried.items() if a == acceleration}
        measured, found = _likeliest(by_noise, noise, few.n_detections), tried[noise, acceleration]
        for _ in range(N_MAXIMISED):
            found = scene.tracked(measured.value, acceleration, found.tracking)
        gain = found.log_density - (math.log(scene.n_detections / scene.exposure) - 1.0)
        n_hits = found.detection_probability.value * found.tracking.vehicle_density * scene.exposure
        if gain * scene.n_detections > LEAST_GAIN * n_hits:
            return replace(found, noise=measured)
    raise ValueError("expected detections that go on from frame to frame as vehicles do, got none")


class _Scene(NamedTuple):
    """Detections that are tracked, group by group.

    Attributes:
        groups: detections of each.
        area: square metres of all groups.
        exposure: square metres of all groups and their frames.
    """

    groups: tuple[Detections, ...]
    area: float
    exposure: float

    @classmethod
    def of(cls, detections: Detections, *, n_most: int) -> _Scene:
        """The first frames, so many at most."""
        frames = np.unique(np.column_stack([detections.time_ns, detections.group]), axis=0)[:n_most]
        first = detections[detections.time_ns <= frames[-1, 0]]
        groups = tuple(first[first.group == group] for group in np.unique(first.group))
        area = np.array([_area(seen.position) for seen in groups])
        return cls(groups, float(area.sum()), float(area @ [np.unique(seen.time_ns).size for seen in groups]))

    @property
    def n_detections(self) -> int:
        """Of all groups."""
        return sum(map(len, self.groups))

    def tracked(self, noise_m: float, acceleration: float, tracking: TrackingConfig) -> OwnTracks:
        """Track them under these parameters, and count what follows of the rates."""
        config, log_density, n_hits, n_looks = FilterConfig(noise_m=noise_m), 0.0, 0.0, 0.0
        parts, n_tracks, n = list[Detections](), 0, self.n_detections
        for seen in self.groups:
            model = ConstantVelocityKalman(acceleration_density=acceleration, config=config)
            tracker = Tracker(model, config=config, tracking=tracking, rng=np.random.default_rng(0))
            named = [replace(frame, track_id=tracker.track(frame).assigned) for frame in seen.frames()]
            parts.append(Detections.concatenate(named))
            n_tracks += np.unique(parts[-1].track_id[parts[-1].track_id != NO_ID]).size
            log_density += tracker.tally.log_density
            n_hits, n_looks = n_hits + tracker.tally.n_hits, n_looks + tracker.tally.n_looks
        by_chance = self.exposure * (tracking.clutter_density + tracking.birth_density)
        by_chance += self.area * tracking.vehicle_density
        probability, n_false = share(n_hits, n_looks), max(n - n_hits - n_tracks, 0.0)
        clutter = Measured((n_false + 0.5) / self.exposure, math.sqrt(n_false + 1.0) / self.exposure)
        n_born, present = max(n_tracks - self.area * n_looks / self.exposure, 0.0), max(n_looks, 0.5)
        return OwnTracks(
            seen=Detections.concatenate(parts), noise=Measured(noise_m, math.nan), acceleration_density=acceleration,
            tracking=replace(
                tracking, detection_probability=probability.value, clutter_density=clutter.value,
                birth_density=(n_born + 0.5) / self.exposure, vehicle_density=present / self.exposure,
            ),
            detection_probability=probability, clutter_density=clutter, log_density=(log_density - by_chance) / n,
        )  # fmt: skip


def _area(position: FloatArray) -> float:
    """Square metres of the box that holds all places (n, 2) but those far away, a square metre at least."""
    low, high = np.quantile(position, [FAR, 1.0 - FAR], axis=0)
    near = position[(np.abs(position - 0.5 * (low + high)) <= high - low).all(axis=1)]
    return float(np.prod(np.maximum(np.ptp(near, axis=0), 1.0)))


def _likeliest(log_density: dict[float, float], best: float, n: int) -> Measured:
    """The noise of greatest evidence, between those that were tried.

    With m errors of variance s^2 the evidence of noise x is a constant less m (log x + s^2 / (2 x^2)): both neighbours
    on the grid give m and s, and m the standard error s / sqrt(2 m).

    Args:
        log_density: per detection, by noise.
        best: of these.
        n: detections.
    """
    around = [x for x in (best / NOISE.factor, best * NOISE.factor) if x in log_density]
    if len(around) < 2:
        return Measured(best, best)
    lost = [n * (log_density[best] - log_density[x]) for x in around]
    rows = [[math.log(x / best), 0.5 * (x**-2 - best**-2)] for x in around]
    m, squares = np.linalg.solve(rows, lost)
    if m <= 1.0 or squares <= 0.0:
        return Measured(best, best)
    value = float(min(max(math.sqrt(squares / m), around[0]), around[1]))
    return Measured(value, value / math.sqrt(2.0 * m))
