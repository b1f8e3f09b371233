"""Who does many tasks: this process, or workers of Dask's `distributed`. The only file that knows of Dask.

Futures alone, no collections: a task writes its result into the store and returns a small receipt, and the future is
released at once, or what is held would be computed again when a worker dies. A task whose worker dies is done again by
another, and so is one whose result went with it before it was fetched: who works must know what it has done before. A
task that kills its workers gives up after `RETRIES`.
"""

from __future__ import annotations

import logging
import os
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import CancelledError
from typing import Any, Protocol, TypeVar

from dirprim_filter.recording.errors import MissingExtraError, RecordingError

Task = TypeVar("Task")
Result = TypeVar("Result")
RETRIES = 3
PATIENCE_S = 30
"""With a scheduler, until it answers and has a worker."""
ALLOWED_FAILURES = 10
"""Of workers, while they hold a task, before it is given up: a worker that dies takes what it holds along."""
ONE_THREAD = {"NUMBA_NUM_THREADS": "1", "OMP_NUM_THREADS": "1", "OPENBLAS_NUM_THREADS": "1"}


LARGE = {"distributed.admin.large-graph-warning-threshold": "10 GiB"}
"""What is shared is large, and sent once."""


class Workers(Protocol):
    """Does tasks.

    Attributes:
        in_process: whether tasks are done in this process, and can call what is in it.
    """

    in_process: bool

    def each(self, work: Callable[..., Result], tasks: Sequence[Task], *shared: Any) -> Iterator[Result]:
        """The result of every task, in the order in which they are done.

        Args:
            work: called with a task, and with what is shared.
            tasks: small.
            shared: what all tasks take; each worker is sent it once.
        """
        ...


class InProcess:
    """One task after the other."""

    in_process = True

    def each(self, work: Callable[..., Result], tasks: Sequence[Task], *shared: Any) -> Iterator[Result]:
        """The results in the order of the tasks."""
        return (work(task, *shared) for task in tasks)


class LocalWorkers:
    """Processes of this machine, one thread each.

    Args:
        n: how many.
    """

    in_process = False

    def __init__(self, n: int) -> None:
        if n < 1:
            raise ValueError(f"workers: expected at least 1, got {n}")
        self._n = n

    def each(self, work: Callable[..., Result], tasks: Sequence[Task], *shared: Any) -> Iterator[Result]:
        """The results as they come.

        Raises:
            MissingExtraError: `distributed` is not installed.
            RecordingError: workers died again and again.
        """
        if not tasks:
            return
        dask, distributed = _dask(f"--workers {self._n}")
        settings = {
            "distributed.scheduler.allowed-failures": ALLOWED_FAILURES, "distributed.nanny.environ": ONE_THREAD,
            "distributed.worker.daemon": False, **LARGE,
        }  # fmt: skip
        with (
            dask.config.set(settings),
            distributed.LocalCluster(
                n_workers=min(self._n, len(tasks)), threads_per_worker=1, processes=True,
                dashboard_address="127.0.0.1:0", scheduler_kwargs={"dashboard": False}, silence_logs=logging.CRITICAL,
            ) as cluster,
            distributed.Client(cluster) as client,
        ):  # fmt: skip
            yield from _results(client, f"--workers {self._n}", work, tasks, *shared)


class ClusterWorkers:
    """Workers of a scheduler that runs, anywhere: they must see the store, and logs, by the same names.

    Args:
        address: of the scheduler, such as tcp://192.168.0.7:8786.
    """

    in_process = False

    def __init__(self, address: str) -> None:
        self._address = address

    def each(self, work: Callable[..., Result], tasks: Sequence[Task], *shared: Any) -> Iterator[Result]:
        """The results as they come.

        Raises:
            MissingExtraError: `distributed` is not installed.
            RecordingError: there is no scheduler, or none of its workers, or it was lost.
        """
        if not tasks:
            return
        who = f"--scheduler {self._address}"
        dask, distributed = _dask(who)
        try:
            client = distributed.Client(self._address, timeout=PATIENCE_S)
        except (OSError, ValueError) as error:
            raise RecordingError(
                f"{who}: expected a scheduler of Dask, got: {error}; start one with `dask scheduler`"
            ) from error
        with client, dask.config.set(LARGE):
            try:
                client.wait_for_workers(1, timeout=PATIENCE_S)
            except TimeoutError as error:
                raise RecordingError(
                    f"{who}: expected workers, none came in {PATIENCE_S} s; start some with `dask worker "
                    f"{self._address} --nthreads 1`"
                ) from error
            yield from _results(client, who, work, tasks, *shared)


def _results(
    client: Any, who: str, work: Callable[..., Result], tasks: Sequence[Task], *shared: Any
) -> Iterator[Result]:
    _, distributed = _dask(who)
    # Tasks themselves, so that what is shared is made again if the workers that have it die.
    held = [client.submit(_itself, each, retries=RETRIES, pure=False) for each in shared]
    futures = client.map(work, tasks, *([each] * len(tasks) for each in held), retries=RETRIES, pure=False)
    for future in distributed.as_completed(futures):
        try:
            result = future.result()
        except distributed.KilledWorker as error:
            raise RecordingError(
                f"{who}: workers were killed again and again at one task, for want of memory perhaps; what is done "
                "counts; run again with fewer workers"
            ) from error
        except CancelledError as error:
            raise RecordingError(f"{who}: the scheduler was lost; what is done counts; run again") from error
        future.release()
        yield result


def _itself(each: Result) -> Result:
    return each


def workers_for(n_tasks: int, asked: int | None, scheduler: str | None = None) -> Workers:
    """So many workers as are asked for, or those of a scheduler; of none asked for, this process where tasks are few.

    Raises:
        ValueError: both are asked for.
    """
    if scheduler is not None:
        if asked is not None:
            raise ValueError("--workers, --scheduler: expected one of them; a scheduler has its own workers")
        return ClusterWorkers(scheduler)
    n = min(os.cpu_count() or 1, n_tasks // FEW) if asked is None else asked
    return InProcess() if n <= 1 else LocalWorkers(n)


FEW = 8
"""Tasks for each worker below which starting it takes as long as doing them."""


def _dask(who: str) -> tuple[Any, Any]:
    try:
        import dask  # noqa: PLC0415 (an extra)
        import distributed  # noqa: PLC0415
    except ImportError as error:
        raise MissingExtraError(who, library="distributed", extra="fleet") from error
    for name in ("distributed", *logging.root.manager.loggerDict):
        if name.startswith("distributed"):  # that workers come and go is nothing to tell
            logging.getLogger(name).setLevel(logging.CRITICAL)
    return dask, distributed
