"""Commands in processes of their own, killed once they have begun to change files.

They are forked from a process that has imported and compiled what they need: one takes a fifth of a second.
"""

import multiprocessing
import os
import signal
import sys

import pytest

from dirprim_filter.cli.main import run

FORKED = multiprocessing.get_context("forkserver")
FORKED.set_forkserver_preload(["warm_interpreter"])
CHANGES = {
    "open_output_stream", "write", "close", "delete_file", "create", "create_write_transaction", "link", "replace",
    "unlink", "fsync",
}  # fmt: skip
"""Functions of compiled libraries by which a process changes files: each call is a step, and each return."""


def run_command(folder, command):
    """A command in a folder; -> its exit code, and what it says."""
    process = _begun(folder, command)
    process.join()
    return process.exitcode, (folder.parent / "said").read_text()


def kill_command(folder, command, *, step=1, after_s=0.0):
    """A command in a folder, killed at such a step of its writing, or so much of its time later; -> whether it was."""
    process = _begun(folder, command, step, after_s)
    process.join()
    return process.exitcode in {-signal.SIGKILL, -signal.SIGPROF}


def _begun(folder, command, step=0, after_s=0.0):
    process = FORKED.Process(target=_run, args=(folder, command, step, after_s))
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv("PYTHONPATH", os.pathsep.join(sys.path))  # the process forked from has no other, if it starts now
        process.start()
    return process


def _run(folder, command, step, after_s):
    os.chdir(folder)
    said = os.open(folder.parent / "said", os.O_WRONLY | os.O_CREAT | os.O_TRUNC)
    os.dup2(said, 1)
    os.dup2(said, 2)
    seen = 0

    def watch(_frame, event, called):
        nonlocal seen
        if event in {"c_call", "c_return"} and called.__name__ in CHANGES and called.__self__ is not sys.stdout:
            seen += 1
            if seen == step and not after_s:
                os.kill(os.getpid(), signal.SIGKILL)
            elif seen == step:
                sys.setprofile(None)
                signal.setitimer(signal.ITIMER_PROF, after_s)  # SIGPROF, which nothing handles, ends it as SIGKILL does

    sys.setprofile(watch if step else None)
    code = run(command.split())
    sys.setprofile(None)
    sys.exit(code)
