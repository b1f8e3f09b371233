"""`dirprim track`: vehicles of a log, tracked with a map."""

from __future__ import annotations

import json
from contextlib import ExitStack, nullcontext
from dataclasses import asdict
from functools import partial
from typing import TYPE_CHECKING, Annotated

import typer

from dirprim_filter.cli import losses
from dirprim_filter.cli.counts import counted
from dirprim_filter.cli.options import (
    Bind,
    ColorBy,
    Config,
    Connect,
    Focus,
    Force,
    Interaction,
    Layout,
    Log,
    Map,
    NoIds,
    Noise,
    Output,
    ParticleColor,
    Particles,
    Save,
    Seed,
    SensorOrAuto,
    Serve,
    Spawn,
    Truth,
)
from dirprim_filter.cli.reading import Reading, reads_logs
from dirprim_filter.cli.results import CONFIG_KEY, read_filter
from dirprim_filter.cli.sensing import sensor_of

if TYPE_CHECKING:
    from pathlib import Path

    from dirprim_filter.config import FilterConfig
    from dirprim_filter.estimates import EstimateSink
    from dirprim_filter.filtering import Worlds
    from dirprim_filter.filtering.smoothing import Smoother
    from dirprim_filter.forecasting import Forecaster, ForecastSink
    from dirprim_filter.nearby_map import NearbyMap
    from dirprim_filter.recording.writer import EstimateWriter

PARTICLES_WRITTEN = 100
"""Of each vehicle: they are for the eye, and all of them take longer to write than to move."""
PARTICLES_SHOWN = 50
"""The same in rerun: 10 minutes of 100 vehicles then stay well below a gigabyte."""


@reads_logs
def track(
    log: Log,
    map_file: Map,
    output: Output,
    layout: Layout = None,
    save: Save = None,
    spawn: Spawn = False,
    connect: Connect = None,
    serve: Serve = False,
    bind: Bind = "127.0.0.1",
    truth: Truth = None,
    focus: Focus = None,
    color_by: ColorBy = ParticleColor.DIRECTION,
    config: Config = None,
    particles: Particles = None,
    noise: Noise = None,
    sensor: SensorOrAuto = None,
    particle_stride: Annotated[
        int | None,
        typer.Option(min=1, help="Write every n-th particle. Default: about 100 a vehicle, 50 to rerun."),
    ] = None,
    in_full: Annotated[
        int | None,
        typer.Option(
            min=0, help="Number of vehicles drawn in full in rerun, with particles, ellipse, name and forecast."
        ),
    ] = None,
    smooth: Annotated[
        bool, typer.Option("--smooth", help="Also write smoothed estimates, which use the whole log.")
    ] = False,
    lag: Annotated[
        float | None,
        typer.Option(min=0.0, help="Fixed-lag smoothing for streams: estimates are this many seconds late."),
    ] = None,
    forecast: Annotated[
        float, typer.Option(min=0.0, help="Every second, forecast this many seconds ahead; 0: no forecasts.")
    ] = 0.0,
    place_free: Annotated[
        bool, typer.Option("--place-free", help="Track without the map's cells: the ablation.")
    ] = False,
    motion: Annotated[
        bool, typer.Option("--motion", help="Use the log's directions and speeds as measurements too.")
    ] = False,
    interaction: Interaction = None,
    no_ids: NoIds = False,
    detection_probability: Annotated[
        float | None, typer.Option(help="Of a vehicle in sight, per frame. Default: 0.9.")
    ] = None,
    clutter_density: Annotated[
        float | None, typer.Option(help="False detections per m2 and frame. Default: 0.0001; 1e-9 if there are none.")
    ] = None,
    seed: Seed = 0,
    reading: Reading = Reading(),
    force: Force = False,
) -> int:
    """Track the vehicles of a log with a learned map; write the estimates, and stream them to rerun.

    How the sensor errs is learned from the first minutes of the log, as far as it shows without a truth, and printed;
    unless --noise, --sensor, --config or the log itself says so. With --sensor a detection is of where the vehicle was
    its latency ago, and estimates are of their own time.

    Groups of a log are tracked each by itself, whatever their times: the vehicles of a group other than 0 are called
    group/id in the output. With --group only that one, under its ids.

    Example: dirprim track recordings/roundabout_track.mcap --map map.mcap -o tracks.mcap --save tracks.rrd
    """
    import numpy as np

    from dirprim_filter.cli.progress import with_progress
    from dirprim_filter.cli.provenance import provenance
    from dirprim_filter.cli.watching import keep_serving, open_viewer
    from dirprim_filter.filtering import Tracker, Worlds
    from dirprim_filter.nearby_map import NearbyMap
    from dirprim_filter.recording import open_map
    from dirprim_filter.recording.writer import EstimateWriter
    from dirprim_filter.replay import replay

    sensing = sensor_of(sensor, log, reading, noise_m=noise, config=config, with_ids=not no_ids, seed=seed)
    knobs, association = read_filter(
        config, n_particles=particles, noise_m=noise, detection_probability=detection_probability,
        clutter_density=clutter_density, interaction=interaction and interaction.value, sensor=sensing,
    )  # fmt: skip
    nearby = NearbyMap(
        open_map(map_file), ahead_s=forecast + (0.0 if sensing is None else sensing.latency_s), noise_m=knobs.noise_m,
        sight=None if sensing is None else sensing.sight,
    )  # fmt: skip
    stride = particle_stride or max(knobs.n_particles // PARTICLES_WRITTEN, 1)
    stream = reading.detections(log, motion=motion)
    watched = save is not None or spawn or connect is not None or serve
    smoother = _smoother(knobs, smooth=smooth, lag_s=lag)

    def tracker_of(group: int) -> Tracker:
        make = Tracker if smoother is None else partial(smoother.tracker, group)
        return make(
            nearby.part.without_places() if place_free else nearby.part, config=knobs, tracking=association,
            sensor=sensing, with_innovations=watched, rng=np.random.default_rng(seed),
        )  # fmt: skip

    worlds = Worlds(tracker_of)
    frames = nearby.along((seen.without_ids() for seen in stream) if no_ids else stream, worlds)
    nearby.followers += [] if place_free else [worlds.move_to]
    said = provenance(
        "track", inputs=[log, map_file], config=knobs, seed=seed, place_free=place_free, no_ids=no_ids,
        motion=motion, smooth=smooth, lag_s=lag,
        tracking=json.dumps(asdict(association), sort_keys=True),
        sensor=None if sensing is None else json.dumps(asdict(sensing)), **reading.said(),
    )  # fmt: skip
    said[CONFIG_KEY] = json.dumps({"filter": asdict(knobs), "tracking": asdict(association)})
    with ExitStack() as open_files:
        estimates = open_files.enter_context(EstimateWriter(output, metadata=said, particle_stride=stride, force=force))
        _draw_map(nearby, estimates, layout, force=force)
        sinks: list[EstimateSink] = [estimates]
        forecasts: list[ForecastSink] = [estimates]
        viewer = None
        if watched:
            viewer = open_viewer(
                map_file.stem, save=save, spawn=spawn, connect=connect, serve=bind if serve else None, force=force,
                particle_stride=particle_stride or max(knobs.n_particles // PARTICLES_SHOWN, 1),
                particle_color=color_by.value, focus=focus, truth=truth,
                most_in_full=in_full,
                group=reading.group if truth == log else None,
            )  # fmt: skip
            open_files.enter_context(viewer)
            nearby.tell(viewer.log_map)
            viewer.log_run(said, {})
            sinks.append(viewer)
            forecasts.append(viewer)
        if smoother is not None:
            smoother.sinks += [estimates.write_smoothed, *([] if viewer is None else [viewer.write_smoothed])]
            sinks.append(smoother)
        if forecast > 0:
            sinks.append(_forecaster(nearby, forecasts, forecast, knobs, seed, place_free=place_free))
        with smoother or nullcontext():
            n_frames = replay(with_progress(frames, what=f"tracking {log.name}", end_ns=stream.end_ns), worlds, sinks)
        reading.require_frames(n_frames, log, stream.losses)
        if viewer is not None:
            viewer.log_run(said, {"frames": str(n_frames), "beliefs reinitialised": str(worlds.recoveries)})
            keep_serving(viewer)
    _say(worlds, f"{output}: {counted(n_frames, 'frame')} of {', '.join(sorted(stream.topics))}")
    return losses.exit_code(stream.losses)


def _smoother(knobs: FilterConfig, *, smooth: bool, lag_s: float | None) -> Smoother | None:
    """What the options ask for.

    Raises:
        BadParameter: both.
    """
    from dirprim_filter.filtering.smoothing import Smoother

    if smooth and lag_s is not None:
        raise typer.BadParameter("--smooth waits for the whole log: give one of both", param_hint="--lag")
    return Smoother(max_gap_s=knobs.max_gap_s, lag_s=lag_s) if smooth or lag_s is not None else None


def _forecaster(
    nearby: NearbyMap, sinks: list[ForecastSink], horizon_s: float, config: FilterConfig, seed: int, *,
    place_free: bool,
) -> Forecaster:  # fmt: skip
    import numpy as np

    from dirprim_filter.forecasting import Forecaster

    rng = np.random.default_rng([seed, 1])
    part = nearby.part.without_places() if place_free else nearby.part
    made = Forecaster(part, sinks, horizon_s=horizon_s, config=config, rng=rng)
    nearby.followers += [] if place_free else [made.move_to]
    return made


def _say(worlds: Worlds, what: str) -> None:
    if worlds.recoveries:
        typer.echo(f"{worlds.recoveries} beliefs reinitialised, as they did not explain their measurements", err=True)
    from dirprim_filter.recording.container.errors import one_line

    typer.echo(
        one_line(what) + (f", {counted(worlds.n_groups, 'group')}, each by itself" if worlds.n_groups > 1 else "")
    )


def _draw_map(nearby: NearbyMap, estimates: EstimateWriter, layout: Path | None, *, force: bool) -> None:
    """The map as Foxglove draws it, and the layout of its window where one is asked for."""
    from dirprim_filter.recording.foxglove.layout import write_layout

    nearby.tell(estimates.write_map_scene)
    if layout is not None:
        write_layout(nearby.part, layout, force=force)
