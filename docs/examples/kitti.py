"""The labels of KITTI's tracking benchmark on the ground, as a table: `python kitti.py label_02/0000.txt OUT.parquet`.

Labels stand in the axes of the rectified camera (x right, y down, z ahead), which moves: `oxts` and `calib` beside
`label_02` say where it is, in metres east and north of the first satellite fix. Needs pyproj.

Source: Geiger, Lenz, Stiller and Urtasun, Vision meets Robotics: The KITTI Dataset, IJRR 2013; the benchmark's readme.
"""

import sys
from pathlib import Path

import numpy as np
import pyarrow as pa
from pyarrow import parquet
from pyproj import Transformer
from scipy.spatial.transform import Rotation

TIMES_S = 0.1  # between frames
CALIBRATION = (("R_rect", "R0_rect"), ("Tr_velo_cam", "Tr_velo_to_cam"), ("Tr_imu_velo", "Tr_imu_to_velo"))


def kitti(labels: Path) -> pa.Table:
    """The columns that `dirprim` reads. Regions marked DontCare are left out."""
    oxts, calib = (labels.parent.parent / folder / labels.name for folder in ("oxts", "calib"))
    rows = np.array([line.split()[:17] for line in labels.read_text().splitlines() if " DontCare " not in line])
    number = rows[:, 5:].astype(float)
    camera = _camera_poses(np.loadtxt(oxts, ndmin=2), calib)[rows[:, 0].astype(int)]
    ahead = np.column_stack([np.cos(number[:, 11]), 0 * number[:, 11], -np.sin(number[:, 11])])
    ahead = np.einsum("nij,nj->ni", camera[:, :3, :3], ahead)
    place = np.einsum("nij,nj->ni", camera[:, :3, :3], number[:, 8:11]) + camera[:, :3, 3]
    columns = {
        "time_s": rows[:, 0].astype(int) * TIMES_S, "track_id": rows[:, 1], "label": rows[:, 2], "x_m": place[:, 0],
        "y_m": place[:, 1], "heading_rad": np.arctan2(ahead[:, 1], ahead[:, 0]), "length_m": number[:, 7],
        "width_m": number[:, 6], "height_m": number[:, 5],
    }  # fmt: skip
    return pa.table(columns)


def _camera_poses(fixes: np.ndarray, calib: Path) -> np.ndarray:
    """(f, 4, 4) what brings the camera's axes to the ground's, frame by frame."""
    plane = f"+proj=topocentric +ellps=WGS84 +lat_0={fixes[0, 0]} +lon_0={fixes[0, 1]} +h_0=0"
    east_north_up = Transformer.from_pipeline(
        f"+proj=pipeline +step +proj=unitconvert +xy_in=deg +xy_out=rad +step +proj=cart +ellps=WGS84 +step {plane}"
    )
    unit = np.tile(np.eye(4), (len(fixes), 1, 1))
    unit[:, :3, :3] = Rotation.from_euler("xyz", fixes[:, 3:6]).as_matrix()
    unit[:, :3, 3] = np.column_stack(east_north_up.transform(*fixes[:, [1, 0, 2]].T))
    lines = dict(line.replace(":", " ").split(maxsplit=1) for line in calib.read_text().splitlines() if line.strip())
    to_camera = np.eye(4)
    for names in CALIBRATION:
        step = np.eye(4)
        matrix = np.array(next(lines[name] for name in names if name in lines).split(), float).reshape(3, -1)
        step[:3, : matrix.shape[1]] = matrix
        to_camera = to_camera @ step
    return unit @ np.linalg.inv(to_camera)


if __name__ == "__main__":
    parquet.write_table(kitti(Path(sys.argv[1])), sys.argv[2])
