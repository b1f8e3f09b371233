"""Learning how drivers go on behind a leader: a ridge regression.

It is judged on held-out drivers: where the leader predicts their acceleration no better than their own speed alone, as
for pedestrians on a square, vehicles do not respond to leaders.
"""

from __future__ import annotations

import logging
from typing import NamedTuple, Self
from zlib import crc32

import numpy as np

from dirprim_filter.arrays import FloatArray, IntArray
from dirprim_filter.instants import Instants
from dirprim_filter.primitives import _leader
from dirprim_filter.primitives._leader import FAR_M, SLOW, STARTS_BEHIND_M
from dirprim_filter.primitives._manoeuvres import STANDING_BELOW
from dirprim_filter.primitives.leader import N_FEATURES, N_PACES, LeaderResponse
from dirprim_filter.primitives.motion import PUSHED_SHARE
from dirprim_filter.primitives.motion_sums import Regression
from dirprim_filter.track_ids import qualified_names
from dirprim_filter.tracks import Tracks

logger = logging.getLogger(__name__)

EVERY_S, RESPONDS_S = 0.5, 1.0
"""How often drivers are looked at, and over how long their acceleration is."""
MOST_INSTANTS = 5000
"""Of so many every driver has been seen often."""
N_FOLDS = 5
"""Folds of the drivers, each predicted from the others."""
OF_SPEED = (0, 4, 8)
"""The features without the leader: 1, speed and its square."""
WORTH = 0.05
"""Leaders must lower the mean squared error on held-out drivers by this share."""
RIDGE = 1.0
"""Pairs of a driver and its leader, by which each feature leans on having no effect."""
TRUSTED_PAIRS = 50.0
"""From so many on the response counts more than what the place says."""
STARTS_SEEN = 5.0
"""Instants of standing vehicles, by which starts lean on those of all that stand."""
MOST_STARTS = 0.95
"""Of those that stand, within `RESPONDS_S`."""


class LeaderSums(NamedTuple):
    """What the response is learned from."""

    acceleration: Regression  # by `_leader.describe`'s features, a row for each fold; a pair of vehicles counts once
    stood: FloatArray  # (4,) instants at which a vehicle stood: behind a leader of each pace, and without one
    started: FloatArray  # (4,) of these, where it drove `RESPONDS_S` later

    @classmethod
    def of(cls, tracks: Tracks) -> Self:
        """The sums of a log: of every vehicle and the nearest one ahead, `EVERY_S`."""
        group, time_ns = _looks(tracks)
        now, later = (Instants.of(tracks, group, at_ns) for at_ns in (time_ns, time_ns + int(RESPONDS_S * 1e9)))
        speed, row = now.state[:, 3], later.rows_of(now)
        seen, feature = np.empty((len(now.state), 3)), np.empty((len(now.state), N_FEATURES))
        _leader.ahead_of_each(now.state, now.first, seen, feature)
        gained = np.where(row >= 0, np.append(later.state[:, 3], 0.0)[row] - speed, np.nan)
        stands = speed < STANDING_BELOW
        follows = (seen[:, 0] < FAR_M) & ~stands & np.isfinite(gained)
        driver, leader = now.vehicle[follows], now.vehicle[seen[follows, 2].astype(np.int64)]
        _, pair, count = np.unique(driver * (1 + now.vehicle.max(initial=0)) + leader, return_inverse=True,
                                   return_counts=True)  # fmt: skip
        waits = stands & np.isfinite(gained)
        near = seen[:, 0] < STARTS_BEHIND_M
        pace = np.where(near, np.digitize(seen[:, 1], [STANDING_BELOW, SLOW]), N_PACES)
        starts = waits & (speed + gained >= STANDING_BELOW)
        return cls(
            Regression.of(
                feature[follows], gained[follows] / RESPONDS_S, 1.0 / count[pair], _folds(tracks)[driver], N_FOLDS
            ),
            np.bincount(pace[waits], minlength=N_PACES + 1).astype(np.float64),
            np.bincount(pace[starts], minlength=N_PACES + 1).astype(np.float64),
        )

    def response(self) -> LeaderResponse | None:
        """The response that follows from the sums; None where it does not improve predictions of held-out drivers."""
        with_leader, by_speed = _held_out_error(self.acceleration), _held_out_error(_part(self.acceleration, OF_SPEED))
        pairs = float(self.acceleration.weight.sum())
        logger.info("%.0f pairs of a driver and its leader: held-out error %.3g of that by speed alone", pairs,
                    with_leader / max(by_speed, 1e-9))  # fmt: skip
        if not with_leader < (1.0 - WORTH) * by_speed:
            return None
        whole = _total(self.acceleration)
        gain = _solved(whole)
        usual = (self.started.sum() + 0.1) / (self.stood.sum() + 1.0)
        share = (self.started[:N_PACES] + STARTS_SEEN * usual) / (self.stood[:N_PACES] + STARTS_SEEN)
        return LeaderResponse(
            gain=gain[0],
            push=float(np.sqrt(whole.mean_square(gain)[0] / PUSHED_SHARE)),
            trust=pairs / (pairs + TRUSTED_PAIRS),
            start_rate=-np.log1p(-np.minimum(share, MOST_STARTS)) / RESPONDS_S,
        )


def _folds(tracks: Tracks) -> IntArray:
    """(n_tracks,) the fold of each vehicle: by its name, so that it is the same whichever others there are."""
    row = tracks.first_rows
    names = qualified_names(tracks.track_id[row], tracks.group[row])
    return np.array([crc32(name.encode()) % N_FOLDS for name in names.tolist()], np.int64)


def _held_out_error(acceleration: Regression) -> float:
    """Mean squared error of each fold by what the others say, m^2/s^4."""
    whole = _total(acceleration)
    error = acceleration.mean_square(_solved(whole - acceleration)) @ acceleration.weight
    return float(error / max(whole.weight[0], 1e-9))


def _total(acceleration: Regression) -> Regression:
    """The sums of all folds."""
    return Regression(*(column.sum(axis=0, keepdims=True) for column in acceleration))


def _part(acceleration: Regression, features: tuple[int, ...]) -> Regression:
    """The sums of some of the features."""
    some = np.array(features)
    return acceleration._replace(xx=acceleration.xx[:, some[:, None], some], xy=acceleration.xy[:, some])


def _solved(acceleration: Regression) -> FloatArray:
    """(z, p) gains; the ridge of each is in units of its own mean square, that of the constant next to none."""
    square = np.diagonal(acceleration.xx, axis1=1, axis2=2) / np.maximum(acceleration.weight, 1e-9)[:, None]
    return acceleration.solved(RIDGE * (square + 1e-9) * np.append(1e-6, np.ones(square.shape[1] - 1)))


def _looks(tracks: Tracks) -> tuple[IntArray, IntArray]:
    """(i,) groups and (i,) times at which drivers are looked at, ascending.

    They are looked at `EVERY_S` from each group's first row on, where it has rows; in a long log less often.
    """
    every_ns, looks = int(EVERY_S * 1e9), [np.empty((0, 2), np.int64)]  # group and time
    for group in np.unique(tracks.group).tolist():
        own = tracks.time_ns[tracks.group == group]
        number = np.unique((own - own[0]) // every_ns)  # a log may pause for days
        looks.append(np.column_stack([np.full(number.size, group), own[0] + number * every_ns]))
    look = np.concatenate(looks)
    group, time_ns = look[:: max(-(-len(look) // MOST_INSTANTS), 1)].T
    return group, time_ns
