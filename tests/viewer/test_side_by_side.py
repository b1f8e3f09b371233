"""Two runs share one time line and one window; what each showed stands under its own path, unchanged."""

import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
import rerun as rr
from rerun.chunk import RrdReader
from rrd_files import rows_of

from dirprim_filter.estimates import TrackedFrame
from dirprim_filter.primitives.primitive_map import PrimitiveMap
from dirprim_filter.viewer.side_by_side import show_side_by_side
from dirprim_filter.viewer.sink import open_stream


@pytest.fixture
def two_runs(tmp_path: Path, scene_map: PrimitiveMap, scene_frames: list[TrackedFrame]) -> list[Path]:
    paths = [tmp_path / "with.rrd", tmp_path / "without.rrd"]
    for path, frames in zip(paths, (scene_frames, scene_frames[2:]), strict=True):
        with open_stream(save=path) as sink:
            sink.log_map(scene_map)
            for frame in frames:
                sink.write(frame)
    return paths


def test_both_runs_come_back_under_their_own_paths(tmp_path: Path, two_runs: list[Path]) -> None:
    with open_stream(save=tmp_path / "both.rrd") as sink:
        show_side_by_side(two_runs, ["with prior", "without"], sink)
    subprocess.run([Path(sys.executable).with_name("rerun"), "rrd", "verify", tmp_path / "both.rrd"], check=True)
    assert len(RrdReader(tmp_path / "both.rrd").blueprints()) == 1
    for run, root in zip(two_runs, ("/with_prior", "/without"), strict=True):
        for entity, column in [
            ("/tracks/particles", "Points3D:positions"), ("/metrics/ess", "Scalars:scalars"),
            ("/map/roses", "Mesh3D:vertex_positions"),
        ]:  # fmt: skip
            alone, beside = rows_of(run, entity, column), rows_of(tmp_path / "both.rrd", root + entity, column)
            assert [time_ns for time_ns, _ in alone] == [time_ns for time_ns, _ in beside]
            for (_, a), (_, b) in zip(alone, beside, strict=True):
                assert np.array_equal(a, b, equal_nan=True)


def test_what_cannot_be_compared_is_refused(tmp_path: Path, two_runs: list[Path]) -> None:
    foreign = tmp_path / "foreign.rrd"
    other = rr.RecordingStream("other")
    other.save(foreign)
    other.log("points", rr.Points3D([[0, 0, 0]]))
    other.disconnect()
    for runs, titles, error in [
        (two_runs[:1], ["a"], "expected two runs"),
        (two_runs, ["a", "a"], "expected two runs of different titles"),
        ([two_runs[0], foreign], ["a", "b"], r"foreign\.rrd: expected an \.rrd that dirprim wrote"),
    ]:
        with open_stream(save=tmp_path / "no.rrd", force=True) as sink, pytest.raises(ValueError, match=error):
            show_side_by_side(runs, titles, sink)
