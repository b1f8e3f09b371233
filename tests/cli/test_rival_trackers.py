"""`dirprim evaluate tracking` with trackers of others: commands and tables, in the same table as ours."""

import csv
import json
import shlex
import sys
import time
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from cli.commands import USAGE
from dirprim_filter import Tracks, write_tracks

ECHO = """
import csv, shutil, sys
rows = [{"track_id": i} | row for i, row in enumerate(csv.DictReader(open(sys.argv[1])))]
with open(sys.argv[2], "w") as file:
    table = csv.DictWriter(file, rows[0])
    table.writeheader()
    table.writerows(rows)
if len(sys.argv) > 3:
    shutil.copy(sys.argv[2], "theirs_seed%s.csv" % sys.argv[3])
"""
QUICK = "evaluate tracking few.mcap --gap 0.5 --seeds 2 --method 'constant velocity'"
ON = "{detections} {estimates}"


@pytest.fixture
def folder(ring, tmp_path, monkeypatch):
    """A log, a tracker that says what it sees, and a folder for temporary files."""
    monkeypatch.chdir(tmp_path)
    write_tracks(ring[(ring.track_id < 8) & (ring.time_ns < 5e9)], "few.mcap")
    Path("echo.py").write_text(ECHO)
    Path("temporary").mkdir()
    monkeypatch.setattr("tempfile.tempdir", str(tmp_path / "temporary"))
    return tmp_path


def by_script(name, *arguments, of="theirs"):
    return ["--method", f"{of}={shlex.join([sys.executable, name])} {' '.join(arguments) or ON}"]


@pytest.fixture
def methods(said):
    """The reports of an experiment by the names of its methods."""
    return lambda *command: {row["name"]: row["reports"] for row in json.loads(said(*command).out)["methods"]}


def test_a_command_is_a_row_beside_ours_and_its_tables_give_the_same_figures(folder, methods):
    first = methods(f"{QUICK} --json", *by_script("echo.py", ON, "{seed}"))
    assert list(first) == ["constant velocity", "theirs"]
    for report in first["theirs"]:
        assert report["seen_rmse"] == pytest.approx(0.5 * 2**0.5, rel=0.3)  # of what is seen, and nothing in gaps
        assert report["seen_nees"] == pytest.approx(2.0, abs=0.8)
        assert report["hidden_rmse"] is None
        assert 0.5 < report["reported"] < 1.0
    assert not list(Path("temporary").iterdir())
    assert methods(f"{QUICK} --json --estimates theirs_seed{{seed}}.csv") == {
        "constant velocity": first["constant velocity"],
        "theirs_seed{seed}.csv": first["theirs"],
    }


def test_tables_for_papers_and_a_picture_have_all_methods(folder, said, refused):
    command, theirs = f"{QUICK} --seeds 1 --no-ids", by_script("echo.py", of="100%_theirs|x")
    head, ruler, *rows = said(f"{command} --markdown --plot out.pdf", *theirs).out.splitlines()
    assert head.startswith("| method | HOTA | AssA | IDF1 |")
    assert [line.replace("\\|", "").count("|") for line in (ruler, *rows)] == [head.count("|")] * 3
    assert rows[1].startswith("| 100%_theirs\\|x | 0.")
    assert Path("out.pdf").read_bytes().startswith(b"%PDF")
    drawn = list(csv.DictReader(Path("out.csv").read_text().splitlines()))
    assert {row["panel"] for row in drawn} == {"time", "reliability", "map", "method"}
    assert {row["method"] for row in drawn if row["panel"] != "map"} == {"constant velocity", "100%_theirs|x"}
    printed = [float(row.replace("\\|", "").split("|")[2]) for row in rows]
    assert [float(row["value"]) for row in drawn if row["panel"] == "method"] == pytest.approx(printed, abs=5e-4)
    begin, *lines, end = said(f"{command} --latex", *theirs).out.splitlines()
    assert (begin, end) == ("\\begin{tabular}{lrrrrrr}", "\\end{tabular}")
    assert lines[-2].startswith("100\\%\\_theirs|x & 0.")
    assert [line.count(" & ") for line in lines if line.endswith(" \\\\")] == [6, 6, 6]
    refused(f"{command} --latex --json", "expected one of --json, --markdown and --latex", code=USAGE)
    for name in ("out.pdf", "out.png"):  # it is there, or its data are
        refused(f"{command} --plot {name}", "--force")
    Path("few.csv").write_text("time_s,track_id,x_m,y_m\n0,a,0,0\n1,a,1,0\n")
    refused("evaluate tracking few.csv --plot few.pdf --force", "few.csv: is an input of this command")


def test_a_group_is_a_recording_of_its_own(ring, folder, methods):
    few = ring[ring.track_id < 4]
    groups = [replace(few, group=np.full(len(few), group)) for group in range(4)]
    write_tracks(Tracks.concatenate(groups), "groups.mcap")
    Path("at_all.py").write_text("""
import csv, sys
seen, asked, out = sys.argv[1:]
rows = list(csv.DictReader(open(seen)))
known = {(row["group"], row["time_s"]) for row in csv.DictReader(open(asked))}
assert {(row["group"], row["time_s"]) for row in rows} <= known and {row["group"] for row in rows} != {"0"}
table = csv.writer(open(out, "w"))
table.writerow(["time_s", "group", "track_id", "x_m", "y_m"])
table.writerows([time_s, group, "one", 0, 0] for group, time_s in known)
""")
    command = "evaluate tracking groups.mcap --no-ids --seeds 1 --set learn=0.5 --method 'constant velocity' --json"
    found = methods(command, *by_script("at_all.py", "{detections} {instants} {estimates}"))
    assert found["theirs"][0]["switches"] == 0


@pytest.mark.parametrize(
    ("script", "why"),
    [
        ("import sys; print('why', file=sys.stderr); print('the last line', file=sys.stderr); sys.exit(7)",
         "ended with 7: the last line"),
        ("raise KeyError('no such column')", "ended with 1: KeyError: 'no such column'"),
        ("import os; os.kill(os.getpid(), 9)", "ended with -9: it reported nothing"),
        ("pass", "ended well and wrote no {estimates}"),
        ("import sys; open(sys.argv[2], 'wb').write(bytes(range(256)))", "{estimates}"),
        ("import sys; open(sys.argv[2], 'w').write('time_s,track_id\\n1,2\\n')", "{estimates}"),
        ("import sys; open(sys.argv[2], 'w').write('time_s,track_id,x_m,y_m\\n1,2,far,away\\n')", "{estimates}"),
        ("import sys; open(sys.argv[2], 'w').write('time_s,track_id,x_m,y_m\\n' + 2 * '1,2,3,4\\n')", "{estimates}"),
        ("import sys; open(sys.argv[2], 'wb').write(b'\\x89MCAP0\\r\\n' + bytes(9))", "{estimates}"),
    ],
)  # fmt: skip
def test_what_fails_is_one_line_and_leaves_nothing(folder, refused, script, why):
    Path("broken.py").write_text(script)
    before = sorted(folder.iterdir())
    assert str(folder) not in refused(QUICK, f"error: theirs, seed 0: {why}", *by_script("broken.py"))
    assert sorted(folder.iterdir()) == before
    assert not list(Path("temporary").iterdir())


def test_a_command_that_takes_too_long_is_stopped_with_all_that_it_started(folder, refused):
    Path("slow.sh").write_text("sleep 60 & echo $! > started; wait")
    command = f"{QUICK} --set time_limit_s=1"
    refused(command, "theirs, seed 0: stopped after 1 s", "--method", f"theirs=sh slow.sh {ON}")
    process, until = Path("/proc", Path("started").read_text().strip(), "stat"), time.monotonic() + 20.0
    while process.exists() and process.read_text().rpartition(")")[2].split()[0] != "Z":
        assert time.monotonic() < until
        time.sleep(0.02)


def test_what_cannot_work_is_refused_before_the_work(folder, refused):
    for more, why in (
        (["--method", "theirs=true {estimates}"], "theirs: expected a command with {detections} and {estimates}"),
        (["--method", f"theirs=no_such_program {ON}"], "no_such_program: there is no such program"),
        (["--method", f"theirs=python 'open {ON}"], "No closing quotation"),
        (["--method", f"=true {ON}"], "expected another name for each row, got ''"),
        (["--method", f"prior=true {ON}", "--method", "prior"], "another name for each row, got 'prior'"),
        (["--method", f"a=true {ON}", "--method", f"a=true {ON}"], "another name for each row, got 'a'"),
        (["--estimates", "few.csv"], "few.csv: expected {seed} in its name, for there are 2 runs"),
        (["--estimates", "few_{seed}.csv"], "few_0.csv: there is no such file"),
        (["--set", "time_limit_s=0", "--method", f"a=true {ON}"], "time_limit_s"),
    ):
        refused(QUICK, why, *more, code=USAGE)
