"""The line about compiling: once, only where something is compiled for long; and the kernels' cache."""

import sys

import pytest
from numba import njit

from cli.commands import python
from dirprim_filter.cli import compiling
from dirprim_filter.cli.demo import recordings_folder
from tessellation import _compiling

NOWHERE = "numba.core.caching._IPythonCacheLocator"
"""Of numba's places for a cache the one that takes no files."""


@pytest.mark.parametrize(("is_terminal", "unnoticed_s", "n_lines"), [(True, 0.0, 1), (False, 0.0, 0), (True, 1e9, 0)])
def test_it_is_said_once_on_a_terminal_where_compiling_is_noticed(
    is_terminal, unnoticed_s, n_lines, monkeypatch, caplog
):
    monkeypatch.setattr(sys.stderr, "isatty", lambda: is_terminal)
    monkeypatch.setattr(_compiling, "UNNOTICED_S", unnoticed_s)
    compiling.quiet_unless_watched()
    monkeypatch.setattr(_compiling.LISTENER, "has_said", False)
    for shift in (1.0, 2.0):
        assert njit(lambda x, shift=shift: x + shift)(1.0) == 1.0 + shift
    assert caplog.text.count("once per installation") == n_lines


def test_programs_that_use_the_package_are_told_too():
    code = (
        "from tessellation import _compiling; _compiling.UNNOTICED_S = 0.0\n"
        "from numba import njit; njit(lambda x: x)(1.0); njit(lambda x: x)(1)"
    )
    assert python(code).stderr == f"{_compiling.NOTICE}\n"


def test_damaged_kernels_are_compiled_again(tmp_path, monkeypatch, capsys):
    monkeypatch.setenv("NUMBA_CACHE_DIR", str(tmp_path))
    (tmp_path / "filtering_1a2b").mkdir()
    other, kernel = (tmp_path / "filtering_1a2b" / f"{name}-13.py311.nbi" for name in ("_other.x", "_kernels.advance"))
    other.write_bytes(b"\x80\x04.")
    kernel.touch()  # as a power cut leaves it
    compiling.mend_cache()
    assert capsys.readouterr().err.startswith("warning: 1 of the compiled kernels' files were damaged")
    assert (kernel.exists(), other.exists()) == (False, True)
    compiling.mend_cache()
    assert capsys.readouterr().err == ""
    kernel.write_bytes(b"\x80\x04\x95")  # or as a full disk does
    compiling.mend_cache()
    assert (kernel.exists(), other.exists()) == (False, True)


def test_an_installation_that_keeps_nothing_compiles_in_each_run_and_says_so(tmp_path):
    """As in a container whose user has no home: by numba's own rules every command ended in a traceback."""
    table = tmp_path / "table.csv"
    table.write_text("time_s,track_id,x_m,y_m\n0,a,0,0\n1,a,1,0\n")
    code = (
        "import os; os.access = lambda *_, **__: False\n"
        "from dirprim_filter.cli.main import run\n"
        f"raise SystemExit(run(['info', {str(table)!r}]))"
    )
    nowhere = {"NUMBA_CACHE_DIR": "", "HOME": "/proc", "XDG_CACHE_HOME": "/proc/none"}
    done = python(code, **nowhere, NUMBA_CACHE_LOCATOR_CLASSES=NOWHERE)
    assert done.returncode == 0, done.stderr
    assert "warning: every run compiles" in done.stderr


@pytest.mark.slow
def test_learning_and_tracking_compile_each_kernel_for_one_kind_of_arguments(tmp_path):
    """Arrays of a log or of a map's file cannot be written to, computed ones can: a kernel is given all as one kind."""
    recordings, learned, out = recordings_folder(), str(tmp_path / "map.mcap"), str(tmp_path / "out.mcap")
    learn = ["learn", str(recordings / "roundabout_learn.mcap"), "--end", "30", "-o", learned]
    track = ["track", str(recordings / "roundabout_track.mcap"), "--map", learned, "--forecast", "3", "-o", out]
    code = (
        "import sys\n"
        "from numba.core.dispatcher import Dispatcher\n"
        "from dirprim_filter.cli.main import run\n"
        f"print(run({learn}), run({track}))\n"
        "kernels = {k for m in list(sys.modules.values()) for k in vars(m).values() if isinstance(k, Dispatcher)}\n"
        "of = [k for k in kernels if k.py_func.__module__.startswith(('dirprim_filter', 'tessellation'))]\n"
        "print(len(of) > 50, [k.py_func.__qualname__ for k in of if len(k.signatures) > 1])\n"
    )
    assert python(code).stdout.splitlines()[-2:] == ["0 0", "True []"]
