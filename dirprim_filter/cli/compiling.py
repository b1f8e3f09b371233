"""The line that says that kernels are compiled, on a terminal: an installation does so once, and it takes long."""

from __future__ import annotations

import os
import sys
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from numba.core.event import Event

UNNOTICED_S = 1.0
"""Seconds without a message; a run that finds most kernels in the cache has compiled the rest by then."""


NOTICE = "compiling, which takes up to a minute: once per installation, the next run starts at once\n"


@contextmanager
def compiling_notice() -> Iterator[None]:
    """Within, a line on stderr says once that kernels are compiled, on a terminal only."""
    if not sys.stderr.isatty():
        yield
        return
    from numba.core.event import Listener, install_listener

    class Clock(Listener):
        """Adds up what compiling takes; a kernel that compiles those it calls is counted once."""

        def __init__(self) -> None:
            self.depth, self.began_s, self.spent_s, self.has_said = 0, 0.0, 0.0, False

        def on_start(self, event: Event) -> None:
            if self.depth == 0:
                self.began_s = time.monotonic()
            self.depth += 1

        def on_end(self, event: Event) -> None:
            self.depth -= 1
            if self.depth == 0:
                self.spent_s += time.monotonic() - self.began_s
                if self.spent_s > UNNOTICED_S and not self.has_said:
                    self.has_said = True
                    sys.stderr.write(NOTICE)

    with install_listener("numba:compile", Clock()):
        yield


def has_kernels(kernel: str = "") -> bool:
    """Whether this installation has compiled any kernel, or this `module.function`: numba's cache has its index."""
    folder = os.environ.get("NUMBA_CACHE_DIR") or Path(__file__).parents[1]
    return any(Path(folder).rglob(f"{kernel}*.nbi"))


def mend_cache() -> None:
    """Remove what a power cut left empty of the compiler's cache, and say so: the compiler would end in an error."""
    package = Path(__file__).parents[1]
    given = os.environ.get("NUMBA_CACHE_DIR")
    folders = [Path(given)] if given else [package, package.parent / "tessellation"]
    broken = [path for folder in folders for path in folder.rglob("*.nb[ic]") if not _is_pickled(path)]
    for path in broken:
        path.unlink(missing_ok=True)
    if broken:
        sys.stderr.write(
            f"warning: {len(broken)} of the compiled kernels' files were damaged and are removed; compiling anew\n"
        )


def _is_pickled(path: Path) -> bool:
    with path.open("rb") as file:
        return file.read(1) == b"\x80"
