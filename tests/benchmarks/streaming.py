"""What does it cost to watch? 100 vehicles of 1,000 particles at 10 Hz, tracked on a map, streamed to rerun.

Decisions: what moves is sent in columns of many frames, an entity for each kind of thing; ellipses are half axes and a
turn, not lines; a file gets one particle in twenty unless asked otherwise; fans of forecasts are compiled, and share
their vertices (finding their regions counts as tracking: the MCAP has them too); Eq. 4 of the ringed vehicle is drawn
for many frames at once; of more than 40 vehicles only a few are drawn with their particles. Wanted: streaming takes at
most 20 % of the time of tracking, and ten minutes stay under 600 MB (from the seconds measured: sizes grow with the
number of frames).

    python tests/benchmarks/streaming.py [--seconds 60] [--vehicles 100] [--particles 1000]
"""

from __future__ import annotations

import argparse
import sys
import tempfile
import time
from pathlib import Path

import numpy as np

sys.path.insert(0, str(Path(__file__).parents[1]))

from dirprim_filter import learn_primitives
from dirprim_filter.config import FilterConfig
from dirprim_filter.detections import Detections
from dirprim_filter.estimates import EstimateSink, TrackedFrame
from dirprim_filter.filtering import Tracker
from dirprim_filter.forecasting import Forecaster, Forecasts, ForecastSink
from dirprim_filter.replay import replay
from dirprim_filter.tracks import Tracks
from dirprim_filter.viewer.sink import RerunSink
from dirprim_filter.viewer.stream import open_stream
from situations import ring_traffic

WATCHED_S = 600.0


class Timed:
    """A sink that counts the seconds that another takes."""

    def __init__(self, sink: RerunSink) -> None:
        self.sink, self.seconds = sink, 0.0

    def write(self, frame: TrackedFrame) -> None:
        """Pass on."""
        began = time.perf_counter()
        self.sink.write(frame)
        self.seconds += time.perf_counter() - began

    def write_forecast(self, forecasts: Forecasts) -> None:
        """Pass on."""
        began = time.perf_counter()
        self.sink.write_forecast(forecasts)
        self.seconds += time.perf_counter() - began


def main() -> None:
    """Print the table."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--seconds", type=float, default=60.0, help="of log time")
    parser.add_argument("--vehicles", type=int, default=100)
    parser.add_argument("--particles", type=int, default=1000)
    given = parser.parse_args()
    rng = np.random.default_rng(1)
    learned = learn_primitives(ring_traffic(rng), tessellation="grid", cell_size=7.0, rng=rng)
    traffic = ring_traffic(rng, n_vehicles=given.vehicles, n_rows=round(10 * given.seconds))
    frames = list(_seen(traffic, rng).frames())
    print(f"{given.vehicles} vehicles of {given.particles} particles, {len(frames)} frames")
    print(f"{'watched':<44}{'tracking s':>11}{'streaming s':>12}{'share':>8}{'MB':>8}{'MB/10 min':>11}")
    for name, stride, forecasts in [
        ("every particle", 1, False), ("one in 10", 10, False), ("one in 20: what track does", 20, False),
        ("one in 20, and 4 s ahead each second", 20, True),
    ]:  # fmt: skip
        with tempfile.TemporaryDirectory() as folder:
            file = Path(folder) / "run.rrd"
            began = time.perf_counter()
            with open_stream(save=file, particle_stride=stride) as shown:
                timed = Timed(shown)
                shown.log_map(learned)
                config = FilterConfig(n_particles=given.particles)
                tracker = Tracker(learned, config=config, rng=np.random.default_rng(2))
                sinks: list[EstimateSink] = [timed]
                to: list[ForecastSink] = [timed]
                if forecasts:
                    sinks.append(Forecaster(learned, to, horizon_s=4.0, rng=np.random.default_rng(3)))
                replay(frames, tracker, sinks)
                closing = time.perf_counter()
            end = time.perf_counter()
            streaming = timed.seconds + end - closing
            tracking = end - began - streaming
            size = file.stat().st_size / 1e6
            ten_minutes = size * WATCHED_S / given.seconds
            print(
                f"{name:<44}{tracking:>11.2f}{streaming:>12.2f}{streaming / tracking:>8.1%}{size:>8.1f}"
                f"{ten_minutes:>11.0f}"
            )


def _seen(traffic: Tracks, rng: np.random.Generator) -> Detections:
    return Detections(
        track_id=traffic.track_id.astype(np.str_),
        time_ns=traffic.time_ns,
        position=traffic.position + rng.normal(0.0, 0.5, traffic.position.shape),
    )


if __name__ == "__main__":
    main()
