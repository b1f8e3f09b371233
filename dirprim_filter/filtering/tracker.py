"""Beliefs about many vehicles, frame by frame: those that their sensor labels, and those it does not."""

from __future__ import annotations

import logging
from dataclasses import replace
from os import PathLike

import numpy as np

from dirprim_filter.arrays import BoolArray, FloatArray, IntArray, require
from dirprim_filter.columns import is_held
from dirprim_filter.config import FilterConfig, TrackingConfig
from dirprim_filter.detections import NO_ID, NO_TIME, Detections
from dirprim_filter.estimates import Estimates, Particles, TrackedFrame
from dirprim_filter.filtering import existence
from dirprim_filter.filtering.association import associated
from dirprim_filter.filtering.belief import birth_key
from dirprim_filter.filtering.existence import Tally, Undetected
from dirprim_filter.filtering.measurements import innovation, with_unseen_errors
from dirprim_filter.filtering.particle_filter import ParticleFilter
from dirprim_filter.filtering.protocols import BayesFilter
from dirprim_filter.filtering.roster import Roster
from dirprim_filter.filtering.smoothing.recorder import Recorder
from dirprim_filter.primitives.motion_sums import AHEAD_S
from dirprim_filter.primitives.primitive_map import PrimitiveMap
from dirprim_filter.sensor import Sensor
from dirprim_filter.track_ids import as_track_ids

logger = logging.getLogger(__name__)

AWAY_S = 1.0
"""Where a belief does not reach a labelled vehicle that is back after longer than this, the belief is wrong: after
seconds unseen that is likelier than that the first measurement is an outlier."""
CUE_LASTS_S = AHEAD_S
"""A cue is about the turn until then: of a vehicle out of sight for longer nothing is known of its next."""


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
        unseen_s: seconds without a measurement up to which frames report labelled tracks that they do not have; in a
            log of many vehicles that tell seldom where they are, such estimates cost most of the time.
        rng: one number drawn from it seeds every vehicle, together with its id.

    Attributes:
        sensor: as given.
        recoveries: number of beliefs that no longer explained their vehicle's positions and were reinitialised.
    """

    def __init__(
        self, model: PrimitiveMap | BayesFilter, *, config: FilterConfig | None = None,
        tracking: TrackingConfig | None = None, sensor: Sensor | None = None, with_innovations: bool = False,
        unseen_s: float = np.inf, rng: np.random.Generator,
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
        self._with_innovations, self._unseen_s = with_innovations, unseen_s
        self._origin = model.origin if isinstance(model, PrimitiveMap) else None
        model = ParticleFilter(model, self.config, sensor) if isinstance(model, PrimitiveMap) else model
        self._filter: BayesFilter = model
        self._recorder: Recorder | None = None
        self._latency_ns = 0 if sensor is None else round(sensor.latency_s * 1e9)
        self._step_ns = max(round(self.config.step_s * 1e9), 1)
        self._on_map = self._filter if isinstance(self._filter, ParticleFilter) else None
        self._roster = Roster(self._filter, self.tracking, moves=self.config)
        traffic = None if self._on_map is None else self._on_map.traffic
        self._undetected = Undetected(traffic, self.tracking, self.config)
        self._seed = int(rng.integers(2**63))
        self._time_ns = self._scanned_ns = NO_TIME
        self._weighed: IntArray = np.empty(0, np.int64)  # slots of the last frame's hits

    def record(self, group: int) -> Recorder:
        """What keeps, from now on, what a smoother needs; `group` is of the log."""
        self._recorder = Recorder(self._filter, group, self.sensor)
        return self._recorder

    @property
    def longest_gap_ns(self) -> int:
        """As of the `Roster`."""
        return self._roster.longest_gap_ns

    @property
    def tally(self) -> Tally:
        """What hits and misses so far are worth, for parameters to be compared by."""
        return self._roster.tally

    @property
    def n_tracks(self) -> int:
        """How many there are, those that are not reported included."""
        return len(self._roster)

    def step(self, detections: Detections, *, time_ns: int | None = None) -> Estimates:
        """The estimates of a frame; as `track`, errors included."""
        return self.track(detections, time_ns=time_ns).estimates

    def track(self, detections: Detections, *, time_ns: int | None = None, is_scan: bool = True) -> TrackedFrame:
        """A whole frame: resample, predict to its time, weigh by its detections, estimate.

        Args:
            detections: one instant, each id once.
            time_ns: the frame's time; left out, that of its detections.
            is_scan: the sensor looked; else there are no detections, and no vehicle was missed at `time_ns`.

        Returns:
            All of the frame; confirmed tracks are reported. Labelled ones of the frame come first, in its order, then
            absent and unlabelled ones. Of the samples copies can be taken until the next frame.

        Raises:
            ValueError: several instants or groups, a repeated id, time going backwards, another time than that of the
                detections, neither detections nor a time, or detections of no scan; the beliefs are as before.
        """
        seen, self._time_ns = self._checked(detections, time_ns, is_scan=is_scan)
        self._filter.resample(self._weighed)
        is_labelled = seen.track_id != NO_ID
        slot, by_chance, false = self._assigned(seen, is_labelled, is_scan=is_scan)
        row = np.flatnonzero(slot >= 0)
        self._weighed = slot[row]
        if is_scan:
            self._begin_tracks(seen, slot, false)
            has_size = ~np.isnan(seen.size[:, 0])
            self._roster.size[slot[has_size]] = seen.size[has_size]
        home, held = self._beliefs(slot[is_labelled])
        lost = self._weigh(self._weighed, seen[row], by_chance[row], is_scan=is_scan)
        self._roster.place[slot] = seen.position
        has_name = self._roster.is_labelled[slot] | self._roster.is_confirmed[slot]
        assigned = np.where(has_name, self._roster.name[slot], NO_ID).astype(np.str_)
        return replace(self._tracked(detections, home, held, lost), assigned=assigned)

    def _checked(self, detections: Detections, time_ns: int | None, *, is_scan: bool) -> tuple[Detections, int]:
        """Detections with the times when they were true, and that of the frame."""
        require("detections", detections, Detections)
        if len(detections) and not is_scan:
            raise ValueError(f"detections: expected none where the sensor did not look, got {len(detections)}")
        if detections.origin and self._origin and not detections.origin.is_of(self._origin):
            raise ValueError(f"detections: expected the map's origin, {self._origin}, got {detections.origin}")
        own_ns = detections.instant() if len(detections) else time_ns
        if own_ns is None:
            raise ValueError("time_ns: expected the time of a frame without detections")
        if time_ns not in (None, own_ns):
            raise ValueError(f"time_ns: expected {own_ns}, that of the detections, got {time_ns}")
        if (own_ns := own_ns - self._latency_ns) <= self._time_ns:
            raise ValueError(f"detections: expected times after {self._time_ns} ns, got {own_ns}")
        self._origin = self._origin or detections.origin
        if self._latency_ns:
            detections = replace(detections, time_ns=detections.time_ns - self._latency_ns)
        if self.sensor is not None and is_held(detections.covariance):  # the sensor's model counts
            detections = replace(detections, covariance=np.empty(0))
        return detections, own_ns

    def _assigned(
        self, detections: Detections, is_labelled: BoolArray, *, is_scan: bool
    ) -> tuple[IntArray, FloatArray, FloatArray]:  # fmt: skip
        """Move tracks to the frame's time. (d,) the track of each detection, -1 for none; and densities by chance.

        These are `Undetected.by_chance`, and of false ones alone, infinite of a vehicle that was detected twice. An id
        is a gate: its track is assigned whatever it predicted.
        """
        roster, now_ns = self._roster, self._time_ns
        passed_ns = now_ns - self._scanned_ns if is_scan else None
        slot = np.full(len(detections), -1, np.int64)
        slot[is_labelled] = roster.see(detections.track_id[is_labelled].tolist(), now_ns, passed_ns=passed_ns)
        by_chance, is_double = np.empty(0), np.zeros(len(detections), np.bool_)
        false = existence.false_density(detections.confidence, self.tracking)
        if passed_ns is not None:
            self._scanned_ns = now_ns
            self._undetected.advance(passed_ns * 1e-9, roster.longest_gap_ns * 1e-9)
            by_chance = self._undetected.by_chance(detections.position, is_labelled, false)
            roster.tally.log_density += float(np.log(by_chance).sum())
        labelled, unlabelled = roster.labelled, roster.unlabelled
        moved = labelled[(roster.seen_ns[labelled] == now_ns) | self._is_reported(labelled)]
        step_ns = self._step_ns * roster.stride[moved]
        n_steps = (now_ns - roster.time_ns[moved]) // step_ns
        for i in range(int(n_steps.max(initial=0))):
            on = moved[n_steps > i]
            self._advance(on, roster.time_ns[on] + step_ns[n_steps > i])
        self._advance(np.concatenate([slot[slot >= 0], unlabelled]), now_ns)
        away = np.flatnonzero((slot >= 0) & (now_ns - roster.measured_ns[slot] > AWAY_S * 1e9))
        if away.size:
            own = existence.of_own_name(self._filter.moments(slot[away]), len(detections))
            by_chance[away] = np.fmin(by_chance[away], own)
        if unlabelled.size:
            roster.age(unlabelled, unlabelled, now_ns)
            row = np.flatnonzero(~is_labelled)
            slot[row], is_double[row] = associated(
                self._filter, unlabelled, detections[row] if is_labelled.any() else detections,
                existence=roster.existence[unlabelled], size=roster.size[unlabelled],
                is_confirmed=roster.is_confirmed[unlabelled], by_chance=by_chance[row], noise=self.config,
                config=self.tracking,
            )  # fmt: skip
        false[is_double] = np.inf
        return slot, by_chance, false

    def _begin_tracks(self, detections: Detections, slot: IntArray, false: FloatArray) -> None:
        """Initialise a track for each detection that has none, and enter it in (d,) `slot`."""
        row = np.flatnonzero(slot < 0)
        names = detections.track_id[row]
        expected = self._undetected.see(detections.position[row], names != NO_ID, false[row])
        if row.size:
            exists = existence.at_birth(expected, false[row])
            slot[row] = self._roster.enter(names.tolist(), time_ns=self._time_ns, exists=exists)
            self._begin(slot[row], detections[row])

    def _begin(self, slot: IntArray, measured: Detections, since_s: FloatArray | None = None) -> None:
        """Initialise beliefs; who was measured so long ago (v,), but for 0, has come from there."""
        names = self._roster.name[slot].tolist()
        key = np.array([birth_key(self._seed, name, self._time_ns) for name in names], dtype=np.uint64)
        self._filter.begin(slot, key, measured)
        if since_s is not None and self._on_map is not None:
            came = (since_s > 0.0) & np.isnan(measured.direction) & np.isnan(measured.speed)
            way = measured.position - self._roster.place[slot]
            self._on_map.steer(slot[came], key[came], way[came], since_s[came])
        if self._recorder is not None:
            self._recorder.begun(slot, measured, self._time_ns)

    def _beliefs(self, seen: IntArray) -> tuple[IntArray, IntArray]:
        """(v,), (v,) slots of all tracks, and those that hold their beliefs at the frame's time.

        A labelled track that is not in the frame is predicted there in a copy: its own belief moves in its own steps.
        """
        roster, now_ns = self._roster, self._time_ns
        labelled, unlabelled = roster.labelled, roster.unlabelled
        absent = labelled[(roster.seen_ns[labelled] < now_ns) & self._is_reported(labelled)]
        home = np.concatenate([seen, absent])
        held = self._at(home, now_ns)
        roster.age(home, held, now_ns)
        return np.concatenate([home, unlabelled]), np.concatenate([held, unlabelled])

    def _is_reported(self, slot: IntArray) -> BoolArray:
        """(v,) of tracks, whether frames that do not have them report them."""
        return np.asarray(self._time_ns - self._roster.measured_ns[slot] <= self._unseen_s * 1e9)

    def _at(self, slot: IntArray, time_ns: int) -> IntArray:
        """Slots that hold beliefs (v,) at a time: of those that are of an earlier one, copies, predicted to it."""
        held, earlier = slot.copy(), self._roster.time_ns[slot] < time_ns
        if earlier.any():
            held[earlier] = self._roster.aside(slot[earlier])
            self._advance(held, time_ns)
        return held

    def _advance(self, slot: IntArray, time_ns: IntArray | int) -> None:
        """Predict beliefs (v,) to a time, under the cues that their vehicles give (Eq. 4)."""
        roster = self._roster
        dt_ns = time_ns - roster.time_ns[slot]
        slot, dt_ns = slot[dt_ns > 0], dt_ns[dt_ns > 0]
        if slot.size:
            if self._recorder is not None:
                self._recorder.moves(slot, roster.time_ns[slot])
            lasts = roster.time_ns[slot] - roster.cue_ns[slot] < CUE_LASTS_S * 1e9
            for cue, rows in roster.by_cue(slot, lasts & (roster.cue_ns == roster.measured_ns)[slot]):
                if self._on_map is None:
                    self._filter.predict(slot[rows], _seconds(dt_ns[rows]))
                elif rows.size:
                    step_s = _seconds(self._step_ns * roster.stride[slot[rows]])
                    self._on_map.predict(slot[rows], _seconds(dt_ns[rows]), cue, step_s)
            roster.time_ns[slot] += dt_ns

    def _weigh(self, slot: IntArray, measured: Detections, by_chance: FloatArray, *, is_scan: bool) -> IntArray:
        """Weigh the moved beliefs by the frame's measurements; reinitialise those that have lost their vehicle.

        Returns:
            (v,) slots of those.
        """
        roster, now_ns = self._roster, self._time_ns
        given = ~np.isnan(measured.cue[:, 0])
        lasts = (measured.cue == roster.cue[slot]).all(axis=1) & (now_ns - roster.cue_ns[slot] <= CUE_LASTS_S * 1e9)
        roster.cue[slot[given]], roster.cue_ns[slot[given]] = measured.cue[given], now_ns
        for cue, rows in roster.by_cue(slot, given & ~lasts):
            if cue is not None and self._on_map is not None:  # at its onset: it weighs once, however long it lasts
                self._on_map.weigh_by_cue(slot[rows], cue)
        since_s = _seconds(now_ns - roster.measured_ns[slot])
        if self._with_innovations:
            moments = self._filter.moments(slot)
            roster.innovation[slot] = innovation(moments, measured, since_s, self.config, self.sensor)
            roster.expected[slot] = moments[:, :2]
        if self._recorder is None:
            evidence = self._filter.weigh(slot, measured)
        else:
            evidence = self._recorder.weigh(slot, measured, now_ns)
        is_back = roster.is_labelled[slot] & (since_s > AWAY_S)
        is_weightless = ~np.isfinite(evidence.log_density)  # no particle has a weight
        roster.log_evidence[slot] = np.where(is_weightless, 0.0, evidence.log_density)
        is_explained = ~evidence.is_unexplained
        roster.n_unexplained[slot] = np.where(is_explained, 0, roster.n_unexplained[slot] + 1)
        roster.learn(slot, evidence.log_density, is_explained, by_chance, now_ns, is_scan=is_scan)
        is_lost = is_weightless | (roster.n_unexplained[slot] >= np.where(is_back, 1, self.tracking.lost_after))
        lost = slot[is_lost]
        if lost.size:
            self.recoveries += int(lost.size)
            logger.info("at %d ns %d beliefs did not explain what was measured: reinitialised", now_ns, lost.size)
            self._begin(lost, measured[is_lost], np.where(roster.lose(lost) & is_back[is_lost], since_s[is_lost], 0.0))
        return lost

    def _tracked(self, detections: Detections, home: IntArray, held: IntArray, lost: IntArray) -> TrackedFrame:
        """The frame as it is reported, at its own time: later by the latency than that of the beliefs."""
        roster, time_ns = self._roster, self._time_ns + self._latency_ns
        exists = roster.probability[home]
        reported = roster.is_confirmed[home] & (exists >= self.tracking.report_above)
        home, slot = home[reported], self._at(held[reported], time_ns)
        names, is_measured = roster.name[home], roster.measured_ns[home] == self._time_ns
        m = self._filter.moments(slot)
        direction, resultant, speed, speed_std, size = np.ascontiguousarray(m[:, 5:].T)
        estimates = with_unseen_errors((Estimates.trusted if np.isfinite(m).all() else Estimates)(
            track_id=as_track_ids(names),
            time_ns=np.full(home.size, time_ns, np.int64),
            position=m[:, :2].copy(),
            covariance=m[:, [2, 3, 3, 4]].reshape(-1, 2, 2),
            direction=direction, direction_resultant=resultant, speed=speed, speed_std=speed_std,
            effective_sample_size=size,
            log_evidence=np.where(is_measured, roster.log_evidence[home], 0.0),
            existence=exists[reported],
            unseen_s=_seconds(self._time_ns - roster.measured_ns[home]),
            follows_map=np.zeros(home.size) if self._on_map is None else self._on_map.places(slot).follows_map,
            origin=self._origin,
        ), self.sensor)  # fmt: skip
        if self._recorder is not None:
            self._recorder.reported(time_ns, home, estimates)
        return TrackedFrame(
            time_ns=time_ns, detections=detections, estimates=estimates,
            particles=Particles.none() if self._on_map is None else self._on_map.particles(slot),
            innovations=np.where(is_measured, roster.innovation[home], np.nan) if self._with_innovations else None,
            expected=np.where(is_measured[:, None], roster.expected[home], np.nan) if self._with_innovations else None,
            reinitialised=tuple(names[np.isin(home, lost)].tolist()) if lost.size else (),
        )  # fmt: skip


def _seconds(time_ns: IntArray) -> FloatArray:
    return np.asarray(time_ns * 1e-9, dtype=np.float64)
