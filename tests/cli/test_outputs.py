"""No output takes the place of an input, whatever --force says; what cannot be written is reported before the work."""

import inspect
import os
import resource
import subprocess
import sys
from pathlib import Path
from shutil import copy
from time import process_time
from typing import get_type_hints

import pytest
from matplotlib.figure import Figure

from cli.commands import DONE, FAILED, dirprim
from dirprim_filter.cli.commands import check_outputs
from dirprim_filter.cli.main import app
from dirprim_filter.cli.options import WRITTEN
from dirprim_filter.cli.results import metadata_of, provenance
from dirprim_filter.partial_file import PartialFile
from dirprim_filter.recording.container.errors import one_line
from dirprim_filter.recording.scan import scan
from dirprim_filter.viewer.figures import save_figure
from dirprim_filter.viewer.sink import RerunSink

UNPRIVILEGED = 65534
COMMANDS = [
    *app.registered_commands,
    *(c for of in app.registered_groups for c in of.typer_instance.registered_commands),
]
REPLACED = "is an input of this command"
EXISTS = "expected a new file, it exists; choose another name or use --force"
ENDS = "expected a name that ends in"
TRACK = "track log.mcap --map map.mcap -o"


@pytest.mark.parametrize(
    ("command", "text"),
    [
        *((f"learn log.mcap -o {name} --force", REPLACED) for name in ("log.mcap", "soft", "hard", "sub/../soft")),
        (f"{TRACK} map.mcap --force", REPLACED),
        (f"{TRACK} log.mcap --force", REPLACED),
        (f"{TRACK} new.mcap --save soft --force", REPLACED),
        ("convert table.csv -o table.csv --force", REPLACED),
        ("recover log.mcap -o log.mcap --force", REPLACED),
        ("plot map.mcap -o map.mcap --force", REPLACED),
        ("view shown.rrd --save shown.rrd --force", REPLACED),
        ("view log.mcap --save log.mcap --force", REPLACED),
        ("export log.mcap -o log.mcap --force", REPLACED),
        (f"{TRACK} new.mcap --save new.mcap", "another file for each output"),
        ("learn log.mcap -o there", EXISTS),
        (f"{TRACK} there", EXISTS),
        (f"{TRACK} new.mcap --save there", EXISTS),
        ("plot map.mcap -o there.png", EXISTS),
        ("store learn fleet -o there", EXISTS),
        ("calibrate log.mcap --truth log.mcap -o there", EXISTS),
        *((f"plot map.mcap -o {name}", f"{name}: {ENDS} .png, .pdf, .svg") for name in ("m", "m.jpg")),
        ("forecast --map map.mcap --at 1 2 --direction-deg 0 --speed 1 -o m.gif", f"m.gif: {ENDS}"),
        ("view map.mcap --save there/out.rrd", "there/out.rrd: expected a folder"),
        ("learn log.mcap -o there/map.mcap", "there/map.mcap: expected a folder"),
    ],
)  # fmt: skip
def test_what_must_not_be_written_is_refused_before_any_work(command, text, here, refused):
    """Before the inputs are read: that they are broken is not seen."""
    for name in ("there", "there.png", "log.mcap", "map.mcap", "table.csv", "shown.rrd"):
        Path(name).write_bytes(b"precious")
    Path("sub").mkdir()
    Path("soft").symlink_to("log.mcap")
    Path("hard").hardlink_to("log.mcap")
    before = {path: path.is_file() and path.read_bytes() for path in here.iterdir()}
    assert refused(command, text).startswith("error: ")
    assert {path: path.is_file() and path.read_bytes() for path in here.iterdir()} == before


@pytest.mark.parametrize("command", COMMANDS, ids=lambda c: c.callback.__name__)
def test_every_option_that_names_an_output_is_marked(command):
    """Of every command: what is called like an output is asked for before the work, and nothing else is."""
    hints = get_type_hints(command.callback, include_extras=True)
    marked = {name for name, hint in hints.items() if WRITTEN in getattr(hint, "__metadata__", ())}
    called = {"output", "save", "plot", "screenshot"} & set(inspect.signature(command.callback).parameters)
    assert marked == called
    assert command.callback.__wrapped__.__name__ == command.callback.__name__  # `checked` wraps what is registered


@pytest.fixture
def locked(tmp_path):
    """A folder that cannot be written; root, who can write everywhere, is the user `nobody` meanwhile."""
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
        RerunSink(save=locked / "out.rrd")
    with pytest.raises(PermissionError) as of_figure:
        save_figure(Figure(), locked / "out.png")
    reported = [caught.value.filename for caught in (of_check, of_file, of_stream, of_figure)]
    assert reported == [str(locked / name) for name in ("out.mcap", "out.mcap", "out.rrd", "out.png")]


@pytest.mark.usefixtures("here")
@pytest.mark.parametrize(
    ("command", "output"),
    [
        ("learn log.mcap -o new --tessellation grid --cell-size 8", "new"), (f"{TRACK} new --particles 20", "new"),
        ("recover log.mcap -o new", "new"), ("plot map.mcap -o new.png", "new.png"),
        ("export run -o new.csv", "new.csv"), ("view map.mcap --save new.rrd", "new.rrd"),
        ("calibrate log.mcap --truth log.mcap -o new", "new"),
    ],
)  # fmt: skip
def test_a_disk_that_is_full_is_reported_by_the_name_of_the_output(tracked, said, monkeypatch, command, output):
    copy(tracked, "run")
    monkeypatch.setattr(sys, "dont_write_bytecode", True)  # Python itself would keep a compiled module that is cut off
    limits = resource.getrlimit(resource.RLIMIT_FSIZE)
    resource.setrlimit(resource.RLIMIT_FSIZE, (100, limits[1]))
    try:
        error = said(command, code=FAILED).err
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, limits)
    assert f"error: {output}: File too large; make room there, or choose another place\n" in error
    assert not Path(output).exists()


def test_the_name_of_an_input_may_be_no_utf8(here):
    Path("log.mcap").rename(name := "log\udcff.mcap")
    for command in ("learn -o new --tessellation grid --cell-size 8", "track --map map.mcap -o out --particles 20"):
        assert dirprim(command, name) == DONE
    assert any(key == "sha256 log\\udcff.mcap" for key in metadata_of(Path("new")))


def test_inputs_of_one_name_have_a_checksum_each(tmp_path):
    for folder in "ab":
        (tmp_path / folder).mkdir()
        (tmp_path / folder / "log.mcap").write_text(folder)
    sums = provenance("learn", inputs=[tmp_path / "a" / "log.mcap", tmp_path / "b" / "log.mcap"])
    assert sum(name.startswith("sha256 ") for name in sums) == 2


@pytest.mark.parametrize("closed", ["| head -1", ">&-", "2>&-", "2>&1 >/dev/null | true"])
def test_a_command_whose_texts_nobody_reads_ends_well_and_its_output_is_whole(here, closed):
    shell = f"set -o pipefail; {sys.executable} -m dirprim_filter recover log.mcap -o whole.mcap {closed}"
    done = subprocess.run(["bash", "-c", shell], capture_output=True, check=False)
    assert done.returncode == DONE
    with scan("whole.mcap") as messages:
        assert sum(1 for _ in messages) > 0
        assert not messages.damage


def texts(n):
    """What a topic of n letters may be called, so that a search for URLs begins again and again."""
    return {
        "letters": "a" * n, "schemes": "a:" * (n // 2), "slashes": "a:/" * (n // 3), "half": "http:/" + "." * n,
        "users": "a://" + "b@" * (n // 2), "queries": "a://b" + "?c=d" * (n // 4),
    }  # fmt: skip


@pytest.mark.parametrize("name", list(texts(1)))
def test_cleaning_a_text_takes_time_as_it_is_long(name):
    def seconds(text):
        begun = process_time()
        one_line(text)
        return process_time() - begun

    short, long = (min(seconds(texts(n)[name]) for _ in range(5)) for n in (20_000, 200_000))
    assert long < 40 * short  # ten times, and a hundred where it is quadratic
