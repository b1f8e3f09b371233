"""How many modes directions have: density-based clustering on the circle (Ester et al. 1996)."""

import numpy as np

from dirprim_filter.arrays import FloatArray, IntArray

NOISE = -1


def dbscan(direction: FloatArray, *, eps: float, min_samples: int) -> IntArray:
    """The cluster of each direction, `NOISE` for none: the labels of scikit-learn's DBSCAN on circular distance.

    Args:
        direction: (n,) radians, n >= 1.
        eps: the reach of a neighbourhood, radians.
        min_samples: a core point has so many points within `eps`, itself included.
    """
    from sklearn.cluster import DBSCAN  # noqa: PLC0415  # heavy, and asked for by the paper's recipe alone

    chord = 2.0 * np.sin(0.5 * min(eps, np.pi))  # of this arc: on the unit circle a tree finds neighbours
    on_circle = np.column_stack([np.cos(direction), np.sin(direction)])
    return np.asarray(DBSCAN(eps=chord, min_samples=min_samples).fit(on_circle).labels_, np.int64)
