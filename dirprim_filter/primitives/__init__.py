"""What do vehicles do here? Directional primitives and how they are learned.

Names are looked up when they are first used: who tracks by a map needs nothing of what learns it.
"""

from typing import TYPE_CHECKING

from tessellation._late import late as _late

if TYPE_CHECKING:
    from dirprim_filter.primitives.learning import learn_primitives as learn_primitives
    from dirprim_filter.primitives.motion import Motion as Motion
    from dirprim_filter.primitives.primitive_map import Primitive as Primitive
    from dirprim_filter.primitives.primitive_map import PrimitiveMap as PrimitiveMap

_HOME = {
    "Motion": "motion", "Primitive": "primitive_map", "PrimitiveMap": "primitive_map", "learn_primitives": "learning",
}  # fmt: skip

__all__ = list(_HOME)
__getattr__ = _late(__name__, _HOME)
