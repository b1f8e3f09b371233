"""`dirprim export` and `dirprim score`: results that leave us, and results of others."""

import csv
import json
import re
from dataclasses import replace

import numpy as np
import pytest

from dirprim_filter import Tracks, read_estimates, read_tracks, save_map, write_tracks
from dirprim_filter.cli.main import run
from dirprim_filter.detections import Detections
from dirprim_filter.estimates import Estimates, Particles, TrackedFrame
from dirprim_filter.evaluation.tracked_rows import TrackedRows
from dirprim_filter.recording.tables import read_named
from dirprim_filter.recording.tables.estimate_table import write_estimates
from dirprim_filter.recording.tracked_table import read_tracked_rows
from dirprim_filter.recording.writer import EstimateWriter

DONE, FAILED, USAGE = 0, 1, 2


def dirprim(*arguments):
    return run([*map(str, arguments)])


def believed(tracks, *, seed=0, prefix="", off=0.3):
    """Estimates of tracks, with errors as their covariances say, a quarter of the time in a gap of a second."""
    rng = np.random.default_rng(seed)
    n = len(tracks)
    names = np.char.add(prefix, tracks.track_id.astype(np.str_))
    since = tracks.time_ns % 4_000_000_000 * 1e-9
    return Estimates(
        track_id=names, time_ns=tracks.time_ns, position=tracks.position + rng.normal(0, off, (n, 2)),
        covariance=np.broadcast_to(off**2 * np.eye(2), (n, 2, 2)), direction=tracks.direction,
        direction_resultant=rng.random(n), speed=tracks.speed, speed_std=rng.random(n),
        effective_sample_size=rng.uniform(1, 100, n), log_evidence=rng.normal(size=n), existence=rng.random(n),
        unseen_s=np.where(since < 1.0, since, 0.0),
    )  # fmt: skip


def write_log(estimates, path):
    with EstimateWriter(path, metadata={}) as log:
        for time_ns in np.unique(estimates.time_ns).tolist():
            rows = estimates[estimates.time_ns == time_ns]
            log.write(
                TrackedFrame(time_ns=time_ns, detections=Detections.none(), estimates=rows, particles=Particles.none())
            )
    return path


@pytest.fixture(scope="module")
def truth(ring, tmp_path_factory):
    path = tmp_path_factory.mktemp("score") / "truth.mcap"
    write_tracks(ring[ring.track_id < 6], path)
    return path


@pytest.fixture(scope="module")
def tracked(truth, tmp_path_factory):
    return write_log(believed(read_tracks(truth)), tmp_path_factory.mktemp("tracked") / "tracked.mcap")


def same(a, b, names):
    return all(np.array_equal(getattr(a, name), getattr(b, name), equal_nan=name != "track_id") for name in names)


def rmse_of(estimates, tracks):
    """Of estimates of the very rows of tracks."""
    assert (estimates.time_ns == tracks.time_ns).all()
    return np.sqrt(((estimates.position - tracks.position) ** 2).sum(axis=1).mean())


@pytest.mark.parametrize("suffix", ["csv", "parquet"])
def test_exported_estimates_come_back_to_the_last_digit(truth, tracked, tmp_path, capsys, suffix):
    out = tmp_path / f"out.{suffix}"
    assert dirprim("export", tracked, "-o", out) == DONE
    estimates = read_estimates(tracked)
    assert capsys.readouterr().out == f"{out}: 6 tracks, {len(estimates)} rows\n"
    rows = read_tracked_rows(out, truth=read_tracks(truth))
    columns = ("track_id", "time_ns", "position", "covariance", "direction", "speed", "unseen_s", "group")
    assert same(rows, TrackedRows.of(estimates), columns)
    assert not same(rows, TrackedRows.of(replace(estimates, unseen_s=estimates.unseen_s + 1e-15)), columns)


def test_every_column_of_a_csv_is_what_is_believed_and_convert_reads_it(tracked, tmp_path):
    out = tmp_path / "out.csv"
    estimates = replace(read_estimates(tracked), time_ns=read_estimates(tracked).time_ns + 1_700_000_000_123_456_789)
    odd = np.where(estimates.track_id == 0, 'a "b", c', estimates.track_id.astype(np.str_))
    write_estimates(replace(estimates, track_id=odd), out)
    with out.open() as file:
        table = list(csv.DictReader(file))
    assert [row["track_id"] for row in table] == odd.tolist()
    for column, attribute in (
        ("speed_std_mps", "speed_std"), ("existence", "existence"), ("log_evidence", "log_evidence"),
        ("effective_sample_size", "effective_sample_size"), ("direction_resultant", "direction_resultant"),
    ):  # fmt: skip
        assert [float(row[column]) for row in table] == getattr(estimates, attribute).tolist()
    tracks = read_named(out).tracks
    assert np.array_equal(np.sort(tracks.time_ns), np.sort(estimates.time_ns))
    assert set(tracks.track_id) == set(odd)


def test_motchallenge_frames_are_the_instants_of_the_log(truth, tracked, tmp_path, capsys):
    tracks = read_tracks(truth)
    late = read_estimates(tracked)
    late = late[late.time_ns > np.unique(tracks.time_ns)[2]]
    log = write_log(replace(late, track_id=np.char.add("car ", late.track_id.astype(np.str_))), tmp_path / "late.mcap")
    out = tmp_path / "out.txt"
    assert dirprim("export", log, "-o", out, "--frames-of", truth) == DONE
    rows = read_tracked_rows(out, truth=tracks)
    assert same(rows, late, ("time_ns", "position"))
    assert rows.n_tracks == 6
    assert np.isnan(rows.covariance).all()
    first = out.read_text().splitlines()[0].split(",")
    assert (first[0], first[2:6], float(first[6])) == ("4", ["-1"] * 4, late.existence[0])
    assert dirprim("export", log, "-o", tmp_path / "own.txt") == DONE
    assert (tmp_path / "own.txt").read_text().startswith("1,")  # its own instants: another numbering
    few = tmp_path / "few.mcap"
    write_tracks(tracks[tracks.time_ns > late.time_ns[-1] - 500_000_000], few)
    assert dirprim("export", log, "-o", tmp_path / "few.txt", "--frames-of", few) == FAILED
    assert "expected one at the time of each estimate" in capsys.readouterr().err
    assert not list(tmp_path.glob("few.txt*"))


def test_exports_are_whole_or_not_there_and_overwrite_nothing(tracked, tmp_path, capsys):
    out = tmp_path / "out.csv"
    assert dirprim("export", tracked, "-o", out) == DONE
    assert dirprim("export", tracked, "-o", out) == FAILED
    assert "choose another name or use --force" in capsys.readouterr().err
    assert dirprim("export", tracked, "-o", out, "--force") == DONE
    assert dirprim("export", tracked, "-o", tmp_path / "out.xls") == FAILED
    assert "expected a name that ends in .csv, .parquet, .txt, got .xls" in capsys.readouterr().err
    assert dirprim("export", tracked, "-o", tmp_path / "new.csv", "--frames-of", tracked) == USAGE
    assert [path.name for path in tmp_path.iterdir()] == ["out.csv"]


def test_score_tells_people_and_machines_the_same_and_draws(truth, tracked, tmp_path, capsys):
    worse = write_log(believed(read_tracks(truth), seed=1, prefix="t", off=0.9), tmp_path / "worse.mcap")
    other, plot = tmp_path / "other.csv", tmp_path / "plot.png"
    assert dirprim("export", worse, "-o", other) == DONE
    capsys.readouterr()
    options = ("score", tracked, worse, other, "--truth", truth)
    assert dirprim(*options, "--plot", plot) == DONE
    text = capsys.readouterr().out
    assert plot.read_bytes().startswith(b"\x89PNG")
    assert dirprim(*options, "--json") == DONE
    reported = json.loads(capsys.readouterr().out)
    assert (reported["format"], reported["format_version"]) == ("dirprim score", 2)
    assert [found["name"] for found in reported["scores"]] == ["tracked.mcap", "worse.mcap", "other.csv"]
    assert [len(file["sha256"]) for file in reported["inputs"]] == [64] * 4
    cells = (re.split(r"  +", line) for line in text.splitlines()[2:])
    lines = {head: figures for head, *figures in cells}
    for head, name in (("HOTA", "hota"), ("RMSE, m", "rmse"), ("RMSE in gaps, m", "hidden_rmse"), ("MOTA", "mota")):
        assert lines[head] == [f"{found['report'][name]:.3f}" for found in reported["scores"]]
    first, second, third = reported["scores"]
    assert second["report"] == third["report"]
    assert first["report"]["hota"] > second["report"]["hota"] + 0.1
    assert first["report"]["rmse"] == pytest.approx(0.3 * np.sqrt(2), rel=0.1)
    assert dirprim(*options, "--plot", plot) == FAILED


def test_errors_are_of_the_ids_where_they_are_the_logs(truth, tracked, tmp_path, capsys):
    """Names that the log has as well mean nothing without --ids: swapped, only the errors by ids are large."""
    estimates = read_estimates(tracked)
    swapped = write_log(replace(estimates, track_id=5 - estimates.track_id), tmp_path / "swapped.mcap")

    def rmse(path, *options):
        assert dirprim("score", path, "--truth", truth, "--json", *options) == DONE
        return json.loads(capsys.readouterr().out)["scores"][0]["report"]["rmse"]

    expected = rmse_of(estimates, read_tracks(truth))
    assert rmse(tracked, "--ids") == pytest.approx(expected, abs=1e-12)
    assert rmse(swapped) == rmse(tracked) == pytest.approx(expected, rel=0.05)
    assert rmse(swapped, "--ids") > 5.0


def test_groups_are_worlds_and_rows_say_which_they_are_of(ring, tmp_path, capsys):
    few = ring[ring.track_id < 3]
    both = Tracks(
        **{
            name: np.concatenate([getattr(few, name)] * 2)
            for name in ("track_id", "time_ns", "position", "direction", "speed")
        },
        group=np.repeat([0, 1], len(few)),
    )
    truth = tmp_path / "truth.mcap"
    write_tracks(both, truth)
    own = believed(few)
    again = replace(own, track_id=np.char.add("1/", own.track_id.astype(np.str_)))
    joined = Estimates.concatenate([own, again])
    log = write_log(joined, tmp_path / "joined.mcap")
    table = tmp_path / "joined.csv"
    with table.open("w") as file:
        file.write("time_s,track_id,x_m,y_m,group\n")
        for group, part in enumerate((own, own)):
            for name, t, (x, y) in zip(part.track_id, part.time_ns, part.position, strict=True):
                file.write(f"{t * 1e-9:.9f},{name},{x!r},{y!r},{group}\n".replace("np.float64(", "").replace(")", ""))
    assert dirprim("score", log, table, "--truth", truth, "--ids", "--json") == DONE
    reported = json.loads(capsys.readouterr().out)
    assert (reported["n_groups"], reported["n_vehicles"]) == (2, 6)
    one, other = (found["report"] for found in reported["scores"])
    assert one["reported"] == other["reported"] == 1.0
    assert one["rmse"] == pytest.approx(rmse_of(own, few))
    for name in ("hota", "idf1", "mota", "gospa", "rmse"):
        assert one[name] == pytest.approx(other[name])
    assert one["idf1"] == 1.0
    assert (one["seen_rmse"], other["seen_rmse"]) == (pytest.approx(one["rmse"], rel=0.2), None)
    alone = write_log(own, tmp_path / "alone.mcap")
    assert dirprim("score", alone, "--truth", truth) == FAILED
    assert "expected rows that say which of the truth's 2 groups they are of" in capsys.readouterr().err
    for group in (0, 1):  # of one group count its own rows, and all rows where none names a group
        for path, left_out in ((log, len(own)), (table, len(own)), (alone, 0)):
            assert dirprim("score", path, "--truth", truth, "--group", group, "--ids", "--json") == DONE
            reported = json.loads(capsys.readouterr().out)["scores"][0]
            assert (reported["left_out"], reported["report"]["reported"]) == (left_out, 1.0)
            assert reported["report"]["rmse"] == pytest.approx(one["rmse"])
            assert reported["report"]["mota"] == 1.0


def test_what_cannot_be_scored_is_one_line(truth, tracked, tmp_path, capsys):
    own = read_estimates(tracked)
    early = write_log(replace(own, time_ns=own.time_ns + 1_000_000_000_000), tmp_path / "e.mcap")
    half = write_log(replace(own, time_ns=own.time_ns + 5_000_000_000), tmp_path / "half.mcap")
    twice = tmp_path / "twice.csv"
    twice.write_text("time_s,track_id,x_m,y_m\n0,1,0,0\n0,1,1,1\n")
    boxes = tmp_path / "boxes.txt"
    boxes.write_text("1,1,100,200,30,40,1,-1,-1,-1\n")
    beyond = tmp_path / "beyond.txt"
    beyond.write_text("1,1,-1,-1,-1,-1,1,2,3,0\n99999,1,-1,-1,-1,-1,1,2,3,0\n")
    for path, message in (
        (early, "expected rows at instants at which the truth is known, 0 to "),
        (twice, "has two rows at 0 ns"),
        (boxes, "give positions in the plane, not boxes of an image"),
        (beyond, "line 2: expected a frame from 1 to"),
        (truth, "expected topic '/dirprim/tracks'"),
    ):
        assert dirprim("score", path, "--truth", truth) == FAILED
        error = capsys.readouterr().err
        assert error.count("\n") == 1
        assert message in error
    assert dirprim("score", half, "--truth", truth) == DONE
    assert "rows of groups or instants without a truth" in capsys.readouterr().err


def test_a_truth_at_other_instants_is_interpolated_and_the_output_says_so(truth, tracked, tmp_path, capsys):
    """Such is a truth by satellite beside a sensor's frames."""
    tracks = read_tracks(truth)
    between = tracks.time_ns + 30_000_000
    rtk = tmp_path / "rtk.mcap"
    step = 0.03 * tracks.speed[:, None] * np.column_stack([np.cos(tracks.direction), np.sin(tracks.direction)])
    write_tracks(replace(tracks, time_ns=between, position=tracks.position + step), rtk)
    reports = []
    for path in (truth, rtk):
        assert dirprim("score", tracked, "--truth", path, "--ids") == DONE
        text = capsys.readouterr().out.splitlines()
        assert dirprim("score", tracked, "--truth", path, "--ids", "--json") == DONE
        table = json.loads(capsys.readouterr().out)
        reports.append((text[1], table, table["scores"][0]["report"]))
    (line, _, own), (line_of_rtk, table, other) = reports
    n = np.unique(tracks.time_ns).size
    assert line == f"judged at the truth's {n} instants, row by row"
    assert line_of_rtk == (
        f"judged at the estimates' {n - 1} instants; {len(tracks) - 6} of the truth's rows are interpolated, between "
        "rows of a vehicle at most 1 s apart"
    )
    assert (table["at_results"], table["n_interpolated"], table["scores"][0]["left_out"]) == (True, len(tracks) - 6, 6)
    assert (own["interpolated"], other["interpolated"], other["reported"]) == (0.0, 1.0, 1.0)
    for name in ("rmse", "hota", "mota", "nees", "speed_rmse"):
        assert other[name] == pytest.approx(own[name], rel=0.03, abs=0.03), name


def test_what_was_smoothed_is_scored_and_exported_beside(truth, ring_map, tmp_path, capsys):
    ring_map_file = tmp_path / "map.mcap"
    save_map(ring_map, ring_map_file)
    out = tmp_path / "smoothed.mcap"
    assert dirprim("track", truth, "--map", ring_map_file, "-o", out, "--particles", 100, "--smooth") == DONE
    again = ("track", truth, "--map", ring_map_file, "-o", tmp_path / "again.mcap", "--particles", 100)
    assert dirprim(*again, "--smooth", "--lag", 1) == USAGE
    assert dirprim(*again, "--lag", 1, "--save", tmp_path / "again.rrd") == DONE
    capsys.readouterr()
    assert dirprim("score", out, "--truth", truth, "--ids", "--smoothed", "--json") == DONE
    filtered, smoothed = json.loads(capsys.readouterr().out)["scores"]
    assert (filtered["name"], smoothed["name"]) == ("smoothed.mcap", "smoothed.mcap smoothed")
    assert smoothed["report"]["rmse"] < filtered["report"]["rmse"]
    assert dirprim("export", out, "--smoothed", "-o", tmp_path / "smoothed.csv") == DONE
    rows = read_tracked_rows(tmp_path / "smoothed.csv", truth=read_tracks(truth))
    np.testing.assert_array_equal(rows.position, read_estimates(out, smoothed=True).position)
