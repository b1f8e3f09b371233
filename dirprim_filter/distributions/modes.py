"""How many modes directions have: density-based clustering on the circle (Ester et al. 1996)."""

import numpy as np

from dirprim_filter.arrays import FloatArray, IntArray, as_floats

NOISE = -1


def dbscan(direction: FloatArray, *, eps: float, min_samples: int) -> IntArray:
    """The cluster of each direction, `NOISE` for none: the labels of scikit-learn's DBSCAN on circular distance.

    Args:
        direction: (n,) radians.
        eps: the reach of a neighbourhood, radians.
        min_samples: a core point has so many points within `eps`, itself included.

    Returns:
        (n,) labels from 0, numbered by their first core point; a border point takes the lowest label in reach.

    Raises:
        ValueError: `eps` or `min_samples` is not positive.
    """
    from sklearn.cluster import DBSCAN  # noqa: PLC0415  # heavy, and asked for by the paper's recipe alone

    theta = as_floats("direction", direction, "n")
    if not eps > 0 or min_samples < 1:
        raise ValueError(f"eps, min_samples: expected positive numbers, got {eps} and {min_samples}")
    if not theta.size:
        return np.empty(0, np.int64)
    chord = 2.0 * np.sin(0.5 * min(eps, np.pi))  # as long as the arc tells: on the unit circle a tree finds neighbours
    on_circle = np.column_stack([np.cos(theta), np.sin(theta)])
    return np.asarray(DBSCAN(eps=chord, min_samples=min_samples).fit(on_circle).labels_, np.int64)
