"""Satellite positions on one local plane: x east, y north of an origin that no single fix decides."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from os import PathLike

import numpy as np

from dirprim_filter.arrays import FloatArray
from dirprim_filter.origin import Origin, exists
from dirprim_filter.recording.errors import MissingExtraError, RecordingError

FARTHEST_M = 1e8
"""Nothing on the Earth, of 4e7 m around, is further from any origin than this; what is, is no position."""
FIXES, LIVE_FIXES = 99, 9
"""The origin is the median of so many first fixes; of a live pipe, which is not to wait for long, of fewer."""


def median_of(geodetic: FloatArray) -> Origin | None:
    """Of the first `FIXES` places of (m, 2) latitudes and longitudes, degrees; None where there is none."""
    places = geodetic[exists(geodetic)][:FIXES]
    if not len(places):
        return None
    latitude, longitude = places.T
    near = longitude - 360 * np.round((longitude - longitude[0]) / 360)  # across 180 degrees
    middle = (len(places) - 1) // 2
    return Origin(float(np.sort(latitude)[middle]), float(longitude[np.argsort(near)[middle]]))


def on_plane(origin: Origin | None, place: FloatArray, own: Origin | None = None) -> FloatArray:
    """(n, 2) metres on the plane of an origin, of latitudes and longitudes, or of places on the plane of their own.

    Without an origin no latitude and longitude is of a place, which is infinite; NaN stays.

    Raises:
        MissingExtraError: pyproj is not installed.
    """
    with needing_pyproj():
        geodetic = own.to_globe(place) if own else place
        if origin is None:
            return np.where(np.isnan(place), np.nan, np.inf)
        return origin.to_plane(geodetic)


@contextmanager
def needing_pyproj() -> Iterator[None]:
    """Where it is not installed, the error is a `MissingExtraError`."""
    try:
        yield
    except ImportError as error:
        raise MissingExtraError("latitudes and longitudes", library="pyproj", extra="geo") from error


def check_kind(path: str | PathLike[str], *, is_geodetic: bool, origin: Origin | None, meets: str) -> None:
    """Whether a log's positions can be on the plane of what it meets.

    Args:
        path: the log.
        is_geodetic: it has latitudes and longitudes, or an origin of its own.
        origin: that of what it meets.
        meets: the name of this.

    Raises:
        RecordingError: one of the two has an origin, the other has none.
    """
    if is_geodetic and origin is None:
        raise RecordingError(
            f"{path}: expected positions in metres, as of {meets}, which has no origin, got latitudes and longitudes; "
            "make that anew of such, or say by --set origin=LAT,LON where its plane is"
        )
    if not is_geodetic and origin is not None:
        raise RecordingError(
            f"{path}: expected latitudes and longitudes, as {meets} has the origin {origin}, got positions in metres; "
            f"where they are of the same plane, say --set origin={origin}"
        )
