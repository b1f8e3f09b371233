"""Who does many tasks: this process, or a client of Dask's `distributed`. The only file that knows of Dask.

A task writes what it makes into the store and returns little. One whose worker dies is done again by another; one that
kills its workers is given up after `RETRIES`.
"""

from __future__ import annotations

import logging
import os
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import CancelledError
from contextlib import ExitStack
from dataclasses import dataclass
from typing import Any, TypeVar

from dirprim_filter.recording.errors import MissingExtraError, RecordingError

Task = TypeVar("Task")
Result = TypeVar("Result")
RETRIES = 3
PATIENCE_S = 30
"""With a scheduler, until it answers and has a worker."""
FEW = 8
"""Tasks for each worker below which starting it takes as long as doing them."""
SETTINGS = {
    "distributed.scheduler.allowed-failures": 10, "distributed.worker.daemon": False,
    "distributed.admin.large-graph-warning-threshold": "10 GiB",
    "distributed.nanny.pre-spawn-environ": {"OMP_NUM_THREADS": 1, "OPENBLAS_NUM_THREADS": 1},
}  # fmt: skip
"""Dask's own environment of workers makes malloc give each array's pages back at once: a quarter of their time."""


@dataclass(frozen=True)
class Workers:
    """Those of this machine, or of a scheduler that runs anywhere: these see the store, and logs, by the same names.

    Attributes:
        n: processes; of one, tasks are done in this process.
        scheduler: its address, such as tcp://192.168.0.7:8786, in place of `n`.
    """

    n: int = 1
    scheduler: str | None = None

    @classmethod
    def of(cls, n_tasks: int, asked: int | None, scheduler: str | None) -> Workers:
        """So many as are asked for; of none asked for, one for each core where tasks are many.

        Raises:
            ValueError: both are asked for.
        """
        if scheduler is not None and asked is not None:
            raise ValueError("--workers, --scheduler: expected one of them; a scheduler has its own workers")
        return cls(max(1, min(os.cpu_count() or 1, n_tasks // FEW)) if asked is None else asked, scheduler)

    @property
    def in_process(self) -> bool:
        """Whether tasks are done in this process, and can call what is in it."""
        return self.scheduler is None and self.n <= 1

    def each(self, work: Callable[[Task], Result], tasks: Sequence[Task], keys: Sequence[str]) -> Iterator[Result]:
        """The result of every task, in the order in which they are done.

        Args:
            work: called with a task.
            tasks: small.
            keys: of each, made of all that its result follows from.

        Raises:
            MissingExtraError: `distributed` is not installed.
            RecordingError: workers died again and again, or there is no scheduler, or it was lost.
        """
        if self.in_process or not tasks:
            yield from map(work, tasks)
            return
        dask, distributed = self._dask()
        with ExitStack() as stack:
            stack.enter_context(dask.config.set(SETTINGS))
            client = self._client(distributed, min(self.n, len(tasks)), stack)
            futures = client.map(work, tasks, key=list(keys), retries=RETRIES)
            for future in distributed.as_completed(futures):
                try:
                    result = future.result()
                except distributed.KilledWorker as error:
                    raise RecordingError(
                        f"{self}: workers were killed again and again at one task, for want of memory perhaps; what is "
                        "done counts; run again with fewer workers"
                    ) from error
                except CancelledError as error:
                    raise RecordingError(f"{self}: the scheduler was lost; what is done counts; run again") from error
                future.release()
                yield result

    def __str__(self) -> str:
        return f"--workers {self.n}" if self.scheduler is None else f"--scheduler {self.scheduler}"

    def _client(self, distributed: Any, n: int, stack: ExitStack) -> Any:
        if self.scheduler is None:
            cluster = stack.enter_context(distributed.LocalCluster(
                n_workers=n, threads_per_worker=1, host="127.0.0.1", dashboard_address="127.0.0.1:0",
                scheduler_kwargs={"dashboard": False}, silence_logs=logging.CRITICAL,
            ))  # fmt: skip
            return stack.enter_context(distributed.Client(cluster))
        try:
            # A Client that cannot connect is never closed, and its finaliser deadlocks a later one: connect first.
            distributed.utils.LoopRunner().run_sync(self._connect, distributed)
            client = stack.enter_context(distributed.Client(self.scheduler, timeout=PATIENCE_S))
            client.wait_for_workers(1, timeout=PATIENCE_S)
        except (OSError, ValueError) as error:
            raise RecordingError(
                f"{self}: expected a scheduler of Dask with workers, got: {error or 'none'}; start them with `dask "
                f"scheduler` and `dask worker {self.scheduler} --nthreads 1`"
            ) from error
        return client

    async def _connect(self, distributed: Any) -> None:
        arguments = distributed.Security().get_connection_args("client")
        comm = await distributed.comm.connect(self.scheduler, timeout=PATIENCE_S, **arguments)
        await comm.close()

    def _dask(self) -> tuple[Any, Any]:
        try:
            import dask  # noqa: PLC0415 (an extra)
            import distributed  # noqa: PLC0415
        except ImportError as error:
            raise MissingExtraError(str(self), library="distributed", extra="fleet") from error
        for name in ("distributed", *logging.root.manager.loggerDict):
            if name.startswith("distributed"):  # that workers come and go is nothing to report
                logging.getLogger(name).setLevel(logging.CRITICAL)
        return dask, distributed
