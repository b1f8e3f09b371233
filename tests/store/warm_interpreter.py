"""Imported by the process that commands are forked from: what they need is imported and compiled.

Nothing of Delta's library runs here: its threads would not outlive a fork.
"""

from pathlib import Path
from tempfile import TemporaryDirectory

import deltalake  # noqa: F401 (for the commands)
from streets import logs_of, street

from dirprim_filter.cli.main import run

with TemporaryDirectory() as folder:
    (log,) = logs_of(Path(folder), a=street(1)).values()
    run(["--quiet", "learn", log, "-o", f"{folder}/map.mcap", "--tessellation", "grid", "--cell-size", "32"])
