"""`dirprim forecast`: where a vehicle may go from here, or all vehicles of a log."""

from __future__ import annotations

import json
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from dirprim_filter.cli import losses
from dirprim_filter.cli.counts import counted
from dirprim_filter.cli.options import (
    WRITTEN,
    Config,
    Force,
    Map,
    NoIds,
    Seed,
    named_file,
)
from dirprim_filter.cli.place import EITHER_WAY, OPTION, tell_if_outside
from dirprim_filter.cli.reading import Reading, reads_logs
from dirprim_filter.cli.results import read_filter
from dirprim_filter.cli.settings import Settings, taken

if TYPE_CHECKING:
    from dirprim_filter.config import FilterConfig, TrackingConfig
    from dirprim_filter.forecasting import Forecasts, ForecastSink


@dataclass(frozen=True, slots=True, kw_only=True)
class Own:
    """The settings that are neither of a filter nor of reading; `every_s`: seconds of the log between forecasts."""

    every_s: float = 1.0


@reads_logs("every_s", "fields of FilterConfig and TrackingConfig")
def forecast(
    map_file: Map,
    at: Annotated[tuple[float, float] | None, typer.Option(OPTION, help=f"Position, {EITHER_WAY}.")] = None,
    direction_deg: Annotated[
        float | None, typer.Option(help="Course, degrees counter-clockwise from east; with --at.")
    ] = None,
    speed: Annotated[float | None, typer.Option(help="m/s; with --at.")] = None,
    log: Annotated[
        Path | None, typer.Option("--log", help="Track this log and forecast its vehicles; -o is then an MCAP.")
    ] = None,
    horizon: Annotated[float, typer.Option(help="Seconds to look ahead.")] = 5.0,
    dt: Annotated[float, typer.Option(help="Seconds between positions.")] = 0.5,
    samples: Annotated[int, typer.Option(min=1, help="Number of rollouts of each vehicle.")] = 100,
    output: Annotated[
        Path | None,
        typer.Option("--output", "-o", help="A figure (.png, .pdf, .svg), or an MCAP with --log.", callback=named_file),
        WRITTEN,
    ] = None,
    config: Config = None,
    no_ids: NoIds = False,
    as_json: Annotated[
        bool, typer.Option("--json", help="Print all rollouts as JSON; with --log, a line for each instant.")
    ] = False,
    seed: Seed = 0,
    force: Force = False,
    *,
    reading: Reading,
    settings: Settings,
) -> int:
    """Sample where a vehicle, or all of a log, may go.

    Rollouts of a log's vehicles start from the filter's beliefs.

    Example: dirprim forecast --map map.mcap --at -30 -1.5 --direction-deg 0 --speed 10 -o forecast.png
    """
    if log is not None:
        if output is None or at is not None:
            raise typer.BadParameter("--log: expected -o with the MCAP to write, and no --at")
        own = taken(Own, settings)
        filtering, association = read_filter(config, settings)
        return _of_log(
            log, map_file, output, reading, filtering, association, horizon_s=horizon, dt_s=dt, every_s=own.every_s,
            n_samples=samples, no_ids=no_ids, seed=seed, as_json=as_json, force=force,
        )  # fmt: skip
    if config or no_ids or settings:
        raise typer.BadParameter("--config, --no-ids and --set are of a tracker: expected --log with them")
    if at is None or direction_deg is None or speed is None:
        raise typer.BadParameter("expected --at, --direction-deg and --speed, or --log")
    _of_state(
        map_file, at, direction_deg, speed, output, horizon_s=horizon, dt_s=dt, n_samples=samples, seed=seed,
        as_json=as_json, force=force,
    )  # fmt: skip
    return 0


def _of_state(
    map_file: Path, at: tuple[float, float], direction_deg: float, speed: float, output: Path | None, *,
    horizon_s: float, dt_s: float, n_samples: int, seed: int, as_json: bool, force: bool,
) -> None:  # fmt: skip
    import numpy as np

    from dirprim_filter.forecasting import forecast as sample_paths
    from dirprim_filter.recording import load_map

    learned = load_map(map_file)
    tell_if_outside(learned, at)
    paths = sample_paths(
        learned, position=at, direction=np.deg2rad(direction_deg), speed=speed, horizon_s=horizon_s, dt_s=dt_s,
        n_samples=n_samples, rng=np.random.default_rng(seed),
    )  # fmt: skip
    if output is not None:
        from dirprim_filter.viewer.figures import map_figure, save_figure

        save_figure(map_figure(learned, forecasts={"forecast": paths}), output, force=force)
    if as_json:
        typer.echo(json.dumps({"dt_s": dt_s, "paths": paths.tolist()}))
        return
    typer.echo("time_s   mean_x_m   mean_y_m   std_x_m   std_y_m")
    mean, std = paths.mean(axis=0), paths.std(axis=0)
    for step in range(paths.shape[1]):
        (x, y), (sx, sy) = mean[step], std[step]
        typer.echo(f"{(step + 1) * dt_s:6.2f}{x:11.2f}{y:11.2f}{sx:10.2f}{sy:10.2f}")


def _of_log(
    log: Path, map_file: Path, output: Path, reading: Reading, config: FilterConfig, tracking: TrackingConfig, *,
    horizon_s: float, dt_s: float, every_s: float, n_samples: int, no_ids: bool, seed: int, as_json: bool, force: bool,
) -> int:  # fmt: skip
    import numpy as np

    from dirprim_filter.cli.progress import with_progress
    from dirprim_filter.cli.provenance import provenance
    from dirprim_filter.filtering import Tracker, Worlds
    from dirprim_filter.forecasting import Forecaster
    from dirprim_filter.recording import load_map
    from dirprim_filter.recording.container.errors import one_line
    from dirprim_filter.recording.writer import EstimateWriter
    from dirprim_filter.replay import replay

    primitive_map = load_map(map_file)
    stream = reading.detections(log, motion=False)
    worlds = Worlds(lambda _: Tracker(primitive_map, config=config, tracking=tracking, rng=np.random.default_rng(seed)))
    frames = (reported.without_ids() for reported in stream) if no_ids else stream
    said = provenance(
        "forecast", inputs=[log, map_file], config=config, seed=seed, horizon_s=horizon_s, dt_s=dt_s,
        every_s=every_s, n_samples=n_samples, no_ids=no_ids, **reading.said(),
    )  # fmt: skip
    with EstimateWriter(output, metadata=said, force=force) as estimates:
        estimates.write_map_scene(primitive_map)
        listening: list[ForecastSink] = [estimates, _Lines(dt_s)] if as_json else [estimates]
        forecaster = Forecaster(
            primitive_map, listening, every_s=every_s, horizon_s=horizon_s, dt_s=dt_s, n_samples=n_samples,
            config=config, rng=np.random.default_rng([seed, 1]),
        )  # fmt: skip
        seen = with_progress(frames, what=f"forecasting {log.name}", end_ns=stream.end_ns)
        n_frames = replay(seen, worlds, [estimates, forecaster])
        reading.require_frames(n_frames, log, stream.losses)
    typer.echo(one_line(f"{output}: {counted(n_frames, 'frame')} of {', '.join(sorted(stream.topics))}"), err=as_json)
    return losses.exit_code(stream.losses)


class _Lines:
    """A `ForecastSink` that prints a line of JSON for each instant with forecasts."""

    def __init__(self, dt_s: float) -> None:
        self._dt_s = dt_s

    def write_forecast(self, forecasts: Forecasts) -> None:
        """Print the rollouts of one instant."""
        paths = dict(zip(forecasts.track_id, forecasts.paths.tolist(), strict=True))
        typer.echo(json.dumps({"time_ns": forecasts.time_ns, "dt_s": self._dt_s, "paths": paths}))
