"""Tracks from SUMO's floating car data, an xml file of any length.

Source: https://sumo.dlr.de/docs/Simulation/Output/FCDOutput.html. x, y are metres of SUMO's network (not lon,
lat: SUMO must run without --fcd-output.geo) and belong to the middle of the vehicle's front bumper; they are
kept as they are, since the file does not contain the vehicle's length. angle is the body's, in compass degrees,
clockwise from north; the course is that of the positions.
"""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from xml.parsers import expat

import numpy as np

from dirprim_filter.recording.errors import TableError
from dirprim_filter.recording.losses import Losses
from dirprim_filter.recording.rows import LEFT_OUT, Rows
from dirprim_filter.recording.tables.columns import Columns
from dirprim_filter.recording.tables.table import Table, table_of

READ_BYTES = 1 << 20
NEEDED = ("id", "x", "y")
NAMES = ("time", *NEEDED, "angle", "speed")


def read_sumo_fcd(path: str | Path) -> Table:
    """The vehicles of an fcd-export; persons and containers are left out and counted.

    Where a vehicle has no angle or speed, both are differenced from the positions of all.

    Raises:
        TableError: the file is no such xml, an attribute is missing or no number, or it declares a DOCTYPE,
            in which a small file can hide an endless one.
        OSError: the file cannot be read.
    """
    losses = Losses()
    table = Columns.of_cells(Path(path), NAMES, _vehicles(Path(path), losses))
    if not len(table):
        raise TableError(Path(path), "", "vehicles in time steps", "none", "run SUMO with --fcd-output")
    angle, speed = table.numbers(("angle", "speed")).T
    moves = not np.isnan(angle + speed).any()
    names, vehicle = table.ids("id")
    rows = Rows(
        names=names, track_id=vehicle, time_ns=table.nanoseconds("time"), position=table.numbers("xy"),
        heading=np.pi / 2 - np.radians(angle) if moves else LEFT_OUT, speed=speed if moves else LEFT_OUT,
    )  # fmt: skip
    return table_of(rows, losses=losses)


def _vehicles(path: Path, losses: Losses) -> Iterator[tuple[int, list[str]]]:
    """The line and the cells, by `NAMES`, of each vehicle, as the xml streams by."""
    parser, found, time = expat.ParserCreate(), [], ""

    def wrong(expected: str, got: str, remedy: str) -> TableError:
        return TableError(path, parser.CurrentLineNumber, expected, got, remedy)

    def refuse(*_: object) -> None:
        raise wrong("no DOCTYPE", "one", "remove it: SUMO writes none")

    def start(name: str, attributes: dict[str, str]) -> None:
        nonlocal time
        if name == "timestep":
            time = attributes.get("time", "")
        elif name == "vehicle":
            if not time:
                raise wrong("vehicles in time steps", "one without a time", "write the file anew")
            if missing := [need for need in NEEDED if need not in attributes]:
                raise wrong(f"{missing[0]} of a vehicle", ", ".join(attributes), "have SUMO write this attribute")
            found.append((parser.CurrentLineNumber, [time, *(attributes.get(of, "") for of in NAMES[1:])]))
        elif name in ("person", "container"):
            losses.drop("persons and containers", 1)
        elif name != "fcd-export" and not time:
            raise wrong("an fcd-export", f"<{name}>", "run SUMO with --fcd-output")

    parser.StartDoctypeDeclHandler, parser.StartElementHandler = refuse, start
    with path.open("rb") as file:
        data = b"start"
        while data:
            data = file.read(READ_BYTES)
            try:
                parser.Parse(data, not data)
            except expat.ExpatError as error:
                raise wrong("well-formed xml", expat.ErrorString(error.code), "write it anew") from error
            yield from found
            found.clear()
