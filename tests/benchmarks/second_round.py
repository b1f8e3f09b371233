"""Is a smoothed log learning data? `python tests/benchmarks/second_round.py LOG`.

Defends `learn` on `/dirprim/smoothed`. The training vehicles are known by their detections alone, 0.5 m of noise in
each axis. First round: smoothed by constant velocity, learned from. Second round: the same detections tracked with
that map, smoothed, learned from. Held-out vehicles are then tracked with either map, and with one learned from the
truth, which no round can expect to beat.
"""

from __future__ import annotations

import argparse

import numpy as np

from dirprim_filter import Tracks, learn_primitives, read_tracks
from dirprim_filter.evaluation.experiment import held_out
from dirprim_filter.evaluation.scenes import Scene, followed
from dirprim_filter.evaluation.scoring import report
from dirprim_filter.evaluation.tracking_experiment import TrackingExperiment
from dirprim_filter.filtering import ConstantVelocityKalman, ParticleFilter
from dirprim_filter.filtering.manoeuvre import acceleration_density
from dirprim_filter.simulation.sensor import detect


def smoothed_tracks(scenes, make, experiment):
    """What the smoother says of detections, as tracks to learn from."""
    worlds = followed(scenes, make, experiment, smooth=True, seed=0).smoothed
    return Tracks.concatenate([
        Tracks(track_id=of.track_id, time_ns=of.time_ns, position=of.position, direction=of.direction, speed=of.speed)
        for of in (world.estimates.all() for world in worlds)
    ])  # fmt: skip


def main() -> None:
    """Print root mean square errors and mean normalised squared errors of held-out vehicles, map by map."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("log")
    parser.add_argument("--vehicles", type=int, default=120, help="to learn from at most; default: %(default)s")
    parser.add_argument("--judged", type=int, default=40, help="held out at most; default: %(default)s")
    given = parser.parse_args()
    experiment = TrackingExperiment()
    rng = np.random.default_rng(0)
    train, test = held_out(read_tracks(given.log), share=0.8, rng=rng)
    train, test = (
        of[np.isin(of.vehicle, rng.permutation(np.unique(of.vehicle))[:most])]
        for of, most in ((train, given.vehicles), (test, given.judged))
    )
    density = 3.0 * acceleration_density(train)
    to_learn = [Scene.of(world, TrackingExperiment(gap_s=0.0), detect, seed=1) for world in train.worlds()]
    to_judge = [Scene.of(world, experiment, detect, seed=2) for world in test.worlds()]

    def judge(name, learned):
        ways = followed(to_judge, lambda: ParticleFilter(learned, experiment.filter), experiment, smooth=True, seed=3)
        for kind, worlds in zip(("filter", "smoother"), ways, strict=True):
            r = report(worlds, with_ids=True, scales=experiment.scales)
            seen, gap = f"{r.seen_rmse:.3f} m (NEES {r.seen_nees:.1f})", f"{r.hidden_rmse:.2f} m ({r.hidden_nees:.1f})"
            print(f"{name:13s} {kind:9s} seen {seen}, in gaps {gap}", flush=True)

    rows = smoothed_tracks(
        to_learn, lambda: ConstantVelocityKalman(acceleration_density=density, config=experiment.filter), experiment
    )
    first = learn_primitives(rows, rng=np.random.default_rng(4))
    judge("first round", first)
    rows = smoothed_tracks(to_learn, lambda: ParticleFilter(first, experiment.filter), experiment)
    judge("second round", learn_primitives(rows, rng=np.random.default_rng(4)))
    judge("the truth", learn_primitives(train, rng=np.random.default_rng(4)))


if __name__ == "__main__":
    main()
