"""Layers, and what importing costs."""

import subprocess
import sys
from pathlib import Path

import pytest


def python(code):
    return subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True).stdout.split()


def test_layers_hold():
    linter = Path(sys.executable).with_name("lint-imports")
    root = Path(__file__).parents[1]
    result = subprocess.run([linter, "--no-cache"], cwd=root, capture_output=True, text=True, check=False)
    assert result.returncode == 0, result.stdout


@pytest.mark.parametrize(
    ("module", "absent"),
    [
        ("dirprim_filter", ["numpy", "numba", "rerun", "matplotlib", "google.protobuf"]),
        ("dirprim_filter.cli.main", ["numpy", "numba", "rerun", "matplotlib", "google.protobuf", "rich.progress"]),
        ("dirprim_filter.primitives", ["sklearn", "rerun", "matplotlib", "mcap"]),
        ("dirprim_filter.recording", ["rerun", "matplotlib", "sklearn"]),
        ("dirprim_filter.replay, dirprim_filter.filtering.smoothing", ["filterpy", "scipy.stats", "rerun"]),
        ("dirprim_filter.evaluation.tracking_experiment", ["filterpy", "scipy.stats"]),
        ("dirprim_filter.store.learning, dirprim_filter.primitives.learning", ["scipy.stats", "filterpy"]),
        ("dirprim_filter.arrays", ["numba", "scipy"]),
        ("tessellation", ["numpy"]),
        ("dirprim_filter.recording.summary", ["numba", "scipy", "google.protobuf", "rosbags"]),
    ],
)
def test_heavy_imports_come_late(module, absent):
    loaded = set(python(f"import sys, {module}; print(*sys.modules)"))
    assert not loaded & set(absent)


def test_the_public_names_are_there_whatever_was_imported_before():
    code = (
        "import dirprim_filter.forecasting, dirprim_filter.recording.reader, dirprim_filter as d;"
        "print(*(callable(getattr(d, n)) for n in d.__all__))"
    )
    assert set(python(code)) == {"True"}
