"""How kernels are compiled: once per installation, which is logged, and without unused wrappers."""

import logging
from multiprocessing import parent_process
from typing import Any

from numba import njit
from numba.core import event

from tessellation._cache import has_a_place

logger = logging.getLogger(__name__)

UNNOTICED_S = 1.0
"""Seconds of compiling without a message; a run that finds most kernels in the cache has compiled the rest by then."""
NOTICE = (
    "compiling, which takes up to a minute: once per installation, the next run starts at once; "
    "`dirprim doctor --compile` does it beforehand"
)


class Notice(event.TimingListener):
    """Adds up what compiling takes, a kernel that compiles those it calls once; and says it, once."""

    has_said = False

    def on_end(self, event: event.Event) -> None:
        """Of a kernel."""
        super().on_end(event)  # type: ignore[no-untyped-call]
        if self.done and self.duration > UNNOTICED_S and not self.has_said and parent_process() is None:
            self.has_said = True
            logger.warning(NOTICE)


LISTENER = Notice()  # type: ignore[no-untyped-call]
event.register("numba:compile", LISTENER)  # type: ignore[no-untyped-call]

_compile: Any = njit
_OPTIONS: dict[str, Any] = {
    "cache": has_a_place(), "no_cfunc_wrapper": True, "nogil": True, "error_model": "numpy", "fastmath": False,
}  # fmt: skip
"""Of all kernels one set: numba compiles its own functions once more for each. The wrapper for C callbacks would take a
tenth of the time that compiling takes. Division by zero gives infinity. No kernel has `fastmath`: by it a loop inlined
into its caller would round otherwise than the same loop called, and the run that compiles otherwise than those that
load what it compiled. See `dirprim_filter.distributions._arithmetic`."""

compiled = _compile(**_OPTIONS)
"""Decorates a kernel."""
pasted = _compile(**_OPTIONS, inline="always")
"""One whose code is put into its callers before they are compiled; by itself it is not compiled."""
uncounted = _compile(**_OPTIONS, _nrt=False)
"""One that allocates nothing and runs for every particle: numba counts no references in it. Each name for an array, and
each part of one, else costs an atomic count, for which threads wait for each other."""
inlined = _compile(**_OPTIONS, _nrt=False, forceinline=True)
"""The same where it takes tables of many arrays, which cost more to hand over than to read."""
