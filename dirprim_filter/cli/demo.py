"""`dirprim demo`: the whole way, from logs to a picture, on the recordings that ship with the project."""

from __future__ import annotations

import subprocess
import sys
from dataclasses import dataclass, replace
from enum import StrEnum
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from dirprim_filter.cli.compiling import has_kernels
from dirprim_filter.cli.options import WRITTEN, Force, Seed

if TYPE_CHECKING:
    from collections.abc import Mapping

    import numpy as np

    from dirprim_filter.config import FilterConfig
    from dirprim_filter.estimates import Estimates, EstimateSink, TrackedFrame
    from dirprim_filter.filtering import BayesFilter
    from dirprim_filter.forecasting import Forecaster
    from dirprim_filter.primitives import PrimitiveMap
    from dirprim_filter.tracks import Tracks

    Table = Mapping[str, Mapping[str, str]]


KERNEL = "_kernels.advance"
"""Where this is compiled, so are the others that tracking needs."""
WITH_MAP, CONSTANT_VELOCITY = "with the map", "constant velocity"
"""Of the ways that are compared."""
TRAIL_NS = 5_000_000_000
"""Of the way that vehicles have come, in the picture."""
N_FITTED = 20
"""Vehicles that constant velocity is fitted to."""


class Scene(StrEnum):
    """The scenes that ship; the blind one is the intersection, without ids and without detections in a ring."""

    ROUNDABOUT = "roundabout"
    INTERSECTION = "intersection"
    BLIND = "blind"

    @property
    def place(self) -> str:
        """In the names of its recordings."""
        return "intersection" if self is Scene.BLIND else self.value


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
    from dirprim_filter.recording import read_tracks, save_map
    from dirprim_filter.recording.errors import OutputExistsError
    from dirprim_filter.recording.foxglove.layout import write_layout

    learning = recordings_folder() / f"{scene.place}_learn.mcap"
    tracking = recordings_folder() / f"{scene.place}_track.mcap"
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
    run = Run(learned=learned, tracks=tracks, truth=truth, log=tracking, is_blind=scene is Scene.BLIND, seed=seed)
    _print_result(learned, truth, run.track_three_ways(outputs, force=force), outputs)


@dataclass(frozen=True, kw_only=True)
class Run:
    """A map and a log that is tracked with it.

    Attributes:
        learned: the map.
        tracks: what it was learned from.
        truth: of the log.
        log: the log.
        is_blind: whether detections have no ids, and there are none in the ring.
        seed: of the particles.
    """

    learned: PrimitiveMap
    tracks: Tracks
    truth: Tracks
    log: Path
    is_blind: bool
    seed: int

    def track_three_ways(self, outputs: Mapping[str, Path], *, force: bool) -> Table:
        """Track with the map, writing and drawing everything; without it; with constant velocity; score all."""
        from dirprim_filter.cli.blind_demo import FrameAt, telling_instant
        from dirprim_filter.cli.provenance import provenance
        from dirprim_filter.config import FilterConfig
        from dirprim_filter.estimates import EstimateList
        from dirprim_filter.forecasting import Forecaster
        from dirprim_filter.recording.writer import EstimateWriter
        from dirprim_filter.viewer.sink import open_stream
        from dirprim_filter.viewer.texts import run_report

        config = FilterConfig()
        said = provenance("demo", inputs=[self.log], config=config, seed=self.seed)
        models: dict[str, PrimitiveMap | BayesFilter] = {
            WITH_MAP: self.learned,
            "without the map": self.learned.without_places(),
            CONSTANT_VELOCITY: _constant_velocity(self.tracks, config),
        }
        kept = {name: EstimateList() for name in models}
        shown_at, focus = telling_instant(self.truth, is_blind=self.is_blind)
        instant = FrameAt(shown_at)
        with (
            EstimateWriter(outputs["tracks.mcap"], metadata=said, particle_stride=10, force=force) as written,
            open_stream("dirprim demo", save=outputs["tracks.rrd"], force=force, n_particles=100) as shown,
        ):
            written.write_map_scene(self.learned)
            shown.log_map(self.learned)
            shown.log_truth(self.truth)
            forecaster = Forecaster(self.learned, [written, shown], config=config, rng=self._rng(1))
            sinks: list[EstimateSink] = [written, shown, forecaster, instant]
            for name, model in models.items():
                self._replay(model, config, [*(sinks if name == WITH_MAP else []), kept[name]])
            table = {name: _scores(of.all(), self.truth, is_blind=self.is_blind) for name, of in kept.items()}
            shown.log_report("\n".join([*_lines(table, markdown=True), "", run_report(said, {}, title="Made with")]))
        if instant.frame is not None:
            self._draw(kept[WITH_MAP].all(), instant.frame, focus, forecaster, outputs["demo.png"], force=force)
        return table

    def _replay(self, model: PrimitiveMap | BayesFilter, config: FilterConfig, sinks: list[EstimateSink]) -> None:
        from dirprim_filter.cli.blind_demo import departure_rate, with_blind_ring
        from dirprim_filter.cli.progress import with_progress
        from dirprim_filter.config import TrackingConfig
        from dirprim_filter.filtering import Tracker
        from dirprim_filter.recording.reader import stream_detections
        from dirprim_filter.replay import replay

        tracking, with_innovations = TrackingConfig(), model is self.learned
        if self.is_blind and not with_innovations:
            tracking = replace(tracking, departure_rate=departure_rate(self.tracks))
        stream = stream_detections(self.log)
        frames = with_progress(stream, what=f"tracking {self.log.name}", end_ns=stream.end_ns)
        if self.is_blind:
            frames = (seen for seen in map(with_blind_ring, frames) if len(seen))
        tracker = Tracker(model, config=config, tracking=tracking, with_innovations=with_innovations, rng=self._rng())
        replay(frames, tracker, sinks)

    def _rng(self, *stream: int) -> np.random.Generator:
        import numpy as np

        return np.random.default_rng([self.seed, *stream] if stream else self.seed)

    def _draw(
        self, estimates: Estimates, frame: TrackedFrame, focus: str, forecaster: Forecaster, path: Path, *, force: bool
    ) -> None:
        from dirprim_filter.viewer.figures import map_figure, save_figure

        name = focus if focus in frame.names else frame.names[0]
        age_ns = frame.time_ns - estimates.time_ns
        figure = map_figure(
            self.learned, tracks=self.tracks, frame=frame, truth=self.truth,
            estimates=estimates[(age_ns >= 0) & (age_ns <= TRAIL_NS)],
            forecasts={name: forecaster.paths(frame)[frame.names.index(name)]},
        )  # fmt: skip
        save_figure(figure, path, force=force)


def _constant_velocity(tracks: Tracks, config: FilterConfig) -> BayesFilter:
    """The Kalman filter under which noisy positions of some of the vehicles are most likely."""
    import numpy as np

    from dirprim_filter.detections import Detections
    from dirprim_filter.evaluation.rivals import fitted

    rng = np.random.default_rng(0)
    some = tracks[np.isin(tracks.vehicle, rng.permutation(tracks.n_tracks)[:N_FITTED])]
    noise = config.noise_m * rng.standard_normal(some.position.shape)
    return fitted("constant velocity", replace(Detections.of(some), position=some.position + noise), tracks, config)()


# --- What is printed -----------------------------------------------------------------------------------


def _scores(estimates: Estimates, truth: Tracks, *, is_blind: bool) -> dict[str, str]:
    """A row of the table: heads and figures."""
    import numpy as np

    from dirprim_filter.cli.blind_demo import blind_report, followers, in_ring
    from dirprim_filter.evaluation.tracked_rows import TrackedRows
    from dirprim_filter.evaluation.tracking_report import Scales, TrackingReport

    if is_blind:
        found = blind_report(estimates, truth)
        followed = (followers(estimates, truth)[in_ring(truth.position)] != "").mean()
        return {
            "HOTA": f"{found.hota:.3f}", "followed in the ring [%]": f"{100.0 * followed:.0f}",
            "changes of track": f"{found.switches:.0f}", "RMSE of the followed [m]": f"{found.rmse:.3f}",
            "in sight": f"{found.seen_rmse:.3f}",
        }  # fmt: skip
    errors = TrackingReport.of(TrackedRows.of(estimates), truth, is_hidden=None, with_ids=True, scales=Scales())
    return {
        "position RMSE [m]": f"{errors.rmse:.3f}",
        "direction RMSE [deg]": f"{np.rad2deg(errors.direction_rmse):.1f}",
        "speed RMSE [m/s]": f"{errors.speed_rmse:.2f}", "NEES (2 is right)": f"{errors.nees:.2f}",
    }  # fmt: skip


def _lines(table: Table, *, markdown: bool = False) -> list[str]:
    rows = [("tracking", *next(iter(table.values()))), *((name, *of.values()) for name, of in table.items())]
    if markdown:
        head, *body = (" | ".join(row) for row in rows)
        return [head, "|".join(["---"] * len(rows[0])), *body]
    widths = [max(map(len, column)) for column in zip(*rows, strict=True)]
    return [
        "  ".join([row[0].ljust(widths[0]), *(c.rjust(w) for c, w in zip(row[1:], widths[1:], strict=True))])
        for row in rows
    ]


def _print_result(learned: PrimitiveMap, truth: Tracks, table: Table, outputs: Mapping[str, Path]) -> None:
    n_modes = (learned.own_weight > 0).sum(axis=1)
    typer.echo(
        f"\nlearned: {learned.tessellation.n_cells} cells of {float(learned.tessellation.area.mean()) ** 0.5:.3g} m, "
        f"{n_modes.mean():.1f} modes each; tracked: {truth.n_tracks} vehicles\n"
    )
    for line in _lines(table):
        typer.echo(line)
    typer.echo("\nwrote " + ", ".join(str(path) for path in outputs.values()))
    typer.echo(f"next: open {outputs['demo.png']}; `dirprim view {outputs['tracks.rrd']}` plays it in rerun;")
    typer.echo(f"      {outputs['tracks.mcap']} opens in Foxglove, with the layout {outputs['layout.json']};")
    typer.echo("      `dirprim info LOG` summarises a log of yours")
