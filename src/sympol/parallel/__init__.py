"""Run tasks in this process, in several processes, or on a Dask cluster (docs/guides/cluster.md).

>>> task = Task("seed 1", "sympol.bench.somewhere:train", {"env": "CartPole-v1", "seed": 1})
>>> run_tasks([task], workers=2, on_done=lambda task, result: print(task.name, result))  # doctest: +SKIP
"""

from __future__ import annotations

import os
from collections import Counter
from collections.abc import Callable, Sequence

from .processes import run_in_processes
from .progress import Progress
from .task import Failure, Result, Task, TasksFailed, encode, import_function, perform

__all__ = ["Failure", "Result", "Task", "TasksFailed", "run_tasks"]


def run_tasks(
    tasks: Sequence[Task],
    *,
    workers: int = 1,
    scheduler: str | None = None,
    retries: int = 2,
    on_done: Callable[[Task, Result], None],
    progress: bool = True,
) -> None:
    """Run all tasks and pass each result to ``on_done`` as soon as it is there.

    Results do not depend on where tasks run. A task whose worker dies is tried again. A task that raises an exception
    is not, because it would raise it again; the other tasks still run. Ctrl-C ends the tasks at work.

    Args:
        tasks: The tasks, started in this order.
        workers: Processes on this machine. With 1, tasks run in this process, one after another.
        scheduler: The address of a Dask scheduler (``"tcp://host:8786"``), in place of ``workers``.
        retries: How often a task whose worker died is tried again.
        on_done: Called in this process and thread with a task and its result, as JSON gives it back.
        progress: Whether to draw a line of progress on the error stream.

    Raises:
        TasksFailed: Some tasks failed; raised after all others are done.
        SchedulerError: There is no scheduler at the address, or a worker would compute other results.
        ValueError: An argument is invalid; raised before any task starts.
        TypeError: A task has arguments that JSON cannot hold.
        ImportError: ``scheduler`` is given without the extra ``sympol[cluster]``.
    """
    _check(tasks, workers, scheduler, retries)
    parallel = max(min(workers, len(tasks)), 1)
    with Progress(len(tasks), on_done, parallel=parallel, show=progress) as shown:
        if scheduler is not None:
            from .dask import run_on_cluster

            run_on_cluster(tasks, scheduler, retries, shown)
        elif workers > 1:
            run_in_processes(tasks, workers, retries, shown)
        else:
            for task in tasks:
                shown.start(task)
                shown.finish(task, perform(task.function, encode(task)))
    shown.raise_failures()


def _check(tasks: Sequence[Task], workers: int, scheduler: str | None, retries: int) -> None:
    if workers < 1:
        raise ValueError(f"workers must be at least 1, got {workers}; 1 works in this process")
    if workers > 1 and scheduler is not None:
        raise ValueError(
            f"workers={workers} and scheduler={scheduler!r} exclude each other: a cluster's workers are started "
            f"beside it (dask worker {scheduler}); leave one of them out"
        )
    if workers > 1 and not hasattr(os, "killpg"):
        raise ValueError(f"workers={workers} needs Linux or macOS; leave it out, or use a scheduler")
    if scheduler is not None and not scheduler.strip():
        raise ValueError("scheduler must be an address such as tcp://host:8786, got an empty one")
    if retries < 0:
        raise ValueError(f"retries must be at least 0, got {retries}")
    twice = [name for name, count in Counter(task.name for task in tasks).items() if count > 1]
    if twice:
        raise ValueError(f"tasks must have unique names, got {twice[0]!r} more than once")
    for task in tasks:
        encode(task)
    for function in {task.function for task in tasks}:
        import_function(function)
