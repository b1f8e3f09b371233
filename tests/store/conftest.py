"""What tests of stores share."""

import logging
import urllib.request
from collections import Counter

import pytest


@pytest.fixture
def object_store(monkeypatch):
    """The file system of S3 as moto plays it, with an empty bucket."""
    server = pytest.importorskip("moto.server", reason="an object store needs moto")
    s3fs = pytest.importorskip("s3fs", reason="an object store needs s3fs")
    for name in ("AWS_ACCESS_KEY_ID", "AWS_SECRET_ACCESS_KEY"):
        monkeypatch.setenv(name, "testing")
    played = server.ThreadedMotoServer(ip_address="127.0.0.1", port=0, verbose=False)
    monkeypatch.setattr(logging.getLogger("werkzeug"), "disabled", True)
    played.start()
    where = "http://{}:{}".format(*played.get_host_and_port())
    urllib.request.urlopen(urllib.request.Request(f"{where}/moto-api/reset", method="POST")).close()  # noqa: S310
    monkeypatch.setenv("AWS_ENDPOINT_URL", where)
    there = s3fs.S3FileSystem(skip_instance_cache=True)
    s3fs.S3FileSystem.clear_instance_cache()  # of other servers that moto played
    there.mkdir("bucket")
    yield there
    played.stop()


@pytest.fixture
def requests(object_store, monkeypatch):
    """How many of each kind this process asked for."""
    kind, asked = type(object_store), Counter()
    call = kind._call_s3

    async def counting(files, method, *given, **options):
        asked[method] += 1
        return await call(files, method, *given, **options)

    monkeypatch.setattr(kind, "_call_s3", counting)
    return asked
