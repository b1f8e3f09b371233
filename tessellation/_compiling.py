"""How kernels are compiled: once per installation, which is logged, and without unused wrappers."""

import logging
from multiprocessing import parent_process
from typing import Any

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

COMPILED: dict[str, Any] = {"cache": has_a_place(), "no_cfunc_wrapper": True, "fastmath": False}
"""Options of numba's `njit`. The wrapper for C callbacks would take a tenth of the time that compiling takes.
No kernel has `fastmath`: by it a loop inlined into its caller would round otherwise than the same loop called, and the
run that compiles otherwise than those that load what it compiled. See `dirprim_filter.distributions._arithmetic`."""

UNCOUNTED: dict[str, Any] = {"_nrt": False}
"""For kernels that allocate nothing and run for every particle: numba counts no references in them. Each name for an
array, and each part of one, else costs an atomic count, for which threads wait for each other."""
INLINED: dict[str, Any] = UNCOUNTED | {"forceinline": True}
"""The same for those that take tables of many arrays, which cost more to hand over than to read."""
