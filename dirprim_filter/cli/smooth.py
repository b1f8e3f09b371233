"""`dirprim smooth`: the tracks of any tracker, refined by a map or another model of motion."""

from __future__ import annotations

from typing import Annotated

import typer

import dirprim_filter as dp
from dirprim_filter.cli import exit_codes
from dirprim_filter.cli.options import Force, Log, MapOrNone, MaybeTruth, Motion, Output, Particles, Rate, Seed
from dirprim_filter.cli.reading import Reading
from dirprim_filter.cli.settings import Settings
from dirprim_filter.cli.tables import score_text
from dirprim_filter.cli.texts import counted


def smooth(
    estimates: Log,
    output: Output,
    map_file: MapOrNone = None,
    motion: Motion = "learned",
    noise: Annotated[
        float | None, typer.Option(min=1e-6, help="Standard deviation of the tracker's errors, metres. Default: 0.5.")
    ] = None,
    truth: MaybeTruth = None,
    rate: Rate = None,
    particles: Particles = None,
    seed: Seed = 0,
    force: Force = False,
    *,
    reading: Reading,
    settings: Annotated[Settings, "fields of FilterConfig and TrackingConfig"],
) -> int:
    """Refine the tracks of another tracker, offline.

    A log or table with ids is enough. Its rows count as measurements whose errors last. Rows in which the tracker
    coasted are left out and filled in along the map; without one as the other vehicles move anywhere.

    Example: dirprim smooth their_tracks.csv --map map.mcap -o refined.mcap --truth truth.mcap
    """
    import numpy as np

    from dirprim_filter.cli.coverage import Coverage
    from dirprim_filter.cli.motion import map_of, motion_of
    from dirprim_filter.cli.progress import working
    from dirprim_filter.cli.results import provenance, read_filter
    from dirprim_filter.detections import NO_ID
    from dirprim_filter.recording.errors import RecordingError
    from dirprim_filter.recording.writer import EstimateWriter
    from dirprim_filter.refining import is_measured, refine

    primitive_map, reading = map_of(map_file, reading)
    config, tracking = read_filter(None, settings, n_particles=particles, noise_m=noise)
    stream = reading.detections(estimates)
    rows = dp.Detections.concatenate(list(stream))
    reading.require_frames(len(rows), estimates, stream.losses)
    if (rows.track_id == NO_ID).any():
        raise RecordingError(f"{estimates}: expected tracks with ids, got detections; `dirprim track` makes tracks")
    known = None if truth is None else reading.of_truth(truth, "group", "start", "end").tracks([truth])
    Coverage(primitive_map, map_file, estimates, is_needed=motion == "learned").check(rows.position)
    moves, _ = motion_of(motion, primitive_map, rows[is_measured(rows)].frames(), config=config, seed=seed)
    said = provenance(
        "smooth", inputs=[path for path in (estimates, map_file) if path], config=config, seed=seed, rate_hz=rate,
        motion=motion, acceleration_density=moves.acceleration or None, tracking=tracking, **reading.said(),
    )  # fmt: skip
    with working(f"smoothing {estimates.name}"), EstimateWriter(output, metadata=said, force=force) as writer:
        writer.write_map_scene(primitive_map)
        frames = refine(
            rows, lambda: moves.model(config), config=config, tracking=tracking, rate_hz=rate,
            rng=lambda: np.random.default_rng(seed),
        )  # fmt: skip
        for frame in frames:
            writer.write(frame)
    after, n_measured = dp.Estimates.concatenate(frame.estimates for frame in frames), int(is_measured(rows).sum())
    typer.echo(
        f"{output}: {counted(len(after), 'row')} of {counted(np.unique(after.track_id).size, 'track')}, from "
        f"{counted(n_measured, 'measured row')} of {len(rows)}"
    )
    if truth is not None and known is not None:
        from dirprim_filter.evaluation.scores import score_rows
        from dirprim_filter.evaluation.tracked_rows import TrackedRows
        from dirprim_filter.recording.estimate_tables import read_tracked_rows

        before = TrackedRows(track_id=rows.track_id, time_ns=rows.time_ns, position=rows.position, group=rows.group)
        both = {"before": before, "after": read_tracked_rows(output, truth=known.tracks)}
        typer.echo(score_text(score_rows(both, known.tracks, with_ids=False), truth.name))
    return exit_codes.of_losses(stream.losses, *(read.losses for read in [known] if read is not None))
