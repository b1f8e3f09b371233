"""`dirprim recover`: a whole log out of a damaged one."""

from __future__ import annotations

import json
from typing import TYPE_CHECKING, Annotated

import typer

from dirprim_filter.cli import losses
from dirprim_filter.cli.counts import counted
from dirprim_filter.cli.options import Force, Log, Output, Strict

if TYPE_CHECKING:
    from pathlib import Path

    from dirprim_filter.recording.container.recovery import Recovery


def recover(
    log: Log,
    output: Output,
    as_json: Annotated[bool, typer.Option("--json", help="One JSON object.")] = False,
    strict: Strict = False,
    force: Force = False,
) -> int:
    """Write the intact part of a damaged log; say what was lost.

    A command that was killed leaves its output beside where it belongs, as NAME.PID.partial: all but its last chunk
    can be recovered. Every message is written anew.

    Example: dirprim recover tracks.mcap.4711.partial -o tracks.mcap
    """
    from dirprim_filter.cli.progress import step_progress
    from dirprim_filter.recording.container.recovery import recover as recover_log

    with step_progress(f"recovering {log.name}", "chunks") as progress:
        recovery = recover_log(log, output, strict=strict, force=force, progress=progress)
    typer.echo(json.dumps(recovery.as_json()) if as_json else _text(output, recovery))
    return losses.DONE if recovery.is_lossless else losses.INPUT_LOST


def _text(output: Path, recovery: Recovery) -> str:
    from dirprim_filter.recording.container.errors import one_line

    lines = [
        f"{output}: {counted(recovery.saved, 'message')} saved, "
        f"{counted(recovery.attachments, 'attachment')}, {recovery.metadata} metadata"
    ]
    lines += [f"  damage: {damage}" for damage in recovery.damage]
    if not recovery.damage:
        lines.append("  nothing was damaged")
    elif recovery.is_lossless:
        lines.append("  no message was lost")
    else:
        unknown = any(damage.messages is None for damage in recovery.damage)
        lines.append(f"  lost: {'at least ' if unknown else ''}{counted(recovery.lost, 'message')}")
    return "\n".join(map(one_line, lines))
