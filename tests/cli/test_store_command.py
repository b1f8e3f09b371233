"""`dirprim store` and `dirprim learn STORE`, from the command line to a map."""

import json
from pathlib import Path

import numpy as np
import pytest

from cli.commands import DONE, FAILED, GRID, INPUT_LOST, dirprim
from dirprim_filter import load_map, write_tracks
from situations import ring_traffic


@pytest.fixture
def logs(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    for seed in range(2):
        write_tracks(ring_traffic(np.random.default_rng(seed), n_vehicles=6, n_rows=40), tmp_path / f"{seed}.mcap")
    return tmp_path


def test_a_store_is_made_told_learned_from_and_forgotten_from(logs, said):
    def done(command):
        return "".join(said(command))

    assert "added 2 logs, 240 rows; 0 known, 0 failed" in done("store add fleet '*.mcap'")
    assert "added 0 logs, 0 rows; 2 known" in done("store add fleet 0.mcap 1.mcap")
    assert json.loads(done("store info fleet --json"))["rows"] == 240
    learn = f"{GRID} --min-vehicles 3"
    assert "from 2 logs, 240 rows; 1 of 1 block learned anew" in done(f"store learn fleet -o map {learn}")
    done("store merge other fleet")
    done(f"store learn other -o same {learn}")
    before = Path("map").read_bytes()
    assert before == Path("same").read_bytes()
    assert load_map("map").motion.n_placed > 0
    done("store update map fleet -o copy")
    assert "0 of 1 block learned anew" in done("store update map fleet")
    assert before == Path("map").read_bytes() == Path("copy").read_bytes()
    assert dirprim("store update map fleet -o copy") == FAILED
    done("store forget fleet 0.mcap")
    done("store update copy fleet")
    assert Path("copy").read_bytes() != before
    done("store update copy other")
    assert Path("copy").read_bytes() == before
    assert "1 log of 1 recording, 120 rows, 6 vehicles" in done("store info fleet")


@pytest.mark.parametrize(
    ("command", "text"),
    [
        ("store learn fleet -o m --min-vehicles 20", "20 vehicles passed the same way"),
        ("learn fleet 1.mcap -o m", "a store is learned from alone"),
        ("learn fleet -o m --topics x", "fixes how its logs are read"),
        ("store add fleet 1.mcap --set frame=odom", "expected no frame"),
        ("store add fleet absent.mcap", "absent.mcap: No such file"),
        ("store forget fleet 1.mcap", "is not in the store"),
    ],
)  # fmt: skip
def test_what_cannot_be_done_is_said_in_one_line(logs, refused, command, text):
    assert dirprim("store add fleet 0.mcap") == DONE
    assert refused(command, text).startswith("error: ")


def test_of_logs_one_that_fails_does_not_stop_the_others(logs, said):
    Path("none.mcap").write_text("no log")
    shown = said("store add fleet none.mcap 1.mcap", code=FAILED)
    assert "added 1 log" in shown.out
    assert shown.err.startswith("error: ")
    assert shown.err.count("\n") == 1
    assert "none.mcap" in shown.err


def test_fewer_vehicles_of_a_month_are_kept(logs, said):
    assert dirprim("store add fleet '*.mcap'") == DONE
    assert "nothing to thin" in said("store keep fleet").out
    assert "fleet: 1970-01, 12 of 12 vehicles kept" in said("store keep fleet --of-month 1970-01 --vehicles 100").out


def test_of_a_damaged_store_the_rest_is_learned_from_and_the_exit_code_says_so(logs, said):
    assert dirprim("store add fleet '*.mcap'") == DONE
    first = min((logs / "fleet" / "rows").iterdir())
    data = bytearray(first.read_bytes())
    data[100] ^= 1
    first.write_bytes(data)
    error = said(f"learn fleet -o map {GRID}", code=INPUT_LOST).err
    assert error.startswith("error: ")
    assert ".mcap is damaged in the store" in error
    assert load_map("map").tessellation.n_cells > 0
