"""What does it cost to watch? 100 vehicles of 1,000 particles at 10 Hz, tracked on a map, streamed to rerun.

Decisions: what moves is sent in columns of many frames, an entity for each kind of thing; ellipses are half axes and a
turn, not lines; a file gets one particle in twenty unless asked otherwise; fans of forecasts are compiled, and share
their vertices (finding their regions counts as tracking: the MCAP has them too); Eq. 4 of the ringed vehicle is drawn
for many frames at once; of more than 40 vehicles only a few are drawn with their particles; files are written by a
thread of their own. Wanted: watched, tracking takes at most 20 % longer than alone, and ten minutes stay under 600 MB
(from the seconds measured: sizes grow with the number of frames).

    python tests/benchmarks/streaming.py [--seconds 60] [--vehicles 100] [--particles 1000]
"""

from __future__ import annotations

import argparse
import sys
import tempfile
import time
from contextlib import ExitStack
from pathlib import Path

import numpy as np

sys.path.insert(0, str(Path(__file__).parents[1]))

from dirprim_filter import learn_primitives
from dirprim_filter.config import FilterConfig
from dirprim_filter.detections import Detections
from dirprim_filter.estimates import EstimateSink
from dirprim_filter.filtering import Tracker
from dirprim_filter.forecasting import Forecaster, ForecastSink
from dirprim_filter.primitives import PrimitiveMap
from dirprim_filter.replay import replay
from dirprim_filter.tracks import Tracks
from dirprim_filter.viewer.sink import open_stream
from situations import ring_traffic

WATCHED_S = 600.0


def main() -> None:
    """Print the table."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--seconds", type=float, default=60.0, help="of log time")
    parser.add_argument("--vehicles", type=int, default=100)
    parser.add_argument("--particles", type=int, default=1000)
    parser.add_argument("--repeats", type=int, default=3, help="of which the quickest counts")
    given = parser.parse_args()
    rng = np.random.default_rng(1)
    learned = learn_primitives(ring_traffic(rng), tessellation="grid", cell_size=7.0, rng=rng)
    traffic = ring_traffic(rng, n_vehicles=given.vehicles, n_rows=round(10 * given.seconds))
    frames = list(_seen(traffic, rng).frames())
    print(f"{given.vehicles} vehicles of {given.particles} particles, {len(frames)} frames")
    print(f"{'watched':<44}{'alone s':>9}{'watched s':>11}{'share':>8}{'MB':>8}{'MB/10 min':>11}")
    for name, stride, forecasts in [
        ("every particle", 1, False), ("one in 10", 10, False), ("one in 20: what track does", 20, False),
        ("one in 20, and 4 s ahead each second", 20, True),
    ]:  # fmt: skip
        taken: dict[bool, list[float]] = {False: [], True: []}
        size = 0.0
        for watched in [False, True] * given.repeats:
            with tempfile.TemporaryDirectory() as folder:
                file = Path(folder) / "run.rrd"
                tracker = Tracker(
                    learned, config=FilterConfig(n_particles=given.particles), rng=np.random.default_rng(2)
                )
                began = time.perf_counter()
                track(frames, tracker, learned, file if watched else None, stride=stride, forecasts=forecasts)
                taken[watched].append(time.perf_counter() - began)
                size = file.stat().st_size / 1e6 if watched else 0.0
        alone, watched_s = min(taken[False]), min(taken[True])
        share, ten_minutes = watched_s / alone - 1.0, size * WATCHED_S / given.seconds
        print(f"{name:<44}{alone:>9.2f}{watched_s:>11.2f}{share:>8.1%}{size:>8.1f}{ten_minutes:>11.0f}")


def track(
    frames: list[Detections],
    tracker: Tracker,
    learned: PrimitiveMap,
    file: Path | None,
    *,
    stride: int,
    forecasts: bool,
) -> None:
    """Track, and forecast, and stream to a file if there is one."""
    with ExitStack() as stack:
        sinks: list[EstimateSink] = []
        to: list[ForecastSink] = []
        if file is not None:
            shown = stack.enter_context(open_stream(save=file, particle_stride=stride))
            shown.log_map(learned)
            sinks.append(shown)
            to.append(shown)
        if forecasts:
            sinks.append(Forecaster(learned, to, horizon_s=4.0, rng=np.random.default_rng(3)))
        replay(frames, tracker, sinks)


def _seen(traffic: Tracks, rng: np.random.Generator) -> Detections:
    return Detections(
        track_id=traffic.track_id.astype(np.str_),
        time_ns=traffic.time_ns,
        position=traffic.position + rng.normal(0.0, 0.5, traffic.position.shape),
    )


if __name__ == "__main__":
    main()
