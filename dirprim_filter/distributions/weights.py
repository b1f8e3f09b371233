"""Weights of observations: how often each counts."""

import numpy as np

from dirprim_filter.arrays import FloatArray, as_floats


def counted(name: str, value: FloatArray, weight: FloatArray | None) -> FloatArray:
    """The weights of `value` over its last axis, ones if left out. (..., n) -> (..., n).

    Raises:
        ValueError: there is no value, a weight is negative, or none is positive.
    """
    if value.shape[-1] == 0:
        raise ValueError(f"{name}: expected at least one value on the last axis, got shape {value.shape}")
    if weight is None:
        return np.ones(value.shape)
    w = np.broadcast_to(as_floats("weight", weight, "... n"), value.shape)
    if (w < 0).any():
        raise ValueError(f"weight: expected no negative number, got {w.min()}")
    if (w.sum(axis=-1) <= 0).any():
        raise ValueError("weight: expected a positive number on the last axis, got zeros alone")
    return w
