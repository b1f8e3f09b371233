"""`dirprim export` and `dirprim score`: results that leave us, and results of others."""

import csv
import json
import re
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from cli.commands import DONE, USAGE, dirprim
from dirprim_filter import read_estimates, read_tracks, write_tracks
from dirprim_filter.detections import Detections
from dirprim_filter.estimates import Estimates, Particles, TrackedFrame
from dirprim_filter.evaluation.tracked_rows import TrackedRows
from dirprim_filter.recording.estimate_tables import read_tracked_rows, write_estimates
from dirprim_filter.recording.tables import read_named
from dirprim_filter.recording.writer import EstimateWriter
from situations import estimates_of


def estimated(tracks, *, seed=0, prefix="", off=0.3):
    """Estimates of tracks, with errors as their covariances say, a quarter of the time in a gap of a second."""
    rng, n = np.random.default_rng(seed), len(tracks)
    since = tracks.time_ns % 4_000_000_000 * 1e-9
    made = estimates_of(
        np.char.add(prefix, tracks.track_id.astype(np.str_)), time_ns=tracks.time_ns, direction=tracks.direction,
        position=tracks.position + rng.normal(0, off, (n, 2)), direction_resultant=rng.random(n), speed=tracks.speed,
        speed_std=rng.random(n), effective_sample_size=rng.uniform(1, 100, n), log_evidence=rng.normal(size=n),
        existence=rng.random(n), unseen_s=np.where(since < 1.0, since, 0.0),
    )  # fmt: skip
    return replace(made, covariance=off**2 * made.covariance)


def write_log(estimates, path, **options):
    nothing = {"detections": Detections.none(), "particles": Particles.none()}
    with EstimateWriter(path, metadata={}, **options) as log:
        for time_ns in np.unique(estimates.time_ns).tolist():
            log.write(TrackedFrame(time_ns=time_ns, estimates=estimates[estimates.time_ns == time_ns], **nothing))


@pytest.fixture
def own(few, here):
    """Estimates of the log's vehicles, which `own.mcap` in the working folder holds."""
    estimates = estimated(few)
    write_log(estimates, "own.mcap")
    return estimates


@pytest.fixture
def scored(said):
    """The object for machines."""
    return lambda command: json.loads(said(f"score {command} --json").out)


def same(a, b, names):
    return all(np.array_equal(getattr(a, name), getattr(b, name), equal_nan=name != "track_id") for name in names)


def rmse_of(estimates, tracks):
    """Of estimates of the very rows of tracks."""
    assert (estimates.time_ns == tracks.time_ns).all()
    return np.sqrt(((estimates.position - tracks.position) ** 2).sum(axis=1).mean())


@pytest.mark.parametrize("suffix", ["csv", "parquet"])
def test_exported_estimates_come_back_to_the_last_digit(own, few, said, suffix):
    assert said(f"export own.mcap -o out.{suffix}").out == f"out.{suffix}: 6 tracks, {len(own)} rows\n"
    rows, estimates = read_tracked_rows(f"out.{suffix}", truth=few), read_estimates("own.mcap")
    columns = ("track_id", "time_ns", "position", "covariance", "direction", "speed", "unseen_s", "group")
    assert same(rows, TrackedRows.of(estimates), columns)
    assert not same(rows, TrackedRows.of(replace(estimates, unseen_s=estimates.unseen_s + 1e-15)), columns)


def test_every_column_of_a_csv_is_what_is_estimated_and_convert_reads_it(own):
    odd = np.where(own.track_id == 0, 'a "b", c', own.track_id.astype(str))
    estimates = replace(own, time_ns=own.time_ns + 1_700_000_000_123_456_789, track_id=odd)
    write_estimates(estimates, "out.csv")
    with Path("out.csv").open() as file:
        table = list(csv.DictReader(file))
    assert [row["track_id"] for row in table] == odd.tolist()
    for name in ("speed_std", "existence", "log_evidence", "effective_sample_size", "direction_resultant"):
        column = "speed_std_mps" if name == "speed_std" else name
        assert [float(row[column]) for row in table] == getattr(estimates, name).tolist()
    tracks = read_named("out.csv").tracks
    assert np.array_equal(np.sort(tracks.time_ns), np.sort(estimates.time_ns))
    assert set(tracks.track_id) == set(odd)


def test_score_is_the_same_for_people_and_machines(own, few, said, scored):
    write_log(estimated(few, seed=1, prefix="t", off=0.9), "worse.mcap")
    assert dirprim("export worse.mcap -o other.csv") == DONE
    command = "own.mcap worse.mcap other.csv --truth log.mcap"
    text, reported = said(f"score {command}").out, scored(command)
    assert (reported["format"], reported["format_version"]) == ("dirprim score", 2)
    assert [found["name"] for found in reported["scores"]] == ["own.mcap", "worse.mcap", "other.csv"]
    assert [len(file["sha256"]) for file in reported["inputs"]] == [64] * 4
    lines = {head: figures for head, *figures in (re.split(r"  +", line) for line in text.splitlines()[2:])}
    for head, name in (("HOTA", "hota"), ("RMSE, m", "rmse"), ("RMSE in gaps, m", "hidden_rmse"), ("MOTA", "mota")):
        assert lines[head] == [f"{found['report'][name]:.3f}" for found in reported["scores"]]
    first, second, third = (found["report"] for found in reported["scores"])
    assert second == third
    assert first["hota"] > second["hota"] + 0.1
    assert first["rmse"] == pytest.approx(0.3 * np.sqrt(2), rel=0.1)


def test_errors_are_of_the_ids_where_they_are_the_logs(own, few, scored):
    """Names that the log has as well mean nothing without --ids: swapped, only the errors by ids are large."""
    write_log(replace(own, track_id=5 - own.track_id), "swapped.mcap")
    rmse = {(name, ids): scored(f"{name}.mcap --truth log.mcap {ids}")["scores"][0]["report"]["rmse"]
            for name in ("own", "swapped") for ids in ("", "--ids")}  # fmt: skip
    expected = rmse_of(own, few)
    assert rmse["own", "--ids"] == pytest.approx(expected, abs=1e-12)
    assert rmse["swapped", ""] == rmse["own", ""] == pytest.approx(expected, rel=0.05)
    assert rmse["swapped", "--ids"] > 5.0


@pytest.mark.parametrize(
    ("east_m", "late_s", "until_s", "asked"),
    [
        (0.0, 0.0, 60.0, ""), (3.0, 0.0, 60.0, ""),
        (5000.0, 0.0, 60.0, "moved.mcap: no estimate is within 5 m of a vehicle of truth.mcap: are both in one frame"),
        (0.0, 0.3, 60.0, "0.3 s late: are both by one clock?"), (0.0, -0.3, 60.0, "0.3 s early: are both by one clock"),
        (0.0, 0.0, 4.0, "are before or after all estimates, and count as missed"),
    ],
)  # fmt: skip
def test_estimates_of_another_place_clock_or_part_of_the_truth_are_asked_about(
    own, said, *, east_m, late_s, until_s, asked
):
    """Once, and with a word of those alone that it holds for."""
    later = replace(own, time_ns=own.time_ns + 1_000_000_000)
    write_log(later, "own.mcap", force=True)
    moved = replace(later, time_ns=later.time_ns + round(late_s * 1e9), position=own.position + np.array([east_m, 0]))
    write_log(moved[own.time_ns < until_s * 1e9], "moved.mcap")
    truth = read_tracks("log.mcap")
    write_tracks(replace(truth, time_ns=truth.time_ns + 1_000_000_000), "truth.mcap")
    lines = said("score own.mcap moved.mcap --truth truth.mcap").err.splitlines()
    lines = [line for line in lines if "without a truth" not in line]
    assert [asked in line and "moved.mcap" in line for line in lines] == [True] * bool(asked)


def test_groups_are_scenes_and_rows_say_which_they_are_of(ring, here, scored, refused):
    few = ring[ring.track_id < 3]
    own = estimated(few)
    write_tracks(type(few).concatenate([few, replace(few, group=np.ones(len(few), np.int64))]), "groups.mcap")
    again = replace(own, track_id=np.char.add("1/", own.track_id.astype(str)))
    write_log(Estimates.concatenate([own, again]), "joined.mcap")
    write_log(own, "alone.mcap")
    rows = [f"{t},{name},{x},{y},{group}" for group in (0, 1)
            for name, t, (x, y) in zip(own.track_id, own.time_ns, own.position.tolist(), strict=True)]  # fmt: skip
    Path("joined.csv").write_text("\n".join(["time_ns,track_id,x_m,y_m,group", *rows]))
    reported = scored("joined.mcap joined.csv --truth groups.mcap --ids")
    assert (reported["n_groups"], reported["n_vehicles"]) == (2, 6)
    one, other = (found["report"] for found in reported["scores"])
    assert one["reported"] == one["idf1"] == 1.0
    assert one["rmse"] == pytest.approx(rmse_of(own, few))
    for name in ("reported", "hota", "idf1", "mota", "gospa", "rmse"):
        assert one[name] == pytest.approx(other[name])
    assert other["seen_rmse"] is None
    refused("score alone.mcap --truth groups.mcap", "rows that say which of the truth's 2 groups they are of")
    for group in (0, 1):  # of one group count its own rows, and all rows where none names a group
        for name, left_out in (("joined.mcap", len(own)), ("joined.csv", len(own)), ("alone.mcap", 0)):
            (found,) = scored(f"{name} --truth groups.mcap --set group={group} --ids")["scores"]
            assert (found["left_out"], found["report"]["reported"], found["report"]["mota"]) == (left_out, 1.0, 1.0)
            assert found["report"]["rmse"] == pytest.approx(one["rmse"])


def test_what_cannot_be_scored_is_one_line(own, said, refused):
    write_log(replace(own, time_ns=own.time_ns + 1_000_000_000_000), "early.mcap")
    write_log(replace(own, time_ns=own.time_ns + 2_500_000_000), "half.mcap")
    for name, text in (
        ("early", "expected rows at instants at which the truth is known, 0 to "),
        ("log", "expected topic '/dirprim/tracks'"),
    ):
        assert refused(f"score {name}.mcap --truth log.mcap", text).startswith("error: ")
    assert "rows of groups or times without a truth" in said("score half.mcap --truth log.mcap").err


def test_estimates_are_interpolated_at_a_truth_of_other_instants(own, few, said, scored):
    """Such is a truth by satellite beside a sensor's frames."""
    step = 0.03 * few.speed[:, None] * np.column_stack([np.cos(few.direction), np.sin(few.direction)])
    write_tracks(replace(few, time_ns=few.time_ns + 30_000_000, position=few.position + step), "rtk.mcap")
    reports = []
    for command in (f"own.mcap --truth {name}.mcap --ids" for name in ("log", "rtk")):
        line = said(f"score {command}").out.splitlines()[1]
        assert line == f"judged at the truth's {np.unique(few.time_ns).size} instants, row by row"
        table = scored(command)
        reports.append(table["scores"][0]["report"])
    own_, other = reports
    assert (table["n_interpolated"], table["scores"][0]["n_interpolated"]) == (0, len(few) - 6)
    assert table["scores"][0]["left_out"] == 6
    assert (own_["interpolated"], other["reported"]) == (0.0, pytest.approx(1.0 - 6 / len(few)))
    for name in ("mota", "speed_rmse"):
        assert other[name] == pytest.approx(own_[name], rel=0.03, abs=0.03), name
    assert other["rmse"] == pytest.approx(np.hypot(0.7, 0.3) * own_["rmse"], rel=0.03)  # errors are independent here


def test_which_track_each_detection_was_assigned_to_is_exported_row_by_row(here, said, refused):
    assert dirprim("track log.mcap --map map.mcap -o t.mcap --noise 0.5 --particles 50 --no-ids --end 2.5") == DONE
    assert "a.csv: 6 tracks, 150 rows" in said("export t.mcap --assigned -o a.csv").out
    header, *rows = Path("a.csv").read_text().replace('"', "").splitlines()
    assert header == "time_s,track_id,x_m,y_m,assigned,group"
    assert sorted(row.split(",")[4] for row in rows[-6:]) == [f"track-{i}" for i in range(1, 7)]
    assert dirprim("export t.mcap --assigned -o a.parquet") == DONE
    assert dirprim("export t.mcap --assigned --smoothed -o b.csv") == USAGE
    refused("export log.mcap --assigned -o b.csv", "topic '/dirprim/assigned' of dirprim.Assignments")


@pytest.mark.slow
def test_what_was_smoothed_is_scored_and_exported_beside(few, here, scored):
    track = "track log.mcap --map map.mcap --particles 100"
    assert dirprim(f"{track} -o s.mcap --smooth") == DONE
    assert dirprim(f"{track} -o again.mcap --lag 1 --save again.rrd") == DONE
    filtered, smoothed = scored("s.mcap --truth log.mcap --ids --smoothed")["scores"]
    assert (filtered["name"], smoothed["name"]) == ("s.mcap", "s.mcap smoothed")
    assert smoothed["report"]["rmse"] < filtered["report"]["rmse"]
    assert dirprim("export s.mcap --smoothed -o s.csv") == DONE
    rows = read_tracked_rows("s.csv", truth=few)
    np.testing.assert_array_equal(rows.position, read_estimates("s.mcap", smoothed=True).position)
