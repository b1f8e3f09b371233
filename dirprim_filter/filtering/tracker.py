"""Beliefs about many vehicles, frame by frame: those that their sensor names, and those it does not."""

from __future__ import annotations

import logging
from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np

from dirprim_filter.config import FilterConfig, TrackingConfig
from dirprim_filter.detections import NO_ID, NO_TIME, Detections, check_after
from dirprim_filter.estimates import Estimates, Innovations, Samples, TrackedFrame
from dirprim_filter.filtering.belief import birth_key
from dirprim_filter.filtering.existence import GONE, unseen_for
from dirprim_filter.filtering.measurements import measured_covariance
from dirprim_filter.filtering.particle_filter import ParticleFilter
from dirprim_filter.filtering.protocols import BayesFilter
from dirprim_filter.filtering.roster import Roster
from dirprim_filter.filtering.strangers import Strangers
from dirprim_filter.primitives import PrimitiveMap
from tessellation.arrays import BoolArray, FloatArray, IntArray

logger = logging.getLogger(__name__)
NOBODY: IntArray = np.empty(0, np.int64)


@dataclass(slots=True, kw_only=True)
class _Frame:
    """The frame at hand, and whose its detections are.

    Attributes:
        detections: as they came.
        named: the ids of its named rows, in their order.
        named_slot: their slots.
        slot: of the beliefs to be weighed, the named ones first.
        row: the rows of `detections` to weigh them by.
        n_named: how many of them are named.
        shown: the slots that hold the numbers of the estimates.
        shown_home: the slots of the vehicles that they are of.
        shown_names: their names.
        innovation: (slots, 2) distance and normalised square, where they were asked for.
        lost: the slots of beliefs that were begun anew.
    """

    detections: Detections = field(default_factory=Detections.none)
    named: list[str] = field(default_factory=list)
    named_slot: IntArray = field(default_factory=NOBODY.copy)
    slot: IntArray = field(default_factory=NOBODY.copy)
    row: IntArray = field(default_factory=NOBODY.copy)
    n_named: int = 0
    shown: IntArray = field(default_factory=NOBODY.copy)
    shown_home: IntArray = field(default_factory=NOBODY.copy)
    shown_names: list[str] = field(default_factory=list)
    innovation: FloatArray | None = None
    lost: IntArray = field(default_factory=NOBODY.copy)


class Tracker:
    """Tracks the vehicles of a log, also while they are out of sight.

    A detection with an id goes to the belief of that id. Such a belief moves from its own measurement to its next, cut
    in whole steps from its own, never by the times of others: a vehicle's estimates are the same whichever other
    vehicles the log holds. Detections without an id are given to the beliefs that foresaw them best, or begin new ones.

    Args:
        model: the map that says how vehicles move, for a particle filter on it; or any other filter.
        config: the knobs of the filter; left out, the defaults.
        tracking: the knobs of association and existence; left out, the defaults.
        with_innovations: tell how far measurements were from where they were expected: for whoever looks for the frame
            where a filter went wrong; costs some 5 % of the time.
        rng: one number drawn from it seeds every vehicle, together with its id.

    Attributes:
        recoveries: how many beliefs no longer explained their vehicle's positions, and were begun anew.
    """

    def __init__(
        self,
        model: PrimitiveMap | BayesFilter,
        *,
        config: FilterConfig | None = None,
        tracking: TrackingConfig | None = None,
        with_innovations: bool = False,
        rng: np.random.Generator,
    ) -> None:
        self.config = config or FilterConfig()
        self.tracking = tracking or TrackingConfig()
        self.recoveries = 0
        self._with_innovations = with_innovations
        self._filter = ParticleFilter(model, self.config) if isinstance(model, PrimitiveMap) else model
        self._roster = Roster(self._filter)
        self._seed = int(rng.integers(2**63))
        self._strangers = Strangers(
            self._filter, self._roster, filter_config=self.config, config=self.tracking, seed=self._seed
        )
        self._step_ns = max(round(self.config.step_s * 1e9), 1)
        self._time_ns = NO_TIME
        self._frame = _Frame()

    def predict(self, detections: Detections, *, time_ns: int | None = None) -> None:
        """Move beliefs to the frame's time, find whose its detections are, and begin those that are new.

        Args:
            detections: one instant, each id once; none is no frame, unless `time_ns` says when nothing was seen.
            time_ns: the frame's time; left out, that of its detections.

        Raises:
            ValueError: several instants or groups, a repeated id, or time going backwards; the beliefs are as before.
        """
        if time_ns is None or len(detections):
            time_ns = detections.instant(after_ns=self._time_ns)
        else:
            check_after(time_ns, self._time_ns)
        is_frame = time_ns > self._time_ns
        self._time_ns = time_ns
        self._frame = frame = _Frame(detections=detections)
        if not is_frame:
            return
        self._roster.forget(
            before_ns=time_ns - int(self.config.max_gap_s * 1e9), forget_below=self.tracking.forget_below
        )
        is_named = detections.track_id != NO_ID
        self._predict_named(np.flatnonzero(is_named))
        found = self._strangers.predict(detections, np.flatnonzero(~is_named), time_ns=time_ns)
        frame.n_named = frame.slot.size
        frame.slot, frame.row = np.concatenate([frame.slot, found.slot]), np.concatenate([frame.row, found.row])

    def weigh(self) -> None:
        """Weigh the moved beliefs by the frame's measurements; begin anew those that have lost their vehicle."""
        frame, roster = self._frame, self._roster
        slot, row = frame.slot, frame.row
        measured = frame.detections[row]
        if self._with_innovations:
            frame.innovation = self._innovation(slot, measured)
        evidence = self._filter.weigh(slot, measured)
        roster.measured_ns[slot] = self._time_ns
        roster.log_evidence[slot] = np.where(np.isfinite(evidence.log_density), evidence.log_density, 0.0)
        roster.n_unexplained[slot] = np.where(evidence.is_unexplained, roster.n_unexplained[slot] + 1, 0)
        is_lost = roster.n_unexplained[slot] >= self.tracking.lost_after
        is_lost |= ~np.isfinite(evidence.log_density)  # no particle has a weight
        if is_lost.any():
            self._recover(slot[is_lost], row[is_lost])
        strange = slot[frame.n_named :]
        self._strangers.judge(strange, roster.log_evidence[strange])

    def estimate(self) -> Estimates:
        """What is believed: of the frame's named vehicles in its order, of those out of sight, of the nameless."""
        self._show()
        roster, home, shown = self._roster, self._frame.shown_home, self._frame.shown
        m = self._filter.moments(shown)
        is_measured = roster.measured_ns[home] == self._time_ns
        return Estimates(
            track_id=np.array(self._frame.shown_names, dtype=np.str_),
            time_ns=np.full(home.size, self._time_ns, np.int64),
            position=m[:, :2],
            covariance=m[:, [2, 3, 3, 4]].reshape(-1, 2, 2),
            direction=m[:, 5],
            direction_resultant=m[:, 6],
            speed=m[:, 7],
            speed_std=m[:, 8],
            effective_sample_size=m[:, 9],
            log_evidence=np.where(is_measured, roster.log_evidence[home], 0.0),
            existence=1.0 - roster.existence[home, GONE],
            unseen_s=_seconds(self._time_ns - roster.measured_ns[home]),
        )

    def particles(self) -> Samples:
        """The samples behind the frame's estimates, of which copies can be taken until the next step."""
        return self._filter.particles(self._frame.shown)

    def innovations(self) -> Innovations | None:
        """Of the frame's estimates; None if they were not asked for."""
        of_slot = self._frame.innovation
        if of_slot is None:
            return None
        rows = of_slot[self._frame.shown_home]
        return Innovations(distance=rows[:, 0], squared=rows[:, 1])

    def begun_anew(self) -> tuple[str, ...]:
        """Of the frame's estimates those whose belief did not explain what was measured, and was begun anew."""
        lost = np.isin(self._frame.shown_home, self._frame.lost)
        return tuple(_chosen(self._frame.shown_names, lost))

    def frame(self) -> TrackedFrame:
        """All of this of the frame at hand, to be written before the next step."""
        return TrackedFrame(
            time_ns=self._time_ns, detections=self._frame.detections, estimates=self.estimate(),
            particles=self.particles(), innovations=self.innovations(), begun_anew=self.begun_anew(),
        )  # fmt: skip

    def resample(self) -> None:
        """Renew the samples of measured beliefs that have lost their weight."""
        self._filter.resample(self._frame.slot)

    def _predict_named(self, row: IntArray) -> None:
        frame, roster, time_ns = self._frame, self._roster, self._time_ns
        frame.named = frame.detections.track_id[row].tolist()
        is_new = np.array([name not in roster for name in frame.named], dtype=np.bool_)
        self._advance_in_whole_steps(roster.members(is_named=True)[1])
        new = _chosen(frame.named, is_new)
        self._begin(roster.enter(new, is_named=True, time_ns=np.full(len(new), time_ns)), row[is_new])
        frame.named_slot = roster.slots_of(frame.named)
        frame.slot, frame.row = frame.named_slot[~is_new], row[~is_new]
        self._advance(frame.slot, time_ns - roster.time_ns[frame.slot])
        roster.time_ns[frame.slot] = time_ns
        roster.existence[frame.named_slot] = [1.0, 0.0, 0.0]

    def _advance_in_whole_steps(self, slot: IntArray) -> None:
        """Steps of `step_s` from each belief's own last measurement: as many as fit before the frame's time."""
        roster = self._roster
        n_steps = (self._time_ns - roster.time_ns[slot]) // self._step_ns
        for i in range(int(n_steps.max(initial=0))):
            self._advance(slot[n_steps > i], np.full(int((n_steps > i).sum()), self._step_ns))
        roster.time_ns[slot] += n_steps * self._step_ns

    def _advance(self, slot: IntArray, dt_ns: IntArray) -> None:
        late = dt_ns > 0
        if late.any():
            self._filter.predict(slot[late], _seconds(dt_ns[late]))

    def _begin(self, slot: IntArray, row: IntArray) -> None:
        if slot.size == 0:
            return
        key = [birth_key(self._seed, name, self._time_ns) for name in self._roster.names_of(slot)]
        self._filter.begin(slot, np.array(key, dtype=np.uint64), self._frame.detections[row])

    def _recover(self, slot: IntArray, row: IntArray) -> None:
        self.recoveries += int(slot.size)
        self._frame.lost = slot
        self._roster.n_unexplained[slot] = 0
        logger.info("at %d ns %d beliefs did not explain what was measured: begun anew", self._time_ns, slot.size)
        self._begin(slot, row)

    def _innovation(self, slot: IntArray, measured: Detections) -> FloatArray:
        """(slots, 2) how far measurements are from the means of the beliefs, and that squared in their covariance."""
        told = np.full((self._roster.time_ns.size, 2), np.nan)
        if slot.size:
            m = self._filter.moments(slot)
            away = measured.position - m[:, :2]
            covariance = m[:, [2, 3, 3, 4]].reshape(-1, 2, 2) + measured_covariance(measured, self.config)
            squared = np.einsum("vi,vi->v", away, np.linalg.solve(covariance, away[..., None])[..., 0])
            told[slot] = np.column_stack([np.hypot(*away.T), squared])
        return told

    def _show(self) -> None:
        """Choose what there are estimates of, and move those out of sight to the frame's time, aside."""
        roster = self._roster
        names, slot = self._unseen()
        dt_ns = self._time_ns - roster.time_ns[slot]
        aside = slot.copy()
        between = dt_ns > 0
        if between.any():
            aside[between] = roster.spare(int(between.sum()))
            self._filter.copy(slot[between], aside[between])
            self._advance(aside, dt_ns)
        named, frame = self._frame.named_slot, self._frame
        strangers, strange = self._strangers.told_of(self._time_ns)
        frame.shown_names = [*frame.named, *names, *strangers]
        frame.shown = np.concatenate([named, aside, strange])
        frame.shown_home = np.concatenate([named, slot, strange])

    def _unseen(self) -> tuple[list[str], IntArray]:
        """Named vehicles that the frame does not hold and that may still be there."""
        roster = self._roster
        names, slot = roster.members(is_named=True)
        unseen_s = _seconds(self._time_ns - roster.measured_ns[slot])
        exists = unseen_for(unseen_s, self.tracking)
        roster.existence[slot, GONE] = 1.0 - exists
        told = (unseen_s > 0) & (exists >= self.tracking.report_above)
        return _chosen(names, told), slot[told]


def _chosen(names: Sequence[str], chosen: BoolArray) -> list[str]:
    return [name for name, is_one in zip(names, chosen, strict=True) if is_one]


def _seconds(time_ns: IntArray) -> FloatArray:
    return np.asarray(time_ns * 1e-9, dtype=np.float64)
