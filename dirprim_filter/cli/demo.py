"""`dirprim demo`: the whole way, from logs to a picture, on the recordings that ship with the project."""

from __future__ import annotations

import subprocess
import sys
from enum import StrEnum
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from dirprim_filter.cli.compiling import has_kernels
from dirprim_filter.cli.options import WRITTEN, Force, Seed

if TYPE_CHECKING:
    from collections.abc import Mapping

    import numpy as np

    from dirprim_filter.arrays import FloatArray
    from dirprim_filter.estimates import Estimates, EstimateSink
    from dirprim_filter.evaluation.tracking_report import TrackingReport
    from dirprim_filter.filtering import Tracker
    from dirprim_filter.primitives import PrimitiveMap
    from dirprim_filter.tracks import Tracks


KERNEL = "_interaction.predict"
"""Where this is compiled, so are the others that tracking needs."""


class Scene(StrEnum):
    """The scenes that ship."""

    ROUNDABOUT = "roundabout"
    INTERSECTION = "intersection"


def recordings_folder() -> Path:
    """Where the recordings are: in the installed package, or beside it in a source tree."""
    package = Path(__file__).parents[1]
    installed = package / "recordings"
    return installed if installed.is_dir() else package.parent / "recordings"


def demo(
    folder: Annotated[Path, typer.Option("--output", "-o", help="Folder for the outputs."), WRITTEN] = Path("demo"),
    scene: Annotated[Scene, typer.Option(help="Which recordings to use.")] = Scene.ROUNDABOUT,
    seed: Seed = 0,
    force: Force = False,
) -> None:
    """Learn a map from one recording, track and forecast the vehicles of another with it, and plot the result.

    Example: dirprim demo --scene intersection -o demo_intersection
    """
    from dirprim_filter.recording import read_tracks, save_map
    from dirprim_filter.recording.errors import OutputExistsError
    from dirprim_filter.recording.foxglove.layout import write_layout

    learning = recordings_folder() / f"{scene.value}_learn.mcap"
    tracking = recordings_folder() / f"{scene.value}_track.mcap"
    outputs = {name: folder / name for name in ("map.mcap", "tracks.mcap", "layout.json", "tracks.rrd", "demo.png")}
    for path in outputs.values():
        if path.exists() and not force:
            raise OutputExistsError(path)
    folder.mkdir(parents=True, exist_ok=True)

    # The first run compiles kernels: some of them on the second core, while the first reads and learns.
    compiling = None
    if not has_kernels(KERNEL):
        compiling = subprocess.Popen([sys.executable, "-m", "dirprim_filter.cli.warm_up"])

    import numpy as np

    from dirprim_filter.cli.progress import learning_progress
    from dirprim_filter.cli.provenance import provenance
    from dirprim_filter.primitives import learn_primitives

    tracks, truth = read_tracks(learning), read_tracks(tracking)
    typer.echo(f"learning from {learning.name}: {tracks.n_tracks} vehicles, {len(tracks)} rows ...", err=True)
    with learning_progress() as bars:
        learned = learn_primitives(tracks, progress=bars.progress, stage=bars.stage, rng=np.random.default_rng(seed))
    save_map(learned, outputs["map.mcap"], metadata=provenance("demo", inputs=[learning], seed=seed), force=force)
    write_layout(learned, outputs["layout.json"], force=force)
    if compiling is not None:
        compiling.wait()
    typer.echo(f"tracking {tracking.name}: {truth.n_tracks} vehicles for 90 s, three ways ...", err=True)
    scores = _track_three_ways(learned, tracks, truth, tracking, outputs, seed=seed, force=force)
    _print_result(learned, scores, outputs, folder)


def _track_three_ways(
    learned: PrimitiveMap,
    tracks: Tracks,
    truth: Tracks,
    log: Path,
    outputs: Mapping[str, Path],
    *,
    seed: int,
    force: bool,
) -> dict[str, TrackingReport]:
    """Track with the prior, writing and drawing everything; then with constant velocity, and place-free; score all."""
    import numpy as np

    from dirprim_filter.cli.provenance import provenance
    from dirprim_filter.config import FilterConfig
    from dirprim_filter.estimates import EstimateList
    from dirprim_filter.evaluation.tracked_rows import TrackedRows
    from dirprim_filter.evaluation.tracking_report import Scales, TrackingReport
    from dirprim_filter.filtering import ConstantVelocityKalman, Tracker
    from dirprim_filter.filtering.manoeuvre import acceleration_density
    from dirprim_filter.forecasting import Forecaster
    from dirprim_filter.recording.writer import EstimateWriter
    from dirprim_filter.viewer.figures import demo_figure, save_figure
    from dirprim_filter.viewer.moment import Moment
    from dirprim_filter.viewer.report import run_report
    from dirprim_filter.viewer.stream import open_stream

    config = FilterConfig()
    said = provenance("demo", inputs=[log], config=config, seed=seed)
    believed, moment = EstimateList(), Moment(_center(learned))
    forecaster_rng = np.random.default_rng([seed, 1])
    with (
        EstimateWriter(outputs["tracks.mcap"], metadata=said, particle_stride=10, force=force) as written,
        open_stream("dirprim demo", save=outputs["tracks.rrd"], force=force, particle_stride=10) as shown,
    ):
        written.write_map_scene(learned)
        shown.log_map(learned)
        shown.log_truth(truth)
        forecaster = Forecaster(learned, [written, shown], config=config, rng=forecaster_rng)
        tracker = Tracker(learned, config=config, with_innovations=True, rng=np.random.default_rng(seed))
        _replay(log, tracker, [written, shown, forecaster, believed, moment])
        estimates = believed.all()

        def score(found: Estimates) -> TrackingReport:
            return TrackingReport.of(TrackedRows.of(found), truth, is_hidden=None, with_ids=True, scales=Scales())

        scores = {"with the prior": score(estimates)}
        rivals: dict[str, Tracker] = {
            "place-free": Tracker(learned.without_places(), config=config, rng=np.random.default_rng(seed)),
            "constant velocity": Tracker(
                ConstantVelocityKalman(acceleration_density=acceleration_density(tracks), config=config),
                config=config,
                rng=np.random.default_rng(seed),
            ),
        }
        for name, rival in rivals.items():
            kept = EstimateList()
            _replay(log, rival, [kept])
            scores[name] = score(kept.all())
        shown.log_report("\n".join([*_table(scores, markdown=True), "", run_report(said, {}, title="Made with")]))
    if moment.frame is not None:
        ids = [str(name) for name in moment.frame.estimates.track_id]
        futures = dict(zip(ids, forecaster.paths(moment.frame), strict=True))
        figure = demo_figure(
            learned, tracks=tracks, frame=moment.frame, estimates=estimates, truth=truth, forecasts=futures,
            focus=moment.focus,
        )  # fmt: skip
        save_figure(figure, outputs["demo.png"], force=force)
    return scores


def _replay(log: Path, tracker: Tracker, sinks: list[EstimateSink]) -> None:
    from dirprim_filter.cli.progress import with_progress
    from dirprim_filter.recording.reader import stream_detections
    from dirprim_filter.replay import replay

    stream = stream_detections(log)
    replay(with_progress(stream, what=f"tracking {log.name}", end_ns=stream.end_ns), tracker, sinks)


def _center(learned: PrimitiveMap) -> FloatArray:
    center: np.ndarray = learned.tessellation.centers.mean(axis=0)
    return center


def _table(scores: Mapping[str, TrackingReport], *, markdown: bool = False) -> list[str]:
    import numpy as np

    heads = ("tracking", "position RMSE [m]", "direction RMSE [deg]", "speed RMSE [m/s]", "NEES (2 is right)")
    rows = [
        (
            name, f"{s.rmse:.3f}", f"{np.rad2deg(s.direction_rmse):.1f}", f"{s.speed_rmse:.2f}",
            f"{s.nees:.2f}",
        )
        for name, s in scores.items()
    ]  # fmt: skip
    if markdown:
        return [" | ".join(heads), "|".join(["---"] * len(heads)), *(" | ".join(row) for row in rows)]
    widths = [max(len(row[i]) for row in [heads, *rows]) for i in range(len(heads))]
    return [
        "  ".join([row[0].ljust(widths[0]), *(c.rjust(w) for c, w in zip(row[1:], widths[1:], strict=True))])
        for row in [heads, *rows]
    ]


def _print_result(
    learned: PrimitiveMap, scores: Mapping[str, TrackingReport], outputs: Mapping[str, Path], folder: Path
) -> None:
    n_modes = (learned.own_weight > 0).sum(axis=1)
    first = next(iter(scores.values()))
    typer.echo(
        f"\nlearned: {learned.tessellation.n_cells} cells of {float(learned.tessellation.area.mean()) ** 0.5:.3g} m, "
        f"{n_modes.mean():.1f} modes each; tracked: {first.reported:.0%} of the vehicles' rows\n"
    )
    for line in _table(scores):
        typer.echo(line)
    typer.echo("\nwrote " + ", ".join(str(path) for path in outputs.values()))
    typer.echo(f"next: open {outputs['demo.png']}; `dirprim view {outputs['tracks.rrd']}` plays it in rerun;")
    typer.echo(f"      {outputs['tracks.mcap']} opens in Foxglove, with the layout {outputs['layout.json']};")
    typer.echo("      `dirprim info LOG` summarises a log of yours")
