"""A log of Argoverse 2, in the city's frame, as a table: `python argoverse2.py LOG OUT.parquet`.

Boxes stand in the axes of the vehicle at their time. Source: Wilson et al., Argoverse 2, 2021, and its api, av2.
"""

import sys
from pathlib import Path

import numpy as np
import pyarrow as pa
from pyarrow import feather, parquet
from scipy.spatial.transform import Rotation

QUATERNION, PLACE, SIZE = ("qx", "qy", "qz", "qw"), ("tx_m", "ty_m", "tz_m"), ("length_m", "width_m", "height_m")


def argoverse2(folder: Path) -> pa.Table:
    """The columns that `dirprim` reads. Boxes without a pose of the vehicle at their very time are left out."""
    boxes = feather.read_table(folder / "annotations.feather")
    poses = feather.read_table(folder / "city_SE3_egovehicle.feather").sort_by("timestamp_ns")
    at = np.minimum(np.searchsorted(poses["timestamp_ns"], boxes["timestamp_ns"]), len(poses) - 1)
    known = poses["timestamp_ns"].to_numpy()[at] == boxes["timestamp_ns"].to_numpy()
    boxes, poses = boxes.filter(known), poses.take(at[known])
    turn, own = (Rotation.from_quat(np.column_stack([of[name] for name in QUATERNION])) for of in (poses, boxes))
    place, own_place = (np.column_stack([of[name] for name in PLACE]) for of in (poses, boxes))
    x, y, _ = (turn.apply(own_place) + place).T
    ahead = (turn * own).apply([1.0, 0.0, 0.0])
    columns = {
        "time_ns": boxes["timestamp_ns"], "track_id": boxes["track_uuid"], "label": boxes["category"], "x_m": x,
        "y_m": y, "heading_rad": np.arctan2(ahead[:, 1], ahead[:, 0]), **{name: boxes[name] for name in SIZE},
    }  # fmt: skip
    return pa.table(columns)


if __name__ == "__main__":
    parquet.write_table(argoverse2(Path(sys.argv[1])), sys.argv[2])
