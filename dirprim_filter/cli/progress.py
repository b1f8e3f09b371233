"""Progress bars on stderr, on a terminal only."""

from __future__ import annotations

import sys
from collections.abc import Callable, Iterable, Iterator
from contextlib import contextmanager
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from dirprim_filter.detections import Detections


def with_progress(frames: Iterable[Detections], *, what: str) -> Iterator[Detections]:
    """The frames as they are; on a terminal, with a count of them and the time reached in the log."""
    if not sys.stderr.isatty():
        yield from frames
        return
    from rich.console import Console
    from rich.progress import Progress, SpinnerColumn, TextColumn, TimeElapsedColumn

    columns = (
        SpinnerColumn(),
        TextColumn("{task.description}"),
        TextColumn("{task.completed} frames, {task.fields[reached]:.1f} s of the log"),
        TimeElapsedColumn(),
    )
    with Progress(*columns, console=Console(stderr=True), transient=True) as progress:
        task = progress.add_task(what, total=None, reached=0.0)
        first_ns: int | None = None
        for frame in frames:
            yield frame
            now_ns = int(frame.time_ns[0])
            first_ns = now_ns if first_ns is None else first_ns
            progress.update(task, advance=1, reached=(now_ns - first_ns) * 1e-9)


@contextmanager
def learning_progress() -> Iterator[Callable[[int, float], None] | None]:
    """What `learn_primitives` tells while it learns cells; on a terminal, a line that follows it.

    When the search is over nobody knows before: so there is no remaining time, but what it has reached.
    """
    if not sys.stderr.isatty():
        yield None
        return
    from rich.console import Console
    from rich.progress import Progress, SpinnerColumn, TextColumn, TimeElapsedColumn

    columns = (SpinnerColumn(), TextColumn("learning cells and primitives{task.fields[reached]}"), TimeElapsedColumn())
    with Progress(*columns, console=Console(stderr=True), transient=True) as progress:
        task = progress.add_task("", total=None, reached="")

        def tell(n_cells: int, objective: float) -> None:
            progress.update(task, reached=f": {n_cells} cells, held-out log density {-objective:.3f}")

        yield tell
