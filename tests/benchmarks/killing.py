"""A tracker killed with signal 9 a hundred times: the decision to close a chunk each second of log time rests on this.

Usage: python tests/benchmarks/killing.py [KILLS] [SEED]. Prints how many outputs were recovered, and what was lost of
those frames that the tracker had handed over. Any output that is not recovered, or loses more than its last chunk (a
second of log time), ends the run with an error.
"""

from __future__ import annotations

import sys
import tempfile
import time
from pathlib import Path

import numpy as np

sys.path.insert(0, str(Path(__file__).parents[1]))
sys.path.insert(0, str(Path(__file__).parents[1] / "recording"))
from killing import trackers

from dirprim_filter import learn_primitives
from situations import ring_traffic


def main(n_kills: int = 100, seed: int = 0) -> None:
    """Kill, recover, count."""
    rng = np.random.default_rng(seed)
    begun = time.perf_counter()
    ring_map = learn_primitives(ring_traffic(rng), tessellation="grid", cell_size=6.0, rng=rng)
    with tempfile.TemporaryDirectory() as folder, trackers(Path(folder), ring_map) as tracking:
        kills = [tracking.kill_one(str(kill), rng) for kill in range(n_kills)]
    lost_s = np.array([kill.lost_ns for kill in kills]) * 1e-9
    handed, recovered = (sum(getattr(kill, f"n_{name}") for kill in kills) for name in ("handed_over", "recovered"))
    print(f"{len(kills)} kills in {time.perf_counter() - begun:.0f} s, each output recovered")
    print(f"{handed} frames were handed over, {recovered} are in the recovered logs")
    print(f"lost of a run, seconds of log time: median {np.median(lost_s):.2f}, most {lost_s.max():.2f}")


if __name__ == "__main__":
    main(*map(int, sys.argv[1:]))
