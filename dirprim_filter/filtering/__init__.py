"""Where is it now? The particle filter on the map, and the Kalman filter it is compared with."""

from typing import TYPE_CHECKING

from tessellation._late import late as _late

if TYPE_CHECKING:
    from dirprim_filter.filtering.custom_filter import CustomFilter as CustomFilter
    from dirprim_filter.filtering.group_tracker import GroupTracker as GroupTracker
    from dirprim_filter.filtering.kalman import ConstantVelocityKalman as ConstantVelocityKalman
    from dirprim_filter.filtering.particle_filter import ParticleFilter as ParticleFilter
    from dirprim_filter.filtering.protocols import BayesFilter as BayesFilter
    from dirprim_filter.filtering.radar import Measurement as Measurement
    from dirprim_filter.filtering.radar import Radar as Radar
    from dirprim_filter.filtering.tracker import Tracker as Tracker
    from dirprim_filter.filtering.transition import MapTransition as MapTransition
    from dirprim_filter.filtering.transition import Moving as Moving
    from dirprim_filter.filtering.transition import Transition as Transition

_HOME = {
    "BayesFilter": "protocols",
    "ConstantVelocityKalman": "kalman",
    "ParticleFilter": "particle_filter",
    "Tracker": "tracker",
    "GroupTracker": "group_tracker",
    "CustomFilter": "custom_filter",
    "Transition": "transition",
    "MapTransition": "transition",
    "Moving": "transition",
    "Measurement": "radar",
    "Radar": "radar",
}
"""The module of each name, imported when it is first used."""

__all__ = list(_HOME)
__getattr__ = _late(__name__, _HOME)
