"""`dirprim demo`: the whole way, from logs to a picture, on the recordings that ship with the project.

A second process compiles kernels, in an installation's first run, and tracks by the rivals, while this one learns and
tracks with the map.
"""

from __future__ import annotations

import signal
from dataclasses import dataclass, replace
from enum import StrEnum
from multiprocessing import get_context
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from dirprim_filter.cli.compiling import has_kernels
from dirprim_filter.cli.options import WRITTEN, Force, Seed
from dirprim_filter.cli.texts import columns

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence
    from multiprocessing.pool import AsyncResult

    import numpy as np

    from dirprim_filter.estimates import Estimates, EstimateSink
    from dirprim_filter.filtering import BayesFilter
    from dirprim_filter.primitives import PrimitiveMap
    from dirprim_filter.tracks import Tracks


KERNEL = "_kernels.advance"
"""Where this is compiled, so are the others that tracking needs."""
WITH_MAP, WITHOUT_MAP, CONSTANT_VELOCITY = "with the map", "without the map", "constant velocity"
"""The ways that are compared."""
TRAIL_NS = 5_000_000_000
"""Of the way that vehicles have come, in the picture."""
LONGEST_S = 900.0
"""The second process is waited for; one that was killed would never answer."""
N_FITTED = 20
"""Vehicles that constant velocity is fitted to."""


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

    outputs = {name: folder / name for name in ("map.mcap", "tracks.mcap", "layout.json", "tracks.rrd", "demo.png")}
    for path in outputs.values():
        if path.exists() and not force:
            raise OutputExistsError(path)
    folder.mkdir(parents=True, exist_ok=True)
    with get_context("spawn").Pool(1, signal.signal, (signal.SIGINT, signal.SIG_IGN)) as second:
        compiled = None if has_kernels(KERNEL) else second.apply_async(_compile)

        from dirprim_filter.cli.learn import map_text
        from dirprim_filter.cli.progress import learning_progress
        from dirprim_filter.cli.provenance import provenance
        from dirprim_filter.primitives import learn_primitives
        from dirprim_filter.recording import read_tracks, save_map
        from dirprim_filter.recording.foxglove.layout import write_layout

        learning, tracking = scene.recording("learn"), scene.recording("track")
        tracks, truth = read_tracks(learning), read_tracks(tracking)
        run = Run(scene=scene, log=tracking, seed=seed)
        rivals = {CONSTANT_VELOCITY: second.apply_async(run.by_constant_velocity, (tracks,))}
        typer.echo(f"learning from {learning.name}: {tracks.n_tracks} vehicles, {len(tracks)} rows ...", err=True)
        with learning_progress() as bars:
            learned = learn_primitives(tracks, progress=bars.progress, stage=bars.stage, rng=run.rng())
        rivals[WITHOUT_MAP] = second.apply_async(run.by, (learned.without_places(), tracks))
        save_map(learned, outputs["map.mcap"], metadata=provenance("demo", inputs=[learning], seed=seed), force=force)
        write_layout(learned, outputs["layout.json"], force=force)
        if compiled is not None:
            compiled.wait(LONGEST_S)
        typer.echo(f"tracking {tracking.name}: {truth.n_tracks} vehicles for 90 s, three ways ...", err=True)
        table = run.track_all_ways(learned, tracks, truth, rivals, outputs, force=force)
    typer.echo(f"\nlearned: {map_text(learned)}; tracked: {truth.n_tracks} vehicles\n")
    typer.echo("\n".join(columns(table)))
    typer.echo("\nwrote " + ", ".join(str(path) for path in outputs.values()))
    typer.echo(f"next: open {outputs['demo.png']}; `dirprim view {outputs['tracks.rrd']}` plays it in rerun;")
    typer.echo(f"      {outputs['tracks.mcap']} opens in Foxglove, with the layout {outputs['layout.json']};")
    typer.echo("      `dirprim info LOG` summarises a log of yours")


def _compile() -> None:
    from dirprim_filter.cli.warm_up import warm_up

    warm_up()


@dataclass(frozen=True, kw_only=True)
class Run:
    """How a recording is tracked, whichever way.

    Attributes:
        scene: of it.
        log: it.
        seed: of the particles.
    """

    scene: Scene
    log: Path
    seed: int

    def rng(self, *stream: int) -> np.random.Generator:
        """Random numbers, of a stream of their own."""
        import numpy as np

        return np.random.default_rng([self.seed, *stream] if stream else self.seed)

    def by(self, model: PrimitiveMap | BayesFilter, tracks: Tracks, sinks: Sequence[EstimateSink] = ()) -> Estimates:
        """Track by a model; `tracks`: what is known of the traffic; `sinks`: those of the way that is shown."""
        from dirprim_filter.cli.blind_demo import departure_rate, with_blind_ring
        from dirprim_filter.cli.progress import with_progress
        from dirprim_filter.config import FilterConfig, TrackingConfig
        from dirprim_filter.estimates import EstimateList
        from dirprim_filter.filtering import Tracker
        from dirprim_filter.recording.reader import stream_detections
        from dirprim_filter.replay import replay

        is_blind, tracking = self.scene is Scene.BLIND, TrackingConfig()
        if is_blind and not sinks:
            tracking = replace(tracking, departure_rate=departure_rate(tracks))
        stream, kept = stream_detections(self.log), EstimateList()
        frames = with_progress(stream, what=f"tracking {self.log.name}", end_ns=stream.end_ns) if sinks else stream
        if is_blind:
            frames = (seen for seen in map(with_blind_ring, frames) if len(seen))
        tracker = Tracker(
            model, config=FilterConfig(), tracking=tracking, with_innovations=bool(sinks), rng=self.rng()
        )  # fmt: skip
        replay(frames, tracker, [*sinks, kept])
        return kept.all()

    def by_constant_velocity(self, tracks: Tracks) -> Estimates:
        """Track by the Kalman filter under which noisy positions of some of the vehicles are most likely."""
        import numpy as np

        from dirprim_filter.config import FilterConfig
        from dirprim_filter.detections import Detections
        from dirprim_filter.evaluation.rivals import fitted

        config, rng = FilterConfig(), np.random.default_rng(0)
        some = tracks[np.isin(tracks.vehicle, rng.permutation(tracks.n_tracks)[:N_FITTED])]
        noise = config.noise_m * rng.standard_normal(some.position.shape)
        seen = replace(Detections.of(some), position=some.position + noise)
        return self.by(fitted("constant velocity", seen, tracks, config)(), tracks)

    def track_all_ways(
        self, learned: PrimitiveMap, tracks: Tracks, truth: Tracks, rivals: Mapping[str, AsyncResult[Estimates]],
        outputs: Mapping[str, Path], *, force: bool,
    ) -> list[Sequence[str]]:  # fmt: skip
        """Track with the map, writing and drawing everything; wait for the rivals; -> a table of all scores."""
        from dirprim_filter.cli.blind_demo import FrameAt, telling_instant
        from dirprim_filter.cli.provenance import provenance
        from dirprim_filter.config import FilterConfig
        from dirprim_filter.forecasting import Forecaster
        from dirprim_filter.recording.writer import EstimateWriter
        from dirprim_filter.viewer.figures import map_figure, save_figure
        from dirprim_filter.viewer.sink import open_stream
        from dirprim_filter.viewer.texts import run_report

        config, (shown_at, focus) = FilterConfig(), telling_instant(truth, is_blind=self.scene is Scene.BLIND)
        said, instant = provenance("demo", inputs=[self.log], config=config, seed=self.seed), FrameAt(shown_at)
        with (
            EstimateWriter(outputs["tracks.mcap"], metadata=said, particle_stride=10, force=force) as written,
            open_stream("dirprim demo", save=outputs["tracks.rrd"], force=force, n_particles=100) as shown,
        ):
            written.write_map_scene(learned)
            shown.log_map(learned)
            shown.log_truth(truth)
            forecaster = Forecaster(learned, [written, shown], config=config, rng=self.rng(1))
            found = {WITH_MAP: self.by(learned, tracks, [written, shown, forecaster, instant])}
            found |= {name: rivals[name].get(LONGEST_S) for name in (WITHOUT_MAP, CONSTANT_VELOCITY)}
            table = self._table(found, truth)
            head, *body = (" | ".join(row) for row in table)
            rule = "|".join(["---"] * len(table[0]))
            shown.log_report("\n".join([head, rule, *body, "", run_report(said, {}, title="Made with")]))
        if (frame := instant.frame) is not None:
            name = focus if focus in frame.names else frame.names[0]
            age_ns = frame.time_ns - found[WITH_MAP].time_ns
            figure = map_figure(
                learned, tracks=tracks, frame=frame, truth=truth,
                estimates=found[WITH_MAP][(age_ns >= 0) & (age_ns <= TRAIL_NS)],
                forecasts={name: forecaster.paths(frame)[frame.names.index(name)]},
            )  # fmt: skip
            save_figure(figure, outputs["demo.png"], force=force)
        return table

    def _table(self, found: Mapping[str, Estimates], truth: Tracks) -> list[Sequence[str]]:
        """A row of scores for each way, under their heads."""
        scores = _blind_scores if self.scene is Scene.BLIND else _scores
        rows = {name: scores(of, truth) for name, of in found.items()}
        return [("tracking", *rows[WITH_MAP]), *((name, *of.values()) for name, of in rows.items())]


def _scores(estimates: Estimates, truth: Tracks) -> dict[str, str]:
    import numpy as np

    from dirprim_filter.evaluation.tracked_rows import TrackedRows
    from dirprim_filter.evaluation.tracking_report import Scales, TrackingReport

    errors = TrackingReport.of(TrackedRows.of(estimates), truth, is_hidden=None, with_ids=True, scales=Scales())
    return {
        "position RMSE [m]": f"{errors.rmse:.3f}",
        "direction RMSE [deg]": f"{np.rad2deg(errors.direction_rmse):.1f}",
        "speed RMSE [m/s]": f"{errors.speed_rmse:.2f}", "NEES (2 is right)": f"{errors.nees:.2f}",
    }  # fmt: skip


def _blind_scores(estimates: Estimates, truth: Tracks) -> dict[str, str]:
    from dirprim_filter.cli.blind_demo import blind_report, followers, in_ring

    found = blind_report(estimates, truth)
    followed = (followers(estimates, truth)[in_ring(truth.position)] != "").mean()
    return {
        "HOTA": f"{found.hota:.3f}", "followed in the ring [%]": f"{100.0 * followed:.0f}",
        "changes of track": f"{found.switches:.0f}", "RMSE of the followed [m]": f"{found.rmse:.3f}",
        "in sight": f"{found.seen_rmse:.3f}",
    }  # fmt: skip
