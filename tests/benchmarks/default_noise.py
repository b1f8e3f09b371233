"""Is noise that is learned from the log a better default than 0.5 m? Simulated sensors, tracked by both.

Decides what `dirprim track` goes by where neither the log nor the user states the noise. Maps are learned from other
vehicles; of Lankershim, from other groups. NEES is 2 where covariances are right.

    python tests/benchmarks/default_noise.py [--scenes roundabout intersection lankershim] [--seconds 30]
"""

import argparse
from dataclasses import replace
from pathlib import Path

import numpy as np

from dirprim_filter import learn_primitives, read_tracks
from dirprim_filter.detections import Detections
from dirprim_filter.estimates import EstimateList, Estimates
from dirprim_filter.evaluation.calibration import self_calibrate
from dirprim_filter.evaluation.tracked_rows import TrackedRows
from dirprim_filter.evaluation.tracking_report import Scales, TrackingReport
from dirprim_filter.filtering import Tracker
from dirprim_filter.recording.tables import read_csv
from dirprim_filter.replay import replay
from dirprim_filter.sensor import AxisError, Sensor
from dirprim_filter.simulation.sensor import sense
from dirprim_filter.tracks import Tracks

ROOT = Path(__file__).parents[2]
SENSORS = [(0.02, 0.0), (0.1, 0.0), (0.25, 0.0), (0.5, 0.0), (1.0, 0.0), (2.0, 0.0), (0.5, 0.8)]
"""Spread in metres, and the share of the variance that lasts for half a second."""


def scene(name: str, seconds: float) -> tuple[Tracks, Tracks]:
    """What the map is learned from, and what is tracked."""
    if name != "lankershim":
        learned, tracked = (read_tracks(ROOT / f"recordings/{name}_{part}.mcap") for part in ("learn", "track"))
        return learned, tracked[tracked.time_ns < tracked.time_ns.min() + seconds * 1e9]
    tracks = read_csv(ROOT / "../shared/data/lankershim/lankershim.csv").tracks
    judged = np.unique(tracks.group)[1::2]
    few = judged[: max(round(seconds / 10.0), 1)]
    return tracks[~np.isin(tracks.group, judged)], tracks[np.isin(tracks.group, few)]


def report_of(learned, truth: Tracks, seen: list[Detections], sensor: Sensor | None) -> TrackingReport:
    """Each group by a tracker of its own."""
    rows = []
    for frames in seen:
        kept = EstimateList()
        replay(frames.frames(), Tracker(learned, sensor=sensor, rng=np.random.default_rng(0)), [kept])
        rows.append(kept.all())
    group = np.repeat([frames.group[0] for frames in seen], [len(part) for part in rows])
    found = TrackedRows.of(Estimates.concatenate(rows), group=group).at_instants_of(truth)
    return TrackingReport.of(found, truth, is_hidden=None, with_ids=True, scales=Scales())


def main():
    """Print a line for each scene and sensor."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--scenes", nargs="+", default=["roundabout", "intersection", "lankershim"])
    parser.add_argument("--seconds", type=float, default=30.0)
    given = parser.parse_args()
    print("scene         spread, lasts  RMSE, NEES, in 90 %: by 0.5 m   by default   by what was put in   found")
    for name in given.scenes:
        others, truth = scene(name, given.seconds)
        learned = learn_primitives(others, rng=np.random.default_rng(0))
        for spread, share in SENSORS:
            axis = AxisError(spread_m=spread, correlated_share=share, correlation_s=0.5)
            put = Sensor(along=axis, across=axis, detection_probability=0.95, clutter_density=2e-6)
            rng = np.random.default_rng(1)
            seen = [
                replace(found, group=np.full(len(found), world.group[0]))
                for world in truth.worlds() for found in [sense(world, put, rng=rng)]
            ]  # fmt: skip
            try:
                auto = self_calibrate(Detections.concatenate(seen), rng=np.random.default_rng(0)).sensor
                found = f"{auto.along.spread_m:.2f} {auto.across.spread_m:.2f} m, {auto.along.correlated_share:.2f}"
            except ValueError as error:
                auto, found = None, str(error)[:40]
            reports = [report_of(learned, truth, seen, sensor) for sensor in (None, auto, put)]
            figures = "  ".join(f"{of.rmse:.2f} {of.nees:5.2f} {of.coverage_90:.2f}" for of in reports)
            print(f"{name:<13} {spread:.2f} m, {share:.1f}   {figures}  {found}", flush=True)


if __name__ == "__main__":
    main()
