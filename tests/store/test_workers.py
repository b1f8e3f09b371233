"""Who does the tasks changes nothing: this process, processes of this machine, or a cluster; and whoever is killed."""

import gc
import json
import signal
import subprocess
import sys
import time
from unittest.mock import patch

import pytest
from streets import GRID, logs_of, map_bytes, store_of, street

from dirprim_filter.cli.main import run
from dirprim_filter.recording.errors import RecordingError
from dirprim_filter.store import add_logs, find_logs, learn_from_store, workers
from dirprim_filter.store.workers import Workers

distributed = pytest.importorskip("distributed")
psutil = pytest.importorskip("psutil")  # of distributed


@pytest.mark.slow
def test_processes_of_this_machine_listen_to_it_alone_and_the_task_of_one_that_is_killed_is_done_by_another():
    here = psutil.Process()
    before, killed, heard = {each.pid for each in here.children(recursive=True)}, [], set()
    for _ in Workers(2).each(time.sleep, [0.0, 0.2, 0.2, 0.2], [f"sleep-{n}" for n in range(4)]):
        ours = [each for each in here.children(recursive=True) if each.pid not in before]
        heard |= {c.laddr.ip for each in (here, *ours) for c in each.net_connections("tcp") if c.status == "LISTEN"}
        if not killed:
            killed = [each for each in ours if "spawn_main" in " ".join(each.cmdline())]
            killed[0].kill()
    assert len(killed) == 2
    assert heard == {"127.0.0.1"}


@pytest.fixture
def cluster(tmp_path):
    """A scheduler and two workers, as the documents say to start them, and where the scheduler is."""
    at = tmp_path / "scheduler.json"
    worker = ["worker", "--nthreads", "1", "--no-nanny"]
    started = [
        subprocess.Popen(
            [sys.executable, "-m", f"distributed.cli.dask_{what}", *options, "--no-dashboard", "--scheduler-file", at],
            stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL,
        )
        for what, *options in (["scheduler", "--host", "127.0.0.1", "--port", "0"], worker, worker)
    ]  # fmt: skip
    while not at.exists():
        time.sleep(0.05)
    yield *started, Workers(scheduler=json.loads(at.read_text())["address"])
    for process in started:
        process.kill()
        process.wait()


@pytest.mark.slow
def test_a_client_a_worker_and_a_scheduler_that_are_killed_change_no_byte(cluster, tmp_path, capsys):
    scheduler, worker, _, several = cluster
    logs = logs_of(tmp_path, **{f"log{i}": street(i, start=-1400.0, length=2800.0, n_vehicles=2) for i in range(4)})
    store = add_logs(tmp_path / "store", find_logs(logs.values()), workers=several).store
    alone = store_of(tmp_path / "alone", *logs.values())
    program = "import sys; from dirprim_filter.cli.main import run; sys.exit(run(sys.argv[1:]))"
    options = ["--tessellation", "grid", "--cell-size", "32", "--scheduler", several.scheduler]
    learn = ["store", "learn", store.path, "-o", str(tmp_path / "map.mcap"), *options]
    client = subprocess.Popen([sys.executable, "-c", program, *learn])
    while client.poll() is None and not list((tmp_path / "store/_fits").rglob("*.arrow")):
        time.sleep(0.01)
    client.kill()
    assert client.wait() == -signal.SIGKILL
    assert not (tmp_path / "map.mcap").exists()
    assert run(learn) == 0
    assert "3 of 3 blocks learned anew" not in capsys.readouterr().out
    assert run(["learn", alone.path, "-o", str(tmp_path / "alone.mcap"), *options[:-2]]) == 0
    assert (tmp_path / "map.mcap").read_bytes() == (tmp_path / "alone.mcap").read_bytes()
    learn_from_store(store, workers=several, done=lambda *_: worker.kill(), **GRID | {"cell_size": 32.0})
    with pytest.raises(RecordingError, match="the scheduler was lost; what is done counts; run again"):
        learn_from_store(store, workers=several, done=lambda *_: scheduler.kill(), **GRID | {"cell_size": 40.0})
    for cell_size, n_known in ((32.0, {3}), (40.0, {1, 2})):
        found = learn_from_store(store, **GRID | {"cell_size": cell_size})
        assert found.n_blocks - found.n_fitted in n_known
        assert map_bytes(store, tmp_path, cell_size=cell_size) == map_bytes(alone, tmp_path, cell_size=cell_size)


def test_no_cluster_and_one_without_workers_are_said_in_one_line():
    for address in ("tcp://127.0.0.1:9", "nowhere", "what://127.0.0.1:9"):
        with (
            patch.object(workers, "PATIENCE_S", 1),
            pytest.raises(RecordingError, match="expected a scheduler") as error,
        ):
            list(Workers(scheduler=address).each(str, [1], ["one"]))
        assert address in str(error.value)
        assert "\n" not in str(error.value)
        # An open client's finaliser, run while another starts, waits for ever for the lock that this one holds.
        clients = [each for each in gc.get_objects() if issubclass(type(each), distributed.Client)]
        assert {each.status for each in clients} <= {"closed"}
    assert list(Workers(scheduler="nowhere").each(str, [], [])) == []
    with pytest.raises(ValueError, match="expected one of them"):
        Workers.of(100, 2, "tcp://127.0.0.1:9")
    assert Workers.of(3, None, None).in_process
