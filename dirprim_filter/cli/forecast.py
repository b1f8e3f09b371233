"""`dirprim forecast`: where a vehicle may go from here; those of a log are forecast by `dirprim track --forecast`."""

from __future__ import annotations

import json
from typing import Annotated

import typer

import dirprim_filter as dp
from dirprim_filter.cli.options import Force, Map, MaybePicture, Seed
from dirprim_filter.cli.texts import columns


def forecast(
    map_file: Map,
    at: Annotated[tuple[float, float], typer.Option(help="Position, metres east and north: --at 3 17.")],
    direction_deg: Annotated[float, typer.Option(help="Course, degrees counter-clockwise from east.")],
    speed: Annotated[float, typer.Option(help="m/s.")],
    horizon: Annotated[float, typer.Option(min=1e-3, max=3600.0, help="Seconds to look ahead.")] = 5.0,
    dt: Annotated[float, typer.Option(min=1e-3, help="Seconds between positions.")] = 0.5,
    samples: Annotated[int, typer.Option(min=1, max=1_000_000, help="Number of rollouts.")] = 100,
    output: MaybePicture = None,
    as_json: Annotated[bool, typer.Option("--json", help="Print all rollouts as JSON.")] = False,
    seed: Seed = 0,
    force: Force = False,
) -> None:
    """Sample where a vehicle may go.

    `dirprim track --forecast` does so for all vehicles of a log. In the picture there are polar plots of the map's
    density of direction along the paths (the paper's Fig. 8).

    Example: dirprim forecast --map map.mcap --at -30 -1.5 --direction-deg 0 --speed 10 --horizon 15 -o forecast.png
    """
    import numpy as np

    from dirprim_filter.recording.transforms.geodesy import FARTHEST_M
    from tessellation import OUTSIDE

    if not (np.abs(at).max() <= FARTHEST_M and 0 <= speed <= 1e4 and np.isfinite(direction_deg)):
        expected = f"a place within {FARTHEST_M:g} m, a speed of 0 to 10000 m/s and a course"
        got = f"{at[0]:g} {at[1]:g}, {speed:g} and {direction_deg:g}"
        raise ValueError(f"--at, --speed, --direction-deg: expected {expected}, got {got}")
    if dt > horizon:
        raise ValueError(f"--dt: expected at most --horizon, {horizon:g} s, got {dt:g}")
    learned = dp.load_map(map_file)
    cells = learned.tessellation
    if cells.cell_of(np.array(at)) == OUTSIDE:
        away = float(np.hypot(*(cells.centers - at).T).min(initial=np.inf))
        nearest = f"{away:.0f} m from the centre of the nearest: the background model answers"
        typer.echo(f"({at[0]:g}, {at[1]:g}) is outside of every cell of the map, {nearest}", err=True)
    paths = dp.forecast(
        learned, position=at, direction=np.deg2rad(direction_deg), speed=speed, horizon_s=horizon, dt_s=dt,
        n_samples=samples, rng=np.random.default_rng(seed),
    )  # fmt: skip
    if output is not None:
        from dirprim_filter.viewer.figures import map_figure, save_figure

        save_figure(map_figure(learned, paths=paths), output, force=force)
    if as_json:
        typer.echo(json.dumps({"dt_s": dt, "paths": paths.tolist()}))
        return
    steps = np.column_stack([dt * np.arange(1, paths.shape[1] + 1), paths.mean(axis=0), paths.std(axis=0)])
    heads = ["time_s", "mean_x_m", "mean_y_m", "std_x_m", "std_y_m"]
    typer.echo("\n".join(columns([heads, *([f"{figure:.2f}" for figure in step] for step in steps)], n_left=0)))
