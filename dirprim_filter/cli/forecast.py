"""`dirprim forecast`: where a vehicle may go from here."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Annotated

import typer

from dirprim_filter.cli.options import Force, Map, Seed


def forecast(
    map_file: Map,
    at: Annotated[tuple[float, float], typer.Option(help="Position, metres east and north.")],
    direction_deg: Annotated[float, typer.Option(help="Course, degrees counter-clockwise from east.")],
    speed: Annotated[float, typer.Option(help="m/s.")],
    horizon: Annotated[float, typer.Option(help="Seconds to look ahead.")] = 5.0,
    dt: Annotated[float, typer.Option(help="Seconds between positions.")] = 0.5,
    samples: Annotated[int, typer.Option(min=1, help="Number of futures.")] = 100,
    output: Annotated[Path | None, typer.Option("--output", "-o", help="A picture: .png, .pdf or .svg.")] = None,
    as_json: Annotated[bool, typer.Option("--json", help="All sampled positions, for machines.")] = False,
    seed: Seed = 0,
    force: Force = False,
) -> None:
    """Sample the futures of a vehicle from a map.

    Example: dirprim forecast --map map.mcap --at -30 -1.5 --direction-deg 0 --speed 10 -o forecast.png
    """
    import numpy as np

    from dirprim_filter.forecasting import forecast as sample_paths
    from dirprim_filter.recording import load_map

    learned = load_map(map_file)
    paths = sample_paths(
        learned, position=at, direction=np.deg2rad(direction_deg), speed=speed, horizon_s=horizon, dt_s=dt,
        n_samples=samples, rng=np.random.default_rng(seed),
    )  # fmt: skip
    if output is not None:
        from dirprim_filter.viewer.figures import map_figure, save_figure

        save_figure(map_figure(learned, forecasts={"forecast": paths}), output, force=force)
    if as_json:
        typer.echo(json.dumps({"dt_s": dt, "paths": paths.tolist()}))
        return
    typer.echo("time_s   mean_x_m   mean_y_m   std_x_m   std_y_m")
    mean, std = paths.mean(axis=0), paths.std(axis=0)
    for step in range(paths.shape[1]):
        (x, y), (sx, sy) = mean[step], std[step]
        typer.echo(f"{(step + 1) * dt:6.2f}{x:11.2f}{y:11.2f}{sx:10.2f}{sy:10.2f}")
