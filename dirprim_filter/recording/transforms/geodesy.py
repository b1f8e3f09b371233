"""Satellite positions on a local plane: x east, y north of an origin, by pyproj (extra `geo`).

Source: EPSG guidance note 7-2, method 9837 (geographic to topocentric); PROJ's `topocentric`.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from dirprim_filter.arrays import FloatArray
from dirprim_filter.recording.errors import MissingExtraError

FARTHEST_M = 1e8
"""Nothing on the Earth, of 4e7 m around, is further from any origin than this; what is, is no position."""


class Origin(NamedTuple):
    """Where the plane touches the ellipsoid of WGS 84."""

    latitude_deg: float
    longitude_deg: float

    @classmethod
    def parse(cls, text: str) -> Origin:
        """Of "latitude,longitude" in degrees.

        Raises:
            ValueError: it is no such place.
        """
        try:
            latitude, longitude = (float(part) for part in text.split(","))
        except ValueError:
            latitude = longitude = np.nan
        if not (abs(latitude) <= 90 and abs(longitude) <= 360):
            raise ValueError(f"origin: expected latitude,longitude in degrees such as 48.137,11.575, got {text!r}")
        return cls(latitude, longitude)


def on_plane(origin: Origin, geodetic: FloatArray) -> FloatArray:
    """(n, 3) metres east, north and up of the origin.

    Args:
        origin: of the plane, at height 0.
        geodetic: (n, 3) longitude and latitude, degrees, and height above the ellipsoid, metres.

    Raises:
        MissingExtraError: pyproj is not installed.
    """
    try:
        from pyproj import Transformer  # noqa: PLC0415  (an extra)
    except ImportError as error:
        raise MissingExtraError("latitudes and longitudes", library="pyproj", extra="geo") from error
    to_plane = Transformer.from_pipeline(
        "+proj=pipeline +step +proj=unitconvert +xy_in=deg +xy_out=rad +step +proj=cart +ellps=WGS84 "
        f"+step +proj=topocentric +ellps=WGS84 +lat_0={origin.latitude_deg!r} +lon_0={origin.longitude_deg!r} +h_0=0"
    )
    return np.column_stack(to_plane.transform(*geodetic.T))


def placed_on_plane(geodetic: FloatArray, origin: Origin | None) -> FloatArray:
    """(n, 3) metres as `on_plane`; infinite where there is no such place.

    Args:
        geodetic: (n, 3) longitude and latitude, degrees, and height, metres.
        origin: of the plane; None: the first place.

    Raises:
        MissingExtraError: pyproj is not installed.
    """
    longitude, latitude, _ = geodetic.T
    exists = (np.abs(latitude) <= 90) & (np.abs(longitude) <= 360)
    place = np.full(geodetic.shape, np.inf)
    if exists.any():
        first = np.argmax(exists)
        place[exists] = on_plane(origin or Origin(float(latitude[first]), float(longitude[first])), geodetic[exists])
    return place
