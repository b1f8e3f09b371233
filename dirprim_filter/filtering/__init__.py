"""Where is it now? The particle filter on the map, and the Kalman filters it is compared with."""

from dirprim_filter.filtering.kalman import ConstantTurnUKF as ConstantTurnUKF
from dirprim_filter.filtering.kalman import ConstantVelocityKalman as ConstantVelocityKalman
from dirprim_filter.filtering.kalman import InteractingModels as InteractingModels
from dirprim_filter.filtering.particle_filter import ParticleFilter as ParticleFilter
from dirprim_filter.filtering.protocols import BayesFilter as BayesFilter
from dirprim_filter.filtering.tracker import Tracker as Tracker
from dirprim_filter.filtering.worlds import Worlds as Worlds
