"""The page of results is what its script writes from the stored figures, and every figure has its command."""

import importlib
import json
import re
import subprocess
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
        "command": maker.command_of(table, run), "commit": "abc1234", "date": "2026-01-01",
        "versions": {}, "figures": {"prior": [1.0] * len(table.columns)},
    } | changes  # fmt: skip


def test_the_page_is_what_the_stored_figures_say_with_a_place_for_every_table(maker):
    for made, path in ((maker.page(), maker.PAGE), (maker.readme(), maker.README)):
        assert made == path.read_text(), "run `python docs/make_results.py`"
    assert sorted(maker.PLACE.findall(maker.TEXT.read_text())) == sorted(["summary", "logs", *maker.TABLES])
    one = {"name": "a", "low": 1.0, "chosen": 2.0, "high": 4.0}
    assert maker.settings_of({"methods": [{"settings": [[one]]}, {"x": [{"constant velocity": [one]}]}]}) == [one, one]


def test_every_stored_figure_has_the_command_of_its_run_and_a_column(maker):
    assert {path.stem for path in maker.STORE.glob("*.json")} <= set(maker.TABLES)
    for name, table in maker.TABLES.items():
        runs = {run.name: run for run in table.runs}
        for run, found in maker.stored(name).items():
            assert found["command"] == maker.command_of(table, runs[run]), f"{name}/{run}: run it again"
            assert {"commit", "date", "versions"} <= set(found)
            assert all(len(figures) == len(table.columns) for figures in found["figures"].values())
            assert found["figures"], f"{name}/{run}"


def test_no_stored_rival_lies_on_a_bound_of_what_was_searched(maker):
    stored = [record for name in maker.TABLES for record in maker.stored(name).values()]
    settings = [setting for record in stored for setting in record.get("settings", [])]
    for setting in settings:
        assert setting["low"] < setting["chosen"] < setting["high"], setting


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


def test_a_difference_is_bold_where_its_interval_does_not_hold_nought(elsewhere):
    beyond, within = {"value": 12.0, "low": 3.0, "high": 21.0}, {"value": -1.0, "low": -3.0, "high": 1.0}
    nothing = {"value": 0.0, "low": 0.0, "high": 0.0}
    figures = {
        "prior": [0.5, 0.25, nothing, nothing, nothing, None, "0.50 to 0.56", "0.88 to 0.91"],
        "constant velocity": [0.75, 1234.5, beyond, within, {"value": 2.0, "low": None, "high": None}, None, "", ""],
    }
    elsewhere.store("forecasts", {"roundabout": record(elsewhere, "forecasts", figures=figures), "no such run": {}})
    shown = elsewhere.page()
    for line in (
        "|prior|0.50/0.25/0.50-0.56/0.88-0.91|", "|constant velocity|0.75/1,234.50//|",
        "|constant velocity|**+12**±9/+2/|", "`, abc1234 (2026-01-01)",
        "|forecasts 5 s ahead|roundabout|constant velocity|+2 %|",
    ):  # fmt: skip
        assert line in shown
    assert "`dirprim evaluate forecast LOG --folds 4" in shown
    assert len(json.loads((elsewhere.STORE / "forecasts.json").read_text())) == 1


def test_what_the_first_method_gains_on_a_smoothed_one_is_not_said_of_another_whose_name_that_begins_with(maker):
    first, smoothed = "with the map", "with the map, smoothed"
    table = {"rows": {first: {}, smoothed: {}}, "gains": {f"{first} against {smoothed}, more HOTA": {"value": -1.0}}}
    found = maker.TABLES["neutral_boxes"].entries(json.dumps({"mot17 (five seeds): HOTA": table}))
    assert [row["gain"] for row in found.values()] == [None, {"value": -1.0}]


def test_what_has_no_data_is_skipped_and_what_fails_keeps_its_figures(elsewhere, tmp_path, capsys, monkeypatch):
    assert elsewhere.run_tables(["forecasts/roundabout"], tmp_path)
    assert f"forecasts/roundabout: skipped, no {tmp_path / 'town03/roundabout.csv'}" in capsys.readouterr().err
    before = {"roundabout": record(elsewhere, "forecasts")}
    elsewhere.store("forecasts", before)
    monkeypatch.setattr(elsewhere, "absent", lambda *_: [])
    monkeypatch.setattr(elsewhere, "logs_of", lambda _: [])

    def never_ends(command, *_, timeout=None, **options):
        if timeout is None:
            return real(command, **options)
        raise subprocess.TimeoutExpired("dirprim", timeout)

    real = subprocess.run
    monkeypatch.setattr(elsewhere.subprocess, "run", never_ends)
    assert not elsewhere.run_tables(["forecasts/roundabout"], tmp_path)
    assert "stopped after 60 minutes" in capsys.readouterr().err
    assert elsewhere.stored("forecasts") == before
