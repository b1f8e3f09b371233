"""Logs broken at random: no crash, nothing lost in silence, every intact chunk delivered, all recovered."""

import numpy as np
import pytest
from mutations import check, check_recovery, mutated, subjects

LOGS = subjects(np.random.default_rng(0))
ROUNDS = 50


@pytest.mark.parametrize("whole", LOGS, ids=lambda whole: whole.name)
def test_what_is_intact_is_delivered_and_what_is_lost_is_reported(whole, tmp_path):
    path, fixed = tmp_path / "broken.mcap", tmp_path / "fixed.mcap"
    noticed = 0
    for i in range(ROUNDS):
        data, done = mutated(whole.data, np.random.default_rng([i, 7]))
        try:
            noticed += check(whole, data, path)
            if i % 6 == 0:
                check_recovery(path, fixed)
        except AssertionError as error:
            raise AssertionError(f"round {i}, {done}") from error
    assert noticed > 0.8 * ROUNDS  # a byte of an index, or of padding, may change unnoticed: nothing hangs on it


@pytest.mark.parametrize("whole", LOGS, ids=lambda whole: whole.name)
def test_the_check_itself_would_notice(whole, tmp_path, monkeypatch):
    """Negative control: a scan that stops at the first damage must fail it."""
    import mutations

    class Impatient:
        def __init__(self, path):
            self.log = real(path)
            self.damage = self.log.damage

        def __enter__(self):
            return self

        def __exit__(self, *_):
            self.log.close()

        def __iter__(self):
            return iter(()) if self.log.damage else iter(self.log)

    real = mutations.scan
    monkeypatch.setattr(mutations, "scan", Impatient)
    broken = [mutated(whole.data, np.random.default_rng([i, 7]))[0] for i in range(ROUNDS)]
    with pytest.raises(AssertionError):
        any(check(whole, data, tmp_path / "broken.mcap") is None for data in broken)
