"""Many logs: their rows in a Delta table that logs are added to, forgotten from and learned from."""

from dirprim_filter.store.adding import add_logs
from dirprim_filter.store.keeping import keep
from dirprim_filter.store.learning import learn_from_store
from dirprim_filter.store.logs import find_logs
from dirprim_filter.store.store import Store

__all__ = ["Store", "add_logs", "find_logs", "keep", "learn_from_store"]
