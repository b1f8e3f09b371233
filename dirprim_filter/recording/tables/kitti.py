"""Tracks from the labels of KITTI's tracking benchmark, in the frame of the ground.

Labels are boxes in the axes of the rectified camera (x right, y down, z ahead), which moves. Its poses stand beside
`label_02/0000.txt`: either `oxts/0000.txt` with `calib/0000.txt` (the plane is that of the satellite fixes, by pyproj,
extra `geo`), or `poses/0000.txt`, a 3 x 4 matrix a frame as in KITTI's odometry (x is ahead of the first camera).

Source: Geiger, Lenz, Stiller and Urtasun, Vision meets Robotics: The KITTI Dataset, IJRR 2013; the benchmark's readme.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np
from scipy.spatial.transform import Rotation

from dirprim_filter.arrays import FloatArray
from dirprim_filter.recording.errors import TableError
from dirprim_filter.recording.losses import Losses
from dirprim_filter.recording.tables.files import text_columns
from dirprim_filter.recording.tables.table import Table, table_of
from dirprim_filter.recording.transforms.geodesy import Origin, placed_on_plane
from dirprim_filter.recording.vehicle_rows import VehicleRows

SIZE, PLACE = ("length", "width", "height"), ("x", "y", "z")
NAMES = (
    "frame", "track id", "label", "truncated", "occluded", "alpha", "left", "top", "right", "bottom", "height", "width",
    "length", *PLACE, "rotation_y", "score",
)  # fmt: skip
MATRICES = {
    "R_rect": "rect", "R0_rect": "rect", "Tr_velo_cam": "velo", "Tr_velo_to_cam": "velo", "Tr_imu_velo": "imu",
    "Tr_imu_to_velo": "imu",
}  # fmt: skip
"""What a matrix is called in KITTI's benchmarks."""
RIGHT_DOWN_AHEAD = np.array([[0.0, 0.0, 1.0], [-1.0, 0.0, 0.0], [0.0, -1.0, 0.0]])
"""Turns the camera's axes into x ahead, y left, z up."""


def read_kitti(path: str | Path, *, frames_per_second: float = 10.0, origin: Origin | None = None) -> Table:
    """The tracks of a `label_02/0000.txt`; direction and speed are differenced from the positions.

    Regions marked DontCare are no vehicles and are left out; rows of frames without a pose are dropped and counted.

    Args:
        path: the labels; the camera's poses stand beside, as the module says.
        frames_per_second: of the camera.
        origin: of the plane of satellite fixes; left out: the first one.

    Raises:
        TableError: a row has another number of cells, or a cell is no number; or no poses stand beside.
        MissingExtraError: pyproj is not installed, and the poses are satellite fixes.
        OSError: a file cannot be read.
    """
    path = Path(path)
    poses, files = _poses(path, origin)
    table, losses = text_columns(path, NAMES, least=len(NAMES) - 1, delimiters=" "), Losses()
    is_vehicle, frame = table.whole_numbers("track id") >= 0, table.whole_numbers("frame")
    known = (frame >= 0) & (frame < len(poses))
    losses.note("of regions marked DontCare", int((~is_vehicle).sum()))
    losses.drop("of a frame without a pose", is_vehicle & ~known)
    pose, yaw = poses[np.where(known, frame, 0)], table.floats("rotation_y")
    forward = np.column_stack([np.cos(yaw), 0 * yaw, -np.sin(yaw), 0 * yaw])  # a direction is not moved
    place = np.column_stack([table.numbers(PLACE), np.ones(len(table))])
    place, forward = (np.einsum("nij,nj->ni", pose, points) for points in (place, forward))
    names, vehicle = table.ids("track id")
    rows = VehicleRows(
        names=names, vehicle=vehicle, time_ns=table.frame_times("frame", frames_per_second=frames_per_second),
        position=place[:, :2], heading=np.arctan2(forward[:, 1], forward[:, 0]), size=table.numbers(SIZE),
    )  # fmt: skip
    kept = is_vehicle & known
    return table_of(rows[kept], label=table.texts("label")[kept], losses=losses, files=(path, *files))


def _poses(path: Path, origin: Origin | None) -> tuple[FloatArray, list[Path]]:
    """(f, 3, 4) what brings the camera's axes to the ground's, of each frame; and the files that say it."""
    oxts, calib, poses = (path.parent.parent / folder / path.name for folder in ("oxts", "calib", "poses"))
    if oxts.exists():
        fixes = _numbers(oxts, 30)
        of_unit = np.zeros((len(fixes), 3, 4))
        of_unit[:, :, :3] = Rotation.from_euler("xyz", fixes[:, 3:6]).as_matrix()
        of_unit[:, :, 3] = placed_on_plane(fixes[:, [1, 0, 2]], origin)
        return of_unit @ _to_unit(calib), [oxts, calib]
    if poses.exists():
        return np.asarray(RIGHT_DOWN_AHEAD @ _numbers(poses, 12).reshape(-1, 3, 4)), [poses]
    raise TableError(path, "", f"the camera's poses as {oxts} or {poses}", "neither", "unpack one of them")


def _to_unit(path: Path) -> FloatArray:
    """(4, 4) of the camera's axes to those of the inertial unit."""
    matrices: dict[str, FloatArray] = {}
    for number, line in enumerate(path.read_text(encoding="utf-8", errors="replace").splitlines(), start=1):
        name, *cells = line.replace(":", " ").split() or [""]
        if name in MATRICES:
            matrices[MATRICES[name]] = homogeneous = np.eye(4)
            try:
                matrix = np.array(cells, np.float64).reshape(3, -1)
                homogeneous[:3, : matrix.shape[1]] = matrix
            except ValueError as error:
                raise TableError(path, number, f"9 or 12 numbers as {name}", str(error), "unpack it anew") from error
    if len(matrices) < len(set(MATRICES.values())):
        got = ", ".join(matrices) or "none of them"
        raise TableError(path, "", "R_rect, Tr_velo_cam and Tr_imu_velo", got, "unpack it anew")
    try:
        return np.asarray(np.linalg.inv(matrices["rect"] @ matrices["velo"] @ matrices["imu"]))
    except np.linalg.LinAlgError as error:
        raise TableError(path, "", "rotations", "matrices that have no inverse", "unpack it anew") from error


def _numbers(path: Path, n_cells: int) -> FloatArray:
    """(n, n_cells) of a text of numbers."""
    names = [f"number {place}" for place in range(1, n_cells + 1)]
    return text_columns(path, names, delimiters=" ").numbers(names)
