"""`dirprim doctor`: a sound installation, and one that is not."""

import pytest

from dirprim_filter.cli import doctor
from dirprim_filter.cli.main import run


def test_a_sound_installation_is_called_so(capsys):
    assert run(["doctor"]) == 0
    said = capsys.readouterr().out
    assert said.count("ok: ") == 4
    assert "dirprim-filter" in said


@pytest.mark.parametrize("check", ["_cache", "_viewer", "_self_test"])
def test_what_fails_is_named_and_the_others_are_checked(check, monkeypatch, capsys):
    def broken():
        raise OSError("the disk is full")

    for name in ("_cache", "_viewer", "_self_test"):
        monkeypatch.setattr(doctor, name, broken if name == check else lambda: "well")
    assert run(["doctor"]) == 1
    said = capsys.readouterr().out
    assert said.count("ok: ") == 3
    assert "FAILED" in said
    assert "OSError: the disk is full" in said
