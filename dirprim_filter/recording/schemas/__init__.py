"""Which schemas of a log can be read as observed objects, and by what."""

from __future__ import annotations

from dirprim_filter.recording.schemas import (
    autoware,
    derived_objects,
    location,
    markers,
    odometry,
    osi,
    osi_sensor_data,
    poses,
    scene_update,
    transform_messages,
    vision,
)
from dirprim_filter.recording.schemas.dirprim import OBSERVATIONS
from dirprim_filter.recording.schemas.object_rows import Family

KINDS: tuple[tuple[Family, ...], ...] = (
    (OBSERVATIONS,),
    (osi.GROUND_TRUTH, osi.SENSOR_VIEW),
    (osi_sensor_data.SENSOR_DATA,),
    (autoware.TRACKED, *derived_objects.FAMILIES),
    (scene_update.SCENE_UPDATE,),
    (markers.MARKERS,),
    (autoware.PREDICTED, autoware.DETECTED, vision.DETECTIONS_3D),
    (odometry.ROS, odometry.FOXGLOVE),
    poses.FAMILIES,
    location.FAMILIES,
)
"""Schemas of one kind hold the same; the first kind that a log has holds the most."""

FAMILIES: dict[str, Family] = {
    name: family for families in (*KINDS, transform_messages.FAMILIES) for family in families for name in family.schemas
}
"""By schema name, those too that are read only where a topic is named."""

ESTIMATES_SCHEMA = "dirprim.TrackEstimates"
"""The schema of our own estimates: no observations, so no input."""
