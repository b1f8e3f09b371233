"""Is it worth knowing that a sensor's errors last? Errors of 0.6 m, of which some last, tracked both ways.

Decides whether each particle carries the correlated part of the error: the filter that takes the errors for white is to
have a larger RMSE and to be surer of itself than it may be. NEES is 2 where covariances are right.

    python tests/benchmarks/correlated_noise.py [--seeds 3]
"""

import argparse
import sys
from pathlib import Path

import numpy as np

sys.path.insert(0, str(Path(__file__).parents[1]))

from dirprim_filter.config import FilterConfig
from dirprim_filter.filtering import Tracker
from dirprim_filter.primitives import learn_primitives
from dirprim_filter.replay import replay
from dirprim_filter.sensor import AxisError, Sensor
from dirprim_filter.simulation.sensor import sense
from evaluation.test_calibration import circling

SPREAD_M = 0.6
WARM_UP_NS = 1_000_000_000


def followed(learned, truth, seen, sensor, *, noise_m=SPREAD_M):
    """RMSE, NEES, and the share of true positions in 90 % ellipses, of estimates after a second."""
    where = {(v, t): x for v, t, x in zip(truth.track_id, truth.time_ns.tolist(), truth.position, strict=True)}
    error, covariance = [], []

    class Keep:
        @staticmethod
        def write(frame):
            of = frame.estimates
            for name, t, x, p in zip(of.track_id, of.time_ns.tolist(), of.position, of.covariance, strict=True):
                if t > WARM_UP_NS and (name, t) in where:
                    error.append(x - where[name, t])
                    covariance.append(p)

    tracker = Tracker(learned, config=FilterConfig(noise_m=noise_m), sensor=sensor, rng=np.random.default_rng(0))
    replay(seen.frames(), tracker, [Keep()])
    off = np.array(error)
    squared = np.einsum("ni,ni->n", off, np.linalg.solve(np.array(covariance), off[..., None])[..., 0])
    return np.sqrt((off**2).sum(axis=1).mean()), squared.mean(), (squared <= -2.0 * np.log(0.1)).mean()


def main():
    """Print a line for each sensor and model."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--seeds", type=int, default=3)
    given = parser.parse_args()
    truth = circling(40, 60)
    learned = learn_primitives(circling(40, 50), tessellation="grid", cell_size=20.0, rng=np.random.default_rng(0))
    print("errors last s, share   modelled as    rmse   nees   in 90 %")
    for seconds, share in ((0.0, 0.0), (0.5, 0.7), (0.5, 0.95), (2.5, 0.95)):
        axis = AxisError(spread_m=SPREAD_M, correlated_share=share, correlation_s=seconds or 1.0)
        sensor = Sensor(along=axis, across=axis)
        seen = [sense(truth, sensor, rng=np.random.default_rng(seed)) for seed in range(given.seeds)]
        for name, model in (("white", None), ("as they are", sensor)):
            found = np.mean([followed(learned, truth, of, model) for of in seen], axis=0)
            print(
                f"{seconds:12.1f}  {share:5.2f}    {name:12s} {found[0]:6.2f} {found[1]:6.2f} {found[2]:8.2f}",
                flush=True,
            )


if __name__ == "__main__":
    main()
