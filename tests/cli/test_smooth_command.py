"""`dirprim smooth`: another tracker's table, refined by a map."""

import numpy as np

from dirprim_filter import read_estimates, save_map, write_tracks
from dirprim_filter.cli.main import run
from situations import ring_traffic
from test_refining import other_tracker


def test_a_table_of_tracks_is_refined_and_scored_before_and_after(ring_map, tmp_path, capsys):
    truth = ring_traffic(np.random.default_rng(3), n_vehicles=4, n_rows=60)
    rows, measured = other_tracker(truth, seed=0)
    save_map(ring_map, tmp_path / "map.mcap")
    write_tracks(truth, tmp_path / "truth.mcap")
    lines = [f"{n},{t},{x},{y}" for n, t, (x, y) in zip(rows.track_id, rows.time_ns, rows.position, strict=True)]
    (tmp_path / "theirs.csv").write_text("\n".join(["track_id,time_ns,x_m,y_m", *lines]))
    given = [str(tmp_path / "theirs.csv"), "--map", str(tmp_path / "map.mcap"), "-o", str(tmp_path / "out.mcap")]
    assert run(["smooth", *given, "--particles", "200", "--truth", str(tmp_path / "truth.mcap")]) == 0
    said = capsys.readouterr().out
    assert f"from {measured.sum()} measured rows of {len(rows)}" in said
    before, after = (float(figure) for figure in next(row for row in said.splitlines() if "RMSE, m" in row).split()[2:])
    assert after < before
    assert len(read_estimates(tmp_path / "out.mcap")) == len(rows)

    assert run(["smooth", *given]) == 1
    assert "exists" in capsys.readouterr().err


def test_detections_without_ids_are_no_tracks(ring_map, tmp_path, capsys):
    save_map(ring_map, tmp_path / "map.mcap")
    (tmp_path / "seen.csv").write_text("time_s,x_m,y_m\n0,1,2\n1,2,3\n")
    given = ["smooth", str(tmp_path / "seen.csv"), "--map", str(tmp_path / "map.mcap"), "-o", str(tmp_path / "o.mcap")]
    assert run(given) == 1
    assert "expected tracks with ids, got detections" in capsys.readouterr().err
    assert not (tmp_path / "o.mcap").exists()
