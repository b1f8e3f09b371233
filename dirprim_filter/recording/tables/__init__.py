"""Where a table came from: one reader for each format."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from inspect import Parameter, signature

from dirprim_filter.recording.tables.datasets import read_sdd, read_sumo_fcd, read_trajnet
from dirprim_filter.recording.tables.named_columns import read_named
from dirprim_filter.recording.tables.table import Table

__all__ = ["FORMATS", "Table", "options_of", "read_named", "read_sdd", "read_sumo_fcd", "read_trajnet"]

FORMATS: Mapping[str, Callable[..., Table]] = {
    **dict.fromkeys(("csv", "parquet", "feather"), read_named),
    "sumo-fcd": read_sumo_fcd, "sdd": read_sdd, "trajnet": read_trajnet,
}  # fmt: skip


def options_of(form: str) -> dict[str, bool]:
    """What the reader of a format takes beside the path, and whether it must be given."""
    parameters = list(signature(FORMATS[form]).parameters.values())[1:]
    return {parameter.name: parameter.default is Parameter.empty for parameter in parameters}
