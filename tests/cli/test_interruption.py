"""Ctrl-C and SIGTERM end a command alike; one that compiled code would swallow is raised again."""

import pytest

from cli.commands import python

CALLBACK = """
import ctypes, signal, sys, time
from dirprim_filter.cli import exit_codes

signal.signal(signal.SIGINT, signal.default_int_handler)  # a shell's background jobs ignore it
if sys.argv[1] == "listen":
    exit_codes.listen()
number = getattr(signal, sys.argv[2])

@ctypes.CFUNCTYPE(None)
def callback():  # as the compiler calls when it has loaded a kernel
    signal.raise_signal(number)

try:
    callback()
    callback()
    time.sleep(0.5)
    print("swallowed")
except KeyboardInterrupt:
    print(exit_codes.of_interruption())
"""

COMMAND = """
import os, signal, sys, time
from dirprim_filter.cli import main

name, then = sys.argv.pop(1), sys.argv.pop(1)

@main.app.command()
def wait():
    try:
        os.kill(os.getpid(), getattr(signal, name))
        time.sleep(5)
    except KeyboardInterrupt:
        if then == "raise":
            raise
        raise RuntimeError("what a compiler makes of it")

signal.signal(signal.SIGINT, signal.default_int_handler)
sys.argv = ["dirprim", "wait"]
main.main()
"""


@pytest.mark.parametrize(
    ("arguments", "heard"),
    [(("listen", "SIGINT"), "130"), (("listen", "SIGTERM"), "143"), (("do not", "SIGINT"), "swallowed")],
)
def test_what_a_callback_swallows_is_heard(arguments, heard):
    assert python(CALLBACK, *arguments).stdout.strip() == heard


@pytest.mark.parametrize(
    ("name", "then", "code"), [("SIGINT", "raise", 130), ("SIGTERM", "raise", 143), ("SIGTERM", "make another", 143)]
)
def test_a_command_that_is_ended_says_so_by_its_code(name, then, code):
    """A command of the real parser, which makes a code of its own of the interrupt."""
    ended = python(COMMAND, name, then)
    assert (ended.returncode, ended.stdout, ended.stderr) == (code, "", "")
