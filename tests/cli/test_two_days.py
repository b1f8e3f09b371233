"""Two days of a crossing in latitude and longitude: whatever meets the first day's log is on its plane, or refused."""

import re
from pathlib import Path
from shutil import copytree

import numpy as np
import pytest

from cli.commands import DONE, FAILED, GRID, dirprim
from dirprim_filter import load_map, read_estimates, read_tracks
from dirprim_filter.origin import _topocentric
from dirprim_filter.recording.tables.files import cells_of

pytest.importorskip("pyproj", reason="the extra geo is not installed")


@pytest.fixture(scope="module")
def made(tmp_path_factory):
    """Day 1 begins on the one road, day 2 on the other, 170 m away; and the map of day 1."""
    folder = tmp_path_factory.mktemp("days")
    for name, first in (("day1.csv", 0), ("day2.csv", 1)):
        rng, rows = np.random.default_rng(first), []
        for i in range(6):
            for k in range(45):
                along = np.array([-120 + 5.0 * k, 0.0])[:: 1 if (i + first) % 2 else -1]
                north, east = along + rng.normal(0, 0.2, 2)
                rows.append((4 * i + 0.5 * k, i, 48.1 + north / 111200, 11.5 + east / 74400))
        lines = [f"{t},v{i},{latitude:.8f},{longitude:.8f}" for t, i, latitude, longitude in sorted(rows)]
        (folder / name).write_text("\n".join(["time_s,track_id,latitude_deg,longitude_deg", *lines]))
    lines = ["time_s,track_id,x_m,y_m", *(f"{k},v,{5 * k},0" for k in range(9))]
    (folder / "metres.csv").write_text("\n".join(lines))
    assert dirprim(f"learn {folder}/day1.csv -o {folder}/map.mcap {GRID}") == DONE
    return folder


@pytest.fixture
def days(made, tmp_path, monkeypatch):
    """The working folder, with copies of all of it."""
    copytree(made, tmp_path, dirs_exist_ok=True)
    monkeypatch.chdir(tmp_path)


TRACK = "--map map.mcap -o out.mcap --noise 0.3 --particles 30 --force"


def test_the_second_day_is_on_the_plane_of_the_map_and_comes_out_in_degrees(days, said):
    origin = load_map("map.mcap").origin
    assert dirprim("convert day2.csv -o day2.mcap") == DONE  # with an origin of its own
    assert read_tracks("day2.mcap").origin not in (None, origin)
    for log in ("day2.csv", "day2.mcap"):
        shown = said(f"track {log} {TRACK}")
        assert f"map.mcap: origin {origin}, of the logs" in shown.err
        assert float(re.search(r"([\d.]+)% outside the map", shown.out)[1]) < 10
        assert read_estimates("out.mcap").origin == origin
    assert dirprim("export out.mcap -o out.csv") == DONE
    degrees = cells_of(Path("out.csv")).numbers(("latitude_deg", "longitude_deg"))
    np.testing.assert_allclose(degrees, origin.to_globe(read_estimates("out.mcap").position), atol=1e-9)
    for command in (
        "score out.mcap out.csv --truth day2.csv", "smooth out.csv --map map.mcap -o smooth.mcap --particles 30",
        "plot map.mcap -o map.png --log day2.csv --estimates out.mcap",
    ):  # fmt: skip
        assert dirprim(command) == DONE
    assert read_estimates("smooth.mcap").origin == origin


def test_a_store_has_the_origin_of_its_first_log(days, refused):
    pytest.importorskip("deltalake", reason="the extra fleet is not installed")
    for command in ("store add fleet day1.csv", "store add fleet day2.csv", f"learn fleet -o both.mcap {GRID}"):
        assert dirprim(command) == DONE
    assert load_map("both.mcap").origin == load_map("map.mcap").origin
    refused("store add fleet metres.csv", "expected latitudes and longitudes")


@pytest.mark.parametrize("command", ["track", "smooth"])
def test_a_log_of_another_country_is_refused_and_what_is_there_stays(days, refused, command):
    Path("far.csv").write_text(Path("day2.csv").read_text().replace(",48.", ",52."))
    Path("out.mcap").write_text("of another run")
    expected = "far.csv: expected moving objects, got none; left out: 270 rows that are no lat"
    refused(f"{command} far.csv {TRACK}", expected)
    assert Path("out.mcap").read_text() == "of another run"


def test_another_plane_is_refused(days, refused, monkeypatch):
    origin = load_map("map.mcap").origin
    assert dirprim(f"learn metres.csv -o plain.mcap {GRID}") == DONE
    for command, text in (
        (f"track metres.csv {TRACK}", f"say --set origin={origin}"),
        (f"track day2.csv {TRACK} --set origin=48,11", "map.mcap: expected origin 48.0,11.0, as --set origin=... st"),
        (f"track day2.csv {TRACK.replace('map.mcap', 'plain.mcap')}", "as of plain.mcap, which has no origin"),
        ("learn day1.csv metres.csv -o x", "metres.csv: expected latitudes and longitudes, as day1.csv has the origin"),
    ):
        refused(command, text)
    assert dirprim(f"track metres.csv {TRACK} --set origin={origin}") != FAILED
    monkeypatch.setitem(__import__("sys").modules, "pyproj", None)
    _topocentric.cache_clear()
    for command in (f"track day2.csv {TRACK}", "export out.mcap -o out.csv"):
        refused(command, "pip install 'dirprim-filter[geo]'")
