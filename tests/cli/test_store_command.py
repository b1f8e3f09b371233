"""`dirprim store` and `dirprim learn STORE`, from the command line to a map."""

import json

import numpy as np
import pytest
import typer

from dirprim_filter import load_map, write_tracks
from dirprim_filter.cli.main import app as whole_program
from dirprim_filter.cli.main import run
from dirprim_filter.cli.store import store as store_commands
from dirprim_filter.recording.reader import ReadOptions
from dirprim_filter.store.config import StoreConfig
from situations import ring_traffic


@pytest.fixture
def logs(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    for seed in range(2):
        write_tracks(ring_traffic(np.random.default_rng(seed), n_vehicles=6, n_rows=40), tmp_path / f"{seed}.mcap")
    return tmp_path


def test_a_store_is_made_told_learned_from_and_forgotten_from(logs, capsys):
    assert run(["store", "add", "fleet", "*.mcap"]) == 0
    assert "added 2 logs, 240 rows; 0 known, 0 failed" in capsys.readouterr().out
    assert run(["store", "add", "fleet", "0.mcap", "1.mcap"]) == 0
    assert "added 0 logs, 0 rows; 2 known" in capsys.readouterr().out
    assert run(["store", "info", "fleet", "--json"]) == 0
    assert json.loads(capsys.readouterr().out)["rows"] == 240
    grid = ["--tessellation", "grid", "--cell-size", "10"]
    assert run(["store", "learn", "fleet", "-o", "map.mcap", "--min-vehicles", "3", *grid]) == 0
    assert "from 2 logs, 240 rows; 1 of 1 block learned anew" in capsys.readouterr().out
    assert run(["store", "merge", "other", "fleet"]) == 0
    assert run(["store", "learn", "other", "-o", "same.mcap", "--min-vehicles", "3", *grid]) == 0
    assert (logs / "map.mcap").read_bytes() == (logs / "same.mcap").read_bytes()
    assert load_map("map.mcap").motion.n_placed > 0
    before = (logs / "map.mcap").read_bytes()
    assert run(["store", "update", "map.mcap", "fleet", "-o", "copy.mcap"]) == 0
    assert run(["store", "update", "map.mcap", "fleet"]) == 0
    assert "0 of 1 block learned anew" in capsys.readouterr().out
    assert before == (logs / "map.mcap").read_bytes() == (logs / "copy.mcap").read_bytes()
    assert run(["store", "update", "map.mcap", "fleet", "-o", "copy.mcap"]) == 1
    assert "copy.mcap" in capsys.readouterr().err
    assert run(["store", "forget", "fleet", "0.mcap"]) == 0
    assert run(["update", "copy.mcap", "fleet"]) == 0
    assert "`dirprim update` is now `dirprim store update`" in capsys.readouterr().err
    assert (logs / "copy.mcap").read_bytes() != before
    assert run(["store", "update", "copy.mcap", "other"]) == 0
    assert (logs / "copy.mcap").read_bytes() == before
    capsys.readouterr()
    assert run(["store", "info", "fleet"]) == 0
    assert "1 log of 1 recording, 120 rows, 6 vehicles" in capsys.readouterr().out


@pytest.mark.parametrize(
    ("arguments", "said"),
    [
        (["store", "learn", "fleet", "-o", "m.mcap", "--min-vehicles", "20"], "20 vehicles passed the same way"),
        (["learn", "fleet", "1.mcap", "-o", "m.mcap"], "a store is learned from alone"),
        (["learn", "fleet", "-o", "m.mcap", "--topics", "x"], "fixes how its logs are read"),
        (["store", "learn", "0.mcap", "-o", "m.mcap"], "expected a store"),
        (["store", "learn", "fleet", "-o", "m.mcap", "--now", "3"], "expected --half-life with it"),
        (["store", "add", "fleet", "1.mcap", "--frame", "odom"], "expected frame None"),
        (["store", "add", "fleet", "absent.mcap"], "absent.mcap: No such file"),
        (["store", "forget", "fleet", "1.mcap"], "is not in the store"),
        (["store", "info", "absent"], "expected a store, found none"),
        (["store", "update", "of_log.mcap", "fleet"], "expected a map of a store"),
    ],
    ids=lambda value: " ".join(value) if isinstance(value, list) else "",
)
def test_what_cannot_be_done_is_said_in_one_line(logs, capsys, arguments, said):
    assert run(["store", "add", "fleet", "0.mcap"]) == 0
    if "of_log.mcap" in arguments:
        assert run(["learn", "0.mcap", "-o", "of_log.mcap", "--tessellation", "grid", "--cell-size", "10"]) == 0
    capsys.readouterr()
    assert run(arguments) == 1
    told = capsys.readouterr().err
    assert said in told
    assert told.startswith("error: ")
    assert told.count("\n") == 1


def test_fewer_vehicles_of_a_month_are_kept(logs, capsys):
    assert run(["store", "add", "fleet", "*.mcap"]) == 0
    assert run(["store", "keep", "fleet"]) == 0
    assert "nothing to thin" in capsys.readouterr().out
    assert run(["store", "keep", "fleet", "--of-month", "1970-01", "--vehicles", "100"]) == 0
    assert "fleet: 1970-01, 12 of 12 vehicles kept" in capsys.readouterr().out
    assert run(["store", "forget", "fleet", "0.mcap", "1.mcap"]) == 0
    assert not any((logs / "fleet" / "rows").iterdir())


def test_of_a_damaged_store_the_rest_is_learned_from_and_the_exit_code_says_so(logs, capsys):
    assert run(["store", "add", "fleet", "*.mcap"]) == 0
    first = min((logs / "fleet" / "rows").iterdir())
    data = bytearray(first.read_bytes())
    data[100] ^= 1
    first.write_bytes(data)
    capsys.readouterr()
    assert run(["learn", "fleet", "-o", "map.mcap", "--tessellation", "grid", "--cell-size", "10"]) == 3
    told = capsys.readouterr().err
    assert told.startswith("error: ")
    assert ".mcap is damaged in the store" in told
    assert load_map("map.mcap").tessellation.n_cells > 0


def test_durations_have_a_unit(logs, capsys):
    assert run(["store", "add", "fleet", "0.mcap"]) == 0
    for wrong in ("30", "-1d", "d", "nand"):
        assert run(["store", "learn", "fleet", "-o", "m.mcap", "--half-life", wrong]) == 2
        assert "expected a positive duration such as 12h, 30d or 2w" in " ".join(capsys.readouterr().err.split())


def test_one_log_that_fails_does_not_hide_that_others_were_added(logs, capsys):
    (logs / "2.mcap").write_text("no log")
    assert run(["store", "add", "fleet", "*.mcap"]) == 1
    told = capsys.readouterr()
    assert "added 2 logs" in told.out
    assert "2.mcap" in told.err


def test_what_several_commands_take_is_one_option_and_logs_are_read_as_everywhere():
    commands = typer.main.get_command(store_commands).commands
    learn, of_store = typer.main.get_command(whole_program).commands["learn"], commands["learn"]
    for one, other in ((learn, of_store), (commands["add"], of_store), (commands["update"], of_store)):
        ours, theirs = ({p.name: (p.opts, p.help, p.default) for p in each.params if p.param_type_name == "option"}
                        for each in (one, other))  # fmt: skip
        shared = ours.keys() & theirs.keys() - {"output"}  # of `update` in the place of the map
        assert len(shared) >= 2
        assert {name: ours[name] for name in shared} == {name: theirs[name] for name in shared}
    assert StoreConfig().reading == ReadOptions()
