"""`dirprim view`, `plot` and the watching options of `track`: what is shown is what the files hold."""

import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
from matplotlib.image import imread
from rerun.chunk import RrdReader

from cli.commands import DONE, FAILED, INPUT_LOST, USAGE, dirprim
from dirprim_filter import save_map, write_tracks
from dirprim_filter.viewer import process as program
from dirprim_filter.viewer.sink import RerunSink
from viewer.rrd_files import DRIVERS, rows_of


@pytest.fixture(scope="module")
def folder(ring, ring_map, tmp_path_factory):
    """A map, a log, and two runs of tracking it, one of them also as .rrd."""
    folder = tmp_path_factory.mktemp("view")
    few = ring[(ring.track_id < 4) & (ring.time_ns < 2_000_000_000)]
    save_map(ring_map, folder / "map.mcap")
    write_tracks(few, folder / "log.mcap")
    common = ("track", folder / "log.mcap", "--map", folder / "map.mcap", "--particles", 100)
    shown = ("--save", folder / "prior.rrd", "--set", f"truth={folder}/log.mcap", "--forecast", 1)
    assert dirprim("", *common, "-o", folder / "prior.mcap", "--smooth", *shown) == DONE
    assert dirprim("", *common, "-o", folder / "free.mcap", "--set", "without_map=true") == DONE
    return folder


@pytest.fixture
def there(folder, monkeypatch):
    """The same, as the working folder."""
    monkeypatch.chdir(folder)
    return folder


def entities(path, *, styled=True):
    subprocess.run([Path(sys.executable).with_name("rerun"), "rrd", "verify", path], check=True, capture_output=True)
    (recording,) = RrdReader(path).recordings()
    assert recording.application_id.startswith("dirprim")
    chunks = [chunk for chunk in RrdReader(path).stream() if styled or not chunk.is_static]
    assert not {"log_time", "log_tick"} & {name for chunk in chunks for name in chunk.to_record_batch().schema.names}
    return {chunk.entity_path for chunk in chunks}


def test_a_tracked_run_has_every_layer_curve_and_text(folder):
    wanted = {
        "/map/cells", "/map/roses", "/detections", "/truth/2", "/tracks/2", "/smoothed/2", "/particles", "/assigned",
        "/forecasts/paths", "/forecasts/region_50", "/forecasts/region_90", "/events/marks",
        "/error/2", "/nees/2", "/innovation/2", "/existence/2", "/error/all", "/samples/all", "/vehicles/all",
        "/events", "/__properties/run", "/legend",
    }  # fmt: skip
    assert wanted <= entities(folder / "prior.rrd")
    said = next(
        chunk.to_record_batch() for chunk in RrdReader(folder / "prior.rrd").stream() if "run" in chunk.entity_path
    )
    assert said.column("run:seed").to_pylist() == [["0"]]
    assert '"n_particles": 100' in said.column("run:config")[0].as_py()[0]


@pytest.mark.parametrize(
    ("files", "holds", "lacks"),
    [
        (("map.mcap",), {"/map/roses"}, {"/tracks/2"}),
        (("log.mcap",), {"/truth/2", "/detections"}, {"/tracks/2"}),
        (("map.mcap", "log.mcap"), {"/map/roses", "/truth/2"}, set()),
        (("prior.mcap",), {"/map/roses", "/tracks/2", "/smoothed/2", "/forecasts/paths", "/assigned",
                           "/__properties/run"}, {"/truth/2", "/error/2"}),
        (("prior.mcap", "log.mcap"), {"/map/roses", "/tracks/2", "/detections", "/error/2"}, set()),
    ],
)  # fmt: skip
def test_files_are_shown_together(folder, tmp_path, files, holds, lacks):
    out = tmp_path / "shown.rrd"
    assert dirprim("view", *(folder / file for file in files), "--save", out) == DONE
    shown = entities(out)
    assert holds <= shown
    assert not lacks & entities(out, styled=False)
    assert len(RrdReader(out).blueprints()) == 1


def test_recordings_go_to_the_viewer_as_they_are(folder, monkeypatch):
    shown = []
    monkeypatch.setattr(program, "spawn_viewer", shown.extend)
    (other := folder / "other.rrd").write_bytes((folder / "prior.rrd").read_bytes())
    assert dirprim("view", folder / "prior.rrd", other) == DONE
    assert shown == [folder / "prior.rrd", other]


def test_several_runs_go_to_one_viewer_each_with_its_own_name(folder, monkeypatch):
    """The second is streamed to the viewer that the first started."""
    opened = []

    class Shown(RerunSink):
        def __init__(self, application_id, *, title, spawn, connect, **_):
            opened.append((application_id, title, spawn, connect))
            super().__init__(application_id, title=title, save=folder / f"{title}_shown.rrd", force=True)
            self.stream.address = "rerun+http://127.0.0.1:1/proxy"

    monkeypatch.setattr("dirprim_filter.viewer.sink.RerunSink", Shown)
    assert dirprim("view", folder / "prior.mcap", folder / "free.mcap", "--truth", folder / "log.mcap") == DONE
    assert opened == [
        ("dirprim prior free", "prior", True, None),
        ("dirprim prior free", "free", False, "rerun+http://127.0.0.1:1/proxy"),
    ]
    assert "/error/2" in entities(folder / "free_shown.rrd")


@pytest.mark.skipif(not DRIVERS, reason="no Vulkan driver: apt-get install mesa-vulkan-drivers")
def test_a_screenshot_needs_no_screen(folder, tmp_path):
    out = tmp_path / "shown.png"
    assert dirprim("view", folder / "prior.mcap", "--screenshot", out, "--at", 1) == DONE
    picture = imread(out)
    assert min(picture.shape[:2]) > 500
    assert np.ptp(picture[..., :3], axis=(0, 1)).min() > 0.5


def test_estimates_are_drawn_over_their_map_and_only_there(folder, tmp_path):
    for name, more in (("with", ("--estimates", folder / "prior.mcap")), ("without", ())):
        assert dirprim("plot", folder / "map.mcap", *more, "-o", tmp_path / f"{name}.png") == DONE
    one, other = (imread(tmp_path / f"{name}.png") for name in ("with", "without"))
    assert one.shape != other.shape or (one != other).any()


@pytest.mark.parametrize(
    ("command", "code", "message"),
    [
        ("view log.mcap --topics /nowhere", FAILED, "'/nowhere'"),
        ("view map.mcap --topics /nowhere", USAGE, "--topics: acts on nothing in these files"),
        ("view prior.mcap --topics /nowhere", USAGE, "--topics: acts on nothing in these files"),
        ("view prior.mcap log.mcap --topics /nowhere", FAILED, "'/nowhere'"),
        ("view log.mcap --set frame=xyz", FAILED, "'xyz'"),
        ("view prior.mcap free.mcap", FAILED, "expected at most one run in a file, got"),
        ("view prior.rrd map.mcap", FAILED, "prior.rrd: an .rrd opens beside other .rrd files alone"),
        ("view prior.rrd", FAILED, "prior.rrd: an .rrd opens beside other .rrd files alone, on a screen, as it is"),
        ("view prior.mcap --at 1", USAGE, "it is of --screenshot"),
        ("plot map.mcap --log log.mcap --topics /nowhere", FAILED, "'/nowhere'"),
        ("plot map.mcap --topics /nowhere", USAGE, "--topics: acts on nothing in these files"),
    ],
)
def test_what_cannot_be_shown_together_or_as_asked_is_said(there, refused, command, code, message):
    refused(f"{command} {'-o it.png' if command.startswith('plot') else '--save it.rrd'}", message, code=code)
    assert not [*there.glob("it.*")]


def test_times_of_a_log_are_shown_as_asked(folder, tmp_path):
    def times(name, *options):
        assert dirprim("", "view", folder / "log.mcap", "--save", tmp_path / name, *options) == DONE
        return len(rows_of(tmp_path / name, "/detections", "Points3D:positions"))

    assert 0 < times("part.rrd", "--start", "0.5", "--end", "1") < times("all.rrd")


def test_tables_patterns_and_logs_without_ids_are_shown(tmp_path, said, monkeypatch):
    monkeypatch.chdir(tmp_path)
    Path("seen.csv").write_text("time_s,x_m,y_m\n0,0,0\n1,1,0\n2,2,0\n")
    assert dirprim("convert seen.csv -o seen.mcap") == DONE
    assert dirprim("view seen.mcap --save shown.rrd") in (DONE, INPUT_LOST)
    assert "/detections" in entities("shown.rrd")
    shown = said("info", tmp_path / "seen.*").out
    assert "seen.csv:" in shown
    assert "seen.mcap:" in shown
    assert "detections without ids in: /detections (3), for `dirprim track`" in shown
    assert "tracks in" not in shown
    assert dirprim("info seen.csv --time-source log") == USAGE
    assert dirprim("info nothing*") == USAGE


def test_a_part_of_the_map(here, said):
    for name, extent in (("a", "0 0 20 20"), ("b", "0 0 20 10")):
        assert said(f"plot map.mcap --log log.mcap -o {name}.png --extent {extent}").out == f"{name}.png\n"
    a, b = (imread(f"{name}.png").shape for name in "ab")
    assert a[1] == b[1] == 7.9 * 200
    assert b[0] < a[0]  # half as deep a part is drawn on a flatter page
