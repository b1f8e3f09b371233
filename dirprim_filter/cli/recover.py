"""`dirprim recover`: a whole log out of a damaged one."""

from __future__ import annotations

from dirprim_filter.cli import exit_codes
from dirprim_filter.cli.options import Force, Log, Output
from dirprim_filter.cli.texts import counted, say


def recover(log: Log, output: Output, force: Force = False) -> int:
    """Write the intact part of a damaged log; say what was lost.

    A command that was killed leaves its output beside where it belongs, as NAME.PID.partial: all but its last chunk
    can be recovered. Every message is written anew.

    Example: dirprim recover tracks.mcap.4711.partial -o tracks.mcap
    """
    from dirprim_filter.cli.progress import step_progress
    from dirprim_filter.recording.container.recovery import recover as recover_log

    with step_progress(f"recovering {log.name}", "chunks") as progress:
        found = recover_log(log, output, force=force, progress=progress)
    at_least = "at least " if any(damage.messages is None for damage in found.damage) else ""
    lost = "no message was lost" if found.is_lossless else f"lost: {at_least}{counted(found.lost, 'message')}"
    say(
        f"{output}: {counted(found.saved, 'message')} saved, {counted(found.attachments, 'attachment')}, "
        f"{found.metadata} metadata",
        *(f"  damage: {damage}" for damage in found.damage),
        f"  {lost if found.damage else 'nothing was damaged'}",
    )
    return exit_codes.DONE if found.is_lossless else exit_codes.INPUT_LOST
