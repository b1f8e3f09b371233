"""The line about compiling: once, on a terminal, only where something is compiled for long."""

import sys

import pytest
from numba import njit

from dirprim_filter.cli import compiling
from dirprim_filter.cli.compiling import compiling_notice, notice


def compile_two():
    for shift in (1.0, 2.0):
        assert njit(lambda x, shift=shift: x + shift)(1.0) == 1.0 + shift


@pytest.mark.parametrize(("is_terminal", "unnoticed_s", "n_lines"), [(True, 0.0, 1), (False, 0.0, 0), (True, 100.0, 0)])
def test_it_is_said_once_on_a_terminal_where_compiling_is_noticed(
    is_terminal, unnoticed_s, n_lines, monkeypatch, capsys
):
    monkeypatch.setattr(sys.stderr, "isatty", lambda: is_terminal)
    monkeypatch.setattr(compiling, "UNNOTICED_S", unnoticed_s)
    with compiling_notice("demo"):
        compile_two()
    compile_two()  # nothing is said to others
    assert capsys.readouterr().err.count("once per installation") == n_lines


def test_it_says_what_is_left():
    assert "about 40 s more" in notice("demo", 5.0)
    assert "about 5 s more" in notice("info", 1000.0)
