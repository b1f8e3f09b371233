"""What cannot be done is said in one line, by its exit code, and nothing is written."""

import subprocess
import sys
from pathlib import Path

import pytest

from cli.commands import FAILED, USAGE

TRACK = "track log.mcap --map map.mcap -o x"
STRAIGHT = "track log.mcap -o x --motion constant-velocity"
HEAD = "time_s,track_id,x_m,y_m"
SENSOR = "[along]\nspread_m = 0.4\n[across]\nspread_m = 0.2\n"
FILES = {
    "kmh.csv": f"{HEAD},speed_kmh\n0,1,2,3,50\n",
    "day.csv": "time,track_id,x_m,y_m\n31/12/2026 10:00,1,2,3\n",
    "two.csv": f"{HEAD}\n0,1,two,3\n", "early.csv": f"{HEAD}\n0,a,2,0\n-5,a,0,0\n-5.5,a,1,0\n",
    "signal.csv": f"{HEAD},turn_signal\n0,a,0,0,lft\n", "no_ids.csv": "time_s,x_m,y_m\n0,1,2\n1,2,3\n",
    "once.csv": f"{HEAD}\n0,a,0,0\n1,b,9,0\n", "seldom.csv": f"{HEAD}\n0,a,0,0\n300,a,900,0\n600,a,1800,0\n",
    "twice.csv": f"{HEAD}\n0,1,0,0\n0,1,1,1\n", "empty.mcap": "", "text.mcap": "hello, this is no log\n" * 9,
    "late.toml": f"latency_s = -1\n{SENSOR}", "sensor.toml": SENSOR,
    "cut.toml": "noise_m = ", "flat.toml": "noise_m = 1.0", "filter.toml": "[filter]\nnoise = 1.0",
    "deep.toml": f"noise_m = {'[' * 20_000}", "deep.json": f'{{"experiment": {"[" * 20_000}',
    "fold.toml": "n_fold = 2",
    "notes.txt": "noise: a lot", "walks.txt": "0 1 2 3\n10 1 3 3\n",
}  # fmt: skip
CASES = [
    ("frobnicate", USAGE, "No such command"),
    ("learn", USAGE, "Missing argument"),
    ("learn absent.mcap -o x", USAGE, "absent.mcap"),
    ("learn log.mcap -o x --tessellation hexagons", USAGE, "hexagons"),
    ("learn log.mcap -o -", USAGE, "expected the name of a file, got -"),
    ("learn map.mcap -o x", FAILED, "error: map.mcap: "),
    ("recover log.mcap -o -", USAGE, "expected the name of a file, got -"),
    ("forecast --map map.mcap --at 1 2", USAGE, "Missing option"),
    ("track log.mcap --map log.mcap -o x", FAILED, "dirprim learn"),
    (f"{TRACK} --noise 0", USAGE, "Invalid value for '--noise'"),
    (f"{TRACK} --forecast -3", USAGE, "Invalid value for '--forecast'"),
    (f"{TRACK} --smooth --lag 1", USAGE, "--smooth waits for the whole log"),
    (f"{TRACK} --noise 1 --sensor auto", USAGE, "a sensor's model contains the noise"),
    (f"{TRACK} --sensor absent.toml", USAGE, "'absent.toml' does not exist"),
    (f"{TRACK} --end 0.5 --sensor auto", FAILED, "log.mcap: --sensor auto: expected at least 8 pieces of track"),
    (f"{TRACK} --sensor late.toml", FAILED, "error: late.toml: latency_s: expected 0 to 5 seconds, got -1"),
    (f"{TRACK} --set particles_out=many", USAGE, "particles_out: expected a value of type int"),
    (f"{TRACK} --config filter.toml", FAILED, "filter: noise: expected one of"),
    (f"info log.mcap --topics {'(' * 20_000}", FAILED, "topics: expected a name or a regular expression"),
    (f"{TRACK} --start 1e999999999", FAILED, "--start: expected seconds from the start"),
    (f"{TRACK} --config flat.toml", FAILED, "flat.toml: noise_m: expected the tables"),
    ("track log.mcap -o x --set without_map=true", USAGE, "without_map is of a map"),
    ("track log.mcap -o x --set motion=true", USAGE, "motion: expected one of"),
    (f"{STRAIGHT} --set measured_motion=true", USAGE, "constant velocity takes positions alone"),
    (f"{STRAIGHT} --forecast 3", USAGE, "leave out --motion"),
    (f"{TRACK} --set acceleration_density=2", USAGE, "a map says how vehicles accelerate"),
    ("track log.mcap -o x --set acceleration_density=-1", USAGE, "acceleration_density: expected 0 to"),
    ("track log.mcap -o x --no-ids --forecast 3", USAGE, "--forecast: needs --map: with --no-ids"),
    ("track no_ids.csv -o x --forecast 3", FAILED,
     "--forecast needs --map, or a log from which motion can be learned"),
    ("learn no_ids.csv -o x", FAILED, "detections without ids; `dirprim track --no-ids`"),
    ("learn once.csv -o x", FAILED, "once.csv: expected tracks, got 2 detections without ids that come again;"),
    ("learn seldom.csv -o x", FAILED, "seldom.csv: expected rows of a vehicle at most 60 s apart, for its course"),
    ("smooth no_ids.csv --map map.mcap -o x", FAILED, "expected tracks with ids, got detections"),
    ("evaluate tracking log.mcap --set miss_rate", USAGE, "expected NAME=VALUE"),
    ("evaluate tracking log.mcap --set mis_rate=1", USAGE, "mis_rate: expected one of"),
    ("evaluate tracking log.mcap --set group=x", USAGE, "group: expected"),
    ("evaluate tracking log.mcap --config cut.toml", FAILED, "cut.toml: expected an experiment in TOML"),
    *((f"evaluate tracking log.mcap --config deep.{form}", FAILED, f"deep.{form}: expected an experiment in TOML")
      for form in ("toml", "json")),
    *((f"{TRACK} --sensor {file}", FAILED, f"{file}: expected a sensor in TOML, as `dirprim calibrate`")
      for file in ("deep.toml", "cut.toml", "map.mcap")),
    (f"{TRACK} --sensor .", USAGE, "expected auto or a file, but '.' is no file"),
    (f"{TRACK} --set noise_m={'[' * 20_000}", FAILED, "noise_m: expected"),
    *((f"{TRACK} {option} 1e300", USAGE, f"Invalid value for '{option}'") for option in ("--lag", "--forecast")),
    ("forecast --map map.mcap --at 1 2 --direction-deg 0 --speed 5 --dt 1e-300", USAGE, "Invalid value for '--dt'"),
    ("forecast --map map.mcap --at 1 2 --direction-deg 0 --speed 5 --dt 9", FAILED, "--dt: expected at most --horizon"),
    *((f"forecast --map map.mcap --at {state}", FAILED, "--at, --speed, --direction-deg: expected a place")
      for state in (f"{at} 2 --direction-deg {way} --speed {speed}" for at, way, speed in (
          ("1e300", 0, 5), ("nan", 0, 5), (1, 0, "1e300"), (1, 0, -5), (1, "nan", 5), (1, "inf", 5)))),
    *((f"{TRACK} --rate {rate}", USAGE, "Invalid value for '--rate'")
      for rate in ("0", "-1", "nan", "inf", "1e9", "1e-308")),
    (f"{TRACK} --set particles_out=-1", USAGE, "particles_out: expected at least 0, got -1"),
    ("learn log.mcap -o x --tessellation grid --cell-size inf", FAILED, "cell_size: expected a positive"),
    ("evaluate tracking log.mcap --config notes.txt", FAILED, "notes.txt: expected an experiment in TOML, or the JSON"),
    ("evaluate forecast log.mcap --config fold.toml", FAILED, "experiment: n_fold: expected one of split_by"),
    ("evaluate density log.mcap --split group", FAILED, "at least two to split by group, got 1"),
    *((f"plot map.mcap -o x.png --extent {box}", USAGE, "expected west south east north")
      for box in ("10 0 -10 5", "nan 0 1 1", "0 0 1e300 1e300", "0 0 1e-9 1e-9", "0 0 1 1e7")),
    ("convert two.csv -o x", FAILED, "two.csv, line 2: expected a number as x_m, got 'two'"),
    ("convert signal.csv -o x", FAILED, "line 2: expected left, right, none as turn_signal, got 'lft'"),
    *((f"{command} -o x", FAILED, "early.csv, line 3: expected times from 0 on, as MCAP holds no earlier ones, "
       "got -5000000000 ns; add 6 s to all") for command in ("convert early.csv", "track early.csv --map map.mcap")),
    ("convert walks.txt -o x --format trajnet", FAILED, "expected frames_per_second, which a table of trajnet"),
    ("convert two.csv -o x --format sumo-fcd --columns x_m=x", FAILED, "format sumo-fcd: expected nothing more, got"),
    ("score twice.csv --truth log.mcap", FAILED, "has two rows at 0 ns"),
    ("score log.mcap log.mcap --truth log.mcap", USAGE, "expected each file once"),
    ("export log.mcap -o x.xls", FAILED, "expected a name that ends in .csv, .parquet, got .xls"),
    ("info empty.mcap", FAILED, "error: empty.mcap"),
    *((f"store add fleet log.mcap {option}", USAGE, "acts on nothing")
      for option in ("--end 3", "--set group=0", "--strict")),
    ("learn log.mcap ./log.mcap -o x", USAGE, "expected each file once"),
    ("score twice.csv --truth log.mcap --smoothed", USAGE, "tables have no smoothed estimates"),
    ("score twice.csv --truth log.mcap --set similarity=1", USAGE, "group, format, similarity_m"),
    ("convert kmh.csv -o x --columns speed=", FAILED, "kmh.csv, line 1: expected column speed, got time_s"),
    ("info kmh.csv", FAILED, "divide by 3.6, and name it speed_mps; or leave it out by --set format=csv,speed_kmh="),
    ("info day.csv", FAILED, "got '31/12/2026 10:00'; write dates as 2026-12-31, year first"),
    ("convert two.csv -o x --columns ''", USAGE, "expected NAME=COLUMN, got nothing"),
    ("convert two.csv -o x --origin ''", FAILED, "origin: expected latitude,longitude"),
    (f"{TRACK} --as ros1", USAGE, "'ros1' is not one of 'foxglove', 'vision_msgs', 'autoware'"),
    (f"{TRACK} --save y --set truth=absent", USAGE, "'absent' does not exist"),
    *((f"{TRACK} --connect {url}", FAILED, said) for url, said in (
        ("nowhere", "expected an address such as"), ("rerun+http://127.0.0.1:99999/proxy", "expected an address"),
        ("rerun+http://127.0.0.1:1/proxy", "no viewer answers"))),
    (f"{TRACK} --config log.mcap", FAILED, "MCAP of an earlier run, got none"),
    ("calibrate log.mcap --truth absent -o x", USAGE, "'absent' does not exist"),
    ("info text.mcap", FAILED, "error: text.mcap"),
    ("store learn log.mcap -o x", FAILED, "expected a store"),
    ("store add fleet -", FAILED, "-: expected a file or a URL"),
    ("store add notes.txt log.mcap", FAILED, "notes.txt: expected a store, or the name of a new folder, got that of"),
    ("store add fleet nothing*.mcap", FAILED, "nothing*.mcap: expected logs, found none"),
    ("store learn fleet -o x --now 3", FAILED, "expected --half-life with it"),
    ("store learn fleet -o x --zone Europe/Berlin", FAILED, "--zone: expected --hours with it"),
    *((f"store keep fleet --of-month {month}", USAGE, "expected a month such as 2026-08")
      for month in ("foo", "2026-13")),
    *((f"store learn fleet -o x --half-life={wrong}", USAGE, "expected a positive duration such as 12h, 30d or 2w")
      for wrong in ("30", "-1d", "d", "nand")),
    ("store info absent", FAILED, "expected a store, found none"),
    ("store update map.mcap fleet", FAILED, "expected a map of a store"),
]  # fmt: skip


@pytest.mark.parametrize(("command", "code", "text"), CASES)
def test_it_is_one_line_with_its_code(command, code, text, here, refused):
    for name, content in FILES.items():
        Path(name).write_text(content)
    before = set(here.iterdir())
    assert refused(command, text, code=code).startswith("error: ") or code == USAGE
    assert set(here.iterdir()) == before


def test_no_memory_and_a_name_of_odd_bytes_are_one_line_too(here, monkeypatch, refused):
    command = [sys.executable, "-m", "dirprim_filter", "info", b"lo\xe9g.mcap"]
    done = subprocess.run(command, capture_output=True, check=False)
    assert done.returncode == USAGE
    assert done.stderr.strip().endswith(b"'lo\\udce9g.mcap' does not exist.")

    def inspect(*_):
        raise MemoryError

    monkeypatch.setattr("dirprim_filter.recording.inspection.inspect", inspect)
    refused("info log.mcap", "error: expected more memory than there is; give less")
