"""Tracked vehicles and maps for Foxglove's map panel: GeoJSON, with the style that the panel reads.

Source: https://docs.foxglove.dev/docs/visualization/panels/map and RFC 7946, which has longitudes before latitudes.
"""

from __future__ import annotations

import json
from collections.abc import Iterable
from typing import Any

import numpy as np
from foxglove import messages as fg

from dirprim_filter.arrays import FloatArray
from dirprim_filter.drawing import shapes
from dirprim_filter.drawing.colors import ByteArray, track_color
from dirprim_filter.estimates import Estimates
from dirprim_filter.origin import Origin
from dirprim_filter.primitives.primitive_map import PrimitiveMap
from dirprim_filter.recording.foxglove.elements import stamp
from dirprim_filter.track_ids import as_texts

DIGITS = 7
"""Of degrees, a centimetre."""


def location(origin: Origin, time_ns: int, middle: FloatArray) -> fg.LocationFix:
    """The middle of what is drawn, (2,) metres, on which the panel centres."""
    ((latitude, longitude),) = origin.to_globe(middle[None]).tolist()
    return fg.LocationFix(timestamp=stamp(time_ns), frame_id=origin.frame, latitude=latitude, longitude=longitude)


def estimates_on_globe(estimates: Estimates) -> fg.GeoJson:
    """Points of vehicles, on a plane with an origin, with their names, in their colours."""
    names = as_texts(estimates.track_id).tolist()
    places = Origin(*estimates.origin).to_globe(estimates.position) if estimates.origin else np.empty((0, 2))
    rows = zip(names, _degrees(places), _texts(track_color(names)), strict=True)
    return _collection(
        _feature("Point", place, name=name, style={"color": color, "fillOpacity": 0.8}) for name, place, color in rows
    )


def map_on_globe(primitive_map: PrimitiveMap, origin: Origin) -> fg.GeoJson:
    """The petals of a map, as polygons in the colours of their speeds."""
    petals = shapes.rose_petals(primitive_map)
    closed = np.concatenate([petals.polygon, petals.polygon[:, :1]], axis=1)
    places = _degrees(origin.to_globe(closed.reshape(-1, 2)).reshape(closed.shape))
    colors = _texts(shapes.petal_colors(petals, fastest=shapes.fastest_speed(petals))[:, 1])
    return _collection(
        _feature("Polygon", [place], style={"color": color, "weight": 1, "fillOpacity": 0.6})
        for place, color in zip(places, colors, strict=True)
    )


def _degrees(places: FloatArray) -> list[Any]:
    """(..., 2) latitudes and longitudes as GeoJSON has them."""
    return list(np.round(places[..., ::-1], DIGITS).tolist())


def _texts(colors: ByteArray) -> list[str]:
    """(n, 4) -> #rrggbb."""
    return [f"#{bytes(color[:3]).hex()}" for color in colors]


def _feature(kind: str, coordinates: Any, **properties: Any) -> dict[str, Any]:
    geometry = {"type": kind, "coordinates": coordinates}
    return {"type": "Feature", "geometry": geometry, "properties": properties}


def _collection(features: Iterable[dict[str, Any]]) -> fg.GeoJson:
    whole = {"type": "FeatureCollection", "features": [*features]}
    return fg.GeoJson(geojson=json.dumps(whole, separators=(",", ":")))
