"""`dirprim plot`: a map from the command line, and one clear line where there is none."""

from pathlib import Path

import pytest
from matplotlib.image import imread

from cli.commands import DONE, USAGE, dirprim


def test_a_part_of_the_map_in_a_given_width_and_resolution(here, capsys):
    for name, extent in (("a", "0 0 20 20"), ("b", "0 0 20 10")):
        assert dirprim(f"plot map.mcap --log log.mcap -o {name}.png --width 3.5 --dpi 60 --extent {extent}") == DONE
    assert capsys.readouterr().out == "a.png\nb.png\n"
    a, b = (imread(f"{name}.png").shape for name in "ab")
    assert a[1] == b[1] == 3.5 * 60
    assert b[0] < a[0]  # half as deep a part is drawn on a flatter page


@pytest.mark.parametrize(
    ("options", "said"), [("--extent 10 0 -10 5", "expected west south east north"), ("--width 1", "--width")]
)
def test_what_cannot_be_drawn_is_reported_and_nothing_is_written(here, capsys, options, said):
    assert dirprim(f"plot map.mcap -o p.png {options}") == USAGE
    assert said in " ".join(capsys.readouterr().err.split())
    assert not Path("p.png").exists()
