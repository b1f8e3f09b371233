"""`dirprim simulate`: traffic by SUMO, as a log."""

from __future__ import annotations

from typing import Annotated, Literal

import typer

from dirprim_filter.cli.options import Force, Output, Seed
from dirprim_filter.cli.texts import counted


def simulate(
    scene: Annotated[Literal["roundabout", "intersection", "highway"], typer.Argument(help="The scene.")],
    output: Output,
    duration: Annotated[float, typer.Option(help="Seconds of traffic.")] = 300.0,
    rate: Annotated[float, typer.Option(help="Rows a second; 10 divided by a whole number.")] = 10.0,
    demand: Annotated[float, typer.Option(help="Factor on the scene's vehicles per hour; from 2 on they queue.")] = 1.0,
    detections: Annotated[bool, typer.Option(help="Also write the detections of a simulated sensor.")] = True,
    noise: Annotated[float, typer.Option(help="Sensor: standard deviation in each axis, metres.")] = 0.5,
    miss_rate: Annotated[float, typer.Option(help="Sensor: share of vehicles missed in a frame.")] = 0.05,
    false_per_frame: Annotated[float, typer.Option(help="Sensor: mean number of false detections.")] = 0.2,
    seed: Seed = 0,
    force: Force = False,
) -> None:
    """Simulate traffic by Eclipse SUMO (extra `sim`) as a log.

    Example: dirprim simulate roundabout -o roundabout.mcap --duration 600 --seed 1
    """
    import numpy as np

    from dirprim_filter.cli.results import provenance
    from dirprim_filter.recording import write_tracks
    from dirprim_filter.simulation.sensor import detect
    from dirprim_filter.simulation.traffic import simulate as run_traffic

    errors = {"noise_m": noise, "miss_rate": miss_rate, "false_per_frame": false_per_frame}
    tracks = run_traffic(scene, duration_s=duration, seed=seed, rate_hz=rate, demand=demand)
    reported = detect(tracks, rng=np.random.default_rng(seed), **errors) if detections else None
    said = provenance(
        "simulate", inputs=[], scene=scene, duration_s=duration, rate_hz=rate, seed=seed, demand=demand, **errors,
    )  # fmt: skip
    write_tracks(tracks, output, detections=reported, metadata=said, force=force)
    typer.echo(f"{output}: {counted(tracks.n_tracks, 'vehicle')}, {counted(len(tracks), 'row')}")
