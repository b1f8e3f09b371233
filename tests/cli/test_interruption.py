"""Ctrl-C and SIGTERM end a command alike; one that compiled code would swallow is raised again."""

import subprocess
import sys

import pytest

CALLBACK = """
import ctypes, signal, sys, time
from dirprim_filter.cli import interruption

signal.signal(signal.SIGINT, signal.default_int_handler)  # a shell's background jobs ignore it
if sys.argv[1] == "listen":
    interruption.listen()
number = getattr(signal, sys.argv[2])

@ctypes.CFUNCTYPE(None)
def callback():  # as the compiler calls when it has loaded a kernel
    signal.raise_signal(number)

try:
    callback()
    callback()
    time.sleep(0.5)
    print("swallowed")
except KeyboardInterrupt as ended:
    print(interruption.exit_code(ended))
"""

COMMAND = """
import os, signal, sys, time
from dirprim_filter.cli import main

def command(*_, **__):
    os.kill(os.getpid(), getattr(signal, sys.argv[1]))
    time.sleep(5)

signal.signal(signal.SIGINT, signal.default_int_handler)
main.app = command
main.main()
"""


def python(code, *arguments):
    return subprocess.run([sys.executable, "-c", code, *arguments], capture_output=True, text=True, check=False)


@pytest.mark.parametrize(
    ("arguments", "heard"),
    [(("listen", "SIGINT"), "130"), (("listen", "SIGTERM"), "143"), (("do not", "SIGINT"), "swallowed")],
)
def test_what_a_callback_swallows_is_heard(arguments, heard):
    assert python(CALLBACK, *arguments).stdout.strip() == heard


@pytest.mark.parametrize(("name", "code"), [("SIGINT", 130), ("SIGTERM", 143)])
def test_a_command_that_is_ended_says_so_by_its_code(name, code):
    ended = python(COMMAND, name)
    assert (ended.returncode, ended.stdout, ended.stderr) == (code, "", "")
