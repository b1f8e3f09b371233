"""The line about compiling: once, on a terminal, only where something is compiled for long."""

import sys
from importlib import import_module

import pytest
from numba import njit

from dirprim_filter.cli import compiling, demo
from dirprim_filter.cli.compiling import compiling_notice
from dirprim_filter.cli.main import app


def compile_two():
    for shift in (1.0, 2.0):
        assert njit(lambda x, shift=shift: x + shift)(1.0) == 1.0 + shift


@pytest.mark.parametrize(("is_terminal", "unnoticed_s", "n_lines"), [(True, 0.0, 1), (False, 0.0, 0), (True, 100.0, 0)])
def test_it_is_said_once_on_a_terminal_where_compiling_is_noticed(
    is_terminal, unnoticed_s, n_lines, monkeypatch, capsys
):
    monkeypatch.setattr(sys.stderr, "isatty", lambda: is_terminal)
    monkeypatch.setattr(compiling, "UNNOTICED_S", unnoticed_s)
    with compiling_notice():
        compile_two()
    compile_two()  # nothing is said to others
    assert capsys.readouterr().err.count("once per installation") == n_lines


@pytest.mark.parametrize("command", ["demo", "learn", "track"])
def test_the_long_commands_say_it(command):
    """Each runs within the notice: `checked` wraps what is registered."""
    (registered,) = [own for own in app.registered_commands if (own.callback or print).__name__ == command]
    assert registered.callback.__wrapped__.__name__ == command


def test_kernels_are_looked_for_by_name(tmp_path, monkeypatch):
    monkeypatch.setenv("NUMBA_CACHE_DIR", str(tmp_path))
    (tmp_path / "filtering_1a2b").mkdir()
    (tmp_path / "filtering_1a2b" / "_interaction.look_ahead-113.py311.nbi").touch()
    assert not compiling.has_kernels(demo.KERNEL)
    (tmp_path / "filtering_1a2b" / f"{demo.KERNEL}-21.py311.nbi").touch()
    assert compiling.has_kernels(demo.KERNEL)
    module, function = demo.KERNEL.split(".")
    assert hasattr(import_module(f"dirprim_filter.filtering.{module}"), function)


def test_what_a_power_cut_left_empty_of_the_cache_is_compiled_anew_and_said(tmp_path, monkeypatch, capsys):
    monkeypatch.setenv("NUMBA_CACHE_DIR", str(tmp_path))
    (tmp_path / "module").mkdir()
    empty, whole = tmp_path / "module" / "kernel.nbi", tmp_path / "module" / "other.nbi"
    empty.touch()
    whole.write_bytes(b"\x80\x04")
    compiling.mend_cache()
    assert capsys.readouterr().err.startswith("warning: 1 of the compiled kernels' files were damaged")
    assert (empty.exists(), whole.exists()) == (False, True)
    compiling.mend_cache()
    assert capsys.readouterr().err == ""
