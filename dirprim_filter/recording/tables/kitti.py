"""Tracks from the labels of KITTI's tracking benchmark, in the frame of the ground.

Labels are boxes in the axes of the rectified camera (x right, y down, z ahead), which moves. Its poses stand beside
`label_02/0000.txt`: either `oxts/0000.txt` with `calib/0000.txt` (the plane is that of the satellite fixes, by pyproj,
extra `geo`), or `poses/0000.txt`, a 3 x 4 matrix a frame as in KITTI's odometry (x is ahead of the first camera).

Source: Geiger, Lenz, Stiller and Urtasun, Vision meets Robotics: The KITTI Dataset, IJRR 2013; the benchmark's readme.
"""

from __future__ import annotations

from pathlib import Path
from typing import NamedTuple

import numpy as np

from dirprim_filter.arrays import FloatArray
from dirprim_filter.recording.errors import TableError
from dirprim_filter.recording.tables.delimited import DelimitedText
from dirprim_filter.recording.tables.table import GrowingTable, Table
from dirprim_filter.recording.transforms.geodesy import Origin, placed_on_plane

FRAME, TRACK_ID, LABEL, ROTATION_Y = 0, 1, 2, 16
SIZE = {12: "length", 11: "width", 10: "height"}
PLACE = {13: "x", 14: "y", 15: "z"}
N_CELLS, N_SCORED = 17, 18
N_OXTS, N_POSE = 30, 12
MATRICES = {
    "R_rect": "rect", "R0_rect": "rect", "Tr_velo_cam": "velo", "Tr_velo_to_cam": "velo", "Tr_imu_velo": "imu",
    "Tr_imu_to_velo": "imu",
}  # fmt: skip
"""What a matrix is called in KITTI's benchmarks."""
RIGHT_DOWN_AHEAD = np.array([[0.0, 0.0, 1.0], [-1.0, 0.0, 0.0], [0.0, -1.0, 0.0]])
"""Turns the camera's axes into x ahead, y left, z up."""


class _Poses(NamedTuple):
    """(f, 3, 3) and (f, 3): what turns and moves the camera's axes to the ground's, of each frame."""

    rotation: FloatArray
    translation: FloatArray


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
    text, table = DelimitedText(path, delimiters=" "), GrowingTable()
    n_cells = N_SCORED if len(next(text.rows(), (0, []))[1]) == N_SCORED else N_CELLS
    for block in text.blocks(n_cells=n_cells):
        is_vehicle = block.whole_numbers(TRACK_ID, "track id") >= 0
        frame = block.whole_numbers(FRAME, "frame")
        known = (frame >= 0) & (frame < len(poses.translation))
        at = np.where(known, frame, 0)
        place = np.column_stack([block.floats(column, name) for column, name in PLACE.items()])
        yaw = block.floats(ROTATION_Y, "rotation_y")
        forward = np.einsum("nij,nj->ni", poses.rotation[at], np.column_stack([np.cos(yaw), 0 * yaw, -np.sin(yaw)]))
        table.losses.note("of regions marked DontCare", int((~is_vehicle).sum()))
        table.losses.drop("of a frame without a pose", is_vehicle & ~known)
        table.extend(
            block.texts(TRACK_ID), kept=is_vehicle & known, label=np.array(block.texts(LABEL), np.str_),
            time_ns=block.frame_times(FRAME, frames_per_second=frames_per_second),
            position=(np.einsum("nij,nj->ni", poses.rotation[at], place) + poses.translation[at])[:, :2],
            heading=np.arctan2(forward[:, 1], forward[:, 0]),
            size=np.column_stack([block.floats(column, name) for column, name in SIZE.items()]),
        )  # fmt: skip
    return table.whole(files=(path, *files))


def _poses(path: Path, origin: Origin | None) -> tuple[_Poses, list[Path]]:
    """What stands beside the labels, and in which files."""
    oxts, calib, poses = (path.parent.parent / folder / path.name for folder in ("oxts", "calib", "poses"))
    if oxts.exists():
        return _of_oxts(oxts, calib, origin), [oxts, calib]
    if poses.exists():
        matrices = _numbers(poses, N_POSE).reshape(-1, 3, 4)
        moved = RIGHT_DOWN_AHEAD @ matrices
        return _Poses(moved[:, :, :3], moved[:, :, 3]), [poses]
    raise TableError(path, "", f"the camera's poses as {oxts} or {poses}", "neither", "unpack one of them")


def _of_oxts(path: Path, calib: Path, origin: Origin | None) -> _Poses:
    """Of fixes and angles of the inertial unit, and how the camera stands to it."""
    oxts = _numbers(path, N_OXTS)
    place = placed_on_plane(oxts[:, [1, 0, 2]], origin)
    roll, pitch, yaw = oxts[:, 3:6].T
    of_unit = _about(yaw, 0, 1) @ _about(pitch, 2, 0) @ _about(roll, 1, 2)
    known = _calibration(calib)
    to_camera = known["rect"] @ known["velo"] @ known["imu"]
    try:
        to_unit = np.linalg.inv(to_camera)
    except np.linalg.LinAlgError as error:
        raise TableError(calib, "", "rotations", "matrices that have no inverse", "unpack it anew") from error
    return _Poses(of_unit @ to_unit[:3, :3], of_unit @ to_unit[:3, 3] + place)


def _about(angle: FloatArray, i: int, j: int) -> FloatArray:
    """(n, 3, 3) rotations that turn axis i towards axis j."""
    turn = np.broadcast_to(np.eye(3), (angle.size, 3, 3)).copy()
    turn[:, i, i] = turn[:, j, j] = np.cos(angle)
    turn[:, j, i] = np.sin(angle)
    turn[:, i, j] = -turn[:, j, i]
    return turn


def _calibration(path: Path) -> dict[str, FloatArray]:
    """Homogeneous matrices by what they bring nearer to the camera's axes."""
    matrices: dict[str, FloatArray] = {}
    for number, line in enumerate(path.read_text(encoding="utf-8", errors="replace").splitlines(), start=1):
        name, *cells = line.replace(":", " ").split() or [""]
        if name in MATRICES:
            try:
                matrix = np.array(cells, np.float64).reshape(3, -1)
                homogeneous = np.eye(4)
                homogeneous[:3, : matrix.shape[1]] = matrix
            except ValueError as error:
                raise TableError(path, number, f"9 or 12 numbers as {name}", str(error), "unpack it anew") from error
            matrices[MATRICES[name]] = homogeneous
    if len(matrices) < len(set(MATRICES.values())):
        got = ", ".join(matrices) or "none of them"
        raise TableError(path, "", "R_rect, Tr_velo_cam and Tr_imu_velo", got, "unpack it anew")
    return matrices


def _numbers(path: Path, n_cells: int) -> FloatArray:
    """(n, n_cells) of a text of numbers."""
    return np.concatenate([
        np.column_stack([block.floats(column, f"number {column + 1}") for column in range(n_cells)])
        for block in DelimitedText(path, delimiters=" ").blocks(n_cells=n_cells)
    ])  # fmt: skip
