"""How tests run a command: as it is typed."""

import io
import os
import shlex
import subprocess
import sys

from dirprim_filter.cli.main import run

DONE, FAILED, USAGE, INPUT_LOST = 0, 1, 2, 3
GRID = "--tessellation grid --cell-size 8"
"""Learned in a moment: where any map will do."""


def dirprim(command, *more):
    """The exit code of a command line, and of what follows it word by word."""
    return run([*shlex.split(command), *map(str, more)])


def python(code, *arguments, **environment):
    """A program in a process of its own, which has ended; its texts."""
    command, beside = [sys.executable, "-c", code, *arguments], os.environ | environment
    return subprocess.run(command, env=beside, capture_output=True, text=True, check=False)


class Terminal(io.StringIO):
    """What stands in for one."""

    def isatty(self):
        return True
