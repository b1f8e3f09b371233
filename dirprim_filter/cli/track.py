"""`dirprim track`: vehicles of a log, tracked with a map."""

from __future__ import annotations

import json
from contextlib import ExitStack
from dataclasses import asdict, dataclass
from functools import partial
from typing import TYPE_CHECKING, Annotated, Literal

import typer

from dirprim_filter.cli import exit_codes, options
from dirprim_filter.cli.reading import Reading
from dirprim_filter.cli.settings import Settings, taken
from dirprim_filter.cli.texts import counted
from dirprim_filter.recording.topic_names import RosMessages

if TYPE_CHECKING:
    from dirprim_filter.estimates import EstimateSink
    from dirprim_filter.viewer.sink import RerunSink


@dataclass(frozen=True, slots=True, kw_only=True)
class Own:
    """The settings of tracking that are neither of its filter nor of reading.

    Attributes:
        measured_motion: the log's directions and speeds are measurements too.
        without_map: track without the map's cells: the ablation.
        acceleration_density: m^2/s^3, of the white acceleration of constant velocity; 0: it is fitted.
        particles_out: so many particles of each vehicle are written, to be looked at.
        truth: a log of true tracks, which the viewer draws and from which it takes the errors.

    Raises:
        ValueError: a number out of its range.
    """

    measured_motion: bool = False
    without_map: bool = False
    acceleration_density: float = 0.0
    particles_out: int = 0
    truth: str = ""

    def __post_init__(self) -> None:
        if not 0 <= self.acceleration_density <= 1e9:
            raise ValueError(f"acceleration_density: expected 0 to 1e+09, got {self.acceleration_density}")
        if self.particles_out < 0:
            raise ValueError(f"particles_out: expected at least 0, got {self.particles_out}")


def track(
    log: options.Log,
    output: options.Output,
    map_file: options.MapOrNone = None,
    motion: options.Motion = "learned",
    save: options.Save = None,
    spawn: options.Spawn = False,
    connect: options.Connect = None,
    smooth: Annotated[bool, typer.Option("--smooth", help="Also write smoothed estimates, by the whole log.")] = False,
    lag: Annotated[
        float | None, typer.Option(min=0.0, max=1e9, help="Also smooth, so many seconds late; a pipe is tracked live.")
    ] = None,
    forecast: Annotated[
        float, typer.Option(min=0.0, max=3600.0, help="Every second, forecast so many seconds ahead.")
    ] = 0.0,
    rate: options.Rate = None,
    no_ids: options.NoIds = False,
    noise: options.Noise = None,
    sensor: options.SensorOrAuto = None,
    particles: options.Particles = None,
    also_as: Annotated[
        Literal["foxglove", RosMessages],
        typer.Option("--as", help="Also write ROS 2 messages of them; foxglove: none."),
    ] = "foxglove",
    config: options.Config = None,
    seed: options.Seed = 0,
    force: options.Force = False,
    *,
    reading: Reading,
    settings: Annotated[Settings, Own, "fields of FilterConfig and TrackingConfig"],
) -> int:
    """Track vehicles of a log, with a learned map or without one.

    Estimates are written as MCAP, and shown by rerun (--save, --spawn, --connect). Unless --noise, --sensor, --config
    or the log states it, the sensor's noise is learned from the log's first minutes, and printed; without ids, unless
    --sensor or --config states them, also misses, clutter and births. With --lag a pipe is tracked as it is written.
    Without --map vehicles move as those of the log's first minutes do anywhere, or if it has no ids straight on, which
    a line says. Each group of a log is tracked by itself; its vehicles are called group/id.

    Example: dirprim track recordings/roundabout_track.mcap --map map.mcap -o tracks.mcap --save tracks.rrd
    """
    import numpy as np

    from dirprim_filter.cli.coverage import Coverage
    from dirprim_filter.cli.motion import map_of, motion_of
    from dirprim_filter.cli.progress import with_progress
    from dirprim_filter.cli.results import CONFIG_KEY, provenance, read_filter
    from dirprim_filter.cli.sensing import configured, sensor_of
    from dirprim_filter.filtering import GroupTracker, Tracker
    from dirprim_filter.filtering.smoother import Smoother
    from dirprim_filter.forecasting import Forecaster
    from dirprim_filter.recording.losses import Losses
    from dirprim_filter.recording.writer import EstimateWriter
    from dirprim_filter.replay import replay

    is_live = lag is not None and (str(log) == "-" or log.is_fifo())  # is read once, and may be written while it is
    own, watched, is_learned = taken(Own, settings), bool(save or spawn or connect), motion == "learned"
    for is_wrong, why, *option in (
        (smooth and lag is not None, "--smooth waits for the whole log: give one of both", "--lag"),
        (sensor is not None and noise is not None, "a sensor's model contains the noise: give one of both", "--noise"),
        (own.without_map and map_file is None, "without_map is of a map: leave out one of both"),
        (own.measured_motion and not is_learned, "constant velocity takes positions alone"),
        (own.acceleration_density and is_learned and map_file, "a map says how vehicles accelerate: leave out one"),
        (forecast > 0 and not is_learned, "forecasts are by a map's motion: leave out --motion", "--forecast"),
        (
            forecast > 0 and not map_file and (no_ids or is_live or own.acceleration_density),
            "needs --map: with --no-ids, a stated acceleration or a live pipe no motion is learned",
            "--forecast",
        ),
        (own.truth and not watched, "truth needs --save, --spawn or --connect"),
    ):
        if is_wrong:
            raise typer.BadParameter(why, param_hint=[*option, "--set"][0])
    truth = options.existing_log(own.truth) if own.truth else None
    smoother = Smoother(lag_s=lag) if smooth or lag is not None else None
    (primitive_map, reading), lost = map_of(map_file, reading), Losses()
    filtering, association = read_filter(config, settings, Own, n_particles=particles, noise_m=noise)
    stream = reading.detections(log, motion=own.measured_motion, live=is_live)
    coverage = Coverage(primitive_map, map_file, log, is_needed=is_learned and not own.without_map)
    sensing, own_tracks, frames = sensor_of(
        sensor, coverage.begun(stream, reading), log=log, noise_m=noise, is_configured=config is not None,
        is_live=is_live, with_ids=not no_ids, seed=seed,
    )  # fmt: skip
    sensing, filtering, association = configured(
        sensing, own_tracks, settings, filtering, association, by_map=map_file is not None
    )
    moves, frames = motion_of(
        motion, primitive_map.without_places() if primitive_map and own.without_map else primitive_map, frames,
        config=filtering, acceleration=own.acceleration_density,
        fitted=own_tracks.acceleration_density if own_tracks else 0.0, is_forecast=forecast > 0, seed=seed,
        why_not="a live pipe does not wait for it" if is_live else "--no-ids" if no_ids else "",
    )  # fmt: skip
    said = provenance(
        "track", inputs=[path for path in (None if is_live else log, map_file) if path], config=filtering, seed=seed,
        without_map=own.without_map, no_ids=no_ids, measured_motion=own.measured_motion, motion=motion, smooth=smooth,
        acceleration_density=moves.acceleration or None, lag_s=lag, rate_hz=rate, tracking=association, sensor=sensing,
        **reading.said(),
        **{CONFIG_KEY: json.dumps({"filter": asdict(filtering), "tracking": asdict(association)})},
    )  # fmt: skip

    def tracker_of(group: int) -> Tracker:
        make = Tracker if smoother is None else partial(smoother.tracker, group)
        return make(
            moves.model(filtering), config=filtering, tracking=association, sensor=sensing, with_innovations=watched,
            rng=np.random.default_rng(seed),
        )  # fmt: skip

    trackers, failures = GroupTracker(tracker_of), list[str]()
    with ExitStack() as files:
        estimates = files.enter_context(EstimateWriter(
            output, metadata=said, force=force, also_as=None if also_as == "foxglove" else also_as,
            particle_stride=max(filtering.n_particles // own.particles_out, 1) if own.particles_out else None,
        ))  # fmt: skip
        estimates.write_map_scene(primitive_map)
        outputs: list[EstimateWriter | RerunSink] = [estimates]
        if watched:
            from dirprim_filter.cli.screen import open_viewer  # which loads rerun

            viewer = files.enter_context(open_viewer(
                (map_file or log).stem, lost, maps=[primitive_map] if primitive_map else [], save=save, spawn=spawn,
                connect=connect, force=force, n_particles=own.particles_out, truth=truth, run=said,
                reading=reading.of_truth(truth, *["group"] * (own.truth == str(log))) if truth else reading,
            ))  # fmt: skip
            outputs.append(viewer)
            failures = viewer.stream.failures
        sinks: list[EstimateSink] = [*outputs, coverage]
        if smoother is not None:
            smoother.sinks += [shown.write_smoothed for shown in outputs]
            sinks.append(files.enter_context(smoother))
        if forecast > 0 and moves.primitive_map is not None:
            drawn, rng = [shown.write_forecast for shown in outputs], np.random.default_rng([seed, 1])
            sinks.append(Forecaster(moves.primitive_map, drawn, horizon_s=forecast, config=filtering, rng=rng))
        seen, what = (frame.without_ids() for frame in frames) if no_ids else frames, f"tracking {log.name}"
        n_frames = replay(with_progress(seen, what=what, end_ns=stream.end_ns), trackers, sinks, rate_hz=rate)
        reading.require_frames(n_frames, log, stream.losses)
    is_poor = coverage.say(
        f"{output}: {counted(n_frames, 'frame')} of {', '.join(sorted(stream.topics))}", trackers,
        share_true=own_tracks.n_true / len(own_tracks.seen) if own_tracks else 1.0,
    )  # fmt: skip
    return exit_codes.of_losses(stream.losses, lost, is_lost=is_poor, failures=failures)
