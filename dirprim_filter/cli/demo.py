"""`dirprim demo`: the whole way, from logs to a picture, on the recordings that ship with the project.

A second process compiles kernels, in an installation's first run, and tracks by the rivals, while this one learns,
tracks with the map, and draws. In the blind scene nothing is detected in a ring about the junction, and detections have
no ids.
"""

from __future__ import annotations

import signal
from contextlib import redirect_stdout
from dataclasses import replace
from io import StringIO
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import TYPE_CHECKING, Annotated, Any, Literal

import typer

import dirprim_filter as dp
from dirprim_filter.cli import exit_codes
from dirprim_filter.cli.compiling import warm_up
from dirprim_filter.cli.learn import learn
from dirprim_filter.cli.options import Force, Seed
from dirprim_filter.cli.plot import plot
from dirprim_filter.cli.reading import Reading
from dirprim_filter.cli.tables import FIGURES
from dirprim_filter.cli.texts import columns, number, say
from dirprim_filter.cli.track import track as track_log
from dirprim_filter.partial_file import PartialFile

if TYPE_CHECKING:
    from dirprim_filter.arrays import BoolArray, FloatArray

WITH_MAP, WITHOUT_MAP, CONSTANT_VELOCITY = "with the map", "without the map", "constant velocity"
"""The ways that are compared."""
LONGEST_S = 900.0
"""The second process is waited for; one that was killed would never answer."""
NEAR_M, FAR_M = 25.0, 45.0
"""Borders of the ring, a square about the junction's middle: max(|x|, |y|)."""


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


def with_blind_ring(seen: dp.Detections) -> dp.Detections:
    """What is detected outside of the ring, without ids."""
    return seen[~in_ring(seen.position)].without_ids()


def departure_rate(tracks: dp.Tracks) -> float:
    """1/s, how often a vehicle leaves: one time each in all the time that they are watched.

    Where they leave is what a map knows; a tracker without one is given how often.
    """
    import numpy as np

    last_ns = np.zeros(tracks.n_tracks, np.int64)
    np.maximum.at(last_ns, tracks.vehicle, tracks.time_ns)
    return tracks.n_tracks / (float((last_ns - tracks.time_ns[tracks.first_rows]).sum()) * 1e-9)


def demo(
    folder: Annotated[Path, typer.Option("--output", "-o", help="Folder for the outputs.")] = Path("demo"),
    scene: Annotated[
        Literal["roundabout", "intersection", "blind"], typer.Option(help="Which recordings to use.")
    ] = "roundabout",
    seed: Seed = 0,
    force: Force = False,
) -> None:
    """Learn, track and plot on the recordings that ship.

    A map is learned from one recording; vehicles of another are tracked and forecast with it.

    In the scene `blind` the detections have no ids, and in a ring about the junction there are none: which tracks last?

    Example: dirprim demo --scene intersection -o demo_intersection
    """
    from multiprocessing import get_context

    names = ("map.mcap", "tracks.mcap", "tracks.rrd", "demo.png")
    map_file, estimates, shown, picture = outputs = [folder / name for name in names]
    folder.mkdir(parents=True, exist_ok=True)
    for path in outputs:
        PartialFile(path, force=force)
    with (
        TemporaryDirectory() as work,
        get_context("spawn").Pool(1, signal.signal, (signal.SIGINT, signal.SIG_IGN)) as second,
    ):
        compiled = second.apply_async(warm_up)

        from dirprim_filter.evaluation.tracked_rows import TrackedRows
        from dirprim_filter.evaluation.tracking_report import report_of
        from dirprim_filter.recording.reader import stream_detections

        is_blind, place = scene == "blind", "intersection" if scene == "blind" else scene
        learning, tracking = (recordings_folder() / f"{place}_{what}.mcap" for what in ("learn", "track"))
        truth, known, seen = dp.read_tracks(tracking), dp.read_tracks(learning), tracking
        if is_blind:
            whole, seen = dp.Detections.concatenate(list(stream_detections(tracking))), Path(work) / "seen.mcap"
            dp.write_tracks(truth[:0], seen, detections=with_blind_ring(whole))
        ways = {WITH_MAP: estimates, **{way: Path(work) / f"{way}.mcap" for way in (WITHOUT_MAP, CONSTANT_VELOCITY)}}
        common: dict[str, Any] = {"log": seen, "seed": seed, "noise": 0.5, "force": True, "reading": Reading()}
        leaving = {"departure_rate": str(departure_rate(known))} if is_blind else {}
        straight = common | {"output": ways[CONSTANT_VELOCITY], "motion": "constant-velocity", "settings": leaving}
        rivals = [second.apply_async(_track_straight, (straight, known))]
        learn(logs=[learning], output=map_file, seed=seed, force=True, reading=Reading())
        by_map = common | {"map_file": map_file}
        without = by_map | {"output": ways[WITHOUT_MAP], "settings": {"without_map": "true", **leaving}}
        rivals.append(second.apply_async(_track, (without,)))
        compiled.wait(LONGEST_S)
        code = track_log(**by_map, output=estimates, save=shown, forecast=5.0, settings={"truth": str(tracking)})
        if code not in (exit_codes.DONE, exit_codes.INPUT_LOST):
            raise typer.Exit(code)
        plot(map_file=map_file, output=picture, estimates=estimates, force=True, reading=Reading())
        for task in rivals:
            task.get(LONGEST_S)
        figures = ("hota idf1 mota switches seen_rmse" if is_blind else "rmse direction_rmse speed_rmse nees").split()
        table = [("tracking", *(FIGURES[figure] for figure in figures))]
        is_hidden = in_ring(truth.position) if is_blind else None
        for way, path in ways.items():
            rows = TrackedRows.of(dp.read_estimates(path))
            found = report_of(rows, truth, is_hidden=is_hidden, with_ids=not is_blind).report
            table.append((way, *(number(getattr(found, figure)) for figure in figures)))
    say(
        "", *columns(table), "", f"next: open {picture}; `dirprim view {shown}` plays it in rerun;",
        f"      {estimates} opens in Foxglove, with the layout in docs/guides;",
        "      `dirprim info LOG` summarises a log of yours",
    )  # fmt: skip


def _track(way: dict[str, Any]) -> None:
    """By `dirprim track` with these options, without its texts."""
    with redirect_stdout(StringIO()):
        track_log(**way)


def _track_straight(way: dict[str, Any], known: dp.Tracks) -> None:
    """By the Kalman filter under which noisy positions of some of the known vehicles are most likely."""
    import numpy as np

    from dirprim_filter.evaluation.without_map import fitted_acceleration

    config, rng = dp.FilterConfig(), np.random.default_rng(0)
    some = known[np.isin(known.vehicle, rng.permutation(known.n_tracks)[:20])]
    noise = config.noise_m * rng.standard_normal(some.position.shape)
    fitted = fitted_acceleration(replace(dp.Detections.of(some), position=some.position + noise), known, config)
    _track(way | {"settings": way["settings"] | {"acceleration_density": str(fitted.chosen)}})
