"""Satellite positions on a local plane: x east, y north of an origin, by pyproj (extra `geo`).

Source: EPSG guidance note 7-2, method 9837 (geographic to topocentric); PROJ's `topocentric`.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from dirprim_filter.arrays import BoolArray, FloatArray
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

    @classmethod
    def of(cls, geodetic: FloatArray) -> Origin | None:
        """The first place of (n, 3) longitude, latitude and height; None where there is none."""
        places = geodetic[_exists(geodetic), 1::-1].tolist()
        return cls(*places[0]) if places else None


def _exists(geodetic: FloatArray) -> BoolArray:
    return np.asarray((np.abs(geodetic[:, 1]) <= 90) & (np.abs(geodetic[:, 0]) <= 360))


def on_plane(origin: Origin | None, geodetic: FloatArray) -> FloatArray:
    """(n, 3) metres east, north and up of the origin; infinite where there is no such place.

    Args:
        origin: of the plane, at height 0; None: the first place.
        geodetic: (n, 3) longitude and latitude, degrees, and height above the ellipsoid, metres.

    Raises:
        MissingExtraError: pyproj is not installed.
    """
    try:
        from pyproj import Transformer  # noqa: PLC0415  (an extra)
    except ImportError as error:
        raise MissingExtraError("latitudes and longitudes", library="pyproj", extra="geo") from error
    place, exists = np.full(geodetic.shape, np.inf), _exists(geodetic)
    if origin := origin or Origin.of(geodetic):
        to_plane = Transformer.from_pipeline(
            "+proj=pipeline +step +proj=unitconvert +xy_in=deg +xy_out=rad +step +proj=cart +ellps=WGS84 +step "
            f"+proj=topocentric +ellps=WGS84 +lat_0={origin.latitude_deg!r} +lon_0={origin.longitude_deg!r} +h_0=0"
        )
        place[exists] = np.column_stack(to_plane.transform(*geodetic[exists].T))
    return place
