"""Beliefs about many vehicles, frame by frame: those that their sensor labels, and those it does not."""

from __future__ import annotations

import logging
from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from itertools import compress
from os import PathLike

import numpy as np

from dirprim_filter.arrays import BoolArray, FloatArray, IntArray, require
from dirprim_filter.config import FilterConfig, TrackingConfig
from dirprim_filter.detections import NO_ID, NO_TIME, Detections, check_after
from dirprim_filter.estimates import Estimates, Particles, TrackedFrame
from dirprim_filter.filtering import existence
from dirprim_filter.filtering.association import Hits, associated
from dirprim_filter.filtering.belief import birth_key
from dirprim_filter.filtering.cued_motion import CuedMotion
from dirprim_filter.filtering.existence import Undetected
from dirprim_filter.filtering.measurements import innovation, with_unseen_errors
from dirprim_filter.filtering.particle_filter import bayes_filter_of
from dirprim_filter.filtering.protocols import BayesFilter, OnMap
from dirprim_filter.filtering.roster import Roster
from dirprim_filter.filtering.smoothing.recorder import Recorder
from dirprim_filter.primitives.primitive_map import PrimitiveMap
from dirprim_filter.sensor import Sensor

logger = logging.getLogger(__name__)

NO_ROWS: IntArray = np.empty(0, np.int64)

AWAY_S = 1.0
"""Where a belief does not reach a labelled vehicle that is back after longer than this, the belief is wrong: after
seconds unseen that is likelier than that the first measurement is an outlier."""


@dataclass(slots=True, kw_only=True)
class _Frame:
    """The current frame, and the tracks that its detections are assigned to."""

    detections: Detections = field(default_factory=Detections.none)  # with the times when they were true
    hits: Hits = field(default_factory=lambda: Hits(NO_ROWS, NO_ROWS))  # tracks of earlier frames, and their rows
    by_chance: FloatArray = field(default_factory=lambda: np.empty(0))  # (d,) density of clutter and first detections
    home: IntArray = field(default_factory=NO_ROWS.copy)  # slots of tracks to report: seen, absent, unlabelled
    n_aside: int = 0  # how many beliefs were moved aside
    held: IntArray = field(default_factory=NO_ROWS.copy)  # the slots that hold their beliefs at the frame's time
    is_scan: bool = True  # the sensor looked
    moments: FloatArray | None = None  # of those, once they are weighed
    innovation: FloatArray | None = None  # (slots,) as in `TrackedFrame`, where they were asked for
    lost: IntArray = field(default_factory=NO_ROWS.copy)  # the slots of reinitialised beliefs


class Tracker:
    """Tracks the vehicles of a log, also while they are occluded.

    A labelled detection is assigned to the track of its id, an unlabelled one to the track that predicted it best; one
    that is not assigned initialises a track. A track exists with a probability, see `existence`. It is reported once it
    is confirmed, as long as that probability is above one half.

    The belief of a labelled track moves from its own measurement to its next, cut in whole steps from its own, never by
    the times of others. Where vehicles respond to leaders, those of the frame before are looked at; else the belief of
    a vehicle does not depend on which other vehicles the log contains.

    Args:
        model: a map, for a particle filter on it; or any other filter.
        config: parameters of the filter; left out, the defaults.
        tracking: parameters of association and existence; left out, the defaults.
        sensor: its errors, for a particle filter on the map; left out, the isotropic noise of `config`. What it states
            of misses, clutter and outliers replaces that of the configurations, for any filter.
            Beliefs are of the time when a detection was true, its latency ago; estimates are of the frame's own time.
        with_innovations: report innovations, to find the frame where a filter went wrong; costs some 5 % of the time.
        recorder: keeps what a smoother needs.
        rng: one number drawn from it seeds every vehicle, together with its id.

    Attributes:
        sensor: as given.
        recoveries: number of beliefs that no longer explained their vehicle's positions and were reinitialised.
    """

    def __init__(
        self, model: PrimitiveMap | BayesFilter, *, config: FilterConfig | None = None,
        tracking: TrackingConfig | None = None, sensor: Sensor | None = None, with_innovations: bool = False,
        recorder: Recorder | None = None, rng: np.random.Generator,
    ) -> None:  # fmt: skip
        self.config = require("config", FilterConfig() if config is None else config, FilterConfig)
        self.tracking = require("tracking", TrackingConfig() if tracking is None else tracking, TrackingConfig)
        require("rng", rng, np.random.Generator)
        if isinstance(model, str | PathLike):
            raise TypeError(f"model: expected a map or a filter, got the path {str(model)!r}; load_map reads it")
        if sensor is not None:
            self.config, self.tracking = require("sensor", sensor, Sensor).informs(self.config, self.tracking)
        self.sensor = sensor
        self.recoveries = 0
        self._with_innovations = with_innovations
        self._filter = bayes_filter_of(model, self.config, sensor)
        self._recorder = recorder
        if recorder is not None:
            recorder.follow(self._filter)
        self._latency_ns = 0 if sensor is None else round(sensor.latency_s * 1e9)
        self._roster = Roster(self._filter, self.tracking, max_gap_s=self.config.max_gap_s)
        self._motion = CuedMotion(self._filter, self._roster, recorder, step_s=self.config.step_s)
        self._on_map = self._filter if isinstance(self._filter, OnMap) else None
        traffic = None if self._on_map is None else self._on_map.traffic
        self._undetected = Undetected(traffic, self.tracking, self.config)
        self._seed = int(rng.integers(2**63))
        self._time_ns = self._scanned_ns = NO_TIME
        self._frame = _Frame()

    @property
    def longest_gap_ns(self) -> int:
        """As of the `Roster`."""
        return self._roster.longest_gap_ns

    def step(self, detections: Detections, *, time_ns: int | None = None) -> Estimates:
        """The estimates of a frame; as `track`, errors included."""
        return self.track(detections, time_ns=time_ns).estimates

    def track(self, detections: Detections, *, time_ns: int | None = None, is_scan: bool = True) -> TrackedFrame:
        """A whole frame: resample, predict to its time, weigh by its detections, estimate.

        Args:
            detections: one instant, each id once; none is no frame, unless `time_ns` says when nothing was seen.
            time_ns: the frame's time; left out, that of its detections.
            is_scan: the sensor looked; else no vehicle was missed at `time_ns`, which is between its frames.

        Returns:
            All of the frame; confirmed tracks are reported. Labelled ones of the frame come first, in its order, then
            absent and unlabelled ones. Of the samples copies can be taken until the next frame.

        Raises:
            ValueError: several instants or groups, a repeated id, time going backwards, or another time than that of
                the detections; the beliefs are as before.
        """
        require("detections", detections, Detections)
        if self._latency_ns:
            detections = replace(detections, time_ns=detections.time_ns - self._latency_ns)
            time_ns = None if time_ns is None else time_ns - self._latency_ns
        if time_ns is None or len(detections):
            asked_ns, time_ns = time_ns, detections.instant(after_ns=self._time_ns)
            if asked_ns not in (None, time_ns):
                raise ValueError(f"time_ns: expected {time_ns}, that of the detections, got {asked_ns}")
        else:
            check_after(time_ns, self._time_ns)
        is_frame = time_ns > self._time_ns
        self._filter.resample(self._frame.hits.slot)  # who was weighed by the frame before
        self._time_ns = time_ns
        self._frame = _Frame(detections=detections, is_scan=is_scan)
        if is_frame:
            self._predict()
            self._weigh()
        return self._tracked()

    def _predict(self) -> None:
        """Predict beliefs to the frame's time, assign its detections, and initialise tracks at those not assigned."""
        frame, time_ns = self._frame, self._time_ns
        detections = frame.detections
        is_labelled = detections.track_id != NO_ID
        labels, row = detections.track_id[is_labelled].tolist(), np.flatnonzero(is_labelled)
        if frame.is_scan:
            self._roster.see(labels, time_ns)
            passed_ns, self._scanned_ns = time_ns - self._scanned_ns, time_ns
            frame.by_chance = self._by_chance(is_labelled, passed_ns)
        self._roster.forget(now_ns=time_ns)
        frame.hits = Hits.concatenate([self._match(labels, row), self._associate(np.flatnonzero(~is_labelled))])
        if frame.is_scan:
            is_new = np.ones(len(detections), np.bool_)
            is_new[frame.hits.row] = False
            self._begin_tracks(np.flatnonzero(is_new), is_labelled)
        self._hold(labels)

    def _weigh(self) -> None:
        """Weigh the moved beliefs by the frame's measurements; reinitialise those that have lost their vehicle.

        Then learn from hits and misses which tracks are of vehicles. A measurement that a belief does not explain is a
        miss: it came from somewhere else.
        """
        frame, roster, time_ns = self._frame, self._roster, self._time_ns
        slot, row = frame.hits
        measured = frame.detections[row]
        self._motion.change_cues(slot, measured.cue)
        if self._with_innovations:
            frame.innovation = np.full(roster.time_ns.size, np.nan)
            frame.innovation[slot] = innovation(self._filter.moments(slot), measured, self.config, self.sensor)
        evidence = (self._recorder or self._filter).weigh(slot, measured)
        missed = roster.missed(slot, time_ns) if frame.is_scan else slot
        is_back = roster.is_labelled[slot] & (_seconds(time_ns - roster.measured_ns[slot]) > AWAY_S)
        roster.hit(slot, time_ns)
        is_weightless = ~np.isfinite(evidence.log_density)  # no particle has a weight
        roster.log_evidence[slot] = np.where(is_weightless, 0.0, evidence.log_density)
        unexplained = evidence.is_unexplained | is_weightless
        roster.n_unexplained[slot] = np.where(unexplained, roster.n_unexplained[slot] + 1, 0)
        not_hit = np.concatenate([missed, slot[unexplained]])
        roster.learn(slot[~unexplained], frame.by_chance[row[~unexplained]], not_hit)
        roster.counted_ns[slot] = roster.counted_ns[not_hit] = time_ns
        is_lost = is_weightless | (roster.n_unexplained[slot] >= np.where(is_back, 1, self.tracking.lost_after))
        if is_lost.any():
            self._recover(slot[is_lost], row[is_lost])
        frame.moments = self._filter.moments(frame.held)

    def _tracked(self) -> TrackedFrame:
        """All of the frame at hand."""
        frame, roster, time_ns = self._frame, self._roster, self._time_ns + self._latency_ns
        exists = roster.probability[frame.home]
        reported = roster.is_confirmed[frame.home] & (exists >= self.tracking.report_above)
        slot, home = self._now(frame.held[reported]), frame.home[reported]
        names, weighed = roster.names_of(home), frame.moments  # of the time when detections were true
        m = self._filter.moments(slot) if weighed is None or self._latency_ns else weighed[reported]
        is_measured = roster.measured_ns[home] == self._time_ns
        estimates = with_unseen_errors(Estimates(
            track_id=np.array(names, dtype=np.str_),
            time_ns=np.full(home.size, time_ns, np.int64),
            position=m[:, :2],
            covariance=m[:, [2, 3, 3, 4]].reshape(-1, 2, 2),
            direction=m[:, 5],
            direction_resultant=m[:, 6],
            speed=m[:, 7],
            speed_std=m[:, 8],
            effective_sample_size=m[:, 9],
            log_evidence=np.where(is_measured, roster.log_evidence[home], 0.0),
            existence=exists[reported],
            unseen_s=_seconds(self._time_ns - roster.measured_ns[home]),
            follows_map=np.zeros(home.size) if self._on_map is None else self._on_map.places(slot).follows_map,
        ), self.sensor)  # fmt: skip
        seen = frame.detections
        if self._latency_ns:
            seen = replace(seen, time_ns=seen.time_ns + self._latency_ns)
        if self._recorder is not None:
            self._recorder.reported(time_ns, home, estimates, roster.is_labelled[home])
        return TrackedFrame(
            time_ns=time_ns, detections=seen, estimates=estimates,
            particles=Particles.none() if self._on_map is None else self._on_map.particles(slot),
            innovations=None if frame.innovation is None else frame.innovation[home],
            reinitialised=tuple(compress(names, np.isin(home, frame.lost).tolist())) if frame.lost.size else (),
        )  # fmt: skip

    def _by_chance(self, is_labelled: BoolArray, passed_ns: int) -> FloatArray:
        """(d,) density of clutter and first detections at each of the frame's, so long after the frame before."""
        undetected = self._undetected
        undetected.advance(passed_ns * 1e-9, self._roster.longest_gap_ns * 1e-9)
        expected = undetected.first_detections(self._frame.detections.position) + self.tracking.clutter_density
        return np.asarray(expected * np.where(is_labelled, undetected.of_labels, 1.0))

    def _match(self, labels: list[str], row: IntArray) -> Hits:
        """Move the tracks of labelled rows (d,) to the frame's time: an id is a gate."""
        roster = self._roster
        self._motion.advance_in_whole_steps(roster.labelled, now_ns=self._time_ns)
        roster.give_way(labels)
        slot = roster.slots_of(labels)
        slot, row = slot[slot >= 0], row[slot >= 0]
        self._motion.advance_to(slot, now_ns=self._time_ns)
        return Hits(slot, row)

    def _associate(self, row: IntArray) -> Hits:
        """Move the unlabelled tracks to the frame's time; which of its unlabelled rows (d,) are theirs."""
        roster, slot = self._roster, self._roster.unlabelled
        if slot.size == 0:
            return Hits(slot, row[:0])
        self._motion.advance_to(slot, now_ns=self._time_ns)
        roster.age(slot, slot, self._time_ns)
        return associated(
            self._filter, slot, self._frame.detections, row, existence=roster.existence[slot],
            is_confirmed=roster.is_confirmed[slot], by_chance=self._frame.by_chance[row], noise=self.config,
            config=self.tracking,
        )  # fmt: skip

    def _begin_tracks(self, row: IntArray, is_labelled: BoolArray) -> None:
        """Initialise a track for each unassigned detection (d,); an unlabelled track is named when it is confirmed."""
        labelled, detections = is_labelled[row], self._frame.detections
        exists = existence.at_birth(self._undetected.see(detections.position[row], labelled), self.tracking)
        if row.size == 0:
            return
        names = np.array(detections.track_id[row], dtype=object)
        names[~labelled] = self._roster.tentative_names(int((~labelled).sum()))
        slot = self._roster.enter(names.tolist(), is_labelled=labelled, time_ns=self._time_ns, exists=exists)
        self._begin(slot, row)

    def _hold(self, labels: Sequence[str]) -> None:
        """Have all beliefs at the frame's time: those of labelled tracks that it does not hold are moved aside."""
        roster, frame = self._roster, self._frame
        seen = roster.slots_of(labels)
        seen = seen[seen >= 0]
        absent = roster.without(roster.labelled, seen)
        dt_ns = self._time_ns - roster.time_ns[absent]
        aside = absent.copy()
        between = dt_ns > 0
        if between.any():
            frame.n_aside = int(between.sum())
            aside[between] = roster.spare(frame.n_aside)
            self._motion.copy(absent[between], aside[between])
            self._motion.advance(aside, dt_ns, now_ns=self._time_ns)
        home, held = np.concatenate([seen, absent]), np.concatenate([seen, aside])
        roster.age(home, held, self._time_ns)
        frame.home, frame.held = (np.concatenate([slot, roster.unlabelled]) for slot in (home, held))

    def _now(self, slot: IntArray) -> IntArray:
        """Slots (v,) of the beliefs of others, moved on by the latency: from when detections were true to now."""
        if not self._latency_ns:
            return slot
        now = self._roster.spare(self._frame.n_aside + slot.size)[: slot.size]
        self._motion.copy(slot, now)
        self._motion.advance(now, np.full(slot.size, self._latency_ns), now_ns=self._time_ns)
        return now

    def _begin(self, slot: IntArray, row: IntArray) -> None:
        if slot.size == 0:
            return
        key = [birth_key(self._seed, name, self._time_ns) for name in self._roster.names_of(slot)]
        self._filter.begin(slot, np.array(key, dtype=np.uint64), self._frame.detections[row])
        if self._recorder is not None:
            self._recorder.begun(slot, self._time_ns)

    def _recover(self, slot: IntArray, row: IntArray) -> None:
        self.recoveries += int(slot.size)
        self._frame.lost = slot
        self._roster.n_unexplained[slot] = 0
        self._roster.cue[slot] = np.nan
        logger.info("at %d ns %d beliefs did not explain what was measured: reinitialised", self._time_ns, slot.size)
        self._begin(slot, row)


def _seconds(time_ns: IntArray) -> FloatArray:
    return np.asarray(time_ns * 1e-9, dtype=np.float64)
