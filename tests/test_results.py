"""The page of results is what its script writes from the stored figures, and every figure has its command."""

import importlib
import json
import re
import subprocess
from dataclasses import replace
from pathlib import Path

import pytest

DOCS = Path(__file__).parents[1] / "docs"


@pytest.fixture
def maker(monkeypatch):
    monkeypatch.syspath_prepend(str(DOCS))
    return importlib.import_module("make_results")


def record(maker, name, **changes):
    """A record as a run of a table makes one."""
    table = maker.TABLES[name]
    run = table.runs[0]
    return {
        "command": maker.command_of(table, run), "commit": "abc1234", "date": "2026-01-01", "seconds": 61,
        "versions": {}, "code": {}, "changed": "", "figures": {"prior": [1.0] * len(table.columns)},
    } | changes  # fmt: skip


def test_the_page_is_what_the_stored_figures_say(maker):
    assert maker.page() == maker.PAGE.read_text(), "run `python docs/make_results.py --page`"


def test_the_text_has_a_place_for_every_table(maker):
    assert maker.PLACE.findall(maker.TEXT.read_text()) == ["logs", *maker.TABLES]


def test_every_stored_figure_has_the_command_of_its_run_and_a_column(maker):
    assert {path.stem for path in maker.STORE.glob("*.json")} <= set(maker.TABLES)
    for name, table in maker.TABLES.items():
        runs = {run.name: run for run in table.runs}
        for run, found in maker.stored(name).items():
            assert found["command"] == maker.command_of(table, runs[run]), f"{name}/{run}: run it again"
            assert {"commit", "date", "seconds", "versions", "code"} <= set(found)
            assert all(len(figures) == len(table.columns) for figures in found["figures"].values())
            assert found["figures"], f"{name}/{run}"


def test_every_log_that_a_command_names_is_made_and_after_what_it_is_made_of(maker):
    for table in maker.TABLES.values():
        for run in table.runs:
            command = maker.command_of(table, run)
            assert set(re.findall(r"\w+\.mcap", command)) <= set(maker.logs_of(command))
    assert maker.logs_of("x highway_track.mcap --map highway_map.mcap") == [
        "highway_learn.mcap", "highway_map.mcap", "highway_track.mcap",
    ]  # fmt: skip


@pytest.fixture
def elsewhere(maker, tmp_path, monkeypatch):
    """Stored figures and a page of their own."""
    monkeypatch.setattr(maker, "STORE", tmp_path)
    monkeypatch.setattr(maker, "PAGE", tmp_path / "results.md")
    return maker


def test_the_best_is_bold_and_what_has_changed_is_said(elsewhere):
    figures = {
        "prior": [0.5, None, 0.125, 0.5, [2.0, 0.25], [0.8, 0.9]],
        "one cell": [0.75, 1, 0.5, 0.5, 3.0, [0.7, 1]],
    }
    changed = record(elsewhere, "forecasts", figures=figures, changed="def5678 of 2026-02-02")
    elsewhere.store("forecasts", {"roundabout": changed, "of no such run": changed})
    shown = elsewhere.page()
    assert "| roundabout | prior | **0.500** |  | **0.125** | **0.500** | 2.00 +- 0.25 | 0.80 to 0.90 |" in shown
    assert "|  | one cell | 0.750 | 1.000 | 0.500 | **0.500** | 3.00 | 0.70 to 1.00 |" in shown
    assert "61 s; **older than its code**, which def5678 of 2026-02-02 changed" in shown
    assert "of no such run" not in shown
    assert len(json.loads((elsewhere.STORE / "forecasts.json").read_text())) == 1


def test_code_that_differs_from_the_stored_one_is_reported_with_its_last_commit(maker, monkeypatch):
    said = {"status": "", "rev-parse": "aaaa", "log": "def5678 of 2026-02-02"}
    monkeypatch.setattr(maker, "git", lambda command, *_: said[command])
    table = replace(maker.TABLES["forecasts"], code=("one",))
    assert maker.changed(table, {"code": {"one": "aaaa"}}) == ""
    assert maker.changed(table, {"code": {"one": "bbbb"}}) == said["log"]
    said["status"] = " M one"
    assert maker.code_of(table) == {}, "what is not committed is no one's"
    assert maker.changed(table, {"code": maker.code_of(table)}) == said["log"]


def test_what_has_no_data_is_skipped_and_what_fails_keeps_its_figures(elsewhere, tmp_path, capsys, monkeypatch):
    assert elsewhere.run_tables(["forecasts/roundabout"], tmp_path)
    assert f"forecasts/roundabout: skipped, no {tmp_path / 'town03/roundabout.csv'}" in capsys.readouterr().err
    before = {"roundabout": record(elsewhere, "forecasts")}
    elsewhere.store("forecasts", before)
    monkeypatch.setattr(elsewhere, "absent", lambda *_: [])

    def never_ends(*_, timeout, **__):
        raise subprocess.TimeoutExpired("dirprim", timeout)

    monkeypatch.setattr(elsewhere.subprocess, "run", never_ends)
    assert not elsewhere.run_tables(["forecasts/roundabout"], tmp_path)
    assert "stopped after 30 minutes" in capsys.readouterr().err
    assert elsewhere.stored("forecasts") == before


def test_a_table_that_does_not_exist_is_named(maker):
    for wrong in ("luck", "forecasts/luck"):
        with pytest.raises(SystemExit, match=f"{wrong}: expected one of densities"):
            list(maker.chosen([wrong]))


def test_figures_are_read_from_what_commands_print(maker):
    figures = importlib.import_module("result_figures")
    reports = [{"hota": 0.5, "switches": 1}, {"hota": 0.7, "switches": 3}]
    printed = json.dumps({"methods": [{"name": "prior", "reports": reports, "by_group": [reports, reports[:1]]}]})
    prior = figures.methods(printed)["prior"]
    assert figures.mean_of("hota")(prior) == pytest.approx([0.6, 0.1 * 2**0.5])
    assert figures.most_in_a_group("switches")(prior) == 3
    speed = figures.printed(step=r"whole +([\d.]+) ms +([\d,]+)")("ours, whole   2.5 ms 1,200")
    assert [figures.group(i)(speed["step"]) for i in range(3)] == [2.5, 1200.0, None]
    with pytest.raises(ValueError, match="step: nothing of the kind"):
        figures.printed(step="whole")("half")
    assert maker.rounded([1 / 3, None]) == [0.333333, None]
