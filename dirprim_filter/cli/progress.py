"""Progress bars on stderr, on a terminal only: how far, and how long it will still take."""

from __future__ import annotations

import sys
from collections.abc import Callable, Iterable, Iterator
from contextlib import contextmanager
from functools import partial
from typing import Any, NamedTuple

import dirprim_filter as dp


class LearningProgress(NamedTuple):
    """Progress of `learn_primitives`: its search for cells, and its stages; and of the tiles of a store's map."""

    progress: Callable[[int, float], None] | None
    stage: Callable[[int], None] | None
    tiles: Callable[[int, int], None] | None


@contextmanager
def working(what: str) -> Iterator[Callable[..., None] | None]:
    """On a terminal, a line that says what is being done, for how long already, and how long it may still take.

    What is yielded, None elsewhere, changes `completed`, `total`, `text` and `description`.
    """
    if not sys.stderr.isatty():
        yield None
        return
    from rich.console import Console
    from rich.progress import BarColumn, Progress, SpinnerColumn, TextColumn, TimeElapsedColumn, TimeRemainingColumn

    from dirprim_filter.recording.container.errors import one_line

    columns: tuple[Any, ...] = (
        SpinnerColumn(), TextColumn("{task.description}"), BarColumn(bar_width=24), TextColumn("{task.fields[text]}"),
        TimeElapsedColumn(), TextColumn("left"), TimeRemainingColumn(),
    )  # fmt: skip
    console = Console(file=getattr(sys.stderr, "stream", sys.stderr))
    with Progress(*columns, console=console, transient=True) as progress:
        yield partial(progress.update, progress.add_task(one_line(what), total=None, text=""))


def with_progress(frames: Iterable[dp.Detections], *, what: str, end_ns: int | None = None) -> Iterator[dp.Detections]:
    """The frames as they are; on a terminal, with a bar over the log's time.

    Args:
        frames: ascending in time.
        what: is being done to them.
        end_ns: of the log, if known: without it the remaining time is unknown.
    """
    with working(what) as show:
        first_ns: int | None = None
        for done, frame in enumerate(frames, start=1):
            yield frame
            if show is None:
                continue
            now_ns = int(frame.time_ns[0])
            first_ns = now_ns if first_ns is None else first_ns
            passed = (now_ns - first_ns) * 1e-9
            # A log of one instant, or with a wrong end time, must not appear done early.
            total = None if end_ns is None or end_ns <= first_ns else (end_ns - first_ns) * 1e-9
            of = "s" if total is None else f"of {total:.1f} s"
            show(completed=passed, total=total, text=f"{passed:.1f} {of} of the log, {done} frames")


@contextmanager
def step_progress(what: str, unit: str) -> Iterator[Callable[[int, int], None] | None]:
    """Progress of a long task in steps; on a terminal, a bar."""
    with working(what) as show:
        yield show and (lambda done, of: show(completed=done, total=of, text=f"{done:.0f} of {of:.0f} {unit}"))


@contextmanager
def learning_progress() -> Iterator[LearningProgress]:
    """Progress of `learn_primitives`; on a terminal, a line with the stage and what its search has reached."""
    with working("learning") as show:
        if show is None:
            yield LearningProgress(None, None, None)
            return
        from dirprim_filter.primitives.learning import STAGES

        yield LearningProgress(
            progress=lambda n_cells, objective: show(text=f"{n_cells} cells, log density {-objective:.3f}"),
            stage=lambda n: show(completed=n + 1, total=len(STAGES), description=STAGES[n], text=""),
            tiles=lambda done, of: show(text=f"{done} of {of} tiles"),
        )
