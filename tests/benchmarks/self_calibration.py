"""What does `--sensor auto` find of a simulated sensor? Of detections of the shipped traffic, beside what was put in.

Decides what the page about sensors says of it: spreads within so many per cent, correlation times less well.

    python tests/benchmarks/self_calibration.py [--seeds 2]
"""

import argparse
import time
from pathlib import Path

import numpy as np

from dirprim_filter import read_tracks
from dirprim_filter.evaluation.calibration import self_calibrate
from dirprim_filter.sensor import AxisError, Sensor
from dirprim_filter.simulation.sensor import sense

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


def main():
    """Print a line for each recording, sensor and seed."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--seeds", type=int, default=2)
    given = parser.parse_args()
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


if __name__ == "__main__":
    main()
