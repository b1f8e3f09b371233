"""The formats of tables: what each is called, what reads it, and how it is recognised."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from inspect import Parameter, signature
from pathlib import Path

from dirprim_filter.recording.container.other_formats import READ_BYTES
from dirprim_filter.recording.tables.datasets import read_sdd, read_trajnet
from dirprim_filter.recording.tables.files import PARQUET
from dirprim_filter.recording.tables.json_table import read_json
from dirprim_filter.recording.tables.named_columns import read_arrow, read_csv
from dirprim_filter.recording.tables.sumo_fcd import read_sumo_fcd
from dirprim_filter.recording.tables.table import Table

FORMATS: Mapping[str, Callable[..., Table]] = {
    "csv": read_csv, "parquet": read_arrow, "feather": read_arrow, "json": read_json, "sumo-fcd": read_sumo_fcd,
    "sdd": read_sdd, "trajnet": read_trajnet,
}  # fmt: skip
OF_FILE = {PARQUET: "parquet", b"ARROW1": "feather", b"FEA1": "feather"}
"""Of how a file begins, its format."""


def recognised(path: str | Path) -> str:
    """The format of a file by how it begins; csv where it begins otherwise.

    Raises:
        OSError: it cannot be read.
    """
    with Path(path).open("rb") as file:
        opening = file.read(READ_BYTES)
    return next((form for start, form in OF_FILE.items() if opening.startswith(start)), "csv")


def options_of(form: str) -> dict[str, bool]:
    """What the reader of a format takes beside the path, and whether it must be given."""
    parameters = list(signature(FORMATS[form]).parameters.values())[1:]
    return {parameter.name: parameter.default is Parameter.empty for parameter in parameters}
