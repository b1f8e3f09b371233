"""Who does the tasks changes nothing: this process, processes of this machine, or a cluster that may be lost."""

import json
import os
import signal
import subprocess
import sys
import time
from pathlib import Path
from unittest.mock import patch

import pytest
from dying import once_killed
from streets import GRID, bytes_of, logs_of, store_of, street

from dirprim_filter.recording.errors import RecordingError
from dirprim_filter.store import add_logs, find_logs, learn_from_store, workers
from dirprim_filter.store.workers import Workers

distributed = pytest.importorskip("distributed")
N_LOGS = 6


@pytest.fixture(scope="module")
def whole(tmp_path_factory):
    """A store of a street across three blocks, by this process, its logs, and the bytes of its map."""
    folder = tmp_path_factory.mktemp("whole")
    path = logs_of(folder, **{f"log{i}": street(i, start=-1400.0, length=2800.0, n_vehicles=2) for i in range(N_LOGS)})
    store = store_of(folder / "store", *path.values())
    return store, list(path.values()), bytes_of(learn_from_store(store, **GRID).primitive_map, folder)


def listening():
    """Addresses, in hexadecimal, on which processes of this machine listen for connections."""
    lines = Path("/proc/net/tcp").read_text().splitlines()[1:]
    return {tuple(line.split()[1].split(":")) for line in lines if line.split()[3] == "0A"}


@pytest.mark.skipif(not Path("/proc/net/tcp").exists(), reason="says who listens on Linux")
def test_processes_of_this_machine_make_the_same_map_and_listen_to_it_alone(whole, tmp_path):
    _, logs, expected = whole
    before, seen = listening(), set()
    several = Workers(2)
    added = add_logs(tmp_path / "store", find_logs(logs), workers=several, progress=lambda *_: seen.update(listening()))
    assert not [receipt.error for receipt in added.receipts if receipt.error]
    opened = seen - before
    assert opened
    assert {address for address, _ in opened} == {"0100007F"}  # 127.0.0.1
    found = learn_from_store(added.store, workers=several, **GRID)
    assert found.n_fitted == found.n_blocks == 3
    assert bytes_of(found.primitive_map, tmp_path) == expected


def test_the_task_of_a_worker_that_is_killed_is_done_by_another(tmp_path):
    tasks = [(tmp_path / "killed", number) for number in range(4)]
    assert sorted(Workers(2).each(once_killed, tasks, [f"task-{n}" for n in range(4)])) == [0, 1, 2, 3]
    assert (tmp_path / "killed").exists()


def test_a_client_that_is_killed_goes_on_where_it_was(whole, tmp_path):
    _, logs, expected = whole
    store = store_of(tmp_path / "store", *logs)
    work = "import sys; from dirprim_filter.cli.main import run; sys.exit(run(sys.argv[1:]))"
    learn = ["learn", store.path, "-o", "map.mcap", "--tessellation", "grid", "--cell-size", "32"]
    client = subprocess.Popen([sys.executable, "-c", work, *learn], cwd=tmp_path, start_new_session=True)
    fits = tmp_path / "store" / "_fits"
    while client.poll() is None and not list(fits.rglob("*.mcap")):
        time.sleep(0.01)
    os.killpg(client.pid, signal.SIGKILL)
    assert client.wait() == -signal.SIGKILL
    assert not (tmp_path / "map.mcap").exists()
    found = learn_from_store(store, **GRID)
    assert bytes_of(found.primitive_map, tmp_path) == expected


def started(what, *options):
    """A process of Dask."""
    return subprocess.Popen(
        [sys.executable, "-m", f"distributed.cli.dask_{what}", "--no-dashboard", *options], stdout=subprocess.DEVNULL,
        stderr=subprocess.DEVNULL,
    )  # fmt: skip


def test_of_a_scheduler_that_is_killed_what_is_done_counts(whole, tmp_path):
    _, logs, expected = whole
    store, at = store_of(tmp_path / "store", *logs), tmp_path / "scheduler.json"
    scheduler = started("scheduler", "--host", "127.0.0.1", "--port", "0", "--scheduler-file", str(at))
    worker = started("worker", "--scheduler-file", str(at), "--nthreads", "1", "--no-nanny", "--death-timeout", "30")
    try:
        while not at.exists():
            time.sleep(0.05)
        cluster = Workers(scheduler=json.loads(at.read_text())["address"])

        def kill(*_):
            scheduler.kill()

        with pytest.raises(RecordingError, match="the scheduler was lost; what is done counts; run again"):
            learn_from_store(store, workers=cluster, done=kill, **GRID)
    finally:
        for process in (worker, scheduler):
            process.kill()
            process.wait()
    found = learn_from_store(store, **GRID)
    assert found.n_fitted < found.n_blocks
    assert bytes_of(found.primitive_map, tmp_path) == expected


def test_no_cluster_and_one_without_workers_are_said_in_one_line():
    for address in ("tcp://127.0.0.1:9", "nowhere", "what://127.0.0.1:9"):
        with (
            patch.object(workers, "PATIENCE_S", 1),
            pytest.raises(RecordingError, match="expected a scheduler") as error,
        ):
            list(Workers(scheduler=address).each(str, [1], ["one"]))
        assert address in str(error.value)
        assert "\n" not in str(error.value)
    assert list(Workers(scheduler="nowhere").each(str, [], [])) == []
    with pytest.raises(ValueError, match="expected one of them"):
        Workers.of(100, 2, "tcp://127.0.0.1:9")
    assert Workers.of(3, None, None).in_process
