"""What tests of logs share."""

import pytest

from dirprim_filter.recording.container import source


@pytest.fixture(autouse=True)
def forget_copies(monkeypatch):
    """Copies of pipes and of remote logs are not kept from one test to the next."""
    monkeypatch.setattr(source, "_kept", {})


@pytest.fixture
def log_file(tmp_path):
    """Writes bytes to a log; -> its path."""

    def write(data):
        path = tmp_path / "log.mcap"
        path.write_bytes(data)
        return path

    return write
