"""Many logs: statistics that add up, in a store that can be merged, forgotten from and learned from."""

from dirprim_filter.store.fading import Fading
from dirprim_filter.store.lattice import Lattice
from dirprim_filter.store.learning import learn_from_summary
from dirprim_filter.store.summary import Summary

__all__ = ["Fading", "Lattice", "Summary", "learn_from_summary"]
