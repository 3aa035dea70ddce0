"""A Dask scheduler and its workers, as `docs/guides/cluster.md` starts them, on loopback."""

from __future__ import annotations

import json
import os
import signal
import subprocess
import sys
import time
from pathlib import Path
from typing import Any

ROOT = Path(__file__).parents[2]


class Cluster:
    def __init__(self, folder: Path, *, allowed_failures: int = 3) -> None:
        self._folder = folder
        self._file = folder / "scheduler.json"
        self._allowed_failures = allowed_failures
        self._processes: list[subprocess.Popen] = []
        self.scheduler = self._start("scheduler", "--scheduler-file", self._file, "--port", "0", "--no-show")
        self.address = ""

    def __enter__(self) -> Cluster:
        self._wait_until(lambda: self._identity() is not None, "the scheduler")
        self.address = self._identity()["address"]
        return self

    def __exit__(self, *_: object) -> None:
        for process in self._processes:
            process.kill()
        for process in self._processes:
            process.wait()

    @property
    def workers(self) -> list[subprocess.Popen]:
        """All that were ever started."""
        return self._processes[1:]

    def hire(self, number: int = 1) -> None:
        """Start workers and wait for them."""
        from distributed import Client

        for _ in range(number):
            self.start_worker()
        with Client(self.address, set_as_default=False) as client:
            alive = sum(process.poll() is None for process in self.workers)
            client.wait_for_workers(alive, timeout=60)

    def start_worker(self) -> subprocess.Popen:
        """A process of one thread, which joins in a second or two."""
        command = ("worker", self.address, "--nthreads", "1", "--no-nanny", "--no-dashboard")
        return self._start(*command, "--name", f"worker{len(self._processes)}")

    def _start(self, role: str, *words: Any) -> subprocess.Popen:
        environment = {
            **os.environ,
            "PYTHONPATH": f"{ROOT}{os.pathsep}{ROOT / 'src'}",  # for the tests' own tasks, and this checkout
            "DASK_DISTRIBUTED__SCHEDULER__ALLOWED_FAILURES": str(self._allowed_failures),
        }
        with (self._folder / f"{role}{len(self._processes)}.log").open("w") as log:
            process = subprocess.Popen(
                [Path(sys.executable).with_name("dask"), role, "--host", "127.0.0.1", *words],
                stdout=log,
                stderr=log,
                env=environment,
                cwd=self._folder,
            )
        self._processes.append(process)
        return process

    def _identity(self) -> Any:
        try:
            return json.loads(self._file.read_text())
        except (FileNotFoundError, json.JSONDecodeError):
            return None

    def _wait_until(self, true, what: str) -> None:
        end = time.monotonic() + 60
        while not true():
            logs = "\n".join(file.read_text() for file in self._folder.glob("*.log"))
            assert time.monotonic() < end, f"{what} did not start: {logs}"
            assert all(process.poll() is None for process in self._processes), logs
            time.sleep(0.05)


def kill(process: subprocess.Popen) -> None:
    process.send_signal(signal.SIGKILL)
    process.wait()
