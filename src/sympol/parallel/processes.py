"""Run tasks in processes of this machine, which live long enough for JAX and its compiled programs to serve many tasks.

A worker reads lines ``[function, arguments]`` and writes a line for each, the answer of `perform`. It has the parent's
environment and cores: with fewer threads, or a core of its own, it would compute other results (`threads`).
docs/design/libraries.md says why this is not `concurrent.futures` or loky.
"""

from __future__ import annotations

import contextlib
import faulthandler
import json
import os
import queue
import signal
import subprocess
import sys
import tempfile
import threading
from collections import deque
from collections.abc import Sequence
from typing import BinaryIO

from .progress import Progress
from .task import Task, encode, perform

_START = (
    "import json, sys; sys.path[:] = json.loads(sys.argv.pop()); "
    "from sympol.parallel.processes import work; work()"
)
_TAIL = 4000
"""The number of bytes of a dead worker's error stream that are shown."""


def run_in_processes(tasks: Sequence[Task], workers: int, retries: int, progress: Progress) -> None:
    """Run tasks in worker processes; a task whose process dies is run again by a fresh one.

    Args:
        tasks: The tasks, started in this order.
        workers: The number of processes.
        retries: How often a task whose process died is tried again.
        progress: Gets every start, result and failure.
    """
    waiting = deque(tasks)
    deaths = {task.name: 0 for task in tasks}
    events: queue.SimpleQueue[tuple[_Worker, str | None]] = queue.SimpleQueue()
    running: dict[_Worker, Task] = {}
    spawned: list[_Worker] = []

    def submit(worker: _Worker) -> None:
        if waiting:
            running[worker] = task = waiting.popleft()
            progress.start(task)
            worker.submit(task)
        else:
            worker.close_input()

    def spawn() -> _Worker:
        spawned.append(_Worker(events))
        return spawned[-1]

    try:
        for _ in range(min(workers, len(tasks))):
            submit(spawn())
        while running:
            worker, answer = events.get()
            task = running.pop(worker, None)
            if task is None:  # it had no task left and has ended
                continue
            if answer is not None:
                progress.finish(task, answer)
                submit(worker)
                continue
            deaths[task.name] += 1
            if deaths[task.name] > retries:
                times = f", and so {deaths[task.name]} times" if deaths[task.name] > 1 else ""
                progress.fail(task, worker.exit_reason() + times, worker.stderr_tail())
            else:
                progress.retry(task, worker.exit_reason())
                waiting.appendleft(task)
            if waiting:
                submit(spawn())
    finally:
        for worker in spawned:
            worker.close(at_once=worker in running)


class _Worker:
    """A worker process, its two pipes and its error stream. Each answer is an event; None says that it has ended."""

    def __init__(self, events: queue.SimpleQueue[tuple[_Worker, str | None]]) -> None:
        self._stderr = tempfile.TemporaryFile()  # noqa: SIM115, it lives as long as the process
        self._process = subprocess.Popen(
            [sys.executable, "-c", _START, json.dumps(sys.path)],
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            stderr=self._stderr,
            start_new_session=True,  # Ctrl-C is ours to pass on, and a task's own children can be ended with it
        )
        self._task_start = 0
        self._reaper = threading.Thread(target=self._reap, daemon=True)
        self._reaper.start()
        threading.Thread(target=self._read_answers, args=(events,), daemon=True).start()

    def submit(self, task: Task) -> None:
        """Send a task; its answer comes as an event."""
        assert self._process.stdin is not None
        self._task_start = os.fstat(self._stderr.fileno()).st_size
        line = json.dumps([task.function, encode(task)]).encode() + b"\n"
        with contextlib.suppress(BrokenPipeError):  # it has just died, which comes as an event, too
            self._process.stdin.write(line)
            self._process.stdin.flush()

    def close_input(self) -> None:
        """Let the process end after its current task."""
        assert self._process.stdin is not None
        with contextlib.suppress(BrokenPipeError):
            self._process.stdin.close()

    def close(self, *, at_once: bool) -> None:
        """End the process and everything it has started."""
        self.close_input()
        self._reaper.join(timeout=0 if at_once else 5)
        if self._reaper.is_alive():
            self._kill_group()
            self._reaper.join()
        self._stderr.close()

    def exit_reason(self) -> str:
        """Return how the process ended, for a message."""
        code = self._process.returncode
        if code >= 0:
            return f"its worker process ended with exit code {code}"
        name = signal.Signals(-code).name if -code in [*signal.Signals] else f"signal {-code}"
        hint = " (out of memory?)" if name == "SIGKILL" else ""
        return f"its worker process was ended by {name}{hint}, exit code {code}"

    def stderr_tail(self) -> str:
        """Return the end of what the process wrote since its last task began."""
        size = os.fstat(self._stderr.fileno()).st_size
        start = max(self._task_start, size - _TAIL)
        return os.pread(self._stderr.fileno(), size - start, start).decode(errors="replace")

    def _read_answers(self, events: queue.SimpleQueue[tuple[_Worker, str | None]]) -> None:
        assert self._process.stdout is not None
        with self._process.stdout as answers:
            for line in answers:
                if line.endswith(b"\n"):  # otherwise it died while writing
                    events.put((self, line.decode()))
        self._reaper.join()
        events.put((self, None))

    def _reap(self) -> None:
        """Wait for the process to end, then end what it has started, which may still hold its end of the pipe."""
        if hasattr(os, "waitid"):  # ended but not reaped, so the process number cannot be another's yet
            os.waitid(os.P_PID, self._process.pid, os.WEXITED | os.WNOWAIT)
        else:
            self._process.wait()
        self._kill_group()
        self._process.wait()

    def _kill_group(self) -> None:
        with contextlib.suppress(ProcessLookupError, PermissionError):
            os.killpg(self._process.pid, signal.SIGKILL)


def work() -> None:
    """Perform tasks from standard input, one after another, until it ends. This is what a worker process runs."""
    faulthandler.enable()  # a crash in a library writes where it happened to the error stream
    requests, answers = _take_standard_streams()
    waiting: queue.SimpleQueue[bytes | None] = queue.SimpleQueue()
    busy = threading.Event()
    threading.Thread(target=_read_requests, args=(requests, waiting, busy), daemon=True).start()
    while (line := waiting.get()) is not None:
        answer = perform(*json.loads(line)).encode() + b"\n"
        busy.clear()  # before the answer, which can bring the next request immediately
        answers.write(answer)
        answers.flush()


def _take_standard_streams() -> tuple[BinaryIO, BinaryIO]:
    """Keep both pipes for the protocol: tasks read nothing, and what they print goes to the error stream."""
    requests, answers = os.fdopen(os.dup(0), "rb", buffering=0), os.fdopen(os.dup(1), "wb")
    nothing = os.open(os.devnull, os.O_RDONLY)
    os.dup2(nothing, 0)
    os.close(nothing)
    os.dup2(2, 1)
    sys.stdout.reconfigure(line_buffering=True)  # pyright: ignore[reportAttributeAccessIssue]
    return requests, answers


def _read_requests(
    requests: BinaryIO, waiting: queue.SimpleQueue[bytes | None], busy: threading.Event
) -> None:
    """Pass requests on. If they end during a task, the parent is gone: end this process and all that it started."""
    for line in requests:
        busy.set()
        waiting.put(line)
    if busy.is_set():
        os.killpg(0, signal.SIGKILL)
    waiting.put(None)
