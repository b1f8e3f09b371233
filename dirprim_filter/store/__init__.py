"""Many logs: statistics that add up, in a store that can be merged, forgotten from and learned from."""

from dirprim_filter.store.fading import Fading
from dirprim_filter.store.lattice import Lattice
from dirprim_filter.store.learning import learn_from_summary
from dirprim_filter.store.store import Store
from dirprim_filter.store.summary import Summary
from dirprim_filter.store.updating import learn_from_store, update_map

__all__ = ["Fading", "Lattice", "Store", "Summary", "learn_from_store", "learn_from_summary", "update_map"]
