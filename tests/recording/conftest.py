"""What tests of logs share."""

import pytest


@pytest.fixture
def log_file(tmp_path):
    """Writes bytes to a log; -> its path."""

    def write(data):
        path = tmp_path / "log.mcap"
        path.write_bytes(data)
        return path

    return write
