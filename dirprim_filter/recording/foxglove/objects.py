"""Observed motion: a cube for each vehicle, a small sphere for each report; `schemas.scene_update` reads them back."""

from __future__ import annotations

import math

from foxglove_schemas_protobuf.SceneUpdate_pb2 import SceneUpdate

from dirprim_filter.arrays import IntArray
from dirprim_filter.detections import Detections
from dirprim_filter.recording.foxglove.entities import add_entity, paint, place
from dirprim_filter.recording.schemas.dirprim import MAP_FRAME
from dirprim_filter.recording.schemas.scene_update import HEADING_NOTE, SIZE_NOTES
from dirprim_filter.track_ids import as_texts
from dirprim_filter.tracks import Tracks

VEHICLE_SIZE = (4.5, 1.9, 1.5)
"""Length, width and height of the cube that stands for a vehicle of unknown size, metres: a middling car."""
DETECTION_DIAMETER = 0.6
VEHICLE_COLOR = (0.35, 0.6, 0.95, 0.6)
DETECTION_COLOR = (1.0, 0.85, 0.2, 0.9)


def tracks_scene(tracks: Tracks, rows: IntArray, time_ns: int, *, lifetime_ns: int) -> SceneUpdate:
    """A cube for each vehicle of one instant; its metadata hold direction, speed, size and heading to the last bit."""
    update = SceneUpdate()
    columns = (as_texts(tracks.track_id[rows]), tracks.position[rows], tracks.direction[rows],
               tracks.speed[rows], tracks.group[rows], tracks.size[rows], tracks.heading[rows])  # fmt: skip
    for name, (x, y), direction, speed, group, size, heading in zip(*(c.tolist() for c in columns), strict=True):
        entity = add_entity(update, name, time_ns, frame=MAP_FRAME, lifetime_ns=lifetime_ns)
        entity.frame_locked = True
        entity.metadata.add(key="direction_rad", value=repr(direction))
        entity.metadata.add(key="speed_mps", value=repr(speed))
        entity.metadata.add(key="group", value=str(group))
        for key, metres in zip(SIZE_NOTES, size, strict=True):
            if not math.isnan(metres):
                entity.metadata.add(key=key, value=repr(metres))
        if not math.isnan(heading):
            entity.metadata.add(key=HEADING_NOTE, value=repr(heading))
        length, width, height = (
            middling if math.isnan(metres) else metres for metres, middling in zip(size, VEHICLE_SIZE, strict=True)
        )
        cube = entity.cubes.add()
        place(cube.pose, x, y, height / 2, direction if math.isnan(heading) else heading)
        cube.size.x, cube.size.y, cube.size.z = length, width, height
        paint(cube.color, VEHICLE_COLOR)
    return update


def detections_scene(detections: Detections, rows: IntArray, time_ns: int, *, lifetime_ns: int) -> SceneUpdate:
    """A small sphere for each report of one instant."""
    update = SceneUpdate()
    columns = (detections.track_id[rows], detections.position[rows])
    for name, (x, y) in zip(*(c.tolist() for c in columns), strict=True):
        sphere = add_entity(update, name, time_ns, frame=MAP_FRAME, lifetime_ns=lifetime_ns).spheres.add()
        place(sphere.pose, x, y, DETECTION_DIAMETER / 2, 0.0)
        sphere.size.x = sphere.size.y = sphere.size.z = DETECTION_DIAMETER
        paint(sphere.color, DETECTION_COLOR)
    return update
