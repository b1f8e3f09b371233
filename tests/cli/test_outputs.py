"""No output takes the place of an input, whatever --force says; what cannot be written is reported before the work."""

import inspect
import os
from pathlib import Path
from typing import get_type_hints

import pytest

from dirprim_filter import save_map, write_tracks
from dirprim_filter.cli.main import app, run
from dirprim_filter.cli.options import WRITTEN
from dirprim_filter.cli.outputs import check_outputs
from dirprim_filter.cli.provenance import provenance
from dirprim_filter.partial_file import PartialFile
from dirprim_filter.viewer.figures import Figure, save_figure
from dirprim_filter.viewer.sink import open_stream

FAILED = 1
UNPRIVILEGED = 65534
EVALUATE = next(of.typer_instance for of in app.registered_groups if of.typer_instance.info.name == "evaluate")
COMMANDS = [*app.registered_commands, *EVALUATE.registered_commands]


def dirprim(*arguments):
    return run([str(argument) for argument in arguments])


@pytest.fixture
def files(ring, ring_map, tmp_path):
    save_map(ring_map, tmp_path / "map.mcap")
    write_tracks(ring[ring.track_id < 2], tmp_path / "log.mcap")
    (tmp_path / "table.csv").write_text("time_s,track_id,x_m,y_m\n0,1,0,0\n1,1,1,0\n")
    (tmp_path / "shown.rrd").write_bytes(b"RRF2")
    (tmp_path / "link.mcap").symlink_to(tmp_path / "log.mcap")
    (tmp_path / "hard.mcap").hardlink_to(tmp_path / "log.mcap")
    return tmp_path


@pytest.mark.parametrize(
    "command",
    [
        "learn log.mcap -o log.mcap",
        "learn log.mcap -o link.mcap",
        "learn log.mcap -o hard.mcap",
        "learn log.mcap -o ./sub/../log.mcap",
        "track log.mcap --map map.mcap -o map.mcap",
        "track log.mcap --map map.mcap -o log.mcap",
        "track log.mcap --map map.mcap -o new.mcap --save log.mcap",
        "track log.mcap --map map.mcap -o new.mcap --save link.mcap",
        "convert table.csv -o table.csv",
        "recover log.mcap -o log.mcap",
        "plot map.mcap -o map.mcap",
        "view shown.rrd --save shown.rrd",
        "view log.mcap --rate inf --save log.mcap",
        "export log.mcap -o log.mcap",
        "score log.mcap --truth log.mcap --plot log.mcap",
        "evaluate tracking log.mcap --map map.mcap -o map.mcap",
        "evaluate forecast log.mcap --plot log.mcap",
    ],
)
def test_an_input_is_never_replaced(command, files, monkeypatch, capsys):
    monkeypatch.chdir(files)
    (files / "sub").mkdir()
    before = {path: path.read_bytes() for path in files.iterdir() if path.is_file()}
    assert dirprim(*command.split(), "--force") == FAILED
    error = capsys.readouterr().err
    assert error.count("\n") == 1
    assert "is an input of this command" in error
    assert {path: path.read_bytes() for path in files.iterdir() if path.is_file()} == before


def test_two_outputs_are_two_files(files, capsys):
    new = files / "new.mcap"
    options = ("--map", files / "map.mcap", "-o", new, "--save", new)
    assert dirprim("track", files / "log.mcap", *options) == FAILED
    assert "another file for each output" in capsys.readouterr().err
    check_outputs([new, files / "other.mcap"], [files / "log.mcap"], force=False)  # these may be written


@pytest.mark.parametrize("command", COMMANDS, ids=lambda c: c.callback.__name__)
def test_every_option_that_names_an_output_is_marked(command):
    """Of every command: what is called like an output is asked for before the work, and nothing else is."""
    hints = get_type_hints(command.callback, include_extras=True)
    marked = {name for name, hint in hints.items() if WRITTEN in getattr(hint, "__metadata__", ())}
    called = {"output", "folder", "save", "plot", "chart", "layout"} & set(
        inspect.signature(command.callback).parameters
    )
    assert marked == called


@pytest.fixture
def locked(tmp_path):
    """A folder that cannot be written; root, who can write everywhere, is nobody meanwhile."""
    folder = tmp_path / "locked"
    folder.mkdir(mode=0o555)
    if os.geteuid() != 0:
        yield folder
        return
    for above in (tmp_path, *tmp_path.parents):
        if not above.stat().st_mode & 0o001:
            above.chmod(above.stat().st_mode | 0o011)
    os.seteuid(UNPRIVILEGED)
    yield folder
    os.seteuid(0)


def test_a_folder_that_cannot_be_written_is_reported_by_the_name_that_was_given(locked):
    with pytest.raises(PermissionError) as of_check:
        check_outputs([locked / "out.mcap"], [], force=False)
    with pytest.raises(PermissionError) as of_file, PartialFile(locked / "out.mcap", force=False):
        pass
    with pytest.raises(PermissionError) as of_stream:
        open_stream(save=locked / "out.rrd")
    with pytest.raises(PermissionError) as of_figure:
        save_figure(Figure(), locked / "out.png")
    reported = [caught.value.filename for caught in (of_check, of_file, of_stream, of_figure)]
    assert reported == [str(locked / name) for name in ("out.mcap", "out.mcap", "out.rrd", "out.png")]


@pytest.mark.parametrize(
    "command",
    [
        "learn log.mcap -o there", "track log.mcap --map map.mcap -o there", "plot map.mcap -o there.png",
        "track log.mcap --map map.mcap -o new.mcap --save there", "store learn fleet -o there",
        "calibrate log.mcap --truth log.mcap -o there", "evaluate forecast log.mcap --plot there.png",
    ],
)  # fmt: skip
def test_a_file_that_is_there_is_reported_before_any_work(command, files, monkeypatch, capsys):
    """Before the inputs are read: that they are broken is not seen."""
    monkeypatch.chdir(files)
    for name in ("there", "there.png", "log.mcap", "map.mcap"):
        (files / name).write_bytes(b"precious")
    assert dirprim(*command.split()) == FAILED
    error = capsys.readouterr().err
    assert error.count("\n") == 1
    assert "expected a new file, it exists; choose another name or use --force" in error
    assert (files / "there").read_bytes() == b"precious"


@pytest.mark.parametrize("command", ["plot map.mcap -o", "score log.mcap --truth log.mcap --plot"])
@pytest.mark.parametrize("name", ["map.xyz", "map", "map.jpg"])
def test_an_unknown_format_is_refused_before_any_work(command, name, files, monkeypatch, capsys):
    monkeypatch.chdir(files)
    assert dirprim(*command.split(), name) == FAILED
    assert f"{name}: expected a name that ends in .png, .pdf, .svg" in capsys.readouterr().err
    assert not (files / name).exists()


@pytest.mark.parametrize("command", ["view map.mcap --save", "learn log.mcap -o"])
def test_what_cannot_be_written_is_one_line(command, files, capsys):
    command, first, *option = command.split()
    (files / "file").touch()
    assert dirprim(command, files / first, *option, files / "file" / "out.rrd") == FAILED
    error = capsys.readouterr().err
    assert error.count("\n") == 1
    assert f"{files}/file/out.rrd: expected a folder" in error
    assert Path(files / "file").is_file()


def test_inputs_of_one_name_have_a_checksum_each(tmp_path):
    for folder in "ab":
        (tmp_path / folder).mkdir()
        (tmp_path / folder / "log.mcap").write_text(folder)
    sums = provenance("learn", inputs=[tmp_path / "a" / "log.mcap", tmp_path / "b" / "log.mcap"])
    assert sum(name.startswith("sha256 ") for name in sums) == 2
