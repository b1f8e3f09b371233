"""What `dirprim smooth` makes of other trackers' output: `python tests/benchmarks/refined_peers.py [--seeds N]`.

Stone Soup's nearest neighbours and norfair track scenes A and B of `peers.py`, at usual settings; in B they may coast
for 60 frames. Their output is refined by the map of other traffic there, and by the same map without its places. The
decision: a tracker's rows count as measurements whose errors last, and coasted rows are left out; `as measured` is what
comes of it without either. Figures are means over the seeds of the sensor.
"""

from __future__ import annotations

import argparse
import sys
from pathlib import Path

import numpy as np

sys.path.insert(0, str(Path(__file__).parent))

from peer_scenes import SCENES, Fold, Part, UnavailableError
from peer_stone_soup import stone_soup
from peer_trackers import norfair

from dirprim_filter import PrimitiveMap, learn_primitives, refining
from dirprim_filter.config import FilterConfig
from dirprim_filter.detections import Detections
from dirprim_filter.estimates import Estimates
from dirprim_filter.evaluation.tracked_rows import TrackedRows
from dirprim_filter.evaluation.tracking_report import report_of
from dirprim_filter.evaluation.truth import judged_rows

DELETED_AFTER = {"A": 10.0, "B": 60.0}
FIGURES = ("hota", "rmse", "switches", "reported")


def refined(rows: TrackedRows, fold: Fold, primitive_map: PrimitiveMap) -> TrackedRows:
    """What the command makes of a tracker's rows."""
    seen = Detections(track_id=rows.track_id, time_ns=rows.time_ns, position=rows.position)
    frames = refining.refine(
        seen, primitive_map, config=FilterConfig(noise_m=fold.noise_m), tracking=fold.tracking,
        rng=lambda: np.random.default_rng(0),
    )  # fmt: skip
    return TrackedRows.of(Estimates.concatenate(frame.estimates for frame in frames))


def as_measured(rows: TrackedRows, fold: Fold, primitive_map: PrimitiveMap) -> TrackedRows:
    """The same, of every row, as if its error were its own."""
    usual = refining.EVEN, refining.CORRELATED_SHARE
    refining.EVEN, refining.CORRELATED_SHARE = -1.0, 0.0
    try:
        return refined(rows, fold, primitive_map)
    finally:
        refining.EVEN, refining.CORRELATED_SHARE = usual


def outputs(scene: str, fold: Fold, part: Part) -> dict[str, TrackedRows]:
    """What each tracker reports."""
    found = {}
    for package in (stone_soup, norfair):
        try:
            name, peer = next(iter(package(fold).items()))
        except UnavailableError as error:
            print(f"left out: {error}", file=sys.stderr)
            continue
        settings = {axis.name: axis.start for axis in peer.axes} | {"deleted_after": DELETED_AFTER[scene]}
        found[name] = peer.track(part, settings).rows
    return found


def main() -> None:
    """Print a line for each scene, tracker and refinement."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--seeds", type=int, default=3, help="of the sensor")
    given = parser.parse_args()
    figures: dict[tuple[str, str, str], list[list[float]]] = {}
    for scene in DELETED_AFTER:
        (fold,) = SCENES[scene](given.seeds)
        learned = learn_primitives(fold.traffic, rng=np.random.default_rng(0))
        for part in fold.judged:
            for name, rows in outputs(scene, fold, part).items():
                judged = {
                    "as it is": rows,
                    "smoothed": refined(rows, fold, learned),
                    "smoothed without the map": refined(rows, fold, learned.without_places()),
                    "as measured": as_measured(rows, fold, learned),
                }
                for how, of in judged.items():
                    report = report_of(
                        judged_rows(of, part.truth).rows, part.truth, is_hidden=part.is_hidden, with_ids=False,
                    ).report  # fmt: skip
                    figures.setdefault((scene, name, how), []).append([getattr(report, key) for key in FIGURES])
    means = {key: np.mean(values, axis=0).tolist() for key, values in figures.items()}
    print(" | ".join(("scene", "tracker", "how", *FIGURES)))
    for key, values in means.items():
        print(" | ".join((*key, *(f"{value:.3f}" for value in values))))


if __name__ == "__main__":
    main()
