"""Where a table came from: one reader for each format."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from inspect import Parameter, signature
from pathlib import Path
from typing import Any

from dirprim_filter.origin import Origin
from dirprim_filter.recording.name_patterns import FORMATS, form_of, named_values
from dirprim_filter.recording.tables.datasets import read_sdd, read_sumo_fcd, read_trajnet
from dirprim_filter.recording.tables.named_columns import COLUMNS, read_named
from dirprim_filter.recording.tables.table import Table

__all__ = ["READERS", "Table", "read_as", "read_named", "read_sdd", "read_sumo_fcd", "read_trajnet"]

READERS: Mapping[str, Callable[..., Table]] = {
    **dict.fromkeys(FORMATS, read_named),
    "sumo-fcd": read_sumo_fcd, "sdd": read_sdd, "trajnet": read_trajnet,
}  # fmt: skip


def read_as(path: Path, stated: str | None = None, origin: Origin | None = None) -> Table:
    """A table of any format.

    Args:
        path: the file.
        stated: the format, and what the table does not contain, such as `trajnet,frames_per_second=25`; or what a table
            of named columns calls them, such as `csv,x_m=Easting,track_id=Id`, and which not to read, such as
            `heading=`. Left out: as the name of the file ends.
        origin: of the plane.

    Raises:
        RecordingError: as its reader.
        ValueError: there is no such format, or not all is stated that it needs.
        OSError: the file cannot be read.
    """
    form, _, rest = (stated or form_of(path)).partition(",")
    if form not in READERS:
        raise ValueError(f"format: expected one of {', '.join(READERS)}, got {form!r}")
    takes = dict([*signature(READERS[form]).parameters.items()][1:])
    is_named = takes.pop("columns", None) is not None
    takes.pop("origin", None)
    if rest and not (takes or is_named):
        raise ValueError(f"format {form}: expected nothing more, got {rest!r}")
    known = COLUMNS if is_named else takes
    given: dict[str, Any] = named_values(rest, known, of=f"format {form}", emptied=is_named) if rest else {}
    if is_named:
        return READERS[form](path, columns=given, origin=origin)
    for name, parameter in takes.items():
        if name in given:
            given[name] = float(given[name])
        elif parameter.default is Parameter.empty:
            way = f"--set format={form},{name}=... states it"
            raise ValueError(f"{path}: expected {name}, which a table of {form} does not contain; {way}")
    return READERS[form](path, **given).on_plane(origin)
