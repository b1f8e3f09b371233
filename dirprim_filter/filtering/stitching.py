"""Pieces of one vehicle's way joined across gaps: of all ways to join them, the likeliest one.

A tracker without ids loses a vehicle that is out of sight for long, or swerves, and calls it by another name when it
finds it again. Offline both ends are known. A piece may continue another if the filter, from where the one ended,
expects the state in which the other began; each continues at most one, and is continued by at most one: a path cover
of least cost, which is an assignment.

Source: Zhang, Li and Nevatia, Global Data Association for Multi-Object Tracking Using Network Flows, 2008.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from dirprim_filter.arrays import FloatArray, IntArray
from dirprim_filter.config import TrackingConfig
from dirprim_filter.filtering import existence
from dirprim_filter.filtering.association import best_pairs
from dirprim_filter.filtering.belief import birth_key
from dirprim_filter.filtering.smoothing import bridge
from dirprim_filter.filtering.smoothing.chain import Chain, may_lead
from dirprim_filter.filtering.smoothing.links import MOVES, Belief
from dirprim_filter.filtering.smoothing.recorder import Recorder
from dirprim_filter.filtering.tracker import Tracker

SURE = 0.99
"""Probability of existence that an unlabelled track has had, of a vehicle: of all candidates of a whole log a few look
confirmed for a moment."""
SLOWEST = 0.5
"""m/s, of s: among those that stand one may walk."""


def stitch(
    recorder: Recorder, tracker: Tracker, *, before_ns: int, gap_ns: int, now_ns: int, joins_labelled: bool = False
) -> list[tuple[str, str]]:  # fmt: skip
    """Drop, trim and join the chains of vehicles that no sensor named, now that the log is known for long after them.

    Of two pieces of one vehicle's way the later takes up the earlier.

    Args:
        recorder: of the chains, and of the filter, which says how vehicles go on.
        tracker: says how detections err, and how likely vehicles appear, are occluded, come back and leave.
        before_ns: time up to which a chain may begin that continues another.
        gap_ns: the longest gap; whoever was not measured for longer will not be again.
        now_ns: the last time that is known.
        joins_labelled: chains whose ids were given are joined too, and neither dropped nor trimmed.

    Returns:
        Of each two that were joined the names, the earlier first.
    """
    frame_ns = np.diff(recorder.frames_ns)
    if frame_ns.size == 0:
        return []
    frame_s, config = float(np.median(frame_ns)) * 1e-9, tracker.tracking
    usual = -np.log(4.0 * np.pi * tracker.config.noise_m**2) - 1.0
    chains = []
    for chain in recorder.chains:
        if not chain.label and chain.is_over(now_ns, gap_ns):
            chain.name = chain.name if chain.existence >= SURE else ""
            trim(chain, frame_s=frame_s, log_density=usual, config=config)
        if chain.name and (joins_labelled or not chain.label):
            chains.append(chain)
    starts = [Belief(*(column[0] for column in chain.smoothed()[:4])) for chain in chains]
    pairs = _candidates(chains, starts, before_ns=before_ns, gap_ns=gap_ns)
    out_s = np.array([starts[j].time_ns - chains[i].last.time_ns for i, j in pairs]) * 1e-9
    gain = _log_odds(out_s, frame_s, config, starts)
    for k, (i, j) in enumerate(pairs):
        ends, start = chains[j].gap_after(chains[i], recorder.straight, recorder.bias_m)
        key = int(birth_key(0, f"{chains[i].name}/{chains[j].name}", ends.end_ns))
        gain[k] += bridge.log_density(recorder.filter, recorder.straight, ends, start, key=key)
    one, other = np.array(pairs, np.int64).reshape(-1, 2).T
    best = best_pairs(one, other, gain).tolist()
    names = []
    for k in sorted(best, key=lambda k: starts[pairs[k][1]].time_ns):
        former, later = (chains[i] for i in pairs[k])
        names.append((former.name, later.name))
        later.take_up(former)
    gone = {id(chains[pairs[k][0]]) for k in best}
    recorder.chains = [chain for chain in recorder.chains if id(chain) not in gone]
    return names


def trim(chain: Chain, *, frame_s: float, log_density: float, config: TrackingConfig) -> None:
    """End a chain where its vehicle was last seen: before measurements that nothing before or after them confirms.

    A belief without measurements grows until it takes a false detection. Looked at backwards, as a track that begins at
    its end, such a measurement is one that is never confirmed.

    Args:
        chain: over.
        frame_s: seconds between two frames.
        log_density: that a measurement usually has under its belief.
        config: of existence.
    """
    while (tail := chain.tail()).size and not _is_confirmed(tail, frame_s, log_density, config):
        chain.cut()


def _is_confirmed(time_ns: IntArray, frame_s: float, log_density: float, config: TrackingConfig) -> bool:
    """Whether measurements (n,), in either order, and the misses between them, are of a vehicle."""
    anywhere = np.array([config.birth_density])
    state, usual = existence.at_birth(anywhere, config.clutter_density), np.array([log_density])
    for dt_ns in np.abs(np.diff(time_ns)).tolist():
        n_frames = max(round(dt_ns * 1e-9 / frame_s), 1)
        for i in range(n_frames):
            state = existence.later(state, np.array([frame_s]), config, departs=config.departure_rate)
            state = existence.after_miss(state, config) if i + 1 < n_frames else state
        state = existence.after_hit(state, usual, anywhere, config)
    return bool(existence.probability(state, np.zeros(1))[0] >= config.confirm_above)


def _candidates(
    chains: Sequence[Chain], starts: Sequence[Belief], *, before_ns: int, gap_ns: int
) -> list[tuple[int, int]]:
    """Pairs of a chain that ended and one that began soon after, as near as a vehicle comes in that time."""
    end = np.array([chain.last.time_ns for chain in chains], np.int64)
    begin = np.array([start.time_ns for start in starts], np.int64)
    is_start = (begin <= before_ns) & (begin == np.array([chain.first_ns for chain in chains]))  # not forgotten
    dt_ns = begin[None] - end[:, None]
    one, other = np.nonzero((dt_ns > 0) & (dt_ns <= gap_ns) & is_start)
    last, first = (
        np.array([of.mean[:MOVES] for of in beliefs]).reshape(-1, MOVES)
        for beliefs in ([c.last for c in chains], starts)
    )
    near = may_lead(last[one], dt_ns[one, other] * 1e-9, first[other, :2])
    return list(zip(one[near].tolist(), other[near].tolist(), strict=True))


def _log_odds(out_s: FloatArray, frame_s: float, config: TrackingConfig, starts: Sequence[Belief]) -> FloatArray:
    """Of one vehicle that came back after so long (n,), against one that left and another that appeared.

    The density of the state in which it came back is not in it.

    In a frame a vehicle is occluded at the occlusion rate and comes back at the reappearance rate, or leaves at the
    departure rate; another appears at the birth density, as fast as those that did: their velocities count as Gaussian,
    which has the density 1 / (4 pi s^2) on average, and half of them are slower than s (2 log 2)^.5.
    """
    squared = np.median([float(start.mean[2:MOVES] @ start.mean[2:MOVES]) for start in starts] or [0.0]) / (
        2.0 * np.log(2.0)
    )
    back = np.log(config.reappearance_rate * frame_s) - config.reappearance_rate * out_s
    away = np.log(config.occlusion_rate) - np.log(config.departure_rate)
    other = np.log(config.birth_density) - np.log(4.0 * np.pi * max(squared, SLOWEST**2))
    return np.asarray(away + back - other)
