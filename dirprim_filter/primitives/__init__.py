"""What do vehicles do here? Directional primitives and how they are learned."""

from dirprim_filter.primitives.learning import learn_primitives as learn_primitives
from dirprim_filter.primitives.motion import Motion as Motion
from dirprim_filter.primitives.primitive_map import Primitive as Primitive
from dirprim_filter.primitives.primitive_map import PrimitiveMap as PrimitiveMap
