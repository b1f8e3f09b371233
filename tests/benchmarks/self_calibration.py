"""What does `--sensor auto` find of a simulated sensor? Of detections of the shipped traffic, beside what was put in.

Decides what the page about sensors says of it: spreads within so many per cent, correlation times less well. With
`--tracked` what the filter gains: beside the default noise of 0.5 m and beside the sensor that was put in.

    python tests/benchmarks/self_calibration.py [--seeds 2] [--tracked]
"""

import argparse
import sys
import time
from pathlib import Path

import numpy as np

sys.path.insert(0, str(Path(__file__).parents[1]))

from benchmarks.correlated_noise import followed
from dirprim_filter import learn_primitives, read_tracks
from dirprim_filter.evaluation.calibration import self_calibrate
from dirprim_filter.filtering.sensed_particles import knobs_of
from dirprim_filter.sensor import AxisError, Sensor
from dirprim_filter.simulation.sensor import sense
from evaluation.test_calibration import circling

RECORDINGS = Path(__file__).parents[2] / "recordings"
SENSORS = {
    "white": Sensor(
        along=AxisError(spread_m=0.5), across=AxisError(spread_m=0.3), detection_probability=0.9, clutter_density=2e-5
    ),
    "lasting": Sensor(
        along=AxisError(spread_m=0.6, correlated_share=0.8, correlation_s=0.5),
        across=AxisError(spread_m=0.3, correlated_share=0.6, correlation_s=0.5),
        detection_probability=0.9, clutter_density=2e-5,
    ),
}  # fmt: skip


def tracked():
    """Print a line for each sensor, with RMSE, NEES and the share of true positions in 90 % ellipses."""
    truth = circling(40, 60)
    learned = learn_primitives(circling(40, 50), tessellation="grid", cell_size=20.0, rng=np.random.default_rng(0))
    print("spread, lasts         by 0.5 m           by auto           by what was put in")
    for spread, share in ((0.25, 0.0), (0.5, 0.0), (1.0, 0.0), (0.6, 0.8)):
        axis = AxisError(spread_m=spread, correlated_share=share, correlation_s=0.5)
        put = Sensor(along=axis, across=axis)
        seen = sense(truth, put, rng=np.random.default_rng(1))
        auto = self_calibrate(seen, rng=np.random.default_rng(0)).sensor
        figures = [
            "  ".join(f"{figure:.2f}" for figure in followed(learned, truth, seen, model, noise_m=noise_m))
            for model, noise_m in ((None, 0.5), (auto, knobs_of(auto)["noise_m"]), (put, spread))
        ]
        print(f"{spread:.2f} m, {share:.1f}   ", "   ".join(figures), flush=True)


def main():
    """Print a line for each recording, sensor and seed; or what it is worth."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--seeds", type=int, default=2)
    parser.add_argument("--tracked", action="store_true")
    given = parser.parse_args()
    if given.tracked:
        return tracked()
    print("recording     sensor   along (put in), lasts    across (put in), lasts     s")
    for scene in ("roundabout", "intersection"):
        truth = read_tracks(RECORDINGS / f"{scene}_track.mcap")
        for name, sensor in SENSORS.items():
            for seed in range(given.seeds):
                seen = sense(truth, sensor, rng=np.random.default_rng(seed))
                began = time.perf_counter()
                found = self_calibrate(seen, rng=np.random.default_rng(seed)).sensor
                axes = "  ".join(
                    f"{got.spread_m:.3f} ({put.spread_m}), {got.correlated_share:.2f} {got.correlation_s:.2f} s"
                    for got, put in ((found.along, sensor.along), (found.across, sensor.across))
                )
                print(f"{scene:<13} {name:<8} {axes}  {time.perf_counter() - began:.0f}", flush=True)
    return None


if __name__ == "__main__":
    main()
