"""Data sets of road users in their own forms: SDD, TrajNet, and SUMO's floating car data.

Sources: the readme of the Stanford Drone Dataset; Sadeghian et al., TrajNet: Towards a Benchmark for Human Trajectory
Prediction, 2018; https://sumo.dlr.de/docs/Simulation/Output/FCDOutput.html.
"""

from __future__ import annotations

from pathlib import Path
from typing import Any
from xml.parsers import expat

import numpy as np
import pyarrow as pa

from dirprim_filter.recording.errors import TableError
from dirprim_filter.recording.losses import Losses
from dirprim_filter.recording.rows import LEFT_OUT, Rows
from dirprim_filter.recording.tables.cells import Cells
from dirprim_filter.recording.tables.files import text_cells
from dirprim_filter.recording.tables.table import Table, table_of

SDD = ("track id", "xmin", "ymin", "xmax", "ymax", "frame", "lost", "occluded", "generated", "label")
TRAJNET = ("frame", "track id", "x", "y")
FCD, NEEDED = ("time", "id", "x", "y", "angle", "speed"), ("id", "x", "y")


def read_sdd(path: str | Path, *, metres_per_pixel: float, frames_per_second: float = 30.0) -> Table:
    """The tracks of an `annotations.txt` of the Stanford Drone Dataset: centres of boxes in the pixels of a video.

    North is up in the image, whose y points down. Rows marked lost are dropped and counted; those interpolated between
    annotations ("generated") are kept.

    Args:
        path: the file.
        metres_per_pixel: scale of the video.
        frames_per_second: rate of the video.

    Raises:
        TableError: a row has not ten cells, or a cell is no number.
        ValueError: a scale that is not positive.
        OSError: the file cannot be read.
    """
    if not (np.isfinite(metres_per_pixel) and metres_per_pixel > 0):
        raise ValueError(f"metres_per_pixel: expected a positive number, got {metres_per_pixel}")
    table, losses = text_cells(path, SDD), Losses()
    x_min, y_min, x_max, y_max = table.numbers(SDD[1:5]).T
    names, vehicle = table.ids("track id")
    rows = Rows(
        names=names, track_id=vehicle, time_ns=table.frame_times("frame", frames_per_second=frames_per_second),
        position=np.column_stack([x_min + x_max, -(y_min + y_max)]) * (0.5 * metres_per_pixel),
        label=table.texts("label"),
    )  # fmt: skip
    lost = table.floats("lost") != 0
    losses.drop("marked as lost", lost)
    return table_of(Path(path), rows[~lost], losses=losses)


def read_trajnet(path: str | Path, *, frames_per_second: float) -> Table:
    """The tracks of a text of frame, id, x, y in metres, with spaces or tabs between, as TrajNet, ETH and UCY have.

    Args:
        path: the file.
        frames_per_second: how many frames, as they are numbered, pass in a second: of ETH and UCY 25, where each tenth
            is annotated.

    Raises:
        TableError: a row has not four cells, or a cell is no number.
        ValueError: a rate that is not positive.
        OSError: the file cannot be read.
    """
    table = text_cells(path, TRAJNET)
    names, vehicle = table.ids("track id")
    time_ns = table.frame_times("frame", frames_per_second=frames_per_second)
    return table_of(Path(path), Rows(names=names, track_id=vehicle, time_ns=time_ns, position=table.numbers("xy")))


def read_sumo_fcd(path: str | Path) -> Table:
    """The vehicles of SUMO's fcd-export, an xml; persons and containers are left out and counted.

    x, y are metres of SUMO's network (not lon, lat: SUMO must run without --fcd-output.geo) and belong to the middle of
    the vehicle's front bumper; they are kept as they are, since the file does not contain the vehicle's length. angle
    is the body's, in compass degrees; the course is that of the positions. Where a vehicle has no angle or speed, both
    are differenced from the positions of all.

    Raises:
        TableError: the file is no such xml, an attribute is missing or no number, or it declares a DOCTYPE,
            in which a small file can hide an endless one.
        OSError: the file cannot be read.
    """
    path, losses = Path(path), Losses()
    cells = _vehicles(path, losses)
    if not len(cells):
        raise TableError(path, "", "vehicles in time steps", "none", "run SUMO with --fcd-output")
    table = Cells(path, cells, cells["line"].to_numpy())
    angle, speed = table.numbers(("angle", "speed")).T
    moves = not np.isnan(angle + speed).any()
    names, vehicle = table.ids("id")
    rows = Rows(
        names=names, track_id=vehicle, time_ns=table.nanoseconds("time"), position=table.numbers("xy"),
        heading=np.pi / 2 - np.radians(angle) if moves else LEFT_OUT, speed=speed if moves else LEFT_OUT,
    )  # fmt: skip
    return table_of(path, rows, losses=losses)


def _vehicles(path: Path, losses: Losses) -> Any:
    """The line and the cells of each vehicle, as a table."""
    parser, found, time = expat.ParserCreate(), list[dict[str, Any]](), ""
    schema = pa.schema([("line", pa.int64()), *((name, pa.string()) for name in FCD)])

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
            found.append(attributes | {"time": time, "line": parser.CurrentLineNumber})
        elif name in ("person", "container"):
            losses.drop("of persons and containers", 1)
        elif name != "fcd-export" and not time:
            raise wrong("an fcd-export", f"<{name}>", "run SUMO with --fcd-output")

    parser.StartDoctypeDeclHandler, parser.StartElementHandler = refuse, start
    with path.open("rb") as file:
        try:
            parser.ParseFile(file)
        except expat.ExpatError as error:
            raise wrong("well-formed xml", expat.ErrorString(error.code), "write it anew") from error
    return pa.Table.from_pylist(found, schema)
