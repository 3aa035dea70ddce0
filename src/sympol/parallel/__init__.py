"""Many tasks, one result: in this process, in several, or on a cluster (docs/guides/cluster.md).

>>> task = Task("seed 1", "sympol.bench.somewhere:train", {"env": "CartPole-v1", "seed": 1})
>>> run_tasks([task], workers=2, on_done=lambda task, result: print(task.name, result))  # doctest: +SKIP
"""

from __future__ import annotations

import os
from collections import Counter
from collections.abc import Callable, Sequence

from .board import Board
from .local import run_here
from .task import Failure, Result, Task, TasksFailed, encode, perform, resolve

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
    """Do all tasks; ``on_done`` gets each result as it comes, in this process and thread.

    Results are the same whichever way they are done. A task whose worker dies is done again; an exception in a task
    is not (it would come again), and does not keep the others from being done. Ctrl-C ends what is at work.

    Args:
        tasks: What to do, in this order as far as there are workers.
        workers: Processes on this machine; 1 does the tasks in this process, one after the other.
        scheduler: The address of a Dask scheduler (``"tcp://host:8786"``), in place of ``workers``.
        retries: How often a task whose worker died is tried again.
        on_done: Called with a task and its result, as JSON gives it back. What it has kept, stays.
        progress: Draw a line on the error stream.

    Raises:
        TasksFailed: some tasks failed; raised after all others are done.
        SchedulerError: no scheduler at the address, or a worker that would give other results.
        ValueError: bad input, before anything is done.
        TypeError: arguments that JSON cannot hold.
        ImportError: ``scheduler`` without the extra ``sympol[cluster]``.
    """
    _check(tasks, workers, scheduler, retries)
    parallel = max(min(workers, len(tasks)), 1)
    with Board(len(tasks), on_done, parallel=parallel, show=progress) as board:
        if scheduler is not None:
            from .dask import run_on_cluster

            run_on_cluster(tasks, scheduler, retries, board)
        elif workers > 1:
            run_here(tasks, workers, retries, board)
        else:
            for task in tasks:
                board.start(task)
                board.answer(task, perform(task.function, encode(task)))
    board.close()


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
        raise ValueError(f"tasks must have names of their own, got {twice[0]!r} more than once")
    for task in tasks:
        encode(task)
    for function in {task.function for task in tasks}:
        resolve(function)
