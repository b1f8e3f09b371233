"""A task that kills its worker; in a module of its own, for workers import it and nothing else."""

import os
import signal


def once_killed(task):
    """The task's number; of number 1 the process dies, the first time it is asked."""
    path, number = task
    if number == 1 and not path.exists():
        path.touch()
        os.kill(os.getpid(), signal.SIGKILL)
    return number
