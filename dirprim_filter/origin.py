"""Where on the Earth a log's plane lies, x east and y north of an origin: to it and back, by pyproj (extra `geo`).

Source: EPSG guidance note 7-2, method 9837 (geographic to topocentric); PROJ's `topocentric`.
"""

from __future__ import annotations

import logging
from collections.abc import Iterable
from functools import lru_cache
from importlib.util import find_spec
from typing import Any, NamedTuple

import numpy as np

from dirprim_filter.arrays import BoolArray, FloatArray

logger = logging.getLogger(__name__)

FRAME = "plane at "
"""Begins the name of a plane's frame."""
SAME_DEG = 1e-8
"""Origins that differ by less, a millimetre, are the same."""
REACH_M = 300_000.0
"""From the origin; there the plane shortens ways by a thousandth, and beyond it is of no use."""
LIFTS = 4
"""Of places on the plane to the ellipsoid: each leaves a thousandth of the height, 300 km from the origin."""


class Origin(NamedTuple):
    """Where the plane touches the ellipsoid of WGS 84, degrees."""

    latitude_deg: float
    longitude_deg: float

    @classmethod
    def parse(cls, text: str) -> Origin:
        """Of "latitude,longitude" in degrees.

        Raises:
            ValueError: it is no such place.
        """
        try:
            latitude, longitude = map(float, text.split(","))
        except ValueError:
            latitude = longitude = np.nan
        if not (abs(latitude) <= 90 and abs(longitude) <= 360):
            raise ValueError(f"origin: expected latitude,longitude in degrees such as 48.137,11.575, got {text!r}")
        return cls(latitude, longitude)

    @classmethod
    def of(cls, pair: Iterable[float] | None) -> Origin | None:
        """Of a latitude and a longitude in degrees; None of None.

        Raises:
            ValueError: it is no such place.
        """
        return None if pair is None else cls.parse(",".join(map(repr, map(float, pair))))

    @classmethod
    def of_frame(cls, name: str) -> Origin | None:
        """Of the plane whose `frame` has this name; None where it is no plane's."""
        try:
            return cls.parse(name.removeprefix(FRAME)) if name.startswith(FRAME) else None
        except ValueError:
            return None

    @property
    def frame(self) -> str:
        """What the plane is called where a frame has a name."""
        return f"{FRAME}{self}"

    def __str__(self) -> str:
        return f"{float(self.latitude_deg)!r},{float(self.longitude_deg)!r}"

    def is_of(self, other: Origin | None) -> bool:
        """Whether another plane is this one."""
        return other is not None and all(abs(a - b) < SAME_DEG for a, b in zip(self, other, strict=True))

    def to_plane(self, geodetic: FloatArray) -> FloatArray:
        """(n, 2) metres east and north, of (n, 2) latitudes and longitudes in degrees, whatever their height.

        NaN stays; infinite where there is no such place, or it is farther away than `REACH_M`.

        Raises:
            ImportError: pyproj is not installed.
        """
        place, here = np.where(np.isnan(geodetic), np.nan, np.inf), np.flatnonzero(exists(geodetic))
        latitude, longitude = geodetic[here].T
        found = np.column_stack(_topocentric(self).transform(longitude, latitude, np.zeros(here.size)))
        near = (found**2).sum(axis=1) <= REACH_M**2
        place[here[near]] = found[near, :2]
        return place

    def to_globe(self, position: FloatArray) -> FloatArray:
        """(n, 2) latitudes and longitudes in degrees, of (n, 2) metres east and north.

        Raises:
            ImportError: pyproj is not installed.
        """
        up = np.zeros(len(position))
        for _ in range(LIFTS):
            longitude, latitude, height = _topocentric(self).transform(*position.T, up, direction="INVERSE")
            up = up - height
        return np.column_stack([latitude, longitude])


def exists(geodetic: FloatArray) -> BoolArray:
    """(n,) where (n, 2) latitudes and longitudes in degrees are of a place."""
    return np.asarray((np.abs(geodetic) <= [90.0, 360.0]).all(axis=1))


@lru_cache(maxsize=16)
def drawable(origin: Origin | None) -> Origin | None:
    """The same, for a map of the Earth; None without pyproj, which is logged."""
    if origin is not None and find_spec("pyproj") is None:
        logger.warning(
            "origin %s: no map of the Earth is drawn without pyproj: pip install 'dirprim-filter[geo]'", origin
        )
        return None
    return origin


@lru_cache(maxsize=16)
def _topocentric(origin: Origin) -> Any:
    from pyproj import Transformer  # noqa: PLC0415  (an extra)

    latitude, longitude = str(origin).split(",")
    return Transformer.from_pipeline(
        "+proj=pipeline +step +proj=unitconvert +xy_in=deg +xy_out=rad +step +proj=cart +ellps=WGS84 +step "
        f"+proj=topocentric +ellps=WGS84 +lat_0={latitude} +lon_0={longitude} +h_0=0"
    )
