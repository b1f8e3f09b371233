"""How large an object is, as messages tell it: three numbers, or a solid whose kind says what its numbers mean.

Source: geometry_msgs/Vector3.msg; shape_msgs/SolidPrimitive.msg (a box has its extents along x, y and z, a sphere its
radius, a cylinder and a cone their height along z and their radius).
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from dirprim_filter.recording.decoding.field_columns import Shredded
from dirprim_filter.recording.decoding.fields import Field
from dirprim_filter.recording.schemas.object_rows import numbers
from tessellation.arrays import FloatArray

SIZE = ("size.x", "size.y", "size.z")
_BOX, _SPHERE, _CYLINDER, _CONE = 1, 2, 3, 4


def extents(path: str, axes: Sequence[str] = ("x", "y", "z")) -> dict[str, Field]:
    """What is wanted of length, width and height beside each other; older definitions may lack them."""
    return {label: Field(path=f"{path}.{axis}", optional=True) for label, axis in zip(SIZE, axes, strict=True)}


def sizes(shredded: Shredded) -> FloatArray:
    """(n, 3) metres; NaN where the message does not tell."""
    return numbers(shredded, *SIZE)


def solid(path: str) -> dict[str, Field]:
    """What is wanted of a `SolidPrimitive`."""
    numbered = {label: Field(path=f"{path}.dimensions[{i}]", optional=True) for i, label in enumerate(SIZE)}
    return {"solid": Field(path=f"{path}.type", optional=True), **numbered}


def solid_sizes(shredded: Shredded) -> FloatArray:
    """(n, 3) metres of the solids; NaN where the message has none, or one of a kind that is not known."""
    kind = shredded.integers("solid")[:, None]
    told = sizes(shredded)
    first, second, _ = told.T
    ball = np.stack([2 * first] * 3, axis=-1)
    upright = np.stack([2 * second, 2 * second, first], axis=-1)
    kinds = [kind == _BOX, kind == _SPHERE, (kind == _CYLINDER) | (kind == _CONE)]
    return np.select(kinds, [told, ball, upright], np.nan)
