"""Tasks in this process and in several: equal results, deaths survived, failures told, interruptions clean."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
import time
from pathlib import Path
from typing import Any

import pytest

from sympol.parallel import Task, TasksFailed, run_tasks

from .tasks import HERE, task

ROOT = Path(__file__).parents[2]


def results(tasks: list[Task], **how: Any) -> dict[str, Any]:
    found: dict[str, Any] = {}
    run_tasks(tasks, on_done=lambda task, result: found.update({task.name: result}), **how)
    return found


def alive(pid: int) -> bool:
    try:
        return Path(f"/proc/{pid}/stat").read_text().rpartition(")")[2].split()[0] != "Z"
    except FileNotFoundError:
        return False


def wait_until(true, seconds: float = 20.0) -> None:
    end = time.monotonic() + seconds
    while not true():
        assert time.monotonic() < end, "waited in vain"
        time.sleep(0.02)


def test_in_this_process_one_after_the_other():
    found = results([task(f"t{x}", "square", x=x) for x in (3, 1, 2)])
    assert list(found) == ["t3", "t1", "t2"]
    assert found["t3"] == {"square": 9, "both": [3, -3]}, "as JSON gives it back, also here"


@pytest.mark.slow
def test_processes_give_what_one_gives_to_the_bit():
    """Also sums whose last digit tells how many threads added them up."""
    tasks = [task(f"t{seed}", "compute", seed=seed) for seed in range(6)]
    assert results(tasks, workers=2) == results(tasks)


def test_workers_live_long():
    pids = results([task(f"t{i}", "process") for i in range(6)], workers=2)
    assert 1 <= len({*pids.values()}) <= 2
    assert os.getpid() not in pids.values()


def test_a_worker_that_dies_is_replaced(tmp_path, capfd):
    tasks = [task("a", "square", x=2), task("b", "die_once", marker=str(tmp_path / "m"), value=7)]
    tasks.append(task("c", "square", x=3))
    assert results(tasks, workers=2)["b"] == 7
    assert "b: its worker process was ended by SIGKILL (out of memory?), exit code -9; trying again" in (
        capfd.readouterr().err
    )


def test_what_kills_its_worker_each_time_is_given_up(tmp_path):
    marker = tmp_path / "children"
    found: list[str] = []
    with pytest.raises(TasksFailed, match=r"1 of 3 tasks failed.*b: .*SIGKILL.*exit code -9, and so 3 times"):
        run_tasks(
            [task("a", "square", x=2), task("b", "die", marker=str(marker)), task("c", "square", x=3)],
            workers=2,
            on_done=lambda task, _: found.append(task.name),
        )
    assert sorted(found) == ["a", "c"]
    children = [int(line) for line in marker.read_text().split()]
    assert len(children) == 3
    wait_until(lambda: not any(alive(child) for child in children))


def test_a_fork_that_outlives_its_worker_holds_nothing_up(tmp_path):
    marker = tmp_path / "child"
    tasks = [task("a", "fork_and_die", marker=str(marker)), task("b", "square", x=1)]
    with pytest.raises(TasksFailed, match=r"a: .*SIGKILL"):
        results(tasks, workers=2, retries=0)
    wait_until(lambda: not alive(int(marker.read_text())))


def test_a_worker_s_last_words_are_told(capfd):
    with pytest.raises(TasksFailed, match="a: its worker process ended with exit code 3") as caught:
        results([task("a", "leave", code=3), task("b", "square", x=1)], workers=2, retries=0)
    assert caught.value.failures[0].details == "last words\n"
    assert "last words" in capfd.readouterr().err


@pytest.mark.parametrize("workers", [1, 2])
def test_an_exception_is_told_with_its_traceback_and_the_others_go_on(workers, capfd):
    found: list[str] = []
    tasks = [task("a", "fail", x=5), task("b", "square", x=1), task("c", "unspeakable")]
    tasks += [task("d", "leave_politely"), task("e", "square", x=1)]
    with pytest.raises(TasksFailed) as caught:
        run_tasks(tasks, workers=workers, on_done=lambda task, _: found.append(task.name))
    assert sorted(found) == ["b", "e"]
    told = capfd.readouterr().err
    assert sorted(failure.task.name for failure in caught.value.failures) == ["a", "c", "d"]
    assert "3 of 5 tasks failed" in str(caught.value)
    assert "a: ArithmeticError: 5 is not a number to my taste" in str(caught.value)
    assert "c: TypeError: Object of type object is not JSON serializable" in str(caught.value)
    assert "d: SystemExit: a command ended" in str(caught.value)
    assert f"{Path(__file__).with_name('tasks.py')}" in told, "the traceback"
    assert "raise ArithmeticError" in told


def test_tasks_in_workers_have_no_terminal(capfd):
    assert results([task("a", "noisy"), task("b", "noisy")], workers=2) == {"a": "", "b": ""}
    out, err = capfd.readouterr()
    assert "noise" not in out + err


def test_where_nobody_watches_each_task_is_a_line(capfd):
    results([task(f"t{x}", "square", x=x) for x in range(2)])
    lines = capfd.readouterr().err.splitlines()
    assert lines == ["[1/2] t0 (0.0 s)  about 0:00:00 left", "[2/2] t1 (0.0 s)"]
    results([task("t", "square", x=1)], progress=False)
    assert capfd.readouterr() == ("", "")


def test_what_on_done_raises_ends_everything(tmp_path):
    def full(task, result):
        raise OSError("no space left on device")

    tasks = [task("a", "square", x=1), task("b", "linger", folder=str(tmp_path), seconds=600)]
    with pytest.raises(OSError, match="no space"):
        run_tasks(tasks, workers=2, on_done=full)
    wait_until(
        lambda: not any(alive(int(pid)) for file in tmp_path.iterdir() for pid in file.name.split("-"))
    )


SCRIPT = """
import sys
from tests.parallel.tasks import task
from sympol.parallel import run_tasks
tasks = [task("quick", "square", x=1)]
tasks += [task(f"t{i}", "linger", folder=sys.argv[1], seconds=600) for i in range(4)]
run_tasks(tasks, workers=2, on_done=lambda task, result: print(task.name, result, flush=True))
"""


@pytest.mark.parametrize("end", [signal.SIGINT, signal.SIGTERM, signal.SIGKILL])
def test_however_it_ends_nothing_is_left_running(tmp_path, end):
    told = tmp_path / "told"
    work = tmp_path / "work"
    work.mkdir()
    with (
        told.open("w") as file,
        subprocess.Popen(
            [sys.executable, "-c", SCRIPT, str(work)], stdout=file, stderr=file, cwd=ROOT
        ) as parent,
    ):
        wait_until(lambda: len([*work.iterdir()]) == 2)
        parent.send_signal(end)
        code = parent.wait(timeout=20)
    pids = [int(pid) for file in work.iterdir() for pid in file.name.split("-")]
    wait_until(lambda: not any(alive(pid) for pid in pids))
    assert len(pids) == 4, "nothing new was begun"
    assert code != 0
    assert "quick {'square': 1" in told.read_text()
    if end == signal.SIGINT:
        assert "stopped: 1 of 5 tasks are done and kept" in told.read_text()
        assert told.read_text().rstrip().endswith("KeyboardInterrupt")


@pytest.mark.parametrize(
    ("tasks", "how", "words"),
    [
        ([], {"workers": 0}, "workers must be at least 1, got 0"),
        ([], {"workers": 2, "scheduler": "tcp://a:1"}, "exclude each other"),
        ([], {"scheduler": " "}, "an address such as tcp://host:8786"),
        ([], {"retries": -1}, "retries must be at least 0, got -1"),
        ([task("a", "square"), task("a", "square")], {}, "unique names, got 'a' more than once"),
        ([Task("a", "square")], {}, "'module:qualname'.*got 'square'"),
        ([Task("a", "__main__:square")], {}, "another process can import"),
        ([Task("a", "no.such.module:f")], {}, "got 'no.such.module:f': No module named 'no'"),
        ([Task("a", f"{HERE}:nothing")], {}, "has no attribute 'nothing'"),
        ([Task("a", f"{HERE}:HERE")], {}, "must be callable"),
    ],
)
def test_bad_input(tasks, how, words):
    with pytest.raises(ValueError, match=words):
        results(tasks, **how)


def test_arguments_must_be_json():
    with pytest.raises(TypeError, match="arguments of task 'a' must be what JSON can hold"):
        results([task("a", "square", x={1, 2})])


@pytest.mark.slow
@pytest.mark.parametrize(
    ("first", "variable", "told"),
    [
        ("import jax", {}, "1"),
        ("import jax; jax.numpy.ones(1)", {}, str(len(os.sched_getaffinity(0)))),
        ("pass", {"PJRT_NPROC": "3"}, "3"),
        ("pass", {"NPROC": "5"}, "5"),
    ],
)
def test_jax_is_told_of_one_thread_only_where_it_can_still_hear(first, variable, told):
    code = f"{first}; from sympol.threads import *; use_one_thread(); print(threads())"
    environment = {name: value for name, value in os.environ.items() if name not in ("PJRT_NPROC", "NPROC")}
    done = subprocess.check_output([sys.executable, "-c", code], env={**environment, **variable}, text=True)
    assert done.strip() == told


def test_nothing_to_do():
    assert results([], workers=2) == {}
