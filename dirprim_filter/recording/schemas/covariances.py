"""The error of a position as messages tell it: the covariance of x and y within a larger matrix, written row by row.

Source: geometry_msgs/PoseWithCovariance.msg (6 x 6, in the axes that the pose is told in); sensor_msgs/NavSatFix.msg
(3 x 3, east, north and up).
"""

from __future__ import annotations

import numpy as np

from dirprim_filter.recording.decoding.field_columns import Shredded
from dirprim_filter.recording.decoding.fields import Field
from tessellation.arrays import BoolArray, FloatArray


def covariance(path: str, *, n_rows: int) -> dict[str, Field]:
    """What is wanted of a matrix of so many rows that starts with x and y."""
    places = {"xx": 0, "xy": 1, "yy": n_rows + 1}
    return {f"c.{name}": Field(path=f"{path}[{place}]", optional=True) for name, place in places.items()}


def covariances(shredded: Shredded, known: BoolArray | None = None) -> FloatArray:
    """(n, 2, 2) square metres; NaN where the message has no matrix, or where by (n,) `known` it means nothing."""
    found = matrices(*(shredded.numbers(f"c.{name}") for name in ("xx", "xy", "yy")))
    return found if known is None else np.where(known[:, None, None], found, np.nan)


def matrices(xx: FloatArray, xy: FloatArray, yy: FloatArray) -> FloatArray:
    """(n, 2, 2) symmetric."""
    return np.stack([xx, xy, xy, yy], axis=-1).reshape(-1, 2, 2)
