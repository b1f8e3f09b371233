"""Layers, and what importing costs."""

import ast
import re
import subprocess
import sys
import tomllib
from importlib.metadata import packages_distributions
from pathlib import Path

import pytest


def python(code):
    return subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True).stdout.split()


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
        ("dirprim_filter.primitives.learning", ["sklearn", "rerun", "matplotlib", "mcap"]),
        ("dirprim_filter.recording", ["rerun", "matplotlib", "sklearn"]),
        (
            "dirprim_filter.replay, dirprim_filter.filtering.smoothing",
            ["filterpy", "scipy.stats", "rerun", "scipy.cluster", "scipy.optimize", "scipy.sparse.csgraph"],
        ),
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
