"""`dirprim calibrate`: how a sensor errs, measured against the truth."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from dirprim_filter.cli import losses
from dirprim_filter.cli.options import Force, Logs, Output
from dirprim_filter.cli.reading import Reading, reads_logs
from dirprim_filter.cli.sensing import number_lines
from dirprim_filter.cli.texts import counted

if TYPE_CHECKING:
    from dirprim_filter.detections import Detections
    from dirprim_filter.evaluation.calibration import Calibration
    from dirprim_filter.tracks import Tracks


@reads_logs()
def calibrate(
    logs: Logs,
    truth: Annotated[
        list[Path],
        typer.Option("--truth", help="A log of where vehicles were; again for each of several logs, or one for all."),
    ],
    output: Output,
    force: Force = False,
    *,
    reading: Reading,
) -> int:
    """Measure how a sensor errs, against the truth.

    Latency, bias, spread, correlation, misses and false detections are written as TOML.

    Not all vehicles need be in the truth. The clocks may differ by a constant, which is found. Options that choose a
    part of a log are about the detections. `dirprim track --sensor` uses the file.

    Example: dirprim calibrate detections.mcap --truth truth.mcap -o sensor.toml
    """
    from dirprim_filter.cli.progress import working
    from dirprim_filter.detections import Detections
    from dirprim_filter.evaluation.calibration import calibrate as measure
    from dirprim_filter.recording.losses import Losses
    from dirprim_filter.recording.sensor_file import save_sensor

    if len(truth) not in (1, len(logs)):
        raise typer.BadParameter(f"expected one, or one for each of the {len(logs)} logs", param_hint="--truth")
    lost = Losses()
    seen: list[Detections] = []
    for path in logs:
        stream = reading.detections(path)
        seen.append(Detections.concatenate(stream))
        reading.require_frames(len(seen[-1]), path, stream.losses)
        lost += stream.losses
    # Of the truth all, in the frame and by the origin of the detections.
    of_truth = replace(reading, topics=None, start=None, end=None, fields=None, labels=None, group=None)
    known = [of_truth.tracks([path]).tracks for path in truth]
    with working(f"measuring {', '.join(path.name for path in logs)}"):
        measured = measure(*_paired(seen, known))
    save_sensor(measured.sensor, output, force=force)
    typer.echo(calibration_text(measured))
    return losses.exit_code(lost)


def calibration_text(measured: Calibration) -> str:
    """A line for each number, what is not known, and what it was learned from."""
    lines = [
        f"{counted(measured.n_pairs, 'detection')} of {counted(measured.n_vehicles, 'true vehicle')}, of "
        f"{measured.n_detections} in all; +- half a 99 % interval"
    ]
    if measured.clock_offset_s:
        lines.append(
            f"the detections' clock is {measured.clock_offset_s:+.3f} s ahead of the truth's, latency included"
        )
    lines += number_lines(measured.sensor.numbers(), measured.sensor.uncertainty)
    return "\n".join([*lines, *(f"not known: {line}" for line in measured.unknown)])


def _paired(seen: list[Detections], known: list[Tracks]) -> tuple[Detections, Tracks]:
    """All as one log: each pair of files a world of its own, or one truth for all."""
    import numpy as np

    from dirprim_filter.detections import Detections
    from dirprim_filter.track_ids import world_names
    from dirprim_filter.tracks import Tracks

    if len(known) == 1:
        return Detections.concatenate(seen), known[0]
    groups = [of.group for of in seen] + [of.group for of in known]
    apart = 1 + max(int(group.max(initial=0)) for group in groups)

    def apart_by(i: int, of: Tracks | Detections) -> dict[str, Any]:
        return {"group": of.group + i * apart, "track_id": world_names(of.track_id, np.full(len(of), i))}

    return (
        Detections.concatenate([replace(of, **apart_by(i, of)) for i, of in enumerate(seen)]),
        Tracks.concatenate([replace(of, **apart_by(i, of)) for i, of in enumerate(known)]),
    )
