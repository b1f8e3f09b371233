"""Beliefs move on in time, with the cues that their vehicles give (Eq. 4).

A cue is weighed as it bears on what a vehicle does at each instant: its weights are taken away before a step, and given
again after it. So a signal that lasts counts once, also where it was given long before the turn.
"""

from __future__ import annotations

import numpy as np

from dirprim_filter.arrays import FloatArray, IntArray
from dirprim_filter.filtering.protocols import BayesFilter, OnMap
from dirprim_filter.filtering.roster import Roster
from dirprim_filter.filtering.smoothing.recorder import Recorder
from dirprim_filter.primitives.cues import Cue
from dirprim_filter.primitives.motion_sums import AHEAD_S

CUE_LASTS_S = AHEAD_S
"""A cue is about the turn until then: of a vehicle out of sight for longer nothing is known of its next."""


class CuedMotion:
    """Moves the beliefs of a filter.

    Args:
        beliefs: a filter.
        roster: whose cues and times these are.
        recorder: keeps where they were, for a smoother.
        step_s: seconds of a whole step.
    """

    def __init__(self, beliefs: BayesFilter, roster: Roster, recorder: Recorder | None, *, step_s: float) -> None:
        self._filter, self._roster, self._recorder = beliefs, roster, recorder
        self._on_map = beliefs if isinstance(beliefs, OnMap) else None
        self._step_ns = max(round(step_s * 1e9), 1)

    def advance(self, slot: IntArray, dt_ns: IntArray, *, now_ns: int) -> None:
        """Predict beliefs (v,) by (v,) nanoseconds; cues of vehicles last seen too long before `now_ns` end."""
        slot, dt_ns = slot[dt_ns > 0], dt_ns[dt_ns > 0]
        if slot.size:
            self._weigh(slot, away=True)
            if self._recorder is not None:
                self._recorder.moves(slot, dt_ns)
            self._filter.predict(slot, np.asarray(dt_ns * 1e-9, np.float64))
            self._roster.cue[slot[now_ns - self._roster.measured_ns[slot] > CUE_LASTS_S * 1e9]] = np.nan
            self._weigh(slot)

    def advance_to(self, slot: IntArray, *, now_ns: int) -> None:
        """Predict beliefs (v,) to a time."""
        self.advance(slot, now_ns - self._roster.time_ns[slot], now_ns=now_ns)
        self._roster.time_ns[slot] = now_ns

    def advance_in_whole_steps(self, slot: IntArray, *, now_ns: int) -> None:
        """Steps from each belief's own last measurement: as many as fit before a time."""
        roster = self._roster
        n_steps = (now_ns - roster.time_ns[slot]) // self._step_ns
        for i in range(int(n_steps.max(initial=0))):
            self.advance(slot[n_steps > i], np.full(int((n_steps > i).sum()), self._step_ns), now_ns=now_ns)
        roster.time_ns[slot] += n_steps * self._step_ns

    def copy(self, source: IntArray, target: IntArray) -> None:
        """Copy beliefs (v,) into other slots (v,), with their cues."""
        self._filter.copy(source, target)
        if self._recorder is not None:
            self._recorder.copied(target)
        for column in (self._roster.cue, self._roster.measured_ns):
            column[target] = column[source]

    def change_cues(self, slot: IntArray, cue: FloatArray) -> None:
        """Weigh beliefs (v,) by what vehicles have begun to signal, (v, 2), and no more by what they have ceased to."""
        former = self._roster.cue[slot]
        changed = slot[(cue != former).any(axis=1) & ~(np.isnan(cue) & np.isnan(former)).all(axis=1)]
        if changed.size:
            self._weigh(changed, away=True)
            self._roster.cue[slot] = cue
            self._weigh(changed)

    def _weigh(self, slot: IntArray, *, away: bool = False) -> None:
        """Weigh beliefs (v,) by the cues that their vehicles give (Eq. 4); or take these weights `away`.

        The inverse of a von Mises is, but for a factor, the one of the opposite direction.
        """
        cue = self._roster.cue[slot]
        given = ~np.isnan(cue[:, 0])
        if self._on_map is None or not given.any():
            return
        kinds, kind = np.unique(cue[given], axis=0, return_inverse=True)
        for i, (turn, concentration) in enumerate(kinds):
            one = Cue(turn=turn + np.pi * away, concentration=concentration)
            self._on_map.weigh_by_cue(slot[given][kind == i], one)
