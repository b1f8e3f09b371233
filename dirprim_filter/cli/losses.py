"""The exit code for lost input."""

from __future__ import annotations

from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from dirprim_filter.recording.losses import Losses

DONE, FAILED, INPUT_LOST = 0, 1, 3


def exit_code(losses: Losses) -> int:
    """3 where a part of the input, if one row, could not be read or used; the library's log has said what."""
    return INPUT_LOST if losses.damage or losses.dropped else DONE
