"""Fields that messages of many schemas have in the same form: headers, poses, errors, sizes and class labels.

A group says which fields are wanted, under labels that are the same in all families; what they hold is read by the
function beside it.

Sources: std_msgs/Header.msg; geometry_msgs/Vector3.msg; geometry_msgs/PoseWithCovariance.msg (6 x 6, in the axes that
the pose is given in); sensor_msgs/NavSatFix.msg (3 x 3, east, north and up); shape_msgs/SolidPrimitive.msg (a box has
its extents along x, y and z, a sphere its radius, a cylinder and a cone their height along z and their radius).
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from dirprim_filter.arrays import AnyArray, BoolArray, FloatArray, IntArray
from dirprim_filter.recording.decoding.field_columns import FieldColumns
from dirprim_filter.recording.decoding.fields import Field

POSITION = ("p.x", "p.y", "p.z")
ORIENTATION = ("q.x", "q.y", "q.z", "q.w")
VELOCITY = ("v.x", "v.y", "v.z")
SIZE = ("size.x", "size.y", "size.z")
COVARIANCE = ("c.xx", "c.xy", "c.yy")
UNLABELLED = -1
"""The number of an object whose class is unknown; as an index, the last of the names."""
_BOX, _SPHERE, _CYLINDER, _CONE = 1, 2, 3, 4


def header(at: str = "", *, stamp: str = ".header.stamp", frame: str = ".header.frame_id") -> dict[str, Field]:
    """Labels `stamp` and `frame`; the paths are those of ROS."""
    return {"stamp": Field(path=f"{at}{stamp}", kind="time"), "frame": Field(path=f"{at}{frame}", kind="name")}


def foxglove_header(at: str = "") -> dict[str, Field]:
    """The same in Foxglove's schemas."""
    return header(at, stamp=".timestamp", frame=".frame_id")


def xyz(prefix: str, path: str, *, optional: bool = False) -> dict[str, Field]:
    """The three numbers of a point or a vector, under labels such as `v.x`."""
    return {f"{prefix}.{axis}": Field(path=f"{path}.{axis}", optional=optional) for axis in "xyz"}


def orientation(path: str, *, optional: bool = True) -> dict[str, Field]:
    """Labels `q.x` to `q.w` of a quaternion."""
    return {label: Field(path=f"{path}.{label[-1]}", optional=optional) for label in ORIENTATION}


def pose(path: str, *, optional: bool = False) -> dict[str, Field]:
    """Position `p.x` to `p.z` and orientation `q.x` to `q.w`, which may be optional, of a pose."""
    return {**xyz("p", f"{path}.position"), **orientation(f"{path}.orientation", optional=optional)}


def covariance(path: str, *, n_rows: int) -> dict[str, Field]:
    """The part of x and y of a matrix of so many rows that starts with these."""
    return {
        label: Field(path=f"{path}[{place}]", optional=True)
        for label, place in zip(COVARIANCE, (0, 1, n_rows + 1), strict=True)
    }


def covariances(columns: FieldColumns, known: BoolArray | None = None) -> FloatArray:
    """(n, 2, 2) square metres; NaN where the message has no matrix, or where by (n,) `known` it means nothing."""
    found = matrices(*(columns.numbers(label) for label in COVARIANCE))
    return found if known is None else np.where(known[:, None, None], found, np.nan)


def matrices(xx: FloatArray, xy: FloatArray, yy: FloatArray) -> FloatArray:
    """(n, 2, 2) symmetric."""
    return np.stack([xx, xy, xy, yy], axis=-1).reshape(-1, 2, 2)


def extents(path: str, axes: Sequence[str] = ("x", "y", "z")) -> dict[str, Field]:
    """Length, width and height beside each other; older definitions may lack them."""
    return {label: Field(path=f"{path}.{axis}", optional=True) for label, axis in zip(SIZE, axes, strict=True)}


def solid(path: str) -> dict[str, Field]:
    """A `SolidPrimitive`."""
    numbered = {label: Field(path=f"{path}.dimensions[{i}]", optional=True) for i, label in enumerate(SIZE)}
    return {"solid": Field(path=f"{path}.type", optional=True), **numbered}


def solid_sizes(columns: FieldColumns) -> FloatArray:
    """(n, 3) metres of the solids; NaN where the message has none, or one of a kind that is not known."""
    kind = columns.integers("solid")[:, None]
    box = columns.vectors(SIZE)
    first, second, _ = box.T
    ball = np.stack([2 * first] * 3, axis=-1)
    upright = np.stack([2 * second, 2 * second, first], axis=-1)
    kinds = [kind == _BOX, kind == _SPHERE, (kind == _CYLINDER) | (kind == _CONE)]
    return np.select(kinds, [box, ball, upright], np.nan)


def label_names(numbers: IntArray, names: Sequence[str]) -> AnyArray:
    """(n,) str: the names of (n,) classes, a number that has none in decimal; empty for `UNLABELLED`."""
    is_named = (numbers >= UNLABELLED) & (numbers < len(names))
    named = np.array([*names, ""])[np.where(is_named, numbers, UNLABELLED)]
    return named if is_named.all() else np.where(is_named, named, numbers.astype(np.str_))


def most_probable(columns: FieldColumns, label: str, probability: str) -> tuple[IntArray, IntArray]:
    """Of the guesses at each object the row of the most probable one, the first of equals.

    Args:
        columns: guesses are a table below that of the objects.
        label: of a column of the guesses.
        probability: of another one.

    Returns:
        (k,) rows of the guesses, and (k,) the rows of their objects, each once.
    """
    of = columns.parent_of(columns.fields[label].table)
    if (np.diff(of) > 0).all():  # one guess at each, as is usual
        return np.arange(of.size), of
    order = np.lexsort((-np.nan_to_num(columns.numbers(probability)), of))
    objects, first = np.unique(of[order], return_index=True)
    return order[first], objects
