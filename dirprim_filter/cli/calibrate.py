"""`dirprim calibrate`: how a sensor errs, measured against the truth."""

from __future__ import annotations

from dirprim_filter.cli import exit_codes
from dirprim_filter.cli.options import Force, Log, Output, Truth
from dirprim_filter.cli.reading import Reading
from dirprim_filter.cli.texts import counted, say


def calibrate(log: Log, truth: Truth, output: Output, force: Force = False, *, reading: Reading) -> int:
    """Measure how a sensor errs, against the truth.

    Latency, bias, spread, correlation, misses and false detections are written as TOML, for `dirprim track --sensor`.
    Not all vehicles need be in the truth. The clocks may differ by a constant, which is found. Options that choose a
    part of a log are about the detections.

    Example: dirprim calibrate detections.mcap --truth truth.mcap -o sensor.toml
    """
    from dirprim_filter.cli.progress import working
    from dirprim_filter.cli.sensing import number_lines
    from dirprim_filter.detections import Detections
    from dirprim_filter.evaluation.calibration.calibrating import calibrate as measure
    from dirprim_filter.recording.sensor_file import save_sensor

    stream = reading.detections(log)
    seen = Detections.concatenate(stream)
    reading.require_frames(len(seen), log, stream.losses)
    of_truth = reading.of_truth(truth).on_plane_of(log, seen.origin)
    known = of_truth.tracks([truth])
    with working(f"measuring {log.name}"):
        measured = measure(seen, known.tracks)
    save_sensor(measured.sensor, output, force=force)
    head = (
        f"{counted(measured.n_pairs, 'detection')} of {counted(measured.n_vehicles, 'true vehicle')}, of "
        f"{measured.n_detections} in all; +- half a 99 % interval"
    )
    offset = f"the detections' clock is {measured.clock_offset_s:+.3f} s ahead of the truth's, latency included"
    numbers = number_lines(measured.sensor.numbers(), measured.sensor.uncertainty)
    say(head, *[offset] * bool(measured.clock_offset_s), *numbers, *(f"not known: {why}" for why in measured.unknown))
    return exit_codes.of_losses(stream.losses, known.losses)
