"""Compiling the kernels of filter, forecasts and regions before they are used: `python -m dirprim_filter.cli.warm_up`.

The first run after an installation compiles, which takes long, and caches what it has compiled. A command that
has other work to do first can let a second core do that meanwhile.
"""

from __future__ import annotations

import numpy as np

from dirprim_filter.config import FilterConfig
from dirprim_filter.detections import Detections
from dirprim_filter.distributions import Gamma, VonMisesMixture
from dirprim_filter.distributions.highest_density import highest_density_regions
from dirprim_filter.filtering import Tracker
from dirprim_filter.forecasting import forecast
from dirprim_filter.primitives import PrimitiveMap
from tessellation import GridTessellation


def warm_up() -> None:
    """Track and forecast one vehicle on a map of one cell: every kernel on the way is compiled, and cached."""
    two_rows = np.ones((2, 1))
    anywhere = PrimitiveMap(
        tessellation=GridTessellation.covering(np.zeros((1, 2)), cell_size=1.0),
        direction=VonMisesMixture(weight=two_rows, mean_direction=0.0 * two_rows, concentration=two_rows),
        speed=Gamma(shape=two_rows, rate=two_rows),
        n_rows=np.ones(2, np.int64),
        n_background_modes=0,
    )
    tracker = Tracker(anywhere, config=FilterConfig(n_particles=10), rng=np.random.default_rng(0))
    reported = Detections(
        track_id=np.array(["a", "a"]),
        time_ns=np.array([0, 10**8], np.int64),
        position=np.array([[0.0, 0.0], [1.5, 0.0]]),  # where few particles come near: for these there is a kernel too
    )
    for frame in reported.frames():
        tracker.predict(frame)
        tracker.weigh()
        tracker.estimate()
        tracker.resample()
    paths = forecast(anywhere, position=(0.0, 0.0), direction=0.0, speed=1.0, n_samples=2, rng=np.random.default_rng(0))
    highest_density_regions(paths, (0.5,))


if __name__ == "__main__":
    warm_up()
