"""The annotated tracks of nuScenes, a group for each scene, as a table: `python nuscenes.py v1.0-mini OUT.parquet`.

Source: Caesar et al., nuScenes: A Multimodal Dataset for Autonomous Driving, CVPR 2020, and its kit.
"""

import json
import sys
from pathlib import Path

import numpy as np
import pyarrow as pa
from pyarrow import parquet
from scipy.spatial.transform import Rotation

X_Y_Z_W = [1, 2, 3, 0]  # nuScenes has w first


def nuscenes(folder: Path) -> pa.Table:
    """The columns that `dirprim` reads, in the map's frame."""
    boxes = json.loads((folder / "sample_annotation.json").read_bytes())
    sample, instance, category = (
        {one["token"]: one for one in json.loads((folder / f"{name}.json").read_bytes())}
        for name in ("sample", "instance", "category")
    )
    of = [sample[box["sample_token"]] for box in boxes]
    group = {scene: k for k, scene in enumerate(dict.fromkeys(one["scene_token"] for one in of))}
    place, width_first = (np.array([box[name] for box in boxes]) for name in ("translation", "size"))
    ahead = Rotation.from_quat(np.array([box["rotation"] for box in boxes])[:, X_Y_Z_W]).apply([1.0, 0.0, 0.0])
    columns = {
        "time_ns": np.array([one["timestamp"] for one in of]) * 1000,
        "track_id": [box["instance_token"] for box in boxes],
        "group": [group[one["scene_token"]] for one in of],
        "label": [category[instance[box["instance_token"]]["category_token"]]["name"] for box in boxes],
        "x_m": place[:, 0], "y_m": place[:, 1], "heading_rad": np.arctan2(ahead[:, 1], ahead[:, 0]),
        "length_m": width_first[:, 1], "width_m": width_first[:, 0], "height_m": width_first[:, 2],
    }  # fmt: skip
    return pa.table(columns)


if __name__ == "__main__":
    parquet.write_table(nuscenes(Path(sys.argv[1])), sys.argv[2])
