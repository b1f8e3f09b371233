"""The layout of Foxglove's window for what is written here: the map from above, and plots beside it.

It stands in `layout.json`. The camera is on the frame `scene`, in the middle of what is drawn, so a layout fits any
log; the ground that it shows is that of one. Lichtblick, Foxglove's open fork, reads the same file.
"""

from __future__ import annotations

import json
from importlib import resources
from pathlib import Path
from typing import Any

import numpy as np

from dirprim_filter.partial_file import PartialFile
from dirprim_filter.primitives.primitive_map import PrimitiveMap
from dirprim_filter.recording.foxglove.elements import view_of

MARGIN = 1.05
"""Times as much ground is shown, from the lower to the upper edge, as the map's busy part."""


def layout(primitive_map: PrimitiveMap) -> dict[str, Any]:
    """The layout for logs in a map, as JSON has it."""
    made: dict[str, Any] = json.loads(resources.files(__package__).joinpath("layout.json").read_text("utf-8"))
    ground_m = MARGIN * float(np.ptp(view_of(primitive_map), axis=0).max())
    made["configById"]["3D!map"]["cameraState"]["distance"] = ground_m
    return made


def write_layout(primitive_map: PrimitiveMap, path: str | Path, *, force: bool = False) -> None:
    """Write the layout for logs in a map, to be imported in Foxglove: Layouts, Import from file.

    Raises:
        OutputExistsError: the file exists, and `force` is not set.
        OSError: the file cannot be written.
    """
    with PartialFile(path, force=force) as file:
        file.write(json.dumps(layout(primitive_map), indent=2).encode() + b"\n")
