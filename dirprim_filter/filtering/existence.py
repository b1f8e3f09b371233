"""Probability that a track is a vehicle, and how many vehicles are expected that no track is of.

One Markov chain of three states, visible, occluded or gone, for labelled and unlabelled tracks: a track is initialised
by one detection, and each frame, a hit or a miss, updates the probability by Bayes' rule. Vehicles that are there and
were never detected are a Poisson process, thinned by each frame that did not show them. In the first frame they are all
vehicles, where traffic is dense; later mostly those that have just appeared, where trajectories begin.

Source: Musicki, Evans and Stankovic, Integrated Probabilistic Data Association, 1994: their "Markov chain two";
Williams, Marginal Multi-Bernoulli Filters: RFS Derivation of MHT, JIPDA, and Association-Based MeMBer, 2015.
"""

from __future__ import annotations

import numpy as np

from dirprim_filter.arrays import BoolArray, FloatArray
from dirprim_filter.config import FilterConfig, TrackingConfig
from dirprim_filter.primitives.traffic import Traffic

VISIBLE, OCCLUDED, GONE = range(3)
"""The states: visible, occluded, or gone: the vehicle left, or the track always was a false detection."""
N_FIXED_POINT = 30
"""Steps of expectation maximisation towards the traffic's level, which rises to it; a few do where few are doubtful."""

MOST_FALSE = 100.0
"""False detections with an id on all of a map in a frame, at most: beyond a square kilometre its densities shrink."""
LABELLED = 0.01
"""Share of what is expected by chance that comes with the id of a track: a false detection has any id."""
LEVEL_S = 900.0
"""Seconds in which all but 1/e of what is known of the traffic's level is forgotten: within a rush hour it follows."""


def false_density(confidence: FloatArray, config: TrackingConfig) -> FloatArray:
    """(n,) -> (n,) density of false detections, 1/m^2: of a confidence c that of true ones times (1 - c) / c.

    That of true ones is detection probability times vehicle density. Where c is NaN, or 0, as fields of messages are
    that nobody sets, it is the configured density.
    """
    known, true = np.where(confidence > 0.0, confidence, np.nan), config.detection_probability * config.vehicle_density
    return np.where(np.isnan(known), config.clutter_density, true * (1.0 - known) / known)


def at_birth(first: FloatArray, false: FloatArray | float) -> FloatArray:
    """(n, 3) after the detection that initialises a track: the first of a vehicle, or a false one.

    Args:
        first: (n,) density of first detections that was expected there, see `Undetected`.
        false: (n,) that of false ones.
    """
    exists = first / (first + false)
    return np.column_stack([exists, np.zeros_like(exists), 1.0 - exists])


def probability(existence: FloatArray, outside: FloatArray) -> FloatArray:
    """(n, 3) -> (n,) probability that there is a vehicle, visible or occluded.

    Args:
        existence: by state.
        outside: (n,) probability that the vehicle is outside of the map's cells: there one that is occluded has left,
            a visible one has not.
    """
    return np.asarray(existence[:, VISIBLE] + existence[:, OCCLUDED] * (1.0 - outside))


def later(
    existence: FloatArray, dt_s: FloatArray, config: TrackingConfig, *, departs: FloatArray | float,
    pace: FloatArray | float = 1.0,
) -> FloatArray:  # fmt: skip
    """(n, 3) -> (n, 3) after `dt_s` (n,) seconds without a frame.

    Args:
        existence: by state.
        dt_s: seconds.
        config: rates of occlusion and reappearance.
        departs: 1/s, (n,), rate of departure.
        pace: (n,) by which the rates of the configuration are multiplied.
    """
    out, back = pace * config.occlusion_rate, pace * config.reappearance_rate
    stays = np.exp(-departs * dt_s)
    mixes = np.exp(-(out + back) * dt_s)
    exists = existence[:, VISIBLE] + existence[:, OCCLUDED]
    balance = exists * back / (out + back)
    visible = stays * (balance + (existence[:, VISIBLE] - balance) * mixes)
    return np.array([visible, stays * exists - visible, 1.0 - stays * exists]).T.copy()


def after_hit(
    existence: FloatArray, log_density: FloatArray, by_chance: FloatArray, config: TrackingConfig
) -> FloatArray:
    """(n, 3) -> (n, 3) after a hit: an assigned detection with this log density (n,) under the track's belief.

    The detection is of the vehicle; or it is clutter, or the first of another vehicle, expected there in this density
    together (n,), and then this one was missed or is not there.
    """
    gain = np.exp(np.clip(log_density - np.log(by_chance), -50.0, 50.0))
    p = config.detection_probability
    return _by_visible(existence, 1.0 - p + p * gain)


def after_miss(existence: FloatArray, config: TrackingConfig) -> FloatArray:
    """(n, 3) -> (n, 3) after a miss: a frame without a detection of the vehicle."""
    return _by_visible(existence, 1.0 - config.detection_probability)


def _by_visible(existence: FloatArray, likelihood: FloatArray | float) -> FloatArray:
    """Bayes' rule, by what is that much likelier of a visible vehicle than of any other."""
    weight = existence.copy()
    weight[:, VISIBLE] *= likelihood
    return np.asarray(weight / weight.sum(axis=1, keepdims=True))


def of_own_name(moments: FloatArray, n_detections: int) -> FloatArray:
    """(v, 10) -> (v,) false detections with a track's own id where its belief is, 1/m^2, at most.

    No more than the frame's detections are false: of a vehicle that is looked for on square kilometres, minutes later,
    far fewer than a density that holds at each place would have there.

    Args:
        moments: of beliefs, as `BayesFilter.moments`.
        n_detections: of the frame.
    """
    spread = moments[:, 2] * moments[:, 4] - moments[:, 3] ** 2
    return np.asarray(LABELLED * n_detections / (4.0 * np.pi * np.sqrt(np.maximum(spread, 1e-12))))


class Tally:
    """What a tracker's own probabilities say of its log so far, frame after frame as they are updated.

    Attributes:
        log_density: natural log of the density of all detections, given who is assigned; what is expected by chance in
            the whole area of the sensor is not subtracted.
        n_hits: expected number of detections of vehicles, but for those that initialise tracks.
        n_looks: expected number of vehicles in sight, summed over frames.
    """

    def __init__(self) -> None:
        self.log_density = self.n_hits = self.n_looks = 0.0

    def add(self, before: FloatArray, after: FloatArray, is_hit: BoolArray, config: TrackingConfig) -> None:
        """Take what hits and misses (n,) made of existence, (n, 3) -> (n, 3)."""
        others, left = (of[:, OCCLUDED:].sum(axis=1) for of in (before, after))  # these are as likely either way
        norm = np.divide(others, left, out=np.ones_like(left), where=left > 0)  # else there is nothing to compare with
        missed = before[:, VISIBLE] * (1.0 - config.detection_probability) / norm
        self.log_density += float(np.log(norm).sum())
        self.n_looks += float(after[:, VISIBLE].sum())
        self.n_hits += float((after[:, VISIBLE] - missed)[is_hit].sum())


class Undetected:
    """The intensity of vehicles not yet detected, in one group.

    On a map they go on as its vehicles did. New ones begin where its trajectories began, as many as fit the traffic's
    *level*: the mean number of vehicles on the map. It has a gamma distribution, at first exponential about
    `vehicle_density` times the area, learns from first detections, and forgets them within `LEVEL_S`. Elsewhere, and
    without a map, the intensity is `vehicle_density` until frames have thinned it, and `birth_density` new ones in each
    frame.

    Args:
        traffic: of a map; None without one.
        config: detection probability and densities.
        noise: standard deviation of detections.

    Attributes:
        level: mean number of vehicles on the map; 1 without one.
    """

    def __init__(self, traffic: Traffic | None, config: TrackingConfig, noise: FilterConfig) -> None:
        area = 0.0 if traffic is None else float(traffic.tessellation.area.sum())
        self._of_labels = min(LABELLED, MOST_FALSE / max(config.clutter_density * area, 1e-300))
        self._traffic, self.config, self._noise = traffic, config, noise
        self._learns_level = False
        self._first = np.array([1.0, 1.0 / (config.vehicle_density * area) if area > 0 else 1.0])
        self._counts = self._first.copy()  # vehicles found, and those expected at a level of 1
        # of one vehicle on the map, how many are where; without a map so many per square metre
        self._present = np.array([config.vehicle_density]) if traffic is None else traffic.present
        self._share = self._present

    @property
    def level(self) -> float:
        """As above."""
        return float(self._counts[0] / self._counts[1])

    def advance(self, dt_s: float, longest_gap_s: float) -> None:
        """Predict by so many seconds; after a pause in which all tracks ended no vehicle counts as detected."""
        self._counts = self._first + np.exp(-dt_s / LEVEL_S) * (self._counts - self._first)
        if dt_s > longest_gap_s:
            self._share = self._present
        elif self._traffic is not None:
            self._share = self._traffic.later(self._share, dt_s)

    def by_chance(self, position: FloatArray, is_labelled: BoolArray, false: FloatArray | float) -> FloatArray:
        """(n, 2), (n,) -> (n,) expected density of first detections and `false` ones there in this frame, 1/m^2.

        Of those with an id at most a share: all false ones on a map are `MOST_FALSE`.
        """
        expected = self._density(self._per_level(position)) + false
        return np.asarray(expected * np.where(is_labelled, self._of_labels, 1.0))

    def see(self, position: FloatArray, is_labelled: BoolArray, false: FloatArray) -> FloatArray:
        """Take the frame's detections (n, 2) that are of no track, `false` (n,); thin by what the frame would show.

        From those without an id the level is learned: no vehicle that has one has a part in the estimates of others.

        Returns:
            (n,) the density of first detections that was expected at each, by what is known of the level now.
        """
        per_level = self._per_level(position)
        self._learns_level |= self._traffic is not None and not is_labelled.all()
        if self._learns_level:
            found, own, other = self._counts[0], per_level[~is_labelled], false[~is_labelled]
            self._counts[1] += (self.config.detection_probability * self._share).sum()
            for _ in range(N_FIXED_POINT if own.size else 0):
                self._counts[0] = found + (self.level * own / (self._density(own) + other)).sum()
        expected = self._density(per_level)
        self._share = (1.0 - self.config.detection_probability) * self._share
        return expected

    def _per_level(self, position: FloatArray) -> FloatArray:
        """(n, 2) -> (n,) first detections per square metre where the level is 1."""
        seen = self.config.detection_probability * self._share
        if self._traffic is None or not len(position):
            return np.full(len(position), seen[0])
        return self._traffic.density(seen, position, spread_m=self._noise.noise_m)

    def _density(self, per_level: FloatArray) -> FloatArray:
        """(n,) -> (n,) with those that come into sight anywhere."""
        return np.asarray(self.config.birth_density + self.level * per_level)
