"""How many modes directions have: density-based clustering on the circle.

DBSCAN (Ester et al. 1996) needs no distance matrix on a circle: a sort and two pointers find every neighbourhood.
"""

import numpy as np

from dirprim_filter.arrays import FloatArray, IntArray, as_floats
from dirprim_filter.distributions import _kernels
from dirprim_filter.distributions.angles import wrap

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
    theta = wrap(as_floats("direction", direction, "n"))
    if not eps > 0 or min_samples < 1:
        raise ValueError(f"eps, min_samples: expected positive numbers, got {eps} and {min_samples}")
    order = np.argsort(theta, kind="stable")
    label = np.empty(theta.size, np.int64)
    _kernels.dbscan_sorted(theta[order], order, eps, min_samples, label)
    return label
