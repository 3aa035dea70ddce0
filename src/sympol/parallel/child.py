"""The other end of `local`: a process that does tasks until its standard input ends.

A line in is ``[function, arguments]``, a line out is what `perform` answered.
"""

from __future__ import annotations

import faulthandler
import json
import os
import queue
import signal
import sys
import threading
from typing import BinaryIO

from .task import perform


def main() -> None:
    """Do tasks, one after the other, keeping JAX and what it compiled between them."""
    faulthandler.enable()  # a crash in a library says where, in the log
    requests, answers = _take_standard_streams()
    waiting: queue.SimpleQueue[bytes | None] = queue.SimpleQueue()
    busy = threading.Event()
    threading.Thread(target=_listen, args=(requests, waiting, busy), daemon=True).start()
    while (line := waiting.get()) is not None:
        answer = perform(*json.loads(line)).encode() + b"\n"
        busy.clear()  # before the answer, which can bring the next request at once
        answers.write(answer)
        answers.flush()


def _take_standard_streams() -> tuple[BinaryIO, BinaryIO]:
    """Keep the two pipes for ourselves.

    A task that reads gets nothing, and what it prints goes where errors go, into the worker's log.
    """
    requests, answers = os.fdopen(os.dup(0), "rb", buffering=0), os.fdopen(os.dup(1), "wb")
    nothing = os.open(os.devnull, os.O_RDONLY)
    os.dup2(nothing, 0)
    os.close(nothing)
    os.dup2(2, 1)
    sys.stdout.reconfigure(line_buffering=True)  # pyright: ignore[reportAttributeAccessIssue]
    return requests, answers


def _listen(requests: BinaryIO, waiting: queue.SimpleQueue[bytes | None], busy: threading.Event) -> None:
    """Pass requests on; where they end in the middle of a task, the parent is gone and so are we.

    That also takes the processes a task has started (they are in our group), whatever ended the parent.
    """
    for line in requests:
        busy.set()
        waiting.put(line)
    if busy.is_set():
        os.killpg(0, signal.SIGKILL)
    waiting.put(None)
