"""Processes that step the copies of an environment side by side.

Each of N workers steps its share of the copies, one after the other; observations, rewards and actions lie in memory
that all map, and a step is one short message to each worker and one back. A worker is a new Python process, neither
forked (threads of JAX may hold locks) nor started by `multiprocessing` (which would run the user's script again).
docs/design/environments.md says why this is not Gymnasium's ``AsyncVectorEnv``.
"""

from __future__ import annotations

import contextlib
import json
import os
import pickle
import signal
import subprocess
import sys
import tempfile
from collections.abc import Callable
from pathlib import Path

import gymnasium

from .copy_group import Buffers
from .errors import EnvironmentFailure
from .spaces import Features
from .worker_process import STEP, mapped, receive, send

_START = (
    "import json, sys; sys.path[:] = json.loads(sys.argv.pop()); "
    "from sympol.envs.worker_process import work; work()"
)
_PATIENCE = 5.0
"""Seconds that a worker has to close its environments, before it is ended."""


class WorkerPool:
    """Worker processes, which serve several groups of copies: those that are trained and those that are validated on.

    Args:
        workers: The number of processes.
    """

    def __init__(self, workers: int) -> None:
        self.workers = [_Worker(index, workers) for index in range(workers)]
        self.num_groups = 0

    def close(self) -> None:
        """End the processes."""
        for worker in self.workers:
            worker.close_input()
        for worker in self.workers:
            worker.end()


class WorkerGroup:
    """Copies of an environment that are divided among workers; the interface is that of `CopyGroup`.

    Args:
        make: A function that makes a copy.
        num_envs: The number of copies.
        features: The description of the observation space.
        action_space: The action space.
        pool: The processes.

    Raises:
        EnvironmentFailure: A copy cannot be made.
        ValueError: The function cannot be sent to another process, or returns the same object each time.
    """

    def __init__(
        self,
        make: Callable[[], gymnasium.Env],
        num_envs: int,
        features: Features,
        action_space: gymnasium.Space,
        pool: WorkerPool,
    ) -> None:
        self.envs: list[gymnasium.Env] = []
        self._number, pool.num_groups = pool.num_groups, pool.num_groups + 1
        layout = Buffers.layout(num_envs, features, action_space)
        pickled = _pickled(make)
        bounds = [num_envs * i // len(pool.workers) for i in range(len(pool.workers) + 1)]
        shares = zip(pool.workers, bounds, bounds[1:], strict=False)
        self._shares = [(worker, begin, end) for worker, begin, end in shares if begin < end]
        folder = "/dev/shm" if os.access("/dev/shm", os.W_OK) else None
        handle, path = tempfile.mkstemp(prefix="sympol-", dir=folder)
        os.close(handle)
        try:
            self.buffers = mapped(path, layout, "w+")
            self._ask(
                lambda begin, end: pickle.dumps(
                    ("open", self._number, pickled, path, layout, begin, end, features)
                )
            )
        except BaseException:
            self.close()
            raise
        finally:
            Path(path).unlink()  # the memory remains for those that have mapped it

    def reset(self, seed: int, num_episodes: int | None = None) -> None:
        """See `CopyGroup.reset`."""
        request = pickle.dumps(("reset", self._number, seed, num_episodes))
        self._ask(lambda begin, end: request)

    def step(self, max_steps: int | None = None) -> None:
        """See `CopyGroup.step`; workers of which no copy is wanted are not asked."""
        request = STEP.pack(b"s", self._number, -1 if max_steps is None else max_steps)
        wanted = self.buffers.wanted
        if not wanted.all():
            for array in (self.buffers.reward, self.buffers.terminated, self.buffers.truncated):
                array.fill(0)
        self._ask(lambda begin, end: request if wanted[begin:end].any() else None)

    def close(self) -> None:
        """Close the copies; the processes remain."""
        request = pickle.dumps(("close", self._number))
        with contextlib.suppress(Exception):  # a worker that has ended, or never opened the group
            self._ask(lambda begin, end: request)
        self._shares = []

    def _ask(self, request_of: Callable[[int, int], bytes | None]) -> None:
        """Send a request to each worker and wait for all answers; the first error is raised."""
        asked = []
        for worker, begin, end in self._shares:
            request = request_of(begin, end)
            if request is not None:
                worker.send(request)
                asked.append((worker, begin, end))
        errors = []
        for worker, begin, end in asked:
            answer = worker.receive()
            if answer is None:
                copies = f"environment {begin}" if end == begin + 1 else f"environments {begin} to {end - 1}"
                errors.append(EnvironmentFailure(f"{worker.name}, which steps {copies}, {worker.fate()}"))
            elif answer:
                errors.append(pickle.loads(answer))
        if errors:
            raise errors[0]


class _Worker:
    """A worker process and its two pipes."""

    def __init__(self, index: int, number: int) -> None:
        self.name = f"worker {index + 1} of {number}"
        self._process = subprocess.Popen(
            [sys.executable, "-c", _START, json.dumps(sys.path)],
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            start_new_session=True,  # Ctrl-C ends the training, which closes its workers
        )

    @property
    def pid(self) -> int:
        """The number of the process."""
        return self._process.pid

    def send(self, request: bytes) -> None:
        """Send a request, which only a worker that still runs receives."""
        assert self._process.stdin is not None
        with contextlib.suppress(BrokenPipeError):
            send(self._process.stdin, request)  # pyright: ignore[reportArgumentType]

    def receive(self) -> bytes | None:
        """Wait for an answer: nothing, a pickled error, or None where the process has ended."""
        assert self._process.stdout is not None
        return receive(self._process.stdout)  # pyright: ignore[reportArgumentType]

    def fate(self) -> str:
        """Say how the process ended."""
        try:
            code = self._process.wait(_PATIENCE)
        except subprocess.TimeoutExpired:
            return "closed its pipe"
        if code >= 0:
            return f"ended with exit code {code}"
        name = signal.Signals(-code).name if -code in [*signal.Signals] else f"signal {-code}"
        return f"was ended by {name}{' (out of memory?)' if name == 'SIGKILL' else ''}"

    def close_input(self) -> None:
        """Let the process end after what it is doing."""
        assert self._process.stdin is not None
        with contextlib.suppress(BrokenPipeError):
            self._process.stdin.close()

    def end(self) -> None:
        """Wait for the process to end, and end it if it does not."""
        try:
            self._process.wait(_PATIENCE)
        except subprocess.TimeoutExpired:
            self._process.kill()
            self._process.wait()
        if self._process.stdout is not None:
            self._process.stdout.close()


def _pickled(make: Callable[[], gymnasium.Env]) -> bytes:
    """Return a function, and what has been registered with Gymnasium, as bytes.

    Raises:
        ValueError: The function cannot be sent.
    """
    import cloudpickle

    registered = []
    for spec in gymnasium.registry.values():
        if not (isinstance(spec.entry_point, str) and spec.entry_point.startswith("gymnasium.")):
            with contextlib.suppress(Exception):
                cloudpickle.dumps(spec)
                registered.append(spec)
    try:
        return cloudpickle.dumps((registered, make))
    except Exception as error:
        raise ValueError(
            "env_workers must be 0, or the function that makes the environment must be one that can be sent to a "
            "worker process: let it make everything itself, in place of holding an object that stays in this process, "
            f"or put it into a module ({type(error).__name__}: {error})"
        ) from error
