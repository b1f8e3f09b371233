"""Where a table came from: one reader for each data set format."""

from dirprim_filter.recording.tables.datasets import read_sdd as read_sdd
from dirprim_filter.recording.tables.datasets import read_trajnet as read_trajnet
from dirprim_filter.recording.tables.formats import FORMATS as FORMATS
from dirprim_filter.recording.tables.json_table import read_json as read_json
from dirprim_filter.recording.tables.named_columns import read_arrow as read_arrow
from dirprim_filter.recording.tables.named_columns import read_csv as read_csv
from dirprim_filter.recording.tables.sumo_fcd import read_sumo_fcd as read_sumo_fcd
from dirprim_filter.recording.tables.table import Table as Table
