"""`dirprim view`: a recording or a map in the rerun viewer."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer


def view(
    file: Annotated[Path, typer.Argument(help="An .rrd, or a map that `dirprim learn` wrote.", exists=True)],
) -> None:
    """Open a recording or a map in the rerun viewer on this machine.

    Example: dirprim view demo/tracks.rrd
    """
    from dirprim_filter.viewer.stream import open_stream, show_file

    if file.suffix == ".rrd":
        show_file(file)
        return
    from dirprim_filter.recording import load_map

    learned = load_map(file)
    with open_stream(spawn=True) as stream:
        stream.log_map(learned)
