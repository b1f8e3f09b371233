"""`dirprim track`: vehicles of a log, tracked with a map."""

from __future__ import annotations

from contextlib import ExitStack
from typing import TYPE_CHECKING, Annotated, Literal

import typer

from dirprim_filter.cli import losses
from dirprim_filter.cli.options import (
    Connect,
    End,
    Fields,
    Force,
    Frame,
    Log,
    Map,
    Noise,
    Output,
    Particles,
    PlaneOrigin,
    Save,
    Seed,
    Spawn,
    Start,
    Strict,
    Time,
    TimeSource,
    Topics,
    time_ns,
)  # fmt: skip

if TYPE_CHECKING:
    from dirprim_filter.estimates import EstimateSink
    from dirprim_filter.forecasting import ForecastSink


def track(
    log: Log,
    map_file: Map,
    output: Output,
    save: Save = None,
    spawn: Spawn = False,
    connect: Connect = None,
    particles: Particles = 1000,
    noise: Noise = 0.5,
    particle_stride: Annotated[int, typer.Option(min=1, help="Write one particle in so many.")] = 1,
    forecast: Annotated[float, typer.Option(help="Each second forecast so many seconds ahead; 0 for none.")] = 0.0,
    place_free: Annotated[bool, typer.Option("--place-free", help="Ignore the places: the ablation.")] = False,
    seed: Seed = 0,
    topics: Topics = None,
    time_source: Time = TimeSource.LOG,
    frame: Frame = None,
    fields: Fields = None,
    origin: PlaneOrigin = None,
    start: Start = None,
    end: End = None,
    strict: Strict = False,
    force: Force = False,
) -> int:
    """Track the vehicles of a log with a learned map; write the estimates, and stream them to rerun.

    Example: dirprim track recordings/roundabout_track.mcap --map map.mcap -o tracks.mcap --save tracks.rrd
    """
    import numpy as np

    from dirprim_filter.cli.progress import with_progress
    from dirprim_filter.cli.provenance import provenance
    from dirprim_filter.config import FilterConfig
    from dirprim_filter.filtering import Tracker
    from dirprim_filter.forecasting import Forecaster
    from dirprim_filter.recording import load_map
    from dirprim_filter.recording.reader import FieldMapping, Origin, stream_detections
    from dirprim_filter.recording.writer import EstimateLog
    from dirprim_filter.replay import replay

    learned = load_map(map_file)
    config = FilterConfig(n_particles=particles, noise_m=noise)
    source: Literal["log", "publish", "header"] = time_source.value
    stream = stream_detections(
        log, topics=topics, time_source=source, start_ns=time_ns(start), end_ns=time_ns(end), strict=strict,
        frame=frame, mapping=FieldMapping.parse(fields) if fields else None,
        origin=Origin.parse(origin) if origin else None,
    )  # fmt: skip
    tracker = Tracker(
        learned.without_places() if place_free else learned, config=config, rng=np.random.default_rng(seed)
    )
    said = provenance(
        "track", inputs=[log, map_file], config=config, seed=seed, topics=topics, frame=frame, fields=fields,
        origin=origin, place_free=place_free,
    )  # fmt: skip
    with ExitStack() as open_files:
        estimates = open_files.enter_context(
            EstimateLog(output, metadata=said, particle_stride=particle_stride, force=force)
        )
        estimates.write_map_scene(learned)
        sinks: list[EstimateSink] = [estimates]
        forecasts: list[ForecastSink] = [estimates]
        if save is not None or spawn or connect is not None:
            from dirprim_filter.viewer.stream import open_stream

            viewer = open_files.enter_context(
                open_stream(save=save, spawn=spawn, connect=connect, force=force, particle_stride=particle_stride)
            )
            viewer.log_map(learned)
            sinks.append(viewer)
            forecasts.append(viewer)
        if forecast > 0:
            rng = np.random.default_rng([seed, 1])
            sinks.append(Forecaster(learned, forecasts, horizon_s=forecast, config=config, rng=rng))
        n_frames = replay(with_progress(stream, what=f"tracking {log.name}"), tracker, sinks)
    typer.echo(f"{output}: {n_frames} frames of {', '.join(sorted(stream.topics))}")
    return losses.exit_code(stream.damage, stream.dropped.total)
