"""`dirprim plot`: every picture of a map from the command line, and one clear line where there is none."""

from pathlib import Path

import pytest
from matplotlib.image import imread

from cli.commands import DONE, FAILED, USAGE, dirprim


@pytest.mark.parametrize(
    "options",
    ["", "--log log.mcap", "--figure place --at 20 0 --log log.mcap",
     "--figure place --cue left --heading-deg 90"],
)  # fmt: skip
def test_every_picture(here, capsys, options):
    assert dirprim(f"plot map.mcap -o p.png {options}") == DONE
    assert Path("p.png").read_bytes().startswith(b"\x89PNG")
    assert capsys.readouterr().out == "p.png\n"


def test_a_part_of_the_map_in_a_given_width_and_resolution(here):
    for name, extent in (("a", "0 0 20 20"), ("b", "0 0 20 10")):
        command = f"plot map.mcap -o {name}.png --width 3.5 --dpi 60 --extent {extent}"
        assert dirprim(command) == DONE
    a, b = (imread(f"{name}.png").shape for name in "ab")
    assert a[1] == b[1] == 3.5 * 60
    assert b[0] < a[0]  # half as deep a part is drawn on a flatter page


@pytest.mark.parametrize(
    ("options", "code", "said"),
    [
        ("--at 1 2", USAGE, "--at: has no meaning for --figure map"),
        ("--figure pie", USAGE, "pie"),
        ("--figure place --width 4", USAGE, "--width: has no meaning for --figure place"),
        ("--extent 10 0 -10 5", USAGE, "expected west south east north"),
        ("--figure place --at 900 0", FAILED, "expected a place in a cell, got (900, 0) m"),
        ("--figure place --at nan 0", FAILED, "finite"),
    ],
)
def test_what_cannot_be_drawn_is_reported_and_nothing_is_written(here, capsys, options, code, said):
    assert dirprim(f"plot map.mcap -o p.png {options}") == code
    assert said in " ".join(capsys.readouterr().err.split())
    assert not Path("p.png").exists()
