"""Our tracker and those of other packages side by side, on the same unlabelled detections, by the same scores.

    python tests/benchmarks/peers.py [SCENE...] --json [--seeds N]

A is the intersection that ships. B is the same without detections in a ring of 20 m about the junction, through which a
track must last. `intersection`, `highway` are dense simulated traffic and `lankershim` is a real junction, with a fifth
of the simulated detections missed and ten false ones a frame. `mcity` has real roadside detections of cars, `autoferry`
real radar of boats.

Every tracker is given the sensor's true noise, detection rate and density of false detections. Those with settings to
choose are tuned on other traffic of the same place (another seed, group, drive or scenario), with the same sensor and
the same blind ring, by HOTA: from a usual start each setting goes to its neighbours on a log grid while that gains, in
turn, until none does; the grid has no end but those that have a meaning, such as two detections before a track is
confirmed. Ours with the map keeps its defaults. Without it, and with constant velocity, how often vehicles leave is
tuned too: where they leave is what the map knows. At Mcity ours also knows how late and biased the sensor is, which
others do not take; a row has ours without that.

Figures are means over seeds, groups, drives or scenarios with 95 % intervals; switches are sums. `behind` is how
much less HOTA a tracker has than ours with the map, paired.
Errors are of vehicles that are followed: who follows more of those out of sight has more to err about.
"""

from __future__ import annotations

import argparse
import json
import logging
import sys
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

sys.path.insert(0, str(Path(__file__).parent))

from peer_scenes import SCENES, Fold, Part, UnavailableError
from peer_stone_soup import stone_soup
from peer_trackers import Peer, Settings, Tracked, motpy, norfair, ours

from dirprim_filter import learn_primitives
from dirprim_filter.evaluation.intervals import difference_of_means, mean_over, paired
from dirprim_filter.evaluation.settings import choose
from dirprim_filter.evaluation.tracking_report import TrackingReport, report_of
from dirprim_filter.evaluation.truth import judged_rows

PACKAGES = (stone_soup, motpy, norfair)
FIRST = "ours, with the map"
GAIN = 1e-4
"""Of HOTA; less is no gain."""
Row = dict[str, Any]


def main() -> None:
    """Print the rows of each scene, as JSON."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("scenes", nargs="*", metavar="SCENE", help=f"of {', '.join(SCENES)}; left out: all")
    parser.add_argument("--seeds", type=int, default=3, help="of the sensor, in scenes of one recording")
    parser.add_argument("--json", action="store_true")
    given = parser.parse_args()
    unknown = [name for name in given.scenes if name not in SCENES]
    if unknown:
        parser.error(f"SCENE: expected some of {', '.join(SCENES)}, got {', '.join(unknown)}")
    logging.disable(logging.WARNING)
    result = {}
    for name in given.scenes or SCENES:
        try:
            result[name] = compared(name, SCENES[name](given.seeds))
        except UnavailableError as error:
            say(f"left out: {error}")
    plain = json.loads(json.dumps(result), parse_constant=lambda _: None)  # null where undefined
    print(json.dumps(plain, indent=None if given.json else 1))


def say(line: str) -> None:
    """To whoever watches."""
    print(line, file=sys.stderr, flush=True)


def compared(name: str, folds: Sequence[Fold]) -> dict[str, Row]:
    """Tune every tracker, run it on what is judged, and score it, fold by fold."""
    ran: dict[str, list[Ran]] = {}
    for fold in folds:
        for called, peer in peers_of(fold).items():
            settings = tuned(peer, fold, ran[peer.after][-1].settings if peer.after else {})
            ran.setdefault(called, []).append(found := Ran.of(peer, fold, settings))
            say(f"{name}: {called}: HOTA {np.mean([of.hota for of in found.reports]):.3f}: {settings}")
    return {called: figures(of, ran[FIRST]) for called, of in ran.items()}


def peers_of(fold: Fold) -> dict[str, Peer]:
    """All trackers that can be had."""
    peers = ours(fold, learn_primitives(fold.traffic, rng=np.random.default_rng(0)))
    for package in PACKAGES:
        try:
            peers |= package(fold)
        except UnavailableError as error:
            say(f"left out: {error}")
    return peers


@dataclass(frozen=True, slots=True)
class Ran:
    """What a tracker did in a fold."""

    settings: Settings
    reports: list[TrackingReport]
    seconds: float
    n_frames: int

    @classmethod
    def of(cls, peer: Peer, fold: Fold, settings: Settings) -> Ran:
        """Run it on what is judged."""
        if not peer.axes:
            peer.track(fold.training[0], settings)  # compiled before it is timed
        tracked = [peer.track(part, settings) for part in fold.judged]
        reports = [scored(found, part, fold.similarity_m) for found, part in zip(tracked, fold.judged, strict=True)]
        n_frames = sum(sum(1 for _ in part.frames()) for part in fold.judged)
        return cls(settings, reports, sum(found.seconds for found in tracked), n_frames)


def scored(found: Tracked, part: Part, similarity_m: float) -> TrackingReport:
    """What a tracker reported, against the truth."""
    rows = part.judged(judged_rows(found.rows, part.truth).rows, part.truth)
    return report_of(rows, part.truth, is_hidden=part.is_hidden, with_ids=False, similarity_m=similarity_m).report


def tuned(peer: Peer, fold: Fold, start: Settings) -> dict[str, float]:
    """The settings of the best HOTA, searched from a start as those of every rival are."""
    axes = [axis._replace(start=start.get(axis.name, axis.start)) for axis in peer.axes]

    def settings_of(values: Sequence[float]) -> dict[str, float]:
        return dict(start) | dict(zip((axis.name for axis in axes), values, strict=True))

    def hota(values: tuple[float, ...]) -> float:
        of = settings_of(values)
        return float(np.mean([scored(peer.track(part, of), part, fold.similarity_m).hota for part in fold.training]))

    return settings_of([of.chosen for of in choose(axes, hota, least_gain=GAIN)]) if axes else dict(start)


def figures(ran: Sequence[Ran], first: Sequence[Ran]) -> Row:
    """Means over what is judged, the interval of HOTA, and how far it is behind ours."""
    reports = [report for of in ran for report in of.reports]
    hota, ahead = (np.array([report.hota for run in of for report in run.reports]) for of in (ran, first))
    each = np.arange(hota.size)
    own, behind = mean_over(each, hota), paired(each, ahead, hota, difference_of_means)
    return {
        "hota": own.value, "hota_low": own.low, "hota_high": own.high, "behind": behind.value,
        "behind_low": behind.low, "behind_high": behind.high,
        "ms_per_frame": 1e3 * sum(of.seconds for of in ran) / sum(of.n_frames for of in ran),
        "settings": [dict(of.settings) for of in ran],
        "switches": float(np.sum([report.switches for report in reports])),
    } | {
        name: float(np.mean([getattr(report, of) for report in reports]))
        for of in ("rmse", "seen_rmse", "hidden_rmse", "seen_nees", "hidden_nees", "reported")
        for name in ["nees" if of == "seen_nees" else of]
    }  # fmt: skip


if __name__ == "__main__":
    main()
