"""Work that a thread of its own does while the tracker goes on: writing a log, sending to a file."""

from __future__ import annotations

from collections.abc import Callable
from concurrent.futures import Future, ThreadPoolExecutor


class Background:
    """Does one piece of work at a time, in the order given; what fails is raised by the next call, once.

    Args:
        name: of the thread.
    """

    def __init__(self, name: str) -> None:
        self._thread = ThreadPoolExecutor(1, name)
        self._underway: Future[None] | None = None

    def do(self, work: Callable[[], None]) -> None:
        """Begin a piece of work, once the one before it is done."""
        self.wait()
        self._underway = self._thread.submit(work)

    def wait(self) -> None:
        """Wait for what is under way."""
        underway, self._underway = self._underway, None
        if underway is not None:
            underway.result()

    def end(self) -> None:
        """Wait for what is under way, even when interrupted; no more work is taken."""
        try:
            self.wait()
        finally:
            self._thread.shutdown()
