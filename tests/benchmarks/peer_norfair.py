"""norfair behind `peers.py`: it needs numpy 1, so it runs in an environment of its own.

    uv run --isolated --no-project --with norfair==2.3.0 --with "numpy<2" python tests/benchmarks/peer_norfair.py

Each line on the standard input is a JSON object: the file of the detections, the file for the tracks, and settings. The
answer is the processor's seconds.
"""

from __future__ import annotations

import json
import sys
import time

import numpy as np
from norfair import Detection, OptimizedKalmanFilterFactory, Tracker


def tracked(given: dict, settings: dict) -> dict:  # type: ignore[type-arg]
    """Arrays of detections and of tracks; norfair's unit of time is a frame."""
    step_s = settings["step_s"]
    delay = round(settings["confirmed_after"]) - 1
    tracker = Tracker(
        distance_function="euclidean",
        distance_threshold=settings["gate_m"],
        hit_counter_max=max(round(settings["deleted_after"]), delay + 1),
        initialization_delay=delay,
        filter_factory=OptimizedKalmanFilterFactory(
            R=settings["noise_m"] ** 2,
            Q=settings["acceleration"] * step_s**3,
            pos_variance=settings["noise_m"] ** 2,
            vel_variance=(settings["speed_m_s"] * step_s) ** 2,
        ),
    )
    names, times, places = [], [], []
    ends = np.cumsum(given["n_seen"])
    for time_ns, end, n in zip(given["instants"].tolist(), ends.tolist(), given["n_seen"].tolist(), strict=True):
        seen = [Detection(points=place[None]) for place in given["position"][end - n : end]]
        for found in tracker.update(seen):
            names.append(found.id)
            times.append(time_ns)
            places.append(found.estimate[0].copy())
    return {
        "track_id": np.array(names, np.int64), "time_ns": np.array(times, np.int64),
        "position": np.array(places, np.float64).reshape(-1, 2),
    }  # fmt: skip


def main() -> None:
    """Track until the input ends."""
    print("ready", flush=True)
    for line in sys.stdin:
        request = json.loads(line)
        with np.load(request["given"]) as given:
            arrays = {name: given[name] for name in given.files}
        since = time.process_time()
        found = tracked(arrays, request["settings"])
        seconds = time.process_time() - since
        np.savez(request["answer"], **found)
        print(seconds, flush=True)


if __name__ == "__main__":
    main()
