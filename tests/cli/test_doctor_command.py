"""`dirprim doctor`: a sound installation, and one that is not."""

import pytest

from cli.commands import DONE, FAILED, dirprim
from dirprim_filter.cli import doctor

CHECKS = ("_packages", "_cache", "_viewer", "_self_test")


def test_a_sound_installation_is_called_so(capsys):
    assert dirprim("doctor") == DONE
    said = capsys.readouterr().out
    assert said.count("ok: ") == 4
    assert "dirprim-filter" in said


@pytest.mark.parametrize("check", CHECKS)
def test_what_fails_is_named_and_the_others_are_checked(check, monkeypatch, capsys):
    def broken(**_):
        raise OSError("the disk is full")

    for name in CHECKS:
        monkeypatch.setattr(doctor, name, broken if name == check else lambda **_: "well")
    assert dirprim("doctor") == FAILED
    said = capsys.readouterr().out
    assert said.count("ok: ") == 3
    assert "FAILED" in said
    assert "OSError: the disk is full" in said
