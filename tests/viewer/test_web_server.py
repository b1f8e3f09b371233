"""Serving answers on this machine alone unless asked otherwise, and a browser that comes by finds the map drawn."""

import io
import shutil
import socket
import subprocess
import time
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest
from matplotlib.image import imread

from dirprim_filter.primitives.primitive_map import PrimitiveMap
from dirprim_filter.viewer.process import WebServer
from dirprim_filter.viewer.sink import open_stream

BROWSER = shutil.which("chromium") or shutil.which("chromium-browser")


def free_ports(n: int) -> list[int]:
    sockets = [socket.socket() for _ in range(n)]
    for each in sockets:
        each.bind(("127.0.0.1", 0))
    ports = [each.getsockname()[1] for each in sockets]
    for each in sockets:
        each.close()
    return ports


@pytest.fixture
def server() -> Iterator[WebServer]:
    data, web = free_ports(2)
    with WebServer("127.0.0.1", data_port=data, web_port=web) as running:
        yield running


def listening(port: int) -> set[str]:
    """The addresses at which something listens on the port, as the kernel writes them."""
    rows = [line.split() for name in ("tcp", "tcp6") for line in Path(f"/proc/net/{name}").read_text().splitlines()[1:]]
    return {row[1].split(":")[0] for row in rows if row[3] == "0A" and int(row[1].split(":")[1], 16) == port}


@pytest.mark.skipif(not Path("/proc/net/tcp").exists(), reason="the kernel does not tell who listens where")
def test_a_server_answers_on_this_machine_alone(server: WebServer) -> None:
    ports = [int(url.split(":")[2].split("/")[0]) for url in (server.stream_url, server.page_url)]
    for port in ports:
        assert listening(port) == {"0100007F"}  # 127.0.0.1
    server.stop()
    assert all(listening(port) == set() for port in ports)


def test_a_taken_port_is_reported(server: WebServer) -> None:
    taken = int(server.stream_url.split(":")[2].split("/")[0])
    with pytest.raises(ConnectionError, match=f"127.0.0.1:{taken}: cannot serve there"):
        WebServer("127.0.0.1", data_port=taken, web_port=free_ports(1)[0])


@pytest.mark.skipif(BROWSER is None, reason="no browser: apt-get install chromium")
def test_a_browser_finds_the_map_drawn(
    tmp_path: Path, scene_map: PrimitiveMap, monkeypatch: pytest.MonkeyPatch
) -> None:
    data, web = free_ports(2)
    monkeypatch.setattr(WebServer.__init__, "__kwdefaults__", {"data_port": data, "web_port": web})
    with open_stream(serve="127.0.0.1") as sink:
        sink.log_map(scene_map)
        sink.flush()
        assert sink.stream.server is not None
        picture = drawn_page(sink.stream.server.page_url, tmp_path)
    # The petals of the scene's map are the only large areas of these two colours: 8 m/s and 4 m/s of 8.
    rgb = (255 * picture[..., :3]).astype(int)
    yellow = (np.abs(rgb - (253, 231, 37)).max(axis=-1) < 40).sum()
    assert yellow > 200


def drawn_page(url: str, folder: Path) -> np.ndarray:
    """The page once it shows something colourful; a browser's own one-shot pictures are taken too early."""
    json_rpc = pytest.importorskip("websocket", reason="no websocket client: pip install websocket-client")
    (port,) = free_ports(1)
    browser = subprocess.Popen(
        [str(BROWSER), "--headless=new", "--no-sandbox", "--use-angle=swiftshader", "--enable-unsafe-swiftshader",
         "--window-size=900,600", f"--user-data-dir={folder}/profile", f"--remote-debugging-port={port}",
         "--remote-allow-origins=*", url],
        stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL,
    )  # fmt: skip
    try:
        return _watch(json_rpc, port)
    finally:
        browser.terminate()
        browser.wait()


def _watch(websocket: object, port: int) -> np.ndarray:
    import base64
    import json
    import urllib.request

    until = time.monotonic() + 90
    picture = np.zeros((1, 1, 3))
    page = None
    while time.monotonic() < until:
        time.sleep(1.0)
        try:
            if page is None:
                with urllib.request.urlopen(f"http://127.0.0.1:{port}/json") as answer:
                    targets = [t for t in json.load(answer) if t["type"] == "page"]
                page = websocket.create_connection(targets[0]["webSocketDebuggerUrl"], timeout=60)
            page.send(json.dumps({"id": 1, "method": "Page.captureScreenshot"}))
            answer = json.loads(page.recv())
        except (OSError, IndexError):
            continue
        picture = imread(io.BytesIO(base64.b64decode(answer["result"]["data"])))
        rgb = (255 * picture[..., :3]).astype(int)
        if (np.abs(rgb - (253, 231, 37)).max(axis=-1) < 40).sum() > 200:
            break
    if page is not None:
        page.close()
    return picture
