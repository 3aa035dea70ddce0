"""The process that steps environments for a training in another one.

It reads requests from standard input and answers on standard output, each preceded by its length. Numbers travel
through memory that both map. This module imports no JAX: it would cost each worker seconds and hundreds of megabytes.
"""

from __future__ import annotations

import faulthandler
import os
import pickle
import struct
import sys
import threading
import time
from pathlib import Path
from typing import Any, BinaryIO

import numpy as np

from .copy_group import Buffers, CopyGroup
from .errors import EnvironmentFailure

LENGTH = struct.Struct("<I")
STEP = struct.Struct("<cBq")
"""A request for a step: ``b"s"``, the number of the group, and the most steps of an episode, or -1."""


def send(pipe: BinaryIO, message: bytes) -> None:
    """Write a message and its length.

    Args:
        pipe: Where to.
        message: The message.
    """
    pipe.write(LENGTH.pack(len(message)) + message)
    pipe.flush()


def receive(pipe: BinaryIO) -> bytes | None:
    """Read a message.

    Args:
        pipe: Where from.

    Returns:
        The message, or None where the other side has ended.
    """
    head = pipe.read(LENGTH.size)
    if len(head) < LENGTH.size:
        return None
    (length,) = LENGTH.unpack(head)
    message = pipe.read(length)
    return message if len(message) == length else None


def mapped(path: str, layout: dict[str, tuple[Any, Any]], mode: Any) -> Buffers:
    """Map the arrays of a group of copies into memory.

    Args:
        path: The file that holds them, one after the other.
        layout: Their shapes and types, as `Buffers.layout` returns them.
        mode: ``"w+"`` to make the file, ``"r+"`` to share it.

    Returns:
        The arrays.
    """
    offsets, size = {}, 0
    for name, (shape, dtype) in layout.items():
        offsets[name] = size
        size += -(-int(np.prod(shape)) * dtype.itemsize // 64) * 64
    if mode == "w+":
        Path(path).write_bytes(bytes(size))
    memory = np.memmap(path, np.uint8, "r+")
    arrays = {}
    for name, (shape, dtype) in layout.items():
        raw = memory[offsets[name] : offsets[name] + int(np.prod(shape)) * dtype.itemsize]
        arrays[name] = np.ndarray.view(raw, np.ndarray).view(dtype).reshape(shape)
    return Buffers(**arrays)


def work() -> None:
    """Serve requests until there are no more."""
    faulthandler.enable()  # a crash in a library writes where it happened to the error stream
    threading.Thread(target=_end_with, args=(os.getppid(),), daemon=True).start()
    requests, answers = _take_standard_streams()
    groups: dict[int, CopyGroup] = {}
    while (request := receive(requests)) is not None:
        try:
            if request[:1] == b"s":
                _, number, max_steps = STEP.unpack(request)
                groups[number].step(None if max_steps < 0 else max_steps)
            else:
                _serve(groups, *pickle.loads(request))
            answer = b""
        except Exception as error:
            answer = _pickled(error)
        send(answers, answer)
    for group in groups.values():
        group.close()


def _serve(groups: dict[int, CopyGroup], what: str, number: int, *arguments: Any) -> None:
    if what == "open":
        groups[number] = _open(*arguments)
    elif what == "reset":
        groups[number].reset(*arguments)
    else:
        groups.pop(number).close()


def _open(pickled: bytes, path: str, layout: Any, begin: int, end: int, features: Any) -> CopyGroup:
    import gymnasium

    try:
        registered, make = pickle.loads(pickled)
    except Exception as error:
        raise EnvironmentFailure(
            "env_workers must be 0, or the function that makes the environment must come from a module that a worker "
            f"process can import; this one fails there: {type(error).__name__}: {error}"
        ) from error
    for spec in registered:
        gymnasium.registry.setdefault(spec.id, spec)
    buffers = mapped(path, layout, "r+")
    return CopyGroup(make, begin, len(buffers.reward), features, buffers.rows(begin, end))


def _pickled(error: Exception) -> bytes:
    """Return an error as bytes, by its text where it is of a kind that cannot be pickled."""
    try:
        answer = pickle.dumps(error)
        pickle.loads(answer)
        return answer
    except Exception:
        return pickle.dumps(EnvironmentFailure(f"{type(error).__name__}: {error}"))


def _take_standard_streams() -> tuple[BinaryIO, BinaryIO]:
    """Keep both pipes for requests and answers: what an environment prints goes to the error stream."""
    requests, answers = os.fdopen(os.dup(0), "rb"), os.fdopen(os.dup(1), "wb")
    nothing = os.open(os.devnull, os.O_RDONLY)
    os.dup2(nothing, 0)
    os.close(nothing)
    os.dup2(2, 1)
    sys.stdout.reconfigure(line_buffering=True)  # pyright: ignore[reportAttributeAccessIssue]
    return requests, answers


def _end_with(parent: int) -> None:
    """End this process when the one that started it has ended, even in the middle of a step."""
    while os.getppid() == parent:
        time.sleep(1)
    os._exit(1)
