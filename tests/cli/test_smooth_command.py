"""`dirprim smooth`: another tracker's table, refined by a map."""

from pathlib import Path

import numpy as np

from cli.commands import DONE, dirprim
from dirprim_filter import read_estimates, write_tracks
from situations import ring_traffic
from test_refining import other_tracker


def test_a_table_of_tracks_is_refined_and_scored_before_and_after(here, capsys):
    truth = ring_traffic(np.random.default_rng(3), n_vehicles=4, n_rows=60)
    rows, measured = other_tracker(truth, seed=0)
    write_tracks(truth, "truth.mcap")
    lines = [f"{n},{t},{x},{y}" for n, t, (x, y) in zip(rows.track_id, rows.time_ns, rows.position, strict=True)]
    Path("theirs.csv").write_text("\n".join(["track_id,time_ns,x_m,y_m", *lines]))
    assert dirprim("smooth theirs.csv --map map.mcap -o out.mcap --particles 200 --truth truth.mcap") == DONE
    said = capsys.readouterr().out
    assert f"from {measured.sum()} measured rows of {len(rows)}" in said
    before, after = (float(figure) for figure in next(row for row in said.splitlines() if "RMSE, m" in row).split()[2:])
    assert after < before
    assert len(read_estimates("out.mcap")) == len(rows)
    assert dirprim("smooth theirs.csv --map map.mcap -o rated.mcap --particles 200 --rate 50") == DONE
    assert len(read_estimates("rated.mcap")) > 4 * len(rows)
