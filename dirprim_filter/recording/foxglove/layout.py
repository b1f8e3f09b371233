"""The layout of Foxglove's window for what is written here: the map from above, and plots beside it.

The camera stands on the frame `scene`, in the middle of what is drawn, so a layout fits any log; the ground that it
shows is that of one. Lichtblick, Foxglove's open fork, reads the same file.
"""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import numpy as np

from dirprim_filter.partial_file import PartialFile
from dirprim_filter.primitives.primitive_map import PrimitiveMap
from dirprim_filter.recording import topic_names
from dirprim_filter.recording.foxglove.scene import SCENE_FRAME, view_of

BACKGROUND = "#10131a"
NO_AXES = {"axisScale": 0.0, "lineWidth": 0.0, "showLabel": False}
FURTHEST_M = 5000.0
"""The camera of a view from above stands half as high."""
MARGIN = 1.05
"""Times as much ground is shown as the map's busy part."""
PLOTS = {
    "speed": ("Speed of each vehicle, m/s", ("speed",)),
    "existence": ("Probability that each vehicle exists", ("existence",)),
    "samples": ("Effective sample size of each vehicle", ("effective_sample_size",)),
    "evidence": ("Log evidence of each vehicle", ("log_evidence",)),
}
"""By panel: its title, and the columns of `dirprim.TrackEstimates` in it."""


def layout(primitive_map: PrimitiveMap) -> dict[str, Any]:
    """The layout for logs in a map, as JSON has it."""
    ground_m = MARGIN * float(np.ptp(view_of(primitive_map), axis=0).max())
    panels = {"3D!map": _from_above(ground_m)} | {
        f"Plot!{name}": _plot(title, columns) for name, (title, columns) in PLOTS.items()
    }
    return {
        "configById": panels,
        "globalVariables": {},
        "userNodes": {},
        "playbackConfig": {"speed": 1},
        "layout": _beside("3D!map", _stacked([f"Plot!{name}" for name in PLOTS]), share=68.0),
    }


def write_layout(primitive_map: PrimitiveMap, path: str | Path, *, force: bool = False) -> None:
    """Write the layout for logs in a map, to be imported in Foxglove: Layouts, Import from file.

    Raises:
        OutputExistsError: the file exists, and `force` is not set.
        OSError: the file cannot be written.
    """
    with PartialFile(path, force=force) as file:
        file.write(json.dumps(layout(primitive_map), indent=2).encode() + b"\n")


def _from_above(ground_m: float) -> dict[str, Any]:
    """The map, north up, and all that lies on it; `ground_m` metres of it from the upper to the lower edge."""
    shown: dict[str, Any] = {"visible": True, "showOutlines": False}
    points: dict[str, Any] = {"visible": True, "pointShape": "circle"}
    return _titled("Map, north up") | {
        "cameraState": {
            "perspective": False,
            "distance": ground_m,
            "phi": 0.0,
            "thetaOffset": 0.0,
            "target": [0.0, 0.0, 0.0],
            "targetOffset": [0.0, 0.0, 0.0],
            "targetOrientation": [0.0, 0.0, 0.0, 1.0],
            "fovy": 45.0,
            "near": 0.5,
            "far": FURTHEST_M,
        },
        "followMode": "follow-pose",
        "followTf": SCENE_FRAME,
        "scene": {"backgroundColor": BACKGROUND, "transforms": NO_AXES},
        "transforms": {},
        "topics": {
            topic_names.MAP_SCENE: shown,
            topic_names.FORECAST: shown,
            topic_names.ESTIMATES_SCENE: shown,
            topic_names.SMOOTHED_SCENE: shown | {"visible": False},
            topic_names.PARTICLES: points | {"pointSize": 2.0, "colorMode": "rgba-fields"},
            topic_names.REPORTS: points | {"pointSize": 5.0, "colorMode": "flat", "flatColor": "#ffffff"},
            topic_names.OBJECTS_SCENE: shown,
            topic_names.DETECTIONS_SCENE: shown,
        },
        "layers": {},
        "publish": {"type": "point"},
        "imageMode": {},
    }


def _plot(title: str, columns: tuple[str, ...]) -> dict[str, Any]:
    return _titled(title) | {
        "paths": [
            {
                "value": f"{topic_names.ESTIMATES}.{column}[:]",
                "enabled": True,
                "timestampMethod": "receiveTime",
                "showLine": False,
            }
            for column in columns
        ],
        "showLegend": False,
        "legendDisplay": "none",
        "isSynced": True,
        "xAxisVal": "timestamp",
        "showXAxisLabels": True,
        "showYAxisLabels": True,
    }


def _titled(title: str) -> dict[str, Any]:
    """Foxglove reads the one key, Lichtblick the other."""
    return {"title": title, "foxglovePanelTitle": title, "lichtblickPanelTitle": title}


def _beside(first: Any, second: Any, *, share: float, direction: str = "row") -> dict[str, Any]:
    """Two panels, of which the first has this share of the room in percent."""
    return {"direction": direction, "first": first, "second": second, "splitPercentage": share}


def _stacked(panels: list[str]) -> Any:
    """Panels of the same height, one below the other."""
    if len(panels) == 1:
        return panels[0]
    return _beside(panels[0], _stacked(panels[1:]), share=100.0 / len(panels), direction="column")
