"""Observed motion: a cube for each vehicle, a small sphere for each report; `schemas.scene_update` reads them back."""

from __future__ import annotations

import math

import numpy as np
from foxglove.messages import CubePrimitive, KeyValuePair, SceneUpdate, SpherePrimitive, Vector3

from dirprim_filter.arrays import IntArray
from dirprim_filter.detections import Detections
from dirprim_filter.recording.foxglove.scene import entity, painted, pose
from dirprim_filter.recording.schemas.dirprim import MAP_FRAME
from dirprim_filter.recording.schemas.scene_update import HEADING_NOTE, SIZE_NOTES
from dirprim_filter.track_ids import as_texts
from dirprim_filter.tracks import Tracks

VEHICLE_SIZE = (4.5, 1.9, 1.5)
"""Length, width and height of the cube that stands for a vehicle of unknown size, metres: a middling car."""
VEHICLE_COLOR = painted((0.35, 0.6, 0.95), 0.6)
REPORT_M, REPORT_COLOR = 0.6, painted((1.0, 0.85, 0.2), 0.9)


def tracks_scene(tracks: Tracks, rows: IntArray, time_ns: int, *, lifetime_ns: int) -> SceneUpdate:
    """The vehicles of one instant; metadata hold direction, speed, group, and where known size and heading."""
    direction, size, heading = tracks.direction[rows], tracks.size[rows], tracks.heading[rows]
    notes = {
        "direction_rad": direction, "speed_mps": tracks.speed[rows], "group": tracks.group[rows],
        **dict(zip(SIZE_NOTES, size.T, strict=True)), HEADING_NOTE: heading,
    }  # fmt: skip
    entities = []
    for name, (at_x, at_y), yaw, (x, y, z), noted in zip(
        as_texts(tracks.track_id[rows]).tolist(), tracks.position[rows].tolist(),
        np.where(np.isnan(heading), direction, heading).tolist(),
        np.where(np.isnan(size), VEHICLE_SIZE, size).tolist(),
        zip(*(column.tolist() for column in notes.values()), strict=True), strict=True,
    ):  # fmt: skip
        body = CubePrimitive(pose=pose(at_x, at_y, z / 2, yaw), size=Vector3(x=x, y=y, z=z), color=VEHICLE_COLOR)
        known = [(key, value) for key, value in zip(notes, noted, strict=True) if not math.isnan(value)]
        entities.append(entity(
            name, time_ns, frame=MAP_FRAME, lifetime_ns=lifetime_ns, frame_locked=True, cubes=[body],
            metadata=[KeyValuePair(key=key, value=repr(value)) for key, value in known],
        ))  # fmt: skip
    return SceneUpdate(entities=entities)


def detections_scene(detections: Detections, rows: IntArray, time_ns: int, *, lifetime_ns: int) -> SceneUpdate:
    """A small sphere for each report of one instant."""
    size = Vector3(x=REPORT_M, y=REPORT_M, z=REPORT_M)
    spheres = (
        SpherePrimitive(pose=pose(x, y, REPORT_M / 2), size=size, color=REPORT_COLOR)
        for x, y in detections.position[rows].tolist()
    )
    names = detections.track_id[rows].tolist()
    return SceneUpdate(
        entities=[
            entity(name, time_ns, frame=MAP_FRAME, lifetime_ns=lifetime_ns, spheres=[sphere])
            for name, sphere in zip(names, spheres, strict=True)
        ]
    )
