"""Messages, definitions, transforms, tables and maps broken at random; `tests/benchmarks/fuzz.py` has ten thousand."""

import os
import subprocess
import sys
from pathlib import Path

import numpy as np
import payload_mutations
import pytest
from map_mutations import MAPS, check_map
from payload_mutations import TABLES, check_definition, check_payload, check_table, check_transforms, subjects

ROUNDS = 20


@pytest.fixture(scope="module")
def whole(tmp_path_factory):
    return subjects(tmp_path_factory.mktemp("whole"))


@pytest.mark.parametrize("check", [check_payload, check_definition])
def test_what_is_broken_costs_itself_and_no_more(whole, check):
    read_by_definition = [subject for subject in whole if subject.name != "json"]
    refused = [
        check(subject, np.random.default_rng([i, 3]))
        for subject in (whole if check is check_payload else read_by_definition)
        for i in range(ROUNDS)
    ]
    assert 0 < sum(refused) < len(refused)


def test_broken_transforms_cost_themselves_and_no_more(tmp_path):
    assert check_transforms(np.random.default_rng(0), tmp_path / "tf.mcap", 100) > 0


@pytest.mark.parametrize("form", TABLES)
def test_of_a_broken_table_each_row_is_read_or_counted(tmp_path, form):
    refused = [check_table(form, tmp_path / "table", np.random.default_rng([i, 3])) for i in range(3 * ROUNDS)]
    assert 0 < sum(refused) < len(refused)


@pytest.mark.parametrize("kind", MAPS)
def test_harmed_maps_are_refused_or_read_and_used(tmp_path, kind):
    refused = [check_map(kind, tmp_path / "map.mcap", np.random.default_rng([i, 3])) for i in range(3 * ROUNDS)]
    assert 0 < sum(refused) < len(refused)


@pytest.mark.slow
def test_no_index_of_a_kernel_leaves_its_array(tmp_path):
    """The kernels compiled with checks of bounds, which normal ones do without: an index beyond raises."""
    command = [sys.executable, Path(__file__).parents[1] / "benchmarks/fuzz.py", "10"]
    checked = os.environ | {"NUMBA_BOUNDSCHECK": "1", "NUMBA_CACHE_DIR": str(tmp_path)}
    done = subprocess.run(command, env=checked, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stdout + done.stderr


def test_the_check_itself_would_notice(whole, monkeypatch):
    """Negative control: a decoder that lets a broken message end the batch must fail it."""
    read = payload_mutations.Decoders.rows

    def hasty(self, messages):
        rows, failures = read(self, messages)
        return (rows[rows.message < min(failures)], failures) if failures else (rows, failures)

    monkeypatch.setattr(payload_mutations.Decoders, "rows", hasty)
    with pytest.raises(AssertionError):
        sum(check_payload(whole[0], np.random.default_rng([i, 3])) for i in range(ROUNDS))
