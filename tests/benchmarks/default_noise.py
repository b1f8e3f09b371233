"""Is noise that is learned from the log a better default than 0.5 m? Simulated sensors, tracked by both.

Decides what `dirprim track` goes by where neither the log nor the user states the noise. Maps are learned from other
vehicles; of Lankershim, from other groups. NEES is 2 where covariances are right.

    python tests/benchmarks/default_noise.py [--scenes roundabout intersection lankershim] [--seconds 30]
"""

import argparse
import sys
import time
from dataclasses import replace
from pathlib import Path

import numpy as np

sys.path.insert(0, str(Path(__file__).parents[1]))

from dirprim_filter import learn_primitives, read_tracks
from dirprim_filter.detections import Detections
from dirprim_filter.evaluation.calibration import self_calibrate
from dirprim_filter.filtering import Tracker
from dirprim_filter.recording.tables import read_csv
from dirprim_filter.replay import replay
from dirprim_filter.sensor import AxisError, Sensor
from dirprim_filter.simulation.sensor import sense
from dirprim_filter.tracks import Tracks

ROOT = Path(__file__).parents[2]
LANKERSHIM = ROOT / "../shared/data/lankershim/lankershim.csv"
SENSORS = ((0.02, 0.0), (0.1, 0.0), (0.25, 0.0), (0.5, 0.0), (1.0, 0.0), (2.0, 0.0), (0.5, 0.8))
"""Metres of spread, and the share of the variance that lasts for 0.5 s."""
WARM_UP_NS = 1_000_000_000


def scene(name: str, seconds: float) -> tuple[Tracks, Tracks]:
    """What the map is learned from, and what is tracked."""
    if name != "lankershim":
        learned, tracked = (read_tracks(ROOT / f"recordings/{name}_{of}.mcap") for of in ("learn", "track"))
        return learned, tracked[tracked.time_ns < tracked.time_ns.min() + seconds * 1e9]
    tracks = read_csv(LANKERSHIM).tracks
    is_learned = np.isin(tracks.group, np.unique(tracks.group)[::2])
    held = tracks[~is_learned]
    return tracks[is_learned], held[np.isin(held.group, np.unique(held.group)[: max(round(seconds / 10.0), 1)])]


def seen_by(sensor: Sensor, truth: Tracks, *, seed: int) -> Detections:
    """What it reports of each group."""
    rng = np.random.default_rng(seed)
    parts = []
    for group in np.unique(truth.group).tolist():
        part = sense(truth[truth.group == group], sensor, rng=rng)
        parts.append(replace(part, group=np.full(len(part), group)))
    return Detections.concatenate(parts)


class Errors:
    """A sink that keeps how far estimates are off, of vehicles seen for a second, and how far they say they may be."""

    def __init__(self, truth: Tracks) -> None:
        rows = zip(map(str, truth.track_id), truth.time_ns.tolist(), truth.position, strict=True)
        self._where = {(name, t): place for name, t, place in rows}
        self._begin = {}
        for name, t in self._where:
            self._begin[name] = min(t, self._begin.get(name, t))
        self.off, self.covariance = [], []

    def write(self, frame) -> None:
        said = frame.estimates
        names = map(str, said.track_id)
        for name, t, place, covariance in zip(
            names, said.time_ns.tolist(), said.position, said.covariance, strict=True
        ):
            if (name, t) in self._where and t > self._begin[name] + WARM_UP_NS:
                self.off.append(place - self._where[name, t])
                self.covariance.append(covariance)


def followed(learned, truth: Tracks, seen: Detections, sensor: Sensor | None) -> tuple[float, float, float]:
    """RMSE, NEES, and the share of true positions in 90 % ellipses."""
    off, covariance = [], []
    for group in np.unique(truth.group).tolist():
        errors = Errors(truth[truth.group == group])
        tracker = Tracker(learned, sensor=sensor, rng=np.random.default_rng(0))
        replay(seen[seen.group == group].frames(), tracker, [errors])
        off += errors.off
        covariance += errors.covariance
    errors = np.array(off)
    squared = np.einsum("ni,ni->n", errors, np.linalg.solve(np.array(covariance), errors[..., None])[..., 0])
    return np.sqrt((errors**2).sum(axis=1).mean()), squared.mean(), (squared <= -2.0 * np.log(0.1)).mean()


def main():
    """Print a line for each scene and sensor."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--scenes", nargs="+", default=["roundabout", "intersection", "lankershim"])
    parser.add_argument("--seconds", type=float, default=30.0)
    given = parser.parse_args()
    print("scene         spread, lasts  by 0.5 m           by auto            by what was put in found")
    for name in given.scenes:
        others, truth = scene(name, given.seconds)
        learned = learn_primitives(others, rng=np.random.default_rng(0))
        for spread, share in SENSORS:
            axis = AxisError(spread_m=spread, correlated_share=share, correlation_s=0.5)
            put = Sensor(along=axis, across=axis, detection_probability=0.95, clutter_density=2e-6)
            seen = seen_by(put, truth, seed=1)
            began = time.process_time()
            try:
                auto, why = self_calibrate(seen, rng=np.random.default_rng(0)).sensor, ""
            except ValueError as error:
                auto, why = None, str(error)
            took = time.process_time() - began
            by = {"0.5 m": None, "put in": put} | ({} if auto is None else {"auto": auto})
            figures = {of: "{:.2f} {:5.2f} {:.2f}".format(*followed(learned, truth, seen, by[of])) for of in by}
            print(
                f"{name:<13} {spread:.2f} m, {share:.1f}  ",
                *(f"{figures.get(of, ''):<18}" for of in ("0.5 m", "auto", "put in")),
                why[:40] if auto is None else f"{auto.along.spread_m:.2f} {auto.across.spread_m:.2f} m,",
                f"{took:.1f} s",
                flush=True,
            )


if __name__ == "__main__":
    main()
