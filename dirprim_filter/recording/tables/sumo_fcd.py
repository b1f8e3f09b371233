"""Tracks from SUMO's floating car data, an xml file of any length.

Source: https://sumo.dlr.de/docs/Simulation/Output/FCDOutput.html. x, y are metres of SUMO's network (not lon,
lat: SUMO must run without --fcd-output.geo) and belong to the middle of the vehicle's front bumper; they are
kept as they are, since the file does not contain the vehicle's length. angle is the body's, in compass degrees,
clockwise from north; the course is that of the positions.
"""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Any
from xml.parsers import expat

import numpy as np

from dirprim_filter.arrays import FloatArray
from dirprim_filter.optional_columns import unknown
from dirprim_filter.recording.errors import TableError
from dirprim_filter.recording.tables.delimited import BLOCK_ROWS, exact_nanoseconds, is_number
from dirprim_filter.recording.tables.table import GrowingTable, Table

READ_BYTES = 1 << 20


def angle_of_compass(angle_deg: FloatArray) -> FloatArray:
    """Radians counter-clockwise from east, of degrees clockwise from north. (...) -> (...)."""
    return np.asarray(np.pi / 2 - np.radians(angle_deg))


def read_sumo_fcd(path: str | Path) -> Table:
    """The vehicles of an fcd-export; persons and containers are left out and counted.

    Where a vehicle has no angle or speed, both are differenced from the positions of all.

    Raises:
        TableError: the file is no such xml, an attribute is missing or no number, or it declares a DOCTYPE,
            in which a small file can hide an endless one.
        OSError: the file cannot be read.
    """
    export = _FcdExport(Path(path))
    with export.path.open("rb") as file:
        while data := file.read(READ_BYTES):
            export.feed(data)
    return export.table()


class _FcdExport:
    """Collects the rows of an fcd-export as its xml streams by."""

    def __init__(self, path: Path) -> None:
        self.path = path
        self._parser = expat.ParserCreate()
        self._parser.StartDoctypeDeclHandler = self._on_doctype
        self._parser.StartElementHandler = self._on_start
        self._time_ns: int | None = None  # of the time step that is read
        self._lines: list[int] = []
        self._times: list[int] = []
        self._vehicles: list[dict[str, str]] = []
        self._table = GrowingTable()
        self._n_rows, self._all_move = 0, True

    def feed(self, data: bytes, *, last: bool = False) -> None:
        try:
            self._parser.Parse(data, last)
        except expat.ExpatError as error:
            raise self._error("well-formed xml", expat.ErrorString(error.code), "write it anew") from error

    def table(self) -> Table:
        self.feed(b"", last=True)
        if self._vehicles:
            self._close_block()
        if not self._n_rows:
            raise self._error("vehicles in time steps", "none", "run SUMO with --fcd-output")
        rows = self._table.rows()
        if not self._all_move:
            rows = replace(rows, heading=unknown(len(rows)), speed=unknown(len(rows)))
        return self._table.whole(rows)

    def _on_doctype(self, *_: object) -> None:
        raise self._error("no DOCTYPE", "one", "remove it: SUMO writes none")

    def _on_start(self, name: str, attributes: dict[str, str]) -> None:
        if name == "timestep":
            time = attributes.get("time", "")
            try:
                self._time_ns = exact_nanoseconds(time)
            except ValueError as error:
                raise self._error("seconds as time", repr(time), "write the file anew") from error
        elif name == "vehicle":
            if self._time_ns is None:
                raise self._error("vehicles in time steps", "one before the first", "write the file anew")
            self._lines.append(self._parser.CurrentLineNumber)
            self._times.append(self._time_ns)
            self._vehicles.append(attributes)
            if len(self._vehicles) >= BLOCK_ROWS:
                self._close_block()
        elif name in ("person", "container"):
            self._table.losses.drop("persons and containers", 1)
        elif name != "fcd-export" and self._time_ns is None:
            raise self._error("an fcd-export", f"<{name}>", "run SUMO with --fcd-output")

    def _close_block(self) -> None:
        motion: dict[str, Any] = {}
        if all("angle" in vehicle and "speed" in vehicle for vehicle in self._vehicles):
            motion = {"speed": self._floats("speed"), "heading": angle_of_compass(self._floats("angle"))}
        self._all_move &= bool(motion)
        self._n_rows += len(self._vehicles)
        self._table.extend(
            self._texts("id"), time_ns=np.array(self._times, np.int64),
            position=np.column_stack([self._floats("x"), self._floats("y")]), **motion,
        )  # fmt: skip
        self._lines, self._times, self._vehicles = [], [], []

    def _texts(self, name: str) -> list[str]:
        for line, vehicle in zip(self._lines, self._vehicles, strict=True):
            if name not in vehicle:
                raise TableError(
                    self.path,
                    line,
                    f"{name} of a vehicle",
                    ", ".join(vehicle),
                    "have SUMO write this attribute",
                )
        return [vehicle[name] for vehicle in self._vehicles]

    def _floats(self, name: str) -> FloatArray:
        texts = self._texts(name)
        try:
            return np.fromiter(map(float, texts), np.float64, len(texts))
        except ValueError as error:
            row = next(row for row, text in enumerate(texts) if not is_number(text))
            raise TableError(
                self.path, self._lines[row], f"a number as {name}", repr(texts[row]), "write the file anew"
            ) from error

    def _error(self, expected: str, got: str, remedy: str) -> TableError:
        return TableError(self.path, self._parser.CurrentLineNumber, expected, got, remedy)
