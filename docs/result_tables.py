"""The tables of `results.md`, as data: the logs, the commands, and what is read from their output.

`make_results.py` runs them, keeps their figures in `results/NAME.json`, and writes the page.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

from result_figures import (
    Entries,
    Figure,
    coverages,
    density,
    energy,
    group,
    mean_of,
    methods,
    most_in_a_group,
    observations,
    of_key,
    printed,
    quantities,
    rows_of,
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
    """A column: its head, how a figure is read from a row's entry, and how it is shown.

    Attributes:
        best: "low" or "high" where the best of a run's rows is in bold, "row" where the highest of a row's columns is.
        beside: how the second of two numbers is set.
    """

    head: str
    read: Callable[[Any], Figure]
    digits: int = 2
    best: str = ""
    beside: str = " +- {}"


@dataclass(frozen=True, slots=True, kw_only=True)
class Run:
    """One command of a table.

    Attributes:
        name: in the first column.
        logs: names of `LOGS`.
        options: beyond those of the table; these may name logs too.
        entries: how its output is read, where that is not the table's way.
    """

    name: str
    logs: tuple[str, ...] = ()
    options: str = ""
    entries: Entries | None = None


@dataclass(frozen=True, slots=True, kw_only=True)
class Table:
    """A table: what is run, and what is read from it.

    Attributes:
        command: `{logs}` and `{options}` stand for the run's.
        entries: how output is read.
        of: the head over the names of the rows.
        code: files and folders that the figures follow from.
        minutes: a run that takes longer is stopped, and its former figures stay.
    """

    command: str
    runs: tuple[Run, ...]
    entries: Entries
    columns: tuple[Column, ...]
    of: str = "method"
    code: tuple[str, ...]
    minutes: float


PRIMITIVES = ("dirprim_filter/primitives", "dirprim_filter/distributions", "tessellation")
FILTER = (*PRIMITIVES, "dirprim_filter/filtering")
TRACKERS = '--method prior --method place-free --method "interacting models" --method "constant velocity"'
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

TABLES: dict[str, Table] = {
    "densities": Table(
        command="dirprim evaluate density {logs} --folds 4{options} --json",
        runs=(
            *LOGGED,
            *(Run(name=f"{run.name}, random", logs=run.logs, options=" --split random") for run in LOGGED),
        ),
        entries=quantities,
        of="density of",
        columns=tuple(
            Column(head=head, read=density(method), best="row", digits=3, beside=" ({})")
            for method, head in (
                ("primitive, curved", "curved"), ("primitive, flat", "flat"), ("primitive, the paper's", "the paper's"),
                ("DGM", "DGM"), ("GP", "GP"), ("place-free", "place-free"), ("uninformative", "uninformative"),
            )
        ),
        code=("dirprim_filter/evaluation/density.py", "dirprim_filter/evaluation/baselines", *PRIMITIVES),
        minutes=20,
    ),
    "cues": Table(
        command="dirprim evaluate cues {logs} --tessellation {options} --json",
        runs=tuple(
            Run(name=f"{run.name}, {cells}", logs=run.logs, options=cells)
            for run in LOGGED[:2] for cells in ("grid", "joint")
        ),
        entries=observations,
        of="observation",
        columns=(
            Column(head="prior", read=of_key("prior"), digits=0),
            Column(head="observation", read=of_key("observation"), digits=0),
            Column(head="posterior", read=of_key("posterior"), digits=0),
            Column(head="gain per vehicle, %", read=lambda entry: 100 * entry["gain"], digits=0),
            Column(head="of log, nat", read=of_key("log_gain")),
        ),
        code=("dirprim_filter/evaluation/cues.py", *PRIMITIVES),
        minutes=10,
    ),
    "exits": Table(
        command="python tests/benchmarks/exits.py {logs} --seeds 1 --json",
        runs=LOGGED[:1],
        entries=rows_of,
        of="seed",
        columns=tuple(
            Column(head=head, read=of_key(key), digits=digits)
            for head, key, digits in (
                ("vehicles", "vehicles", 0), ("instants", "instants", 0), ("no cue", "before", 3),
                ("signal", "signal", 3), ("wrong side", "wrong", 3), ("the very turn", "exact", 3),
            )
        ),
        code=FILTER,
        minutes=10,
    ),
    "cells": Table(
        command="python tests/benchmarks/joint_cells.py {logs} --no-field --json",
        runs=LOGGED,
        entries=rows_of,
        of="cells",
        columns=(
            Column(head="mean log density", read=of_key("mean"), digits=3, best="high"),
            Column(head="deviation of folds", read=of_key("deviation"), digits=3),
            Column(head="cells", read=of_key("cells"), digits=0),
        ),
        code=PRIMITIVES,
        minutes=60,
    ),
    "forecasts": Table(
        command="dirprim evaluate forecast {logs} --folds 4 --horizon 1 --horizon 3 --horizon 5 --horizon 8 --json",
        runs=(*LOGGED[:3], Run(name="Death Circle, video 2", logs=DEATH_CIRCLE[:1])),
        entries=methods,
        columns=(
            *(Column(head=f"{s} s", read=energy(s, to_last=True), digits=3, best="low") for s in (1, 3, 5, 8)),
            Column(head="energy at 5 s, m", read=energy(5, to_last=False)),
            Column(head="in the 90 % region", read=coverages, beside=" to {}"),
        ),
        code=("dirprim_filter/evaluation/forecasting.py", "dirprim_filter/evaluation/forecast_cases.py",
            "dirprim_filter/evaluation/forecast_methods.py", "dirprim_filter/evaluation/baselines", *PRIMITIVES,
            "dirprim_filter/filtering/rollouts.py", "dirprim_filter/filtering/_interaction.py"),
        minutes=30,
    ),
    "forecast_cells": Table(
        command="python tests/benchmarks/forecast_cells.py {logs} --json",
        runs=LOGGED[:3],
        entries=methods,
        of="cells",
        columns=(
            *(Column(head=f"{s} s", read=energy(s, to_last=True), digits=3, best="low") for s in (1, 3, 5, 8)),
            Column(head="energy at 5 s, m", read=energy(5, to_last=False)),
        ),
        code=("dirprim_filter/evaluation/forecasting.py", "dirprim_filter/evaluation/forecast_cases.py",
            "dirprim_filter/evaluation/forecast_methods.py", *PRIMITIVES, "dirprim_filter/filtering/rollouts.py"),
        minutes=30,
    ),
    "tracking": Table(
        command=f"dirprim evaluate tracking {{logs}} --learn 0.9 --seeds 1 --smooth {TRACKERS} --json",
        runs=LOGGED[:3],
        entries=methods,
        columns=(
            Column(head="RMSE in sight, m", read=mean_of("seen_rmse"), best="low"),
            Column(head="settled", read=mean_of("settled_rmse"), best="low"),
            Column(head="in gaps", read=mean_of("hidden_rmse"), best="low"),
            Column(head="NEES in sight", read=mean_of("seen_nees"), digits=1),
            Column(head="in gaps", read=mean_of("hidden_nees"), digits=1),
        ),
        code=("dirprim_filter/evaluation", *FILTER),
        minutes=20,
    ),
    "no_ids": Table(
        command="dirprim evaluate tracking {logs} --no-ids --smooth --miss-rate 0.2 --false-per-frame 10 "
        f'--particles 300 {TRACKERS} --method "raw detections" {{options}} --json',
        runs=(
            Run(name="Lankershim", logs=("lankershim.mcap",), options="--gap 0 --seeds 1"),
            Run(name="Lankershim, out of sight for 3 s", logs=("lankershim.mcap",), options="--gap 3 --seeds 1"),
            *(
                Run(name=f"dense {of}", logs=(f"{of}_track.mcap",), options=f"--map {of}_map.mcap --gap 0 --seeds 3")
                for of in ("intersection", "highway")
            ),
        ),
        entries=methods,
        columns=(
            Column(head="HOTA", read=mean_of("hota"), digits=3, best="high"),
            Column(head="DetA", read=mean_of("deta"), digits=3, best="high"),
            Column(head="AssA", read=mean_of("assa"), digits=3, best="high"),
            Column(head="GOSPA per vehicle, m", read=mean_of("gospa"), best="low"),
            Column(head="missed, m2", read=mean_of("missed")),
            Column(head="false, m2", read=mean_of("false")),
            Column(head="switches", read=mean_of("switches"), digits=1, best="low"),
            Column(head="most in a group", read=most_in_a_group("switches"), digits=0),
        ),
        code=("dirprim_filter/evaluation", *FILTER),
        minutes=20,
    ),
    "speed": Table(
        command="python tests/benchmarks/{options}",
        runs=(
            Run(
                name="fit of one cell, modes counted", options="fitting.py",
                entries=printed(
                    **{f"{n} angles": rf"{n} angles +([\d.]+) ms +([\d.]+) ms" for n in ("500", "5,000", "50,000")}
                ),
            ),
            Run(
                name="samples of Eq. 4", options="product.py",
                entries=printed(samples=r"closed form +([\d.]+) ms\nrejection +([\d.]+) ms"),
            ),
            Run(
                name="step of 100,000 particles", options="tracking.py",
                entries=printed(
                    **{
                        "predict, weigh, resample": r"100 vehicles, whole +([\d.]+) ms",
                        "times real time, 100 vehicles of 1,000": r"every 10. particle written: +([\d.]+) x",
                    }
                ),
            ),
            Run(
                name="reading", options="scanning.py",
                entries=printed(**{"thousand messages a second": r"time, zstd +([\d.]+) k/s +([\d.]+) k/s"}),
            ),
        ),
        entries=printed(),
        of="what",
        columns=(Column(head="ours", read=group(0)), Column(head="rival", read=group(1))),
        code=("dirprim_filter", "tessellation"),
        minutes=10,
    ),
}  # fmt: skip
"""Every table, by the name of its file in `results/`. A method that joins `evaluate tracking` joins `TRACKERS`."""
