"""Tasks on a real Dask cluster of this machine: equal results, a worker killed in the middle, errors that help."""

from __future__ import annotations

import sys

import pytest
from distributed import Client

from sympol import provenance
from sympol.parallel import TasksFailed, dask, run_tasks
from sympol.provenance import code_hash

from .cluster import Cluster, kill
from .tasks import task
from .test_workers import results, wait_until

pytestmark = pytest.mark.slow


@pytest.fixture(scope="module")
def cluster(tmp_path_factory):
    with Cluster(tmp_path_factory.mktemp("cluster")) as cluster:
        cluster.hire(3)
        code_hash.cache_clear()
        with Client(
            cluster.address, set_as_default=False
        ) as client:  # all at once, lest a file is edited meanwhile
            assert {*client.run(code_hash).values()} == {code_hash()}
        yield cluster


@pytest.fixture
def code_as_it_is_now(monkeypatch):
    """For clusters started later than the one above: somebody may have edited a file since."""
    monkeypatch.setattr(provenance, "code_hash", code_hash.__wrapped__)


def test_a_cluster_gives_what_one_process_gives_to_the_bit(cluster, capfd):
    tasks = [task(f"t{seed}", "compute", seed=seed) for seed in range(4)] + [task("s", "square", x=3)]
    assert results(tasks, scheduler=cluster.address) == results(tasks, progress=False)
    assert "[5/5]" in capfd.readouterr().err


def test_an_exception_is_told_with_its_traceback_and_the_others_go_on(cluster, capfd):
    found: list[str] = []
    tasks = [task("a", "fail", x=5), task("b", "square", x=1)]
    with pytest.raises(TasksFailed, match=r"1 of 2 tasks failed.*a: ArithmeticError: 5 is not a number"):
        run_tasks(tasks, scheduler=cluster.address, on_done=lambda task, _: found.append(task.name))
    assert found == ["b"]
    assert "raise ArithmeticError" in capfd.readouterr().err


def test_a_worker_killed_in_the_middle_loses_nothing(cluster):
    victim = cluster.workers[0]
    tasks = [task(f"t{x}", "square", x=x, seconds=0.3) for x in range(18)]
    found = {}

    def done(task, result):
        found[task.name] = result
        if len(found) == 4:
            kill(victim)

    run_tasks(tasks, scheduler=cluster.address, on_done=done)
    assert found == results([task(f"t{x}", "square", x=x) for x in range(18)], progress=False)


def test_results_that_die_with_their_worker_are_computed_again(cluster):
    cluster.hire()
    victim = cluster.workers[-1]
    tasks = [task(f"t{x}", "square", x=x, seconds=0.05) for x in range(12)]
    found = {}

    def done(task, result):
        found[task.name] = result
        if len(found) == 1:
            with Client(cluster.address, set_as_default=False) as client:
                workers = _workers(client)
                wait_until(lambda: not any(client.processing().values()))
                assert all(client.has_what().values())
                kill(victim)
                wait_until(lambda: len(_workers(client)) < len(workers))

    run_tasks(tasks, scheduler=cluster.address, on_done=done)
    assert found == results([task(f"t{x}", "square", x=x) for x in range(12)], progress=False)


def _workers(client):
    return client.scheduler_info(n_workers=-1)["workers"]


@pytest.mark.usefixtures("code_as_it_is_now")
def test_what_kills_its_workers_is_tried_again_and_given_up(tmp_path, capfd):
    marker = tmp_path / "marker"
    with Cluster(tmp_path, allowed_failures=0) as cluster:  # so that Dask itself tries nothing again
        cluster.hire(3)
        tasks = [task("a", "die_once", marker=str(marker), value=7)]
        assert results(tasks, scheduler=cluster.address) == {"a": 7}
        assert "a: 1 workers were lost with it, tcp://127.0.0.1:" in capfd.readouterr().err
        marker.unlink()
        with pytest.raises(TasksFailed, match="a: 1 workers were lost with it"):
            results(tasks, scheduler=cluster.address, retries=0)


def test_a_worker_of_another_version_is_refused_at_the_door(cluster, monkeypatch):
    monkeypatch.setattr(
        dask, "training_versions", lambda: {"python": "3.11", "sympol": "9.9.9", "jax": "0", "jaxlib": "0"}
    )
    with pytest.raises(
        dask.SchedulerError, match=r"worker tcp://127\S+ has sympol 0\.\S+, this process has 9\.9\.9"
    ):
        results([task("a", "square", x=1)], scheduler=cluster.address)


def test_a_worker_of_other_code_is_refused_by_its_first_task(cluster, monkeypatch):
    monkeypatch.setattr(provenance, "code_hash", lambda: "0123456789ab")
    with pytest.raises(
        dask.SchedulerError, match=r"worker tcp://127\S+ has sympol's code \w{12}, this .*same commit"
    ):
        results([task("a", "square", x=1)], scheduler=cluster.address)


def test_a_worker_with_other_threads_is_refused_by_its_first_task(cluster, monkeypatch):
    monkeypatch.setenv("PJRT_NPROC", "77")
    with pytest.raises(
        dask.SchedulerError, match=r"JAX threads: \d+, .*has 77: .*start it with PJRT_NPROC=77"
    ):
        results([task("a", "square", x=1)], scheduler=cluster.address)


@pytest.mark.usefixtures("code_as_it_is_now")
def test_workers_may_come_later(tmp_path, capfd):
    with Cluster(tmp_path) as cluster:
        cluster.start_worker()
        assert results([task("a", "square", x=2)], scheduler=cluster.address)["a"]["square"] == 4
    assert (
        f"no workers at {cluster.address} yet, waiting for the first: dask worker tcp"
        in capfd.readouterr().err
    )


@pytest.mark.usefixtures("code_as_it_is_now")
def test_a_scheduler_that_goes_away_is_told(tmp_path):
    with Cluster(tmp_path) as cluster:
        cluster.hire()
        tasks = [task(f"t{x}", "square", x=x, seconds=0.2) for x in range(50)]
        with pytest.raises(dask.SchedulerError, match=r"went away.* 1 of 50 tasks are done and kept"):
            run_tasks(tasks, scheduler=cluster.address, on_done=lambda *_: kill(cluster.scheduler))


@pytest.mark.parametrize("address", ["tcp://127.0.0.1:1", "nonsense://there", "127.0.0.1:what"])
def test_no_scheduler_there(address, monkeypatch):
    monkeypatch.setattr(dask, "_TIMEOUT", 1)
    with pytest.raises(dask.SchedulerError, match=f"no Dask scheduler answers at '{address}' within 1 s"):
        results([task("a", "square", x=1)], scheduler=address)


def test_without_the_extra(monkeypatch):
    monkeypatch.setitem(sys.modules, "distributed", None)
    with pytest.raises(ImportError, match=r"pip install 'sympol\[cluster\]'"):
        results([task("a", "square", x=1)], scheduler="tcp://127.0.0.1:1")
