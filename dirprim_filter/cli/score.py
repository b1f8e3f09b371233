"""`dirprim score`: what trackers wrote beside the truth, side by side."""

from __future__ import annotations

from dataclasses import asdict, dataclass
from typing import Annotated

import typer

from dirprim_filter.cli.options import Json, Outputs, Truth
from dirprim_filter.cli.reading import Reading
from dirprim_filter.cli.settings import Settings, deal, taken
from dirprim_filter.cli.tables import score_text
from dirprim_filter.cli.texts import counted, say
from dirprim_filter.recording.name_patterns import is_table

SMOOTHED = " smoothed"
"""Ends the name of what a smoother wrote."""
LATE_S, LATE_SHARE, BEYOND_SHARE = 0.1, 0.5, 0.1
"""A clock is asked about from such a delay on that explains so much of the errors; and a truth that goes on alone."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Own:
    """Settings of the command."""

    similarity_m: float = 5.0


def score(
    estimates: Outputs,
    truth: Truth,
    smoothed: Annotated[
        bool, typer.Option("--smoothed", help="Also score the smoothed estimates of --smooth or --lag.")
    ] = False,
    with_ids: Annotated[
        bool, typer.Option("--ids/--no-ids", help="Assign estimates by id, or to the nearest vehicle.")
    ] = False,
    as_json: Json = False,
    *,
    reading: Reading,
    settings: Annotated[Settings, Own],
) -> int:
    """Score the outputs of trackers against the truth.

    The table has a column for each file.

    Each group of the truth is compared by itself. Options of reading choose a part of the truth. Estimates of other
    groups, and before or after the truth, are left out and counted. The instants of the truth are judged. Estimates are
    interpolated there, between rows of a track at most 1.5 of the file's median intervals apart; elsewhere they are
    missing. The truth is, between rows of a vehicle at most 1 s, or 2.5 of its median intervals, apart.

    Example: dirprim score tracks.mcap other.csv --truth recordings/roundabout_track.mcap
    """
    from dirprim_filter.cli.progress import step_progress
    from dirprim_filter.cli.results import report
    from dirprim_filter.evaluation.scores import score_rows
    from dirprim_filter.recording.estimate_tables import read_tracked_rows

    names = [path.name for path in estimates]
    named = {name if names.count(name) == 1 else str(path): path for name, path in zip(names, estimates, strict=True)}
    if smoothed and all(map(is_table, estimates)):
        raise typer.BadParameter("tables have no smoothed estimates beside others", param_hint="--smoothed")
    log = reading.tracks([truth])
    one_of_many, meets = reading.group is not None, "" if "origin" in reading.given else str(truth)
    own = taken(Own, settings)
    deal(settings, Own)
    with step_progress("scoring", "files") as progress:
        rows = {
            name + SMOOTHED * is_smoothed: read_tracked_rows(
                path, truth=log.tracks, one_of_many=one_of_many, smoothed=is_smoothed, losses=log.losses, meets=meets
            )
            for name, path in named.items()
            for is_smoothed in (False, True)[: 1 + (smoothed and not is_table(path))]
        }
        table = score_rows(rows, log.tracks, with_ids=with_ids, similarity_m=own.similarity_m, progress=progress)
    for found in table.scores:
        path = named[found.name.removesuffix(SMOOTHED)]
        if found.n_rows and found.report.deta == 0.0:
            far = f"{path}: no estimate is within {table.similarity_m:g} m of a vehicle of {truth}"
            say(f"{far}: are both in one frame, of one origin and by one clock?", err=True)
        if found.late_share > LATE_SHARE and abs(found.late_s) > LATE_S:
            way = f"{abs(found.late_s):.2g} s {'late' if found.late_s > 0 else 'early'}"
            say(f"{path}: {found.late_share:.0%} of the squared error is that of estimates {way}: are both by one "
                "clock? A sensor's latency is found by `dirprim calibrate`", err=True)  # fmt: skip
        if found.beyond > BEYOND_SHARE * table.n_rows:
            say(f"{path}: {found.beyond} of the truth's {table.n_rows} rows are before or after all estimates, and "
                "count as missed; --start and --end choose a part of the truth", err=True)  # fmt: skip
        if found.left_out:
            say(f"{path}: left out {counted(found.left_out, 'row')} of groups or times without a truth", err=True)
    return report(
        "score", [*estimates, truth], reading, log.losses, table=asdict(table), settings=asdict(own),
        text=lambda: score_text(table, truth.name), as_json=as_json,
    )  # fmt: skip
