"""Layers, and what importing costs."""

import ast
import re
import subprocess
import sys
import tomllib
from importlib.metadata import packages_distributions
from pathlib import Path

import pytest


def test_what_packages_import_is_installed_with_them():
    root = Path(__file__).parents[1]
    project = tomllib.loads((root / "pyproject.toml").read_text())["project"]
    users = [*project["dependencies"], *(each for name in ("sim", "geo", "remote", "fleet")
                                         for each in project["optional-dependencies"][name])]  # fmt: skip
    declared = {re.split(r"[<>=\[]", each)[0].replace("_", "-").lower() for each in users}
    imported = set()
    for package in ("dirprim_filter", "tessellation"):
        for node in (node for path in (root / package).rglob("*.py") for node in ast.walk(ast.parse(path.read_text()))):
            if isinstance(node, ast.Import):
                imported |= {each.name.split(".")[0] for each in node.names}
            elif isinstance(node, ast.ImportFrom) and node.module and not node.level:
                imported.add(node.module.split(".")[0])
    found = packages_distributions()
    brought = {"apsw", "ruamel", "dask", "llvmlite"}  # by rosbags, distributed and numba
    others = imported - set(sys.stdlib_module_names) - {"dirprim_filter", "tessellation"} - brought
    assert not {name for name in others if not {each.lower() for each in found.get(name, [name])} & declared}


ABSENT = {
    "dirprim_filter": "numpy numba rerun matplotlib google.protobuf",
    "tessellation": "numpy",
    "dirprim_filter.cli.main": "numpy numba rerun matplotlib google.protobuf rich.progress",
    "dirprim_filter.arrays": "numba scipy",
    "dirprim_filter.recording.summary": "numba scipy google.protobuf rosbags",
    "dirprim_filter.evaluation.tracking_experiment": "filterpy scipy.stats",
    "dirprim_filter.filtering.smoothing": "filterpy scipy.stats scipy.cluster scipy.optimize scipy.sparse.csgraph",
    "dirprim_filter.replay": "filterpy scipy.stats scipy.cluster scipy.optimize scipy.sparse.csgraph rerun",
    "dirprim_filter.primitives.learning": "sklearn scipy.stats rerun matplotlib",
    "dirprim_filter.store.learning": "sklearn scipy.stats filterpy",
    "dirprim_filter.recording": "sklearn rerun matplotlib",
    "dirprim_filter.viewer.figures": "matplotlib.pyplot",
}
"""What is not loaded yet after a module and those above it."""


def test_heavy_imports_come_late_and_the_public_names_are_there_whatever_was_imported_before():
    """In one process, for a start of Python with numba takes seconds."""
    program = ["import sys", *(f"import {module}; print('{module}', *sys.modules)" for module in ABSENT)]
    program += ["import dirprim_filter.forecasting, dirprim_filter.recording.reader, dirprim_filter as d"]
    program += ["print(*(callable(getattr(d, name)) for name in d.__all__))"]
    done = subprocess.run([sys.executable, "-c", "\n".join(program)], capture_output=True, text=True, check=True)
    *lines, public = done.stdout.splitlines()
    for (module, absent), loaded in zip(ABSENT.items(), lines, strict=True):
        assert not set(absent.split()) & set(loaded.split()), module
    assert set(public.split()) == {"True"}


UNUSED = {
    """from dirprim_filter.cli.sensing import _scene
from dirprim_filter.detections import Detections
assert _scene(Detections(track_id=["a"], time_ns=[0], position=[[0.0, 0.0]]), Path("a log"), 0.5) is None
""": "scipy.optimize",
    """from dirprim_filter.cli.main import run
assert run(["info", "recordings/roundabout_track.mcap"]) == 0
""": "pyarrow rosbags ruamel.yaml apsw fsspec sklearn matplotlib rerun foxglove scipy.spatial scipy.sparse",
}
"""What learns from detections without ids is not loaded for those with ids, nor by `info` what it does not need."""


@pytest.mark.parametrize("program", UNUSED)
def test_what_is_not_used_is_not_loaded(program):
    program, absent = f"import sys\nfrom pathlib import Path\n{program}print(*sys.modules)", UNUSED[program].split()
    command, root = [sys.executable, "-c", program], Path(__file__).parents[1]
    done = subprocess.run(command, cwd=root, capture_output=True, text=True, check=True)
    assert not set(absent) & set(done.stdout.split())
