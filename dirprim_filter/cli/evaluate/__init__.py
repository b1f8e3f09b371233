"""`dirprim evaluate`: how good maps of primitives are on held-out vehicles of a log."""

from __future__ import annotations

import typer

from dirprim_filter.cli.commands import register
from dirprim_filter.cli.evaluate import held_out, tracking

evaluate = typer.Typer(
    name="evaluate",
    help=(
        "Compare methods on held-out vehicles of your own log. "
        "Example: dirprim evaluate density recordings/roundabout_learn.mcap"
    ),
    no_args_is_help=True,
)
for experiment in (tracking.tracking, held_out.forecast, held_out.density, held_out.cues):
    register(evaluate, experiment)
