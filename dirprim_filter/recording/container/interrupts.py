"""Ctrl-C and SIGTERM that wait while a file is between two states."""

from __future__ import annotations

import signal
from collections.abc import Iterator
from contextlib import contextmanager
from threading import current_thread, main_thread

SIGNALS = (signal.SIGINT, signal.SIGTERM)


@contextmanager
def uninterrupted() -> Iterator[None]:
    """Signals inside the body count behind it; threads other than the main one are never interrupted anyway.

    An unhandled SIGTERM ends the process at once: what was written can be recovered.
    """
    handlers = {number: handler for number in SIGNALS if callable(handler := signal.getsignal(number))}
    if current_thread() is not main_thread() or not handlers:
        yield
        return
    held: list[int] = []

    def hold(number: int, _: object) -> None:
        held.append(number)

    for number in handlers:
        signal.signal(number, hold)
    try:
        yield
    finally:
        for number, handler in handlers.items():
            signal.signal(number, handler)
        if held:
            signal.raise_signal(held[0])
