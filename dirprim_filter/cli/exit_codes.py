"""How a command ends: its exit code; and Ctrl-C and SIGTERM, which close its outputs, and neither of which is lost.

Where compiled code calls back into Python, as the compiler does at each kernel it loads, Python prints and drops what
the callback raises, a `KeyboardInterrupt` too. It is then raised again, until the command receives it.
"""

from __future__ import annotations

import _thread
import signal
import sys
from collections.abc import Sequence
from threading import Timer
from typing import TYPE_CHECKING, NoReturn

if TYPE_CHECKING:
    from dirprim_filter.recording.losses import Losses

DONE, FAILED, INPUT_LOST = 0, 1, 3
INTERRUPTED, TERMINATED = 130, 143
"""As shells have them: 128 and the number of the signal."""


class Terminated(KeyboardInterrupt):
    """SIGTERM came: what Ctrl-C closes is closed."""

    came = False
    """Whether it came in this process: libraries make other errors of it."""


def listen() -> None:
    """From here on SIGTERM ends this process as Ctrl-C does, and neither is lost in a callback."""
    signal.signal(signal.SIGTERM, _terminate)
    report = sys.unraisablehook

    def repeat(lost: sys.UnraisableHookArgs) -> None:
        if not issubclass(lost.exc_type, KeyboardInterrupt):
            report(lost)
            return
        number = signal.SIGTERM if issubclass(lost.exc_type, Terminated) else signal.SIGINT
        again = Timer(0.05, _thread.interrupt_main, (number,))
        again.daemon = True
        again.start()

    sys.unraisablehook = repeat


def of_losses(*losses: Losses, is_lost: bool = False, failures: Sequence[str] = ()) -> int:
    """3 where a part of an input, if one row, could not be read or used; 1 where viewers failed. The log says what."""
    if failures:
        return FAILED
    return INPUT_LOST if is_lost or any(of.damage or of.dropped for of in losses) else DONE


def of_interruption() -> int:
    """What an interrupted command ends with."""
    return TERMINATED if Terminated.came else INTERRUPTED


def _terminate(*_: object) -> NoReturn:
    Terminated.came = True
    raise Terminated
