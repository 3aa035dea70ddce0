"""Tasks in processes of this machine: long-lived, so that JAX and what it compiled serve many tasks.

They have this process's environment and cores. To give each fewer threads, or a core of its own, would give other
results than this process does (`threads`).
"""

from __future__ import annotations

import contextlib
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

from .board import Board
from .task import Task, encode

_START = (
    "import json, sys; sys.path[:] = json.loads(sys.argv.pop()); "
    "from sympol.parallel.child import main; main()"
)
_TAIL = 4000
"""So many bytes of what a dead worker wrote are shown."""


def run_here(tasks: Sequence[Task], workers: int, retries: int, board: Board) -> None:
    """Do the tasks in ``workers`` processes; a task whose process dies is done again by a fresh one."""
    waiting = deque(tasks)
    deaths = {task.name: 0 for task in tasks}
    events: queue.SimpleQueue[tuple[_Worker, str | None]] = queue.SimpleQueue()
    running: dict[_Worker, Task] = {}
    everyone: list[_Worker] = []

    def give(worker: _Worker) -> None:
        if waiting:
            running[worker] = task = waiting.popleft()
            board.start(task)
            worker.give(task)
        else:
            worker.dismiss()

    def hire() -> _Worker:
        everyone.append(_Worker(events))
        return everyone[-1]

    try:
        for _ in range(min(workers, len(tasks))):
            give(hire())
        while running:
            worker, answer = events.get()
            task = running.pop(worker, None)
            if task is None:  # dismissed, and now it has gone
                continue
            if answer is not None:
                board.answer(task, answer)
                give(worker)
                continue
            deaths[task.name] += 1
            if deaths[task.name] > retries:
                board.fail(task, _given_up(worker.end(), deaths[task.name]), worker.last_words())
            else:
                board.retry(task, worker.end())
                waiting.appendleft(task)
            if waiting:
                give(hire())
    finally:
        for worker in everyone:
            worker.close(at_once=worker in running)


def _given_up(end: str, deaths: int) -> str:
    return end if deaths == 1 else f"{end}, and so {deaths} times"


class _Worker:
    """A process that does tasks, its two pipes, and what it wrote."""

    def __init__(self, events: queue.SimpleQueue[tuple[_Worker, str | None]]) -> None:
        self._log = tempfile.TemporaryFile()  # noqa: SIM115, it lives as long as the process
        self._process = subprocess.Popen(
            [sys.executable, "-c", _START, json.dumps(sys.path)],
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            stderr=self._log,
            start_new_session=True,  # Ctrl-C is for us to pass on, and what a task starts can be ended with it
        )
        self._begun = 0
        self._undertaker = threading.Thread(target=self._bury, daemon=True)
        self._undertaker.start()
        threading.Thread(target=self._listen, args=(events,), daemon=True).start()

    def give(self, task: Task) -> None:
        """Have a task done; the answer comes as an event."""
        assert self._process.stdin is not None
        self._begun = os.fstat(self._log.fileno()).st_size
        line = json.dumps([task.function, encode(task)]).encode() + b"\n"
        with contextlib.suppress(BrokenPipeError):  # it has just died: that comes as an event as well
            self._process.stdin.write(line)
            self._process.stdin.flush()

    def dismiss(self) -> None:
        """There is nothing left to do for it."""
        assert self._process.stdin is not None
        with contextlib.suppress(BrokenPipeError):
            self._process.stdin.close()

    def close(self, *, at_once: bool) -> None:
        """End the process and everything it has started."""
        self.dismiss()
        self._undertaker.join(timeout=0 if at_once else 5)
        if self._undertaker.is_alive():
            self._kill_group()
            self._undertaker.join()
        self._log.close()

    def end(self) -> str:
        """How it died."""
        code = self._process.returncode
        if code >= 0:
            return f"its worker process ended with exit code {code}"
        name = signal.Signals(-code).name if -code in [*signal.Signals] else f"signal {-code}"
        hint = " (out of memory?)" if name == "SIGKILL" else ""
        return f"its worker process was ended by {name}{hint}, exit code {code}"

    def last_words(self) -> str:
        """The end of what it wrote since its last task began."""
        size = os.fstat(self._log.fileno()).st_size
        start = max(self._begun, size - _TAIL)
        return os.pread(self._log.fileno(), size - start, start).decode(errors="replace")

    def _listen(self, events: queue.SimpleQueue[tuple[_Worker, str | None]]) -> None:
        assert self._process.stdout is not None
        with self._process.stdout as answers:
            for line in answers:
                if line.endswith(b"\n"):  # else it died writing
                    events.put((self, line.decode()))
        self._undertaker.join()
        events.put((self, None))

    def _bury(self) -> None:
        """Once it is dead, end what it had started, which may still hold its end of the pipe."""
        if hasattr(os, "waitid"):  # dead but not reaped: the number is surely still its own
            os.waitid(os.P_PID, self._process.pid, os.WEXITED | os.WNOWAIT)
        else:
            self._process.wait()
        self._kill_group()
        self._process.wait()

    def _kill_group(self) -> None:
        with contextlib.suppress(ProcessLookupError, PermissionError):
            os.killpg(self._process.pid, signal.SIGKILL)
