"""`dirprim demo`: the whole way, from logs to a picture, on the recordings that ship with the project.

A second process compiles kernels, in an installation's first run, and tracks by the rivals, while this one learns and
tracks with the map. In the blind scene nothing is detected in a ring about the junction, and detections have no ids.
"""

from __future__ import annotations

import signal
from dataclasses import replace
from enum import StrEnum
from multiprocessing import get_context
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, NamedTuple

import typer

from dirprim_filter.cli.compiling import has_kernels, warm_up
from dirprim_filter.cli.options import WRITTEN, Force, Seed
from dirprim_filter.cli.texts import FIGURES, columns, number

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence
    from multiprocessing.pool import AsyncResult

    from dirprim_filter.arrays import BoolArray, FloatArray
    from dirprim_filter.detections import Detections
    from dirprim_filter.estimates import Estimates, EstimateSink
    from dirprim_filter.evaluation.tracking_report import TrackingReport
    from dirprim_filter.filtering import BayesFilter
    from dirprim_filter.primitives import PrimitiveMap
    from dirprim_filter.tracks import Tracks

KERNEL = "_kernels.advance"
"""Where this is compiled, so are the others that tracking needs."""
WITH_MAP, WITHOUT_MAP, CONSTANT_VELOCITY = "with the map", "without the map", "constant velocity"
"""The ways that are compared."""
LONGEST_S = 900.0
"""The second process is waited for; one that was killed would never answer."""
N_FITTED = 20
"""Vehicles that constant velocity is fitted to."""
SEEN_FIGURES = ("rmse", "direction_rmse", "speed_rmse", "nees")
BLIND_FIGURES = ("hota", "idf1", "mota", "switches", "seen_rmse")
"""What is printed of each way."""
NEAR_M, FAR_M = 25.0, 45.0
"""Borders of the ring, a square about the junction's middle: max(|x|, |y|)."""


class Scene(StrEnum):
    """The scenes that ship; the blind one is the intersection, without ids and without detections in a ring."""

    ROUNDABOUT = "roundabout"
    INTERSECTION = "intersection"
    BLIND = "blind"

    def recording(self, what: str) -> Path:
        """Its log to `learn` from, or to `track`."""
        place = "intersection" if self is Scene.BLIND else self.value
        return recordings_folder() / f"{place}_{what}.mcap"


def recordings_folder() -> Path:
    """Where the recordings are: in the installed package, or beside it in a source tree."""
    package = Path(__file__).parents[1]
    installed = package / "recordings"
    return installed if installed.is_dir() else package.parent / "recordings"


def in_ring(position: FloatArray) -> BoolArray:
    """(n, 2) metres -> (n,) whether a place is in the ring."""
    reach = abs(position).max(axis=1, initial=0.0)
    within: BoolArray = (reach >= NEAR_M) & (reach <= FAR_M)
    return within


def with_blind_ring(seen: Detections) -> Detections:
    """What is detected outside of the ring, without ids."""
    return seen[~in_ring(seen.position)].without_ids()


def departure_rate(tracks: Tracks) -> float:
    """1/s, how often a vehicle leaves: one time each in all the time that they are watched.

    Where they leave is what a map knows; a tracker without one is given how often.
    """
    import numpy as np

    last_ns = np.zeros(tracks.n_tracks, np.int64)
    np.maximum.at(last_ns, tracks.vehicle, tracks.time_ns)
    return tracks.n_tracks / (float((last_ns - tracks.time_ns[tracks.first_rows]).sum()) * 1e-9)


class Run(NamedTuple):
    """How a recording is tracked, whichever way: what is known of the traffic, and the seed of the particles."""

    scene: Scene
    log: Path
    tracks: Tracks
    seed: int


def demo(
    folder: Annotated[Path, typer.Option("--output", "-o", help="Folder for the outputs."), WRITTEN] = Path("demo"),
    scene: Annotated[Scene, typer.Option(help="Which recordings to use.")] = Scene.ROUNDABOUT,
    seed: Seed = 0,
    force: Force = False,
) -> None:
    """Learn, track and plot on the recordings that ship.

    A map is learned from one recording; vehicles of another are tracked and forecast with it.

    In the scene `blind` the detections have no ids, and in a ring about the junction there are none: which tracks last?

    Example: dirprim demo --scene intersection -o demo_intersection
    """
    from dirprim_filter.recording.errors import OutputExistsError

    outputs = {name: folder / name for name in ("map.mcap", "tracks.mcap", "tracks.rrd", "demo.png")}
    for path in outputs.values():
        if path.exists() and not force:
            raise OutputExistsError(path)
    folder.mkdir(parents=True, exist_ok=True)
    with get_context("spawn").Pool(1, signal.signal, (signal.SIGINT, signal.SIG_IGN)) as second:
        compiled = None if has_kernels(KERNEL) else second.apply_async(warm_up)

        import numpy as np

        from dirprim_filter.cli.learn import map_text
        from dirprim_filter.cli.progress import learning_progress
        from dirprim_filter.cli.results import provenance
        from dirprim_filter.primitives import learn_primitives
        from dirprim_filter.recording import read_tracks, save_map

        learning, tracking = scene.recording("learn"), scene.recording("track")
        tracks, truth = read_tracks(learning), read_tracks(tracking)
        run, rng = Run(scene, tracking, tracks, seed), np.random.default_rng(seed)
        rivals = {CONSTANT_VELOCITY: second.apply_async(by_constant_velocity, (run,))}
        typer.echo(f"learning from {learning.name}: {tracks.n_tracks} vehicles, {len(tracks)} rows ...", err=True)
        with learning_progress() as bars:
            learned = learn_primitives(tracks, progress=bars.progress, stage=bars.stage, rng=rng)
        rivals[WITHOUT_MAP] = second.apply_async(track, (run, learned.without_places()))
        save_map(learned, outputs["map.mcap"], metadata=provenance("demo", inputs=[learning], seed=seed), force=force)
        if compiled is not None:
            compiled.wait(LONGEST_S)
        typer.echo(f"tracking {tracking.name}: {truth.n_tracks} vehicles for 90 s, three ways ...", err=True)
        found = track_all_ways(run, learned, truth, rivals, outputs)
    typer.echo(f"\nlearned: {map_text(learned)}; tracked: {truth.n_tracks} vehicles\n")
    typer.echo("\n".join(columns(found)))
    typer.echo("\nwrote " + ", ".join(str(path) for path in outputs.values()))
    typer.echo(f"next: open {outputs['demo.png']}; `dirprim view {outputs['tracks.rrd']}` plays it in rerun;")
    typer.echo(f"      {outputs['tracks.mcap']} opens in Foxglove, with the layout in docs/guides;")
    typer.echo("      `dirprim info LOG` summarises a log of yours")


def track(run: Run, model: PrimitiveMap | BayesFilter, sinks: Sequence[EstimateSink] = ()) -> Estimates:
    """Track by a model; `sinks`: those of the way that is shown."""
    import numpy as np

    from dirprim_filter.cli.progress import with_progress
    from dirprim_filter.config import TrackingConfig
    from dirprim_filter.estimates import EstimateList
    from dirprim_filter.filtering import Tracker
    from dirprim_filter.recording.reader import stream_detections
    from dirprim_filter.replay import replay

    is_blind, tracking = run.scene is Scene.BLIND, TrackingConfig()
    if is_blind and not sinks:
        tracking = replace(tracking, departure_rate=departure_rate(run.tracks))
    stream, kept = stream_detections(run.log), EstimateList()
    frames = with_progress(stream, what=f"tracking {run.log.name}", end_ns=stream.end_ns) if sinks else stream
    if is_blind:
        frames = (seen for seen in map(with_blind_ring, frames) if len(seen))
    rng = np.random.default_rng(run.seed)
    replay(frames, Tracker(model, tracking=tracking, with_innovations=bool(sinks), rng=rng), [*sinks, kept])
    return kept.all()


def by_constant_velocity(run: Run) -> Estimates:
    """Track by the Kalman filter under which noisy positions of some of the vehicles are most likely."""
    import numpy as np

    from dirprim_filter.config import FilterConfig
    from dirprim_filter.detections import Detections
    from dirprim_filter.evaluation.rivals import fitted

    config, rng, tracks = FilterConfig(), np.random.default_rng(0), run.tracks
    some = tracks[np.isin(tracks.vehicle, rng.permutation(tracks.n_tracks)[:N_FITTED])]
    noise = config.noise_m * rng.standard_normal(some.position.shape)
    seen = replace(Detections.of(some), position=some.position + noise)
    return track(run, fitted("constant velocity", seen, tracks, config)())


def track_all_ways(
    run: Run, learned: PrimitiveMap, truth: Tracks, rivals: Mapping[str, AsyncResult[Estimates]],
    outputs: Mapping[str, Path],
) -> list[Sequence[str]]:  # fmt: skip
    """Track with the map, writing and drawing everything; wait for the rivals; -> a table of all scores."""
    import numpy as np

    from dirprim_filter.cli.results import provenance
    from dirprim_filter.forecasting import Forecaster
    from dirprim_filter.recording.writer import EstimateWriter
    from dirprim_filter.viewer.figures import map_figure, save_figure
    from dirprim_filter.viewer.sink import open_stream

    said = provenance("demo", inputs=[run.log], seed=run.seed)
    with (
        EstimateWriter(outputs["tracks.mcap"], metadata=said, force=True) as written,
        open_stream("dirprim demo", save=outputs["tracks.rrd"], force=True) as shown,
    ):
        written.write_map_scene(learned)
        shown.log_map(learned)
        shown.log_truth(truth)
        forecaster = Forecaster(learned, [written, shown], rng=np.random.default_rng([run.seed, 1]))
        found = {WITH_MAP: track(run, learned, [written, shown, forecaster])}
        found |= {name: rivals[name].get(LONGEST_S) for name in (WITHOUT_MAP, CONSTANT_VELOCITY)}
        figures = BLIND_FIGURES if run.scene is Scene.BLIND else SEEN_FIGURES
        reports = {name: report(of, truth, is_blind=run.scene is Scene.BLIND) for name, of in found.items()}
        table = [(name, *(number(getattr(of, figure)) for figure in figures)) for name, of in reports.items()]
        heads = [FIGURES[figure] for figure in figures]
        shown.log_run(
            said, {f"{head}, {name}": of for name, *row in table for head, of in zip(heads, row, strict=True)}
        )
    save_figure(map_figure(learned, estimates=found[WITH_MAP]), outputs["demo.png"], force=True)
    return [("tracking", *heads), *table]


def report(estimates: Estimates, truth: Tracks, *, is_blind: bool) -> TrackingReport:
    """The figures of a tracker; in the blind scene it knows no ids."""
    from dirprim_filter.evaluation.tracked_rows import TrackedRows
    from dirprim_filter.evaluation.tracking_report import Scales, TrackingReport

    is_hidden = in_ring(truth.position) if is_blind else None
    return TrackingReport.of(
        TrackedRows.of(estimates), truth, is_hidden=is_hidden, with_ids=not is_blind, scales=Scales()
    )
