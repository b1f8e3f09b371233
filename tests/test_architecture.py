"""Layers, names and sizes of files, and what importing costs."""

import subprocess
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[1]
PACKAGES = [ROOT / "dirprim_filter", ROOT / "tessellation"]
SOURCES = [path for package in PACKAGES for path in package.rglob("*.py") if not path.name.endswith("_pb2.py")]


def python(code):
    return subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True).stdout.split()


def test_layers_hold():
    linter = Path(sys.executable).with_name("lint-imports")
    result = subprocess.run([linter, "--no-cache"], cwd=ROOT, capture_output=True, text=True, check=False)
    assert result.returncode == 0, result.stdout


def test_a_file_is_one_noun_and_no_longer_than_a_reader_bears():
    assert not {path.stem for path in SOURCES} & {"utils", "helpers", "common", "base", "manager"}
    assert not [path for path in SOURCES if len(path.read_text().splitlines()) > 400]


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
