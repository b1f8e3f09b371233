"""Frames of objects in JSON, as Mcity's roadside detections and GPS, as a table: `python mcity.py FRAMES OUT.parquet`.

Source: Zou et al., Real-time full-stack traffic scene perception for autonomous driving with roadside cameras, 2022.
"""

import json
import sys
from pathlib import Path

import pyarrow as pa
from pyarrow import parquet

KEYS = {"track_id": "id", "latitude_deg": "lat", "longitude_deg": "lon", "label": "classType"}


def mcity(path: Path) -> pa.Table:
    """The columns that `dirprim` reads, of an array of frames or a frame in each line."""
    text = path.read_text()
    frames = (
        json.loads(text)
        if text.lstrip().startswith("[")
        else [json.loads(line) for line in text.splitlines() if line.strip()]
    )
    rows = [(frame["timestamp"], one) for frame in frames for one in frame["objs"]]
    of_objects = {name: [str(one[key]) for _, one in rows] for name, key in KEYS.items() if key in rows[0][1]}
    return pa.table({"time_s": [float(time) for time, _ in rows], **of_objects})


if __name__ == "__main__":
    parquet.write_table(mcity(Path(sys.argv[1])), sys.argv[2])
