"""Models of sensors as TOML files: what `dirprim calibrate` writes, and what anybody may write by hand."""

from __future__ import annotations

import tomllib
from collections.abc import Mapping
from pathlib import Path

from dirprim_filter.config import from_table
from dirprim_filter.partial_file import PartialFile
from dirprim_filter.sensor import Sensor

DIGITS = 6
"""Of the numbers written; none is known to as many."""


def load_sensor(path: str | Path) -> Sensor:
    """The sensor that a TOML file describes.

    Raises:
        ValueError: the file is no TOML, or holds an unknown name or a number out of range; names the file.
        OSError: the file cannot be read.
    """
    path = Path(path)
    try:
        table = tomllib.loads(path.read_text(encoding="utf-8"))
    except (ValueError, RecursionError) as error:  # what is no TOML or no UTF-8 is the first as well
        raise ValueError(f"{path}: expected a sensor in TOML, as `dirprim calibrate` writes it: {error}") from error
    try:
        return from_table(Sensor, table)
    except ValueError as error:
        raise ValueError(f"{path}: {error}") from error


def save_sensor(sensor: Sensor, path: str | Path, *, force: bool = False) -> None:
    """Write the file.

    Raises:
        OutputExistsError: the file exists, and `force` is not set.
        OSError: the file cannot be written.
    """
    with PartialFile(path, force=force) as file:
        file.write(sensor_text(sensor).encode())


def sensor_text(sensor: Sensor) -> str:
    """The sensor as TOML: numbers that are not known are left out."""
    numbers = {name: value for name, value in sensor.numbers().items() if value is not None}
    lines = _lines({name: value for name, value in numbers.items() if "." not in name})
    for axis in ("along", "across"):
        own = {name.partition(".")[2]: value for name, value in numbers.items() if name.startswith(f"{axis}.")}
        lines += ["", f"[{axis}]", *_lines(own)]
    if sensor.uncertainty:
        quoted = {f'"{name}"': width for name, width in sensor.uncertainty.items()}
        lines += ["", "[uncertainty]  # half the widths of 99 % intervals", *_lines(quoted)]
    return "\n".join(lines) + "\n"


def _lines(numbers: Mapping[str, float]) -> list[str]:
    return [f"{name} = {float(f'{value:.{DIGITS}g}')!r}" for name, value in numbers.items()]
