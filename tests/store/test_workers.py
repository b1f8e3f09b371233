"""Who does the tasks changes nothing: this process, processes of this machine, or a cluster that may be lost."""

import json
import subprocess
import sys
import time

import numpy as np
import pytest
from streets import FAR_M, add, bytes_of, store_of, street

from dirprim_filter import Tracks, write_tracks
from dirprim_filter.recording.errors import RecordingError
from dirprim_filter.store import Store, learn_from_store, update_map, workers
from dirprim_filter.store.adding import add_logs
from dirprim_filter.store.config import StoreConfig
from dirprim_filter.store.log_files import find_logs
from dirprim_filter.store.workers import ClusterWorkers, LocalWorkers, workers_for

distributed = pytest.importorskip("distributed")
N_LOGS = 12


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    """Logs of two streets, and of one of them again."""
    folder = tmp_path_factory.mktemp("logs")
    both = [street(1, north=0.0, n_vehicles=9), street(2, north=FAR_M, n_vehicles=9)]
    write_tracks(Tracks.concatenate(both), folder / "both.mcap")
    write_tracks(street(3, north=0.0), folder / "near.mcap")
    for seed in range(N_LOGS):
        write_tracks(street(seed, north=0.0, n_vehicles=2), folder / f"small{seed}.mcap")
    return folder


@pytest.fixture(scope="module")
def cluster():
    """A scheduler with a worker, as anyone's."""
    with distributed.LocalCluster(
        n_workers=1, threads_per_worker=1, dashboard_address="127.0.0.1:0", host="127.0.0.1"
    ) as running:
        yield running


def learned(store, **options):
    return learn_from_store(
        store, min_vehicles=2, tessellation="voronoi", n_cells=40, rng=np.random.default_rng(0), **options
    )


def test_the_map_is_the_same_whoever_fits_it(folder, tmp_path, cluster):
    store = store_of(tmp_path / "store", folder, "both")
    here, reported = learned(store), []
    there = learned(store, workers=LocalWorkers(2), fitted=lambda *done: reported.append(done), stage=reported.append)
    assert bytes_of(there, tmp_path / "there.mcap") == bytes_of(here, tmp_path / "here.mcap")
    n = reported[-1][1]
    assert [of for _, of in reported] == [n] * len(reported)
    assert [done for done, _ in reported] == sorted({done for done, _ in reported})
    assert reported[-1] == (n, n)
    add(store, folder, "near")
    anew, by_cluster = (
        update_map(here, store, workers=each) for each in (None, ClusterWorkers(cluster.scheduler_address))
    )
    assert anew.n_cells == by_cluster.n_cells > 0
    assert bytes_of(by_cluster.primitive_map, tmp_path / "there.mcap") == bytes_of(
        anew.primitive_map, tmp_path / "a.mcap"
    )
    assert bytes_of(anew.primitive_map, tmp_path / "a.mcap") != (tmp_path / "here.mcap").read_bytes()


def test_a_cluster_without_workers_and_no_cluster_are_said_in_one_line(monkeypatch):
    monkeypatch.setattr(workers, "PATIENCE_S", 1)
    with (
        distributed.LocalCluster(n_workers=0, dashboard_address="127.0.0.1:0", host="127.0.0.1") as idle,
        pytest.raises(RecordingError, match=r"expected workers, none came in 1 s; start some with `dask worker tcp"),
    ):
        list(ClusterWorkers(idle.scheduler_address).each(str, [1]))
    for address in ("tcp://127.0.0.1:9", "nowhere", "what://127.0.0.1:9"):
        with pytest.raises(RecordingError, match=f"--scheduler {address}: expected a scheduler of Dask") as error:
            list(ClusterWorkers(address).each(str, [1]))
        assert "\n" not in str(error.value)
    assert list(ClusterWorkers("nowhere").each(str, [])) == []


def test_workers_or_a_scheduler():
    assert isinstance(workers_for(100, None, "tcp://127.0.0.1:9"), ClusterWorkers)
    with pytest.raises(ValueError, match="expected one of them"):
        workers_for(100, 2, "tcp://127.0.0.1:9")


def started(what, *options):
    """A process of Dask."""
    return subprocess.Popen(
        [sys.executable, "-m", f"distributed.cli.dask_{what}", "--no-dashboard", *options], stdout=subprocess.DEVNULL,
        stderr=subprocess.DEVNULL,
    )  # fmt: skip


def test_of_a_scheduler_that_is_killed_what_is_done_counts_and_no_finished_log_is_opened_again(
    folder, tmp_path, monkeypatch
):
    """The store is then, after another run, that of this process."""
    logs = find_logs([str(folder / "small*.mcap")])
    whole, store = (Store.create(tmp_path / name, StoreConfig()) for name in ("whole", "store"))
    add_logs(whole, logs)
    at = tmp_path / "scheduler.json"
    scheduler = started("scheduler", "--host", "127.0.0.1", "--port", "0", "--scheduler-file", str(at))
    worker = started("worker", "--scheduler-file", str(at), "--nthreads", "1", "--no-nanny", "--death-timeout", "30")
    try:
        while not at.exists():
            time.sleep(0.05)
        address = json.loads(at.read_text())["address"]

        def kill(done, of):
            if done == 3:
                scheduler.kill()

        with pytest.raises(RecordingError, match=r"the scheduler was lost; what is done counts; run again"):
            add_logs(store, logs, workers=ClusterWorkers(address), progress=kill)
    finally:
        for process in (worker, scheduler):
            process.kill()
            process.wait()
    n_done = len(store.entries())
    assert 3 <= n_done < N_LOGS
    assert add_logs(store, logs).known == n_done
    recordings = [
        {path.name: path.read_bytes() for path in (of.path / "recordings").iterdir()} for of in (store, whole)
    ]
    assert recordings[0] == recordings[1]
