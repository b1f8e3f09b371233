"""`dirprim track`: vehicles of a log, tracked with a map."""

from __future__ import annotations

import json
from contextlib import ExitStack
from dataclasses import asdict
from typing import TYPE_CHECKING, Annotated, Literal

import typer

from dirprim_filter.cli import losses
from dirprim_filter.cli.options import (
    Connect,
    End,
    Force,
    Log,
    Map,
    Noise,
    Output,
    Particles,
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

PARTICLES_WRITTEN = 100
"""Of each vehicle: they are for the eye, and all of them take longer to write than to move."""


def track(
    log: Log,
    map_file: Map,
    output: Output,
    save: Save = None,
    spawn: Spawn = False,
    connect: Connect = None,
    particles: Particles = 1000,
    noise: Noise = 0.5,
    particle_stride: Annotated[
        int | None, typer.Option(min=1, help="Write one particle in so many; left out, some 100 of each vehicle.")
    ] = None,
    forecast: Annotated[float, typer.Option(help="Each second forecast so many seconds ahead; 0 for none.")] = 0.0,
    place_free: Annotated[bool, typer.Option("--place-free", help="Ignore the places: the ablation.")] = False,
    motion: Annotated[
        bool, typer.Option("--motion", help="The log's directions and speeds were measured: use them too.")
    ] = False,
    no_ids: Annotated[
        bool, typer.Option("--no-ids", help="Ignore the log's ids; detections without one need no such word.")
    ] = False,
    detection_probability: Annotated[float, typer.Option(help="Without ids: of a vehicle in sight, per frame.")] = 0.9,
    clutter_density: Annotated[float, typer.Option(help="Without ids: false detections per m2 and frame.")] = 1e-4,
    seed: Seed = 0,
    topics: Topics = None,
    time_source: Time = TimeSource.LOG,
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
    from dirprim_filter.config import FilterConfig, TrackingConfig
    from dirprim_filter.filtering import Tracker
    from dirprim_filter.forecasting import Forecaster
    from dirprim_filter.recording import load_map
    from dirprim_filter.recording.reader import stream_detections
    from dirprim_filter.recording.writer import EstimateLog
    from dirprim_filter.replay import replay

    learned = load_map(map_file)
    config = FilterConfig(n_particles=particles, noise_m=noise)
    stride = particle_stride or max(particles // PARTICLES_WRITTEN, 1)
    source: Literal["log", "publish", "header"] = time_source.value
    stream = stream_detections(
        log,
        topics=topics,
        time_source=source,
        start_ns=time_ns(start),
        end_ns=time_ns(end),
        strict=strict,
        motion=motion,
    )
    association = TrackingConfig(detection_probability=detection_probability, clutter_density=clutter_density)
    tracker = Tracker(
        learned.without_places() if place_free else learned,
        config=config, tracking=association, rng=np.random.default_rng(seed),
    )  # fmt: skip
    said = provenance(
        "track", inputs=[log, map_file], config=config, seed=seed, topics=topics, place_free=place_free, no_ids=no_ids,
        motion=motion,
        tracking=json.dumps(asdict(association), sort_keys=True),
    )  # fmt: skip
    with ExitStack() as open_files:
        estimates = open_files.enter_context(EstimateLog(output, metadata=said, particle_stride=stride, force=force))
        estimates.write_map_scene(learned)
        sinks: list[EstimateSink] = [estimates]
        forecasts: list[ForecastSink] = [estimates]
        if save is not None or spawn or connect is not None:
            from dirprim_filter.viewer.stream import open_stream

            viewer = open_files.enter_context(
                open_stream(save=save, spawn=spawn, connect=connect, force=force, particle_stride=stride)
            )
            viewer.log_map(learned)
            sinks.append(viewer)
            forecasts.append(viewer)
        if forecast > 0:
            rng = np.random.default_rng([seed, 1])
            sinks.append(Forecaster(learned, forecasts, horizon_s=forecast, config=config, rng=rng))
        frames = (frame.without_ids() for frame in stream) if no_ids else stream
        n_frames = replay(with_progress(frames, what=f"tracking {log.name}"), tracker, sinks)
    if tracker.recoveries:
        typer.echo(f"{tracker.recoveries} times a belief did not explain what was measured: begun anew", err=True)
    typer.echo(f"{output}: {n_frames} frames of {', '.join(sorted(stream.topics))}")
    return losses.exit_code(stream.damage, stream.dropped.total)
