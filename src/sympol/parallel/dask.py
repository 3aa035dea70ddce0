"""Run tasks on a Dask cluster, after comparing the versions of every worker with those of this process."""

from __future__ import annotations

import contextlib
import json
import logging
import uuid
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any

from ..provenance import environment_fingerprint, training_versions
from .progress import Progress
from .task import Task, encode, perform

if TYPE_CHECKING:
    from distributed import Client, Future

_TIMEOUT = 10
"""Seconds for a scheduler to answer."""
_LABELS = {"code": "sympol's code", "threads": "JAX threads:"}
_SAME = "install the same on both (from a checkout, the same commit) and start the worker again"


class SchedulerError(ConnectionError):
    """The cluster cannot be used: nobody answers, or a worker would compute other results."""


@dataclass(frozen=True)
class _Cluster:
    client: Client
    address: str
    ours: dict[str, str]
    """The versions that a worker must have to compute our results."""
    topic: str = field(default_factory=lambda: f"sympol-{uuid.uuid4().hex[:8]}")
    """Workers report the tasks that they begin under this topic."""

    def submit(self, task: Task) -> Future:
        return self.client.submit(
            _perform_there,
            self.topic,
            task.name,
            task.function,
            encode(task),
            self.ours,
            key=f"{task.name}-{uuid.uuid4().hex}",
            pure=False,
        )


def run_on_cluster(tasks: Sequence[Task], address: str, retries: int, progress: Progress) -> None:
    """Run tasks on the workers of a Dask scheduler.

    A task whose worker was lost runs again, first by the scheduler's decision (``allowed-failures``, 3 unless set),
    then by ours, until more than ``retries`` workers were lost with it.

    Args:
        tasks: The tasks.
        address: The scheduler's address.
        retries: How often a task whose workers were lost is submitted again.
        progress: Gets every start, result and failure.

    Raises:
        SchedulerError: Nobody answers at the address, the scheduler went away, or a worker has other versions.
        ImportError: Dask distributed is not installed.
    """
    with _connect(address) as client:
        _compare_versions(client, address, progress)
        cluster = _Cluster(client, address, environment_fingerprint())
        client.subscribe_topic(cluster.topic, _starts(tasks, progress))
        futures = {cluster.submit(task): task for task in tasks}
        try:
            _collect(cluster, futures, retries, progress)
        except BaseException:
            with contextlib.suppress(Exception):  # the scheduler may be what went away
                client.cancel([*futures], force=True)
            raise


def _collect(cluster: _Cluster, futures: dict[Future, Task], retries: int, progress: Progress) -> None:
    from distributed import as_completed
    from distributed.scheduler import KilledWorker

    lost = dict.fromkeys((task.name for task in futures.values()), 0)
    completed = as_completed([*futures], loop=cluster.client.loop)
    for future in completed:
        if future.status in ("lost", "pending"):
            completed.add(future)  # its worker died with the result, so the scheduler runs it again
            continue
        task = futures.pop(future)
        if future.status == "finished":
            threads: Any = cluster.client.nthreads()
            progress.parallel = max(sum(threads.values()), 1)
            progress.finish(task, _checked(future.result(), cluster.ours))
            continue
        if future.status == "cancelled":
            raise SchedulerError(
                f"the scheduler at {cluster.address} went away, or was told to cancel {task.name!r}; "
                f"{progress.done} of {progress.total} tasks are done and kept: start it again (dask scheduler) and "
                "run the same command to resume"
            )
        error = future.exception()
        if not isinstance(
            error, KilledWorker
        ):  # `perform` catches what a task raises: this is Dask's own failure
            progress.fail(task, f"{type(error).__name__}: {error}")
            continue
        lost[task.name] += error.allowed_failures + 1
        reason = f"{lost[task.name]} workers were lost with it, {error.last_worker.address} the last"
        if lost[task.name] > retries:
            progress.fail(task, reason, "What the worker wrote to its own terminal or log says why.")
            continue
        progress.retry(task, reason)
        again = cluster.submit(task)
        futures[again] = task
        completed.add(again)


@contextlib.contextmanager
def _connect(address: str) -> Iterator[Client]:
    try:
        from distributed import Client
    except ImportError as error:
        raise ImportError(
            f"a scheduler needs Dask distributed ({error}): pip install 'sympol[cluster]'"
        ) from None
    logger = logging.getLogger("distributed")  # it prints lost connections over our line
    level = logger.level
    logger.setLevel(logging.CRITICAL)
    try:
        try:
            client = Client(address, timeout=_TIMEOUT, set_as_default=False, name="sympol")
        except (OSError, ValueError, TypeError) as error:
            raise SchedulerError(
                f"no Dask scheduler answers at {address!r} within {_TIMEOUT} s ({error}); start one with "
                "'dask scheduler', which prints the address to give, and see that no firewall is between"
            ) from None
        with client:
            yield client
    finally:
        logger.setLevel(level)


def _compare_versions(client: Client, address: str, progress: Progress) -> None:
    """Refuse workers whose results could differ. Those that join later are checked with their first task."""
    ours = training_versions()
    packages = [name for name in ours if name != "python"]  # which is reported in any case
    reported: Any = client.get_versions(packages=packages)
    for worker, there in sorted(reported["workers"].items()):
        theirs = {name: there["packages"].get(name) or "none" for name in ours}
        theirs["python"] = ".".join(theirs["python"].split(".")[:2])
        _refuse_difference(worker, theirs, ours)
    if not reported["workers"]:
        progress.print(f"no workers at {address} yet, waiting for the first: dask worker {address}")


def _refuse_difference(worker: str, theirs: dict[str, str], ours: dict[str, str]) -> None:
    for name, here in ours.items():
        if theirs.get(name) != here:
            remedy = f"start it with PJRT_NPROC={here}" if name == "threads" else _SAME
            raise SchedulerError(
                f"worker {worker} has {_LABELS.get(name, name)} {theirs.get(name)}, this process has {here}: their "
                f"results could differ; {remedy}"
            )


def _perform_there(topic: str, name: str, function: str, arguments: str, expected: dict[str, str]) -> str:
    """Run a task on the worker, unless its versions are not the expected ones."""
    from distributed import get_worker

    worker = get_worker()
    here = environment_fingerprint()
    if here != expected:
        return json.dumps({"refused": worker.address, "environment": here})
    worker.log_event(topic, name)
    return perform(function, arguments)


def _checked(answer: str, ours: dict[str, str]) -> str:
    if answer.startswith('{"refused"'):
        content = json.loads(answer)
        _refuse_difference(content["refused"], content["environment"], ours)
    return answer


def _starts(tasks: Sequence[Task], progress: Progress) -> Any:
    by_name = {task.name: task for task in tasks}

    def started(event: Any) -> None:
        _, name = event
        progress.start(by_name[name])

    return started
