"""Messages, definitions and transforms broken at random; tests/benchmarks/fuzz_payloads.py has ten thousand of each."""

import numpy as np
import payload_mutations
import pytest
from payload_mutations import check_definition, check_payload, check_transforms, subjects

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


def test_the_check_itself_would_notice(whole, monkeypatch):
    """Negative control: a decoder that lets a broken message end the batch must fail it."""
    read = payload_mutations.Decoders.rows

    def hasty(self, messages):
        rows, failures = read(self, messages)
        return (rows[rows.message < min(failures)], failures) if failures else (rows, failures)

    monkeypatch.setattr(payload_mutations.Decoders, "rows", hasty)
    with pytest.raises(AssertionError):
        sum(check_payload(whole[0], np.random.default_rng([i, 3])) for i in range(ROUNDS))
