"""Where is it now? The particle filter on the map, and the Kalman filter it is compared with."""

from typing import TYPE_CHECKING

from tessellation._late import late as _late

if TYPE_CHECKING:
    from dirprim_filter.filtering.group_tracker import GroupTracker as GroupTracker
    from dirprim_filter.filtering.kalman import ConstantVelocityKalman as ConstantVelocityKalman
    from dirprim_filter.filtering.particle_filter import ParticleFilter as ParticleFilter
    from dirprim_filter.filtering.protocols import BayesFilter as BayesFilter
    from dirprim_filter.filtering.tracker import Tracker as Tracker

_HOME = {
    "BayesFilter": "protocols",
    "ConstantVelocityKalman": "kalman",
    "ParticleFilter": "particle_filter",
    "Tracker": "tracker",
    "GroupTracker": "group_tracker",
}
"""The module of each name, imported when it is first used."""

__all__ = list(_HOME)
__getattr__ = _late(__name__, _HOME)
