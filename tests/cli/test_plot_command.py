"""`dirprim plot`: every picture of a map from the command line, and one clear line where there is none."""

import pytest
from matplotlib.image import imread

from dirprim_filter import save_map, write_tracks
from dirprim_filter.cli.main import run

DONE, FAILED, USAGE = 0, 1, 2


@pytest.fixture(scope="module")
def files(ring, ring_map, tmp_path_factory):
    folder = tmp_path_factory.mktemp("plot")
    save_map(ring_map, folder / "map.mcap")
    write_tracks(ring[ring.track_id < 8], folder / "log.mcap")
    return folder


def plot(files, *arguments):
    return run(["plot", str(files / "map.mcap"), *map(str, arguments)])


@pytest.mark.parametrize(
    ("figure", "more"),
    [
        ("map", ()),
        ("place", ("--at", 20, 0, "--log", "log.mcap")),
        ("place", ("--cue", "left", "--heading-deg", 90)),
    ],
)
def test_every_picture(files, tmp_path, capsys, figure, more):
    arguments = [files / a if a == "log.mcap" else a for a in more]
    assert plot(files, "-o", tmp_path / "p.png", "--figure", figure, *arguments) == DONE
    assert (tmp_path / "p.png").read_bytes().startswith(b"\x89PNG")
    assert capsys.readouterr().out == f"{tmp_path / 'p.png'}\n"
    assert plot(files, "-o", tmp_path / "p.png", "--figure", figure, *arguments) == FAILED
    assert "--force" in capsys.readouterr().err


def test_a_part_of_the_map_in_a_given_width_and_resolution(files, tmp_path):
    options = ["--log", files / "log.mcap", "--width", 3.5, "--dpi", 60]
    for name, extent in (("a", (0, 0, 20, 20)), ("b", (0, 0, 20, 10))):
        assert plot(files, "-o", tmp_path / f"{name}.png", *options, "--extent", *extent) == DONE
    a, b = (imread(tmp_path / f"{name}.png").shape for name in "ab")
    assert a[1] == b[1] == 3.5 * 60
    assert b[0] < a[0]  # half as deep a part is drawn on a flatter page


@pytest.mark.parametrize(
    ("arguments", "said"),
    [
        (["--at", 1, 2], "--at: has no meaning for --figure map; it is for place"),
        (["--figure", "pie"], "pie"),
        (["--figure", "place", "--width", 4], "--width: has no meaning for --figure place"),
        (["--extent", 10, 0, -10, 5], "expected west south east north"),
        (["--figure", "place", "--at", 900, 0], "expected a place in a cell, got (900, 0) m"),
        (["--figure", "place", "--at", "nan", 0], "finite"),
    ],
)
def test_what_cannot_be_drawn_is_reported_and_nothing_is_written(files, tmp_path, capsys, arguments, said):
    assert plot(files, "-o", tmp_path / "p.png", *arguments) in (FAILED, USAGE)
    assert said in " ".join(capsys.readouterr().err.split())
    assert list(tmp_path.iterdir()) == []


def test_a_format_is_refused_before_the_work(files, tmp_path, capsys):
    assert plot(files, "-o", tmp_path / "p.gif") == FAILED
    assert "ends in .png, .pdf, .svg, got .gif" in capsys.readouterr().err
