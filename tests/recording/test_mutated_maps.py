"""No harmed map makes a kernel read beyond its tables: some hundreds of them, under checks of bounds."""

import os
import subprocess
import sys
from pathlib import Path

import pytest


@pytest.mark.slow
def test_harmed_maps_are_refused_or_read_and_used(tmp_path):
    folder = Path(__file__).parent
    environment = os.environ | {
        "NUMBA_BOUNDSCHECK": "1", "NUMBA_CACHE_DIR": str(tmp_path),  # kernels without checks are cached elsewhere
        "PYTHONPATH": os.pathsep.join(map(str, (folder, folder.parent, folder.parents[1]))),
    }  # fmt: skip
    done = subprocess.run(
        [sys.executable, "-W", "ignore", folder / "map_mutations.py", "150"], env=environment, capture_output=True,
        text=True, check=False,
    )  # fmt: skip
    assert done.returncode == 0, done.stderr[-2000:]
    refused, read = map(int, done.stdout.split())
    assert refused + read == 300
    assert refused > 50
    assert read > 20
