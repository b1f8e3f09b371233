"""What tests of stores share."""

import socket
import subprocess
import sys
import time
import urllib.request

import pytest


@pytest.fixture(scope="session")
def moto():
    """An object store, as moto plays S3; one for all tests, in a process of its own: Delta's library holds the lock."""
    pytest.importorskip("moto.server", reason="an object store needs moto")
    with socket.create_server(("127.0.0.1", 0)) as free:
        port = free.getsockname()[1]
    command = [sys.executable, "-m", "moto.server", "-H", "127.0.0.1", "-p", str(port)]
    played = subprocess.Popen(command, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)
    for _ in range(1200):  # a busy machine is slow to start it
        try:
            socket.create_connection(("127.0.0.1", port), timeout=1.0).close()
            break
        except OSError:
            time.sleep(0.1)
    yield f"http://127.0.0.1:{port}"
    played.kill()
    played.wait()


@pytest.fixture
def bucket(moto, monkeypatch):
    """The URL of an empty bucket."""
    urllib.request.urlopen(urllib.request.Request(f"{moto}/moto-api/reset", method="POST")).close()  # noqa: S310
    settings = {
        "AWS_ACCESS_KEY_ID": "testing", "AWS_SECRET_ACCESS_KEY": "verysecret", "AWS_ENDPOINT_URL": moto,
        "AWS_REGION": "us-east-1", "AWS_ALLOW_HTTP": "true",
    }  # fmt: skip
    for name, value in settings.items():
        monkeypatch.setenv(name, value)
    urllib.request.urlopen(urllib.request.Request(f"{moto}/bucket", method="PUT")).close()  # noqa: S310
    return "s3://bucket"


@pytest.fixture(params=["folder", "object store"])
def place(request, tmp_path):
    """Where a store may be."""
    return str(tmp_path / "a store") if request.param == "folder" else f"{request.getfixturevalue('bucket')}/a/store"
