"""Where is it now? The particle filter on the map, and the Kalman filter it is compared with."""

from dirprim_filter.filtering.kalman import ConstantVelocityTracker as ConstantVelocityTracker
from dirprim_filter.filtering.protocols import BayesFilter as BayesFilter
from dirprim_filter.filtering.tracker import Tracker as Tracker
