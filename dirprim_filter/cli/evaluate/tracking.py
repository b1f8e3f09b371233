"""`dirprim evaluate tracking`: the same tracker on several motion models, on traffic that a sensor reports badly."""

from __future__ import annotations

from dataclasses import asdict, fields, replace
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from dirprim_filter.cli.options import Config, Json, Logs
from dirprim_filter.cli.reading import Reading, reads_logs
from dirprim_filter.cli.results import read_experiment, report
from dirprim_filter.cli.settings import Settings, deal
from dirprim_filter.cli.texts import counted, figure_lines, number

if TYPE_CHECKING:
    from dirprim_filter.evaluation.tracking import TrackingTable
    from dirprim_filter.evaluation.tracking_experiment import TrackingExperiment


@reads_logs("those of an experiment", "fields of FilterConfig and TrackingConfig")
def tracking(
    logs: Logs,
    map_file: Annotated[
        Path | None,
        typer.Option("--map", help="Track with this map. Default: learn one from a part of the log.", exists=True),
    ] = None,
    method: Annotated[list[str] | None, typer.Option(help="Compare only this method; may be repeated.")] = None,
    gap: Annotated[
        float | None, typer.Option(help="Seconds out of sight of each vehicle; 0: none. Default: 3.")
    ] = None,
    with_ids: Annotated[bool | None, typer.Option("--ids/--no-ids", help="Whether the sensor reports ids.")] = None,
    seeds: Annotated[int | None, typer.Option(min=1, help="Runs, each with random numbers of its own.")] = None,
    seed: Annotated[int | None, typer.Option(min=0, help="The same seed gives the same result.")] = None,
    config: Config = None,
    as_json: Json = False,
    *,
    reading: Reading,
    settings: Settings,
) -> int:
    """Compare trackers on known traffic, by a simulated sensor.

    The sensor adds noise, gaps, misses and false detections. Trackers with and without the map get the same ones.
    docs/experiments.md lists what --set takes, such as noise_m or miss_rate.

    Example: dirprim evaluate tracking recordings/roundabout_learn.mcap --gap 3 --seeds 2
    """
    from dirprim_filter.cli.coverage import Coverage
    from dirprim_filter.cli.progress import step_progress
    from dirprim_filter.evaluation.tracking import evaluate_tracking
    from dirprim_filter.recording import load_map

    made = _experiment(config, settings, {
        "gap_s": gap, "with_ids": with_ids, "methods": method or None, "n_seeds": seeds, "seed": seed,
    })  # fmt: skip
    inputs, primitive_map = [*logs, *([map_file] if map_file else [])], load_map(map_file) if map_file else None
    if map_file is not None and primitive_map is not None:
        reading = reading.on_plane_of(map_file, primitive_map.origin)
    log = reading.tracks(logs)
    if map_file is not None and primitive_map is not None:
        Coverage(primitive_map, map_file, logs[0]).check(log.tracks.position)
    with step_progress("evaluating", "steps") as step:
        table = evaluate_tracking(log.tracks, made, primitive_map=primitive_map, progress=step)
    return report(
        "evaluate tracking", inputs, reading, log.losses, table=tracking_object(table), settings=asdict(made),
        text=lambda: tracking_text(table), as_json=as_json,
    )  # fmt: skip


def _experiment(config: Path | None, settings: Settings, options: dict[str, Any]) -> TrackingExperiment:
    """Of the file, but for what settings and options state."""
    from dirprim_filter.config import FilterConfig, TrackingConfig, from_table
    from dirprim_filter.evaluation.tracking_experiment import TrackingExperiment

    tables = [[f.name for f in fields(kind)] for kind in (TrackingExperiment, FilterConfig, TrackingConfig)]
    given, of_filter, of_tracking = deal(settings, *tables)
    configured = read_experiment(config)
    configured |= given | {name: value for name, value in options.items() if value is not None}
    for name, own in (("filter", of_filter), ("tracking", of_tracking)):
        if own:
            configured[name] = (configured.get(name) or {}) | own
    return from_table(TrackingExperiment, configured)


def tracking_text(table: TrackingTable) -> str:
    """The table as text: means over the seeds, then what the first method gains over each other."""
    from dirprim_filter.evaluation.tracking import comparisons

    experiment = table.experiment
    ids = "ids" if experiment.with_ids else "no ids"
    where = f"map learned from others, held out by {table.split_by}" if table.map_learned else "map given"
    has_groups = table.n_groups > experiment.n_seeds
    groups = f" in {counted(table.n_groups, 'group')}, each by itself," if has_groups else ""
    lines = [
        f"{counted(table.n_vehicles, 'vehicle')}{groups} tracked in {counted(experiment.n_seeds, 'run')}, "
        f"{counted(table.n_gaps, 'gap')} of {experiment.gap_s:g} s, noise {experiment.noise_m:g} m, "
        f"{experiment.miss_rate:.0%} missed, {experiment.false_per_frame:g} false per frame, {ids}; {where}",
        *["means over the runs, +- deviations from run to run"] * (experiment.n_seeds > 1),
        "",
    ]

    def cell(i: int, figure: str) -> str:
        method = table.methods[i]
        spread = [method.std(figure)] if experiment.n_seeds > 1 else []
        return " +-".join(map(number, [method.mean(figure), *spread]))

    lines += figure_lines([method.name for method in table.methods], cell)
    lines += ["", *(found.sentence for found in comparisons(table) if found.sentence)]
    return "\n".join(lines).rstrip()


def tracking_object(table: TrackingTable) -> dict[str, Any]:
    """The table for machines: every method's figures, and the first method beside each other."""
    from dirprim_filter.evaluation.tracking import comparisons

    bare = replace(table, methods=tuple(replace(method, errors=()) for method in table.methods))
    return asdict(bare) | {"comparisons": comparisons(table)}
