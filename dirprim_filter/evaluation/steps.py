"""How far an evaluation has come."""

from __future__ import annotations

from collections.abc import Callable


class StepCount:
    """Counts steps and reports them.

    Args:
        total: how many steps there will be.
        progress: called with the number of steps done, and their total; None: not reported.
    """

    def __init__(self, total: int, progress: Callable[[int, int], None] | None) -> None:
        self._done, self._total, self._progress = 0, total, progress

    def add(self) -> None:
        """One more is done."""
        self._done += 1
        if self._progress is not None:
            self._progress(self._done, self._total)
