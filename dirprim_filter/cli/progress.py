"""Progress bars on stderr, on a terminal only: how far, and how long it will still take."""

from __future__ import annotations

import sys
from collections.abc import Callable, Iterable, Iterator
from contextlib import contextmanager
from typing import TYPE_CHECKING, NamedTuple, TypeVar

if TYPE_CHECKING:
    from rich.progress import Progress, ProgressColumn

    from dirprim_filter.detections import Detections
    from dirprim_filter.estimates import TrackedFrame

NS_PER_S = 1e9
Frame = TypeVar("Frame", "Detections", "TrackedFrame")


def with_progress(frames: Iterable[Frame], *, what: str, end_ns: int | None = None) -> Iterator[Frame]:
    """The frames as they are; on a terminal, with a bar over the log's time.

    Args:
        frames: ascending in time.
        what: is being done to them.
        end_ns: of the log, if known: without it the remaining time is unknown.
    """
    if not sys.stderr.isatty():
        yield from frames
        return
    with _bar("{task.completed:.1f} of {task.total:.1f} s of the log", "{task.fields[done]} frames") as progress:
        task = progress.add_task(what, total=None, done=0)
        first_ns: int | None = None
        for done, frame in enumerate(frames, start=1):
            yield frame
            now_ns = frame.time_ns if isinstance(frame.time_ns, int) else int(frame.time_ns[0])
            if first_ns is None:
                first_ns = now_ns
                # A log of one instant, or with a wrong end time, must not appear done early.
                lasts_ns = None if end_ns is None or end_ns <= now_ns else end_ns - now_ns
                progress.update(task, total=None if lasts_ns is None else lasts_ns / NS_PER_S)
            progress.update(task, completed=(now_ns - first_ns) / NS_PER_S, done=done)


@contextmanager
def step_progress(what: str, unit: str) -> Iterator[Callable[[int, int], None] | None]:
    """Progress of a long task in steps; on a terminal, a bar."""
    if not sys.stderr.isatty():
        yield None
        return
    with _bar("{task.completed:.0f} of {task.total:.0f} " + unit, "") as progress:
        task = progress.add_task(what, total=None, done=0)

        def report(done: int, of: int) -> None:
            progress.update(task, completed=done, total=of)

        yield report


class LearningProgress(NamedTuple):
    """Progress of `learn_primitives`: its search for cells, and its stages; and of the tiles of a store's map."""

    progress: Callable[[int, float], None] | None
    stage: Callable[[int], None] | None
    tiles: Callable[[int, int], None] | None


@contextmanager
def learning_progress() -> Iterator[LearningProgress]:
    """Progress of `learn_primitives`; on a terminal, a line with the stage and what its search has reached."""
    if not sys.stderr.isatty():
        yield LearningProgress(None, None, None)
        return
    from rich.progress import MofNCompleteColumn, SpinnerColumn, TextColumn, TimeElapsedColumn

    from dirprim_filter.primitives.learning import STAGES

    columns = (SpinnerColumn(), TextColumn("{task.description}"), MofNCompleteColumn(),
               TextColumn("{task.fields[reached]}"), TimeElapsedColumn())  # fmt: skip
    with _on_stderr(*columns) as progress:
        task = progress.add_task("learning", total=len(STAGES), reached="")

        def begin(number: int) -> None:
            progress.update(task, completed=number + 1, description=STAGES[number], reached="")

        def report(n_cells: int, objective: float) -> None:
            progress.update(task, reached=f"{n_cells}, log density {-objective:.3f}")

        def count(done: int, of: int) -> None:
            progress.update(task, completed=len(STAGES), reached=f"{done} of {of} tiles")

        yield LearningProgress(report, begin, count)


@contextmanager
def working(what: str) -> Iterator[None]:
    """On a terminal, a line that says what is being done, and for how long already."""
    with step_progress(what, ""):
        yield


def _bar(counted: str, done: str) -> Progress:
    """A bar with a count and the remaining time; a spinner while the total is unknown."""
    from rich.progress import BarColumn, SpinnerColumn, Task, TextColumn, TimeElapsedColumn, TimeRemainingColumn
    from rich.text import Text

    class Count(TextColumn):
        def render(self, task: Task) -> Text:
            return Text("") if task.total is None else super().render(task)

    return _on_stderr(
        SpinnerColumn(), TextColumn("{task.description}"), BarColumn(bar_width=24), Count(counted), TextColumn(done),
        TimeElapsedColumn(), TextColumn("left"), TimeRemainingColumn(),
    )  # fmt: skip


def _on_stderr(*columns: ProgressColumn) -> Progress:
    from rich.console import Console
    from rich.progress import Progress

    return Progress(*columns, console=Console(stderr=True), transient=True)
