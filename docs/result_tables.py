"""The tables of `results.md`, as data: the logs, the commands, and what is read from their output.

`make_results.py` runs them, keeps their figures in `results/NAME.json`, and writes the page.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, NamedTuple

from result_figures import (
    Entries,
    Figure,
    changes,
    cue_rows,
    densities,
    forecasts,
    group,
    mean_of,
    mechanisms,
    neutral,
    of_key,
    peers,
    printed,
    rows_of,
    trackers,
)  # fmt: skip


@dataclass(frozen=True, slots=True, kw_only=True)
class Log:
    """A log, and the command that makes it.

    Attributes:
        command: `{log}` stands for it, `{data}` for the folder of the data.
        about: what it is; empty where it is only a means.
        source: of the data, which may be absent; empty where it needs none.
    """

    command: str
    about: str = ""
    source: str = ""


@dataclass(frozen=True, slots=True, kw_only=True)
class Column:
    """A column: its head, how a figure is read from a row's entry, and its decimals."""

    head: str
    read: Callable[[Any], Figure]
    digits: int = 2


@dataclass(frozen=True, slots=True, kw_only=True)
class Run:
    """One command of a table.

    Attributes:
        name: in the first column.
        logs: names of `LOGS`.
        options: beyond those of the table; these may name logs too.
        entries: how its output is read, where that is not the table's way.
        source: of the data, which the command reads by itself.
    """

    name: str
    logs: tuple[str, ...] = ()
    options: str = ""
    entries: Entries | None = None
    source: str = ""


@dataclass(frozen=True, slots=True, kw_only=True)
class Table:
    """A table: what is run, and what is read from it.

    Attributes:
        command: `{logs}` and `{options}` stand for the run's.
        entries: how output is read.
        of: the head over the names of the rows.
        blocks: captions, and which columns stand under each, all runs side by side; empty: a column for each figure.
        beside: rows stand under each caption with a column for each method instead of one for each run.
        renamed: patterns in names of rows, and what the page says instead; a row without a name is not shown.
        minutes: a run that takes longer is stopped, and its former figures stay.
    """

    command: str
    runs: tuple[Run, ...]
    entries: Entries
    columns: tuple[Column, ...]
    of: str = "method"
    blocks: tuple[tuple[str, tuple[int, ...]], ...] = ()
    beside: bool = False
    renamed: tuple[tuple[str, str], ...] = ()
    minutes: float = 60


TRACKERS = "".join(f' --method "{name}"' for name in ("prior", "place-free", "one cell", "constant velocity"))
WITHOUT = (("place-free", "without the map"),)
"""The method's name in files, and what the page says."""
DEATH_CIRCLE = ("death_circle_2.mcap", "death_circle_4.mcap")
LOGGED = (
    Run(name="roundabout", logs=("roundabout.mcap",)),
    Run(name="intersection", logs=("intersection.mcap",)),
    Run(name="Lankershim", logs=("lankershim.mcap",)),
    Run(name="Death Circle", logs=DEATH_CIRCLE),
)


def _converted(source: str, about: str, options: str = "") -> Log:
    return Log(command=f"dirprim convert {{data}}/{source} -o {{log}}{options}", about=about, source=source)


def _dense(scene: str, demand: float, about: str) -> dict[str, Log]:
    simulate = f"dirprim simulate {scene} -o {{log}} --demand {demand} --no-detections"
    return {
        f"{scene}_learn.mcap": Log(command=f"{simulate} --duration 300 --rate 5 --seed 1"),
        f"{scene}_map.mcap": Log(command=f"dirprim learn {scene}_learn.mcap -o {{log}}"),
        f"{scene}_track.mcap": Log(command=f"{simulate} --duration 30 --seed 2", about=about),
    }


LOGS: dict[str, Log] = {
    "roundabout.mcap": _converted("town03/roundabout.csv", "CARLA's Town03, driven by SUMO; 567 vehicles"),
    "intersection.mcap": _converted("town03/intersection.csv", "the same town; 398 vehicles"),
    "lankershim.mcap": _converted("lankershim/lankershim.csv", "NGSIM's boulevard; 1,091 vehicles in 24 groups"),
    **{
        f"death_circle_{video}.mcap": _converted(
            f"death_circle/video{video}/annotations.txt", about, f" --format sdd --metres-per-pixel {scale}"
        )
        for video, scale, about in (
            (2, 0.03948, "Stanford Drone Dataset; pedestrians and bicycles, 35 tracks"), (4, 0.03898, "the same; 56"),
        )
    },
    **_dense("intersection", 2.2, "SUMO, queues at traffic lights; some 35 vehicles at once"),
    **_dense("highway", 2.5, "SUMO, vehicles weave and overtake; some 60 at once"),
}  # fmt: skip

TOWNS = ("roundabout", "intersection", "Lankershim")
OWN_SHARE, ABOVE = ", mean confidence by the other sequences", ", mean score above 2.5"
NEUTRAL = "python tests/benchmarks/neutral.py {options} --json"
TABLES: dict[str, Table] = {
    "neutral": Table(
        command=NEUTRAL,
        runs=(
            Run(name="GeoLife", options="geolife --seeds 1", source="geolife"),
            Run(name="Chicago", options="chicago_bus --seeds 1", source="chicago_bus"),
            Run(name="Austin", options="austin_bus --seeds 1", source="austin_bus"),
            Run(name="Solent", options="solent_ais --seeds 3", source="solent_ais"),
            Run(name="Mcity", options="mcity_blind --seeds 2", source="mcity_roadside"),
            Run(name="town", options="town --seeds 1", source="town03"),
        ),
        entries=neutral,
        columns=(
            Column(head="error, m", read=of_key("error")),
            Column(head="energy score, m", read=of_key("energy")),
            Column(head="answered, %", read=of_key("answered", times=100.0), digits=0),
            Column(head="in the 50 % region", read=of_key("in 50 %")),
            Column(head="in the 90 % region", read=of_key("in 90 %")),
            Column(head="the map is nearer, %", read=of_key("gain", times=100.0), digits=0),
        ),
        of="gap, s|estimate",
        blocks=(("Error, m / the map is nearer, %", (0, 5)),
                ("Energy score, m / truth in the 50 % / in the 90 % region", (1, 3, 4))),
        beside=True,
        renamed=((r"\w+, gaps of ([\d.]+) s, (\w+)", r"\1|\2"), ("line between both ends", "straight line")),
        minutes=240,
    ),
    "neutral_boxes": Table(
        command=NEUTRAL,
        runs=(
            Run(name="KITTI", options="kitti --seeds 2", source="kitti_tracking"),
            Run(name="MOT17", options="mot17 --seeds 5", source="mot17"),
            Run(name="PETS09", options="pets09 --seeds 5", source="mot15"),
        ),
        entries=neutral,
        columns=(
            *(Column(head=head, read=of_key(head.lower()), digits=1) for head in ("HOTA", "AssA", "MOTA", "IDF1")),
            Column(head="switches", read=of_key("switches"), digits=0),
            Column(head="the first method's HOTA less this", read=of_key("gain"), digits=1),
        ),
        renamed=(
            (r".*(eleven sequences|02 04 09|(the map|constant velocity), mean score above 2\.5).*", ""),
            (r"^\w+: ", ""), (OWN_SHARE, ", mean confidence chosen"),
        ),
        minutes=240,
    ),
    "tracking": Table(
        command=f"dirprim evaluate tracking {{logs}} --set learn=0.9 --seeds 5 --set smooth=true{TRACKERS} --json",
        runs=LOGGED[:3],
        entries=trackers,
        columns=(
            Column(head="RMSE in sight, m", read=mean_of("seen_rmse")),
            Column(head="in gaps, m", read=mean_of("hidden_rmse")),
            Column(head="NEES in sight", read=mean_of("seen_nees"), digits=1),
            Column(head="in gaps", read=mean_of("hidden_nees"), digits=1),
            Column(head="the map is nearer in sight, %", read=of_key("against", "in_sight", times=100.0), digits=0),
            Column(head="in gaps, %", read=of_key("against", "in_gaps", times=100.0), digits=0),
        ),
        blocks=(
            ("RMSE in sight / in gaps, m", (0, 1)), ("NEES in sight / in gaps", (2, 3)),
            ("the map is nearer, in sight / in gaps, %", (4, 5)),
        ),
        renamed=(("place-free smoothed", ""), *WITHOUT),
    ),
    "no_ids": Table(
        command="dirprim evaluate tracking {logs} --no-ids --set miss_rate=0.2 --set false_per_frame=10 "
        f"--set n_particles=300{TRACKERS} {{options}} --json",
        runs=(
            Run(name="Lankershim", logs=("lankershim.mcap",), options="--set learn=0.9 --gap 0 --seeds 5"),
            Run(
                name="Lankershim, out of sight for 3 s", logs=("lankershim.mcap",),
                options="--set learn=0.9 --gap 3 --seeds 5",
            ),
            *(
                Run(name=f"dense {of}", logs=(f"{of}_track.mcap",), options=f"--map {of}_map.mcap --gap 0 --seeds 5")
                for of in ("intersection", "highway")
            ),
        ),
        entries=trackers,
        columns=(
            Column(head="HOTA", read=mean_of("hota"), digits=3),
            Column(head="GOSPA per vehicle, m", read=mean_of("gospa")),
            Column(head="switches", read=mean_of("switches"), digits=1),
            Column(head="the map's HOTA less this", read=of_key("against", "hota"), digits=3),
        ),
        blocks=(("HOTA / switches", (0, 2)), ("the map's HOTA less the row's", (3,))),
        renamed=WITHOUT,
    ),
    "forecasts": Table(
        command="dirprim evaluate forecast {logs} --folds 4 --horizon 1 --horizon 3 --horizon 5 --horizon 8 --json",
        runs=(*LOGGED[:3], Run(name="Death Circle, video 2", logs=DEATH_CIRCLE[:1])),
        entries=forecasts,
        columns=(
            Column(head="energy at 1 s, m", read=of_key("energy", "1")),
            Column(head="at 5 s, m", read=of_key("energy", "5")),
            *(Column(head=f"the map is nearer at {s} s, %", read=of_key("less", str(s), times=100.0), digits=0)
              for s in (1, 3, 5, 8)),
            Column(head="in the 50 % region", read=of_key("coverage", "50")),
            Column(head="in the 90 % region", read=of_key("coverage", "90")),
        ),
        blocks=(("energy at 1 s / 5 s, m / truth in the 50 % / in the 90 % regions", (0, 1, 6, 7)),
                ("the map is nearer at 1 s / 5 s / 8 s, %", (2, 4, 5))),
        renamed=WITHOUT,
    ),
    "densities": Table(
        command="dirprim evaluate density {logs} --folds 4 --every 0.5{options} --json",
        runs=(*LOGGED, Run(name="Lankershim, random", logs=("lankershim.mcap",), options=" --split random")),
        entries=densities,
        columns=(
            Column(head="direction, log", read=of_key("direction", "mean_log", "value"), digits=3),
            Column(head="mean", read=of_key("direction", "mean")),
            Column(head="speed, log", read=of_key("speed", "mean_log", "value"), digits=3),
            Column(head="both, log", read=of_key("joint", "mean_log", "value"), digits=3),
            Column(head="the map is ahead in direction, nat", read=of_key("direction", "behind")),
            Column(head="in both, nat", read=of_key("joint", "behind")),
        ),
        blocks=(("log density of direction / of both, nat / mean density of direction", (0, 3, 1)),
                ("the map is ahead in direction / in both, nat", (4, 5))),
    ),
    "cues": Table(
        command="dirprim evaluate cues {logs} --tessellation grid --json",
        runs=LOGGED[:2],
        entries=cue_rows,
        of="observation",
        columns=(
            Column(head="observation, mean density", read=of_key("observation", "mean")),
            Column(head="prior", read=of_key("prior", "mean")),
            Column(head="posterior", read=of_key("posterior", "mean")),
            Column(head="posterior over observation, nat", read=of_key("log_gain")),
            Column(head="over prior, nat", read=of_key("over_prior")),
        ),
    ),
    "cells": Table(
        command="python tests/benchmarks/joint_cells.py {logs} --json",
        runs=LOGGED,
        entries=rows_of,
        of="cells",
        columns=(
            Column(head="mean log density", read=of_key("mean"), digits=3),
            Column(head="cells", read=of_key("cells"), digits=0),
            Column(head="joint, curved is ahead by, nat", read=changes, digits=3),
        ),
        blocks=(("mean log density / cells / joint, curved is ahead, nat", (0, 1, 2)),),
        renamed=(("grid, (.*), .* m is best", r"best grid, \1"),),
    ),
    "peers": Table(
        command="python tests/benchmarks/peers.py {options} --json",
        runs=(
            Run(name="A", options="A --seeds 3"),
            Run(name="B", options="B --seeds 3"),
            Run(name="dense intersection", options="intersection --seeds 3"),
            Run(name="dense highway", options="highway --seeds 3"),
            Run(name="Lankershim", options="lankershim", source="lankershim"),
            Run(name="Mcity", options="mcity", source="mcity_roadside"),
            Run(name="autoferry", options="autoferry", source="autoferry"),
        ),
        entries=peers,
        of="tracker",
        columns=(
            Column(head="HOTA", read=of_key("hota"), digits=3),
            Column(head="ours with the map, HOTA more", read=of_key("behind"), digits=3),
            Column(head="RMSE in sight, m", read=of_key("seen_rmse")),
            Column(head="switches, all runs", read=of_key("switches"), digits=0),
            Column(head="ms a frame", read=of_key("ms_per_frame"), digits=1),
        ),
        blocks=(
            ("HOTA / switches, all runs", (0, 3)), ("ours with the map, HOTA more", (1,)),
            ("RMSE in sight, m / ms a frame", (2, 4)),
        ),
    ),
    "ablation": Table(
        command="python tests/benchmarks/ablation.py --part tracking {options} --json",
        runs=tuple(
            Run(name=scene, options=f'--scene "{scene}"')
            for scene in (*TOWNS, "dense intersection", "dense highway", "Mcity", "autoferry")
        ),
        entries=mechanisms,
        of="without",
        columns=(
            Column(head="RMSE in sight, %", read=of_key("in sight", times=100.0), digits=1),
            Column(head="in gaps, %", read=of_key("in gaps", times=100.0), digits=1),
            Column(head="HOTA, hundredths", read=of_key("HOTA", times=100.0)),
        ),
        blocks=(("RMSE in sight / in gaps, %", (0, 1)), ("HOTA, hundredths", (2,))),
        minutes=240,
    ),
    "ablation_learning": Table(
        command="python tests/benchmarks/ablation.py --part learning {options} --json",
        runs=tuple(Run(name=scene, options=f'--scene "{scene}"') for scene in TOWNS),
        entries=mechanisms,
        of="without",
        columns=(
            Column(head="log density, nat", read=of_key("density")),
            Column(head="energy at 1 s, %", read=of_key("energy at 1 s", times=100.0), digits=1),
            Column(head="at 5 s, %", read=of_key("energy at 5 s", times=100.0), digits=1),
            Column(head="RMSE in gaps, %", read=of_key("in gaps", times=100.0), digits=1),
        ),
        blocks=(("log density, nat / energy at 1 s / at 5 s / RMSE in gaps, %", (0, 1, 2, 3)),),
        minutes=240,
    ),
    "speed": Table(
        command="python tests/benchmarks/speed.py {options}",
        runs=(
            Run(
                name="step of 100,000 particles", options="step",
                entries=printed(
                    **{
                        "predict, weigh, resample": r"whole step ([\d.]+) ms",
                        "times real time, 100 vehicles, `dirprim track`": r"whole log ([\d.]+) x",
                    }
                ),
            ),
            Run(
                name="reading", options="read",
                entries=printed(**{"thousand messages a second": r"messages ([\d.]+) k/s ([\d.]+) k/s"}),
            ),
        ),
        entries=printed(),
        of="what",
        columns=(Column(head="ours", read=group(0)), Column(head="rival", read=group(1))),
        minutes=60,
    ),
}  # fmt: skip
"""Every table, by the name of its file in `results/`."""

BLIND = (
    ("GeoLife", "geolife, gaps of 60 s"), ("Chicago", "chicago_bus, gaps of 60 s"),
    ("Solent", "solent_ais, gaps of 185.64 s"), ("Mcity", "mcity_blind, gaps of 6 s"),
)  # fmt: skip
SUMMARY = (
    *(("error in gaps, online", " %", "neutral", run, f"{where}, online: {row}", "the map is nearer, %")
      for run, where in BLIND for row in ("without the map", "constant velocity")),
    *(("error in gaps, smoothed", " %", "neutral", run, f"{where}, smoothed: constant velocity", "the map is nearer, %")
      for run, where in BLIND),
    *((what, " %", "tracking", run, "constant velocity", column)
      for what, column in (("error in gaps of 3 s", "in gaps, %"), ("error in sight", "the map is nearer in sight, %"))
      for run in ("roundabout", "Lankershim")),
    *(("HOTA without ids", "", "no_ids", run, "constant velocity",
       "the map's HOTA less this") for run in ("Lankershim",)),
    ("HOTA of boxes, %", "", "neutral_boxes", "PETS09", "pets09: constant velocity",
     "the first method's HOTA less this"),
    *(("forecasts 5 s ahead", " %", "forecasts", run, row, "the map is nearer at 5 s, %")
      for run in ("roundabout", "Lankershim") for row in ("constant velocity", "trajectory memory")),
)  # fmt: skip
"""First of all: a question, its unit, and the table, run, row and column of its answer."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Ground:
    """A row of README: what we reach somewhere, and what stands beside it.

    Attributes:
        where: the ground.
        what: the question.
        table: with `run`, where the figures are.
        run: of the table.
        ours: our row.
        rival: the row beside it.
        called: the rival's name here.
        column: the head of the figure.
        gain: the head of the column that has what ours gains on the rival.
        unit: after each figure.
        digits: decimals.
    """

    where: str
    what: str
    table: str
    run: str
    ours: str
    rival: str
    called: str
    column: str = "error, m"
    gain: str = "the map is nearer, %"
    unit: str = " m"
    digits: int = 1


def _gap(where: str, run: str, ground: str, gap: str, how: str, *, called: str = "constant velocity") -> Ground:
    place = f"{ground}, gaps of {gap} s, {how}: "
    return Ground(
        where=where, what=f"position, out of sight for {gap} s, {how}", table="neutral", run=run,
        ours=f"{place}with the map", rival=f"{place}constant velocity", called=called,
    )  # fmt: skip


def _boxes(where: str, run: str, row: str, called: str, *, ours: str = "with the map", label: str = "") -> Ground:
    place = f"{run.lower()}: "
    return Ground(
        where=where, what="HOTA of boxes, no ids, %", table="neutral_boxes", run=run, ours=f"{place}{ours}{label}",
        rival=f"{place}{row}", called=called, column="HOTA", gain="the first method's HOTA less this", unit="",
    )  # fmt: skip


GROUNDS = (
    _boxes("cars about a driving car (KITTI), no map", "KITTI", f"constant velocity{OWN_SHARE}", "constant velocity",
           ours="without the map", label=OWN_SHARE),
    _boxes("the same", "KITTI", "AB3DMOT, five sequences (run again, mean score above 2.5)", "AB3DMOT",
           ours="without the map", label=ABOVE),
    _boxes("people before a camera (MOT17-04)", "MOT17", "constant velocity", "constant velocity"),
    _boxes("the same", "MOT17", "UCMCTrack, 04 (run again, its settings)", "UCMCTrack"),
    _boxes("people before a camera (PETS09)", "PETS09", "constant velocity", "constant velocity"),
    _gap("GPS in Beijing (GeoLife)", "GeoLife", "geolife", "60", "online"),
    _gap("the same", "GeoLife", "geolife", "60", "smoothed", called="Rauch-Tung-Striebel"),
    _gap("GPS of buses (Chicago)", "Chicago", "chicago_bus", "15", "online"),
    _gap("the same", "Chicago", "chicago_bus", "15", "smoothed", called="Rauch-Tung-Striebel"),
    _gap("real roadside sensor (Mcity)", "Mcity", "mcity_blind", "6", "online"),
    Ground(
        where="real radar of boats (autoferry)", what="HOTA, no ids", table="peers", run="autoferry",
        ours="ours, with the map", rival="Stone Soup GNN", called="Stone Soup GNN", column="HOTA",
        gain="ours with the map, HOTA more", unit="", digits=3,
    ),
    Ground(
        where="**simulated** roundabout (CARLA's map, SUMO's traffic)", what="position, out of sight for 3 s, online",
        table="tracking", run="roundabout", ours="prior", rival="constant velocity", called="constant velocity",
        column="in gaps, m", gain="in gaps, %",
    ),
)  # fmt: skip
"""README's first table."""


class Place(NamedTuple):
    """A column of README's second table: its head, and where HOTA stands; `{}` is the tracker's name in `row`."""

    head: str
    table: str
    run: str
    row: str
    times: float = 1.0


PLACES = (
    Place("cars, KITTI", "neutral_boxes", "KITTI", f"kitti: {{}}{OWN_SHARE}"),
    Place("people, MOT17-04", "neutral_boxes", "MOT17", "mot17: {}"),
    Place("people, PETS09", "neutral_boxes", "PETS09", "pets09: {}"),
    Place("boats, real radar", "peers", "autoferry", "{}", times=100.0),
    Place("cars, real roadside sensor", "peers", "Mcity", "{}", times=100.0),
    Place("simulated blind ring", "peers", "B", "{}", times=100.0),
)
OURS = {name: f"ours, {name}" for name in ("with the map", "without the map", "constant velocity")}
"""Names of `neutral.py`, and the same trackers' in `peers.py`."""
PACKAGES_BESIDE = (
    ("ours, with the map", "with the map", ""),
    ("ours, without the map", "without the map", "places without earlier logs"),
    ("ours, constant velocity", "constant velocity", "boats and boxes of video"),
    ("[Stone Soup](https://stonesoup.rtfd.io) GNN", "Stone Soup GNN", "many sensors and algorithms to choose from"),
    ("[norfair](https://github.com/tryolabs/norfair)", "norfair",
     "a tracker in ten lines; five times as fast"),
    ("[motpy](https://github.com/wmuron/motpy)", "motpy", "four times as fast"),
)  # fmt: skip
"""Its rows: what a tracker is called there, its name in the tables, and what it is better at."""
