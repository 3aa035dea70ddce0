"""Tasks, and how they run: by the same few lines in this process, in another one and on another machine."""

from __future__ import annotations

import functools
import importlib
import json
import traceback
from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Any

Result = Any
"""What a task returns: anything JSON can hold."""


@dataclass(frozen=True)
class Task:
    """One piece of work, described so that any process on any machine can do it.

    Args:
        name: The name in progress and errors, unique within a call of `run_tasks`.
        function: ``"module:qualname"``, importable wherever tasks are done.
        arguments: The keyword arguments, as JSON can hold them. An interrupted task is started again with the same
            ones, so the function itself must find what it has already done.
    """

    name: str
    function: str
    arguments: dict[str, Any] = field(default_factory=dict)


@dataclass(frozen=True)
class Failure:
    """A task that was given up."""

    task: Task
    reason: str
    """One line."""
    details: str
    """The traceback, or the end of what the worker wrote before it died."""


class TasksFailed(RuntimeError):
    """Some tasks failed; raised when all others are done.

    Args:
        failures: Which tasks failed, and why.
        total: The number of tasks.
    """

    def __init__(self, failures: list[Failure], total: int) -> None:
        self.failures = failures
        words = "; ".join(f"{failure.task.name}: {failure.reason}" for failure in failures)
        super().__init__(
            f"{len(failures)} of {total} tasks failed, the others are done and kept; "
            f"the same command again does only the failed ones: {words}"
        )


def encode(task: Task) -> str:
    """Return a task's arguments as JSON, which is what a task gets wherever it runs.

    Args:
        task: The task.

    Returns:
        JSON.

    Raises:
        TypeError: JSON cannot hold an argument.
    """
    try:
        return json.dumps(task.arguments)
    except (TypeError, ValueError) as error:
        raise TypeError(
            f"the arguments of task {task.name!r} must be what JSON can hold ({error}); pass numbers, text, lists "
            f"and dictionaries, and build the rest in {task.function}"
        ) from None


def import_function(function: str) -> Callable[..., Result]:
    """Import a function by its name.

    Args:
        function: ``"module:qualname"``.

    Returns:
        The function.

    Raises:
        ValueError: There is no such function, or only this process could import it.
    """
    module, _, qualname = function.partition(":")
    if not qualname or module == "__main__" or "<" in qualname:
        raise ValueError(
            f"a task's function must be 'module:qualname' that another process can import, got {function!r}; "
            "move it to the top of a module"
        )
    try:
        found = functools.reduce(getattr, qualname.split("."), importlib.import_module(module))
    except (ImportError, AttributeError) as error:
        raise ValueError(
            f"a task's function must be importable, got {function!r}: {error}; is it spelled so, and is its "
            "package installed (or on PYTHONPATH)?"
        ) from error
    if not callable(found):
        raise ValueError(f"a task's function must be callable, {function!r} is {type(found).__name__}")
    return found


def perform(function: str, arguments: str) -> str:
    """Run a task's function.

    Arguments and result are JSON even if no process boundary is crossed, so that a tuple becomes a list everywhere.

    Args:
        function: ``"module:qualname"``.
        arguments: The keyword arguments as JSON.

    Returns:
        JSON: ``{"result": …}``, or ``{"error": one line, "details": traceback}``.
    """
    try:
        return json.dumps({"result": import_function(function)(**json.loads(arguments))})
    except (Exception, SystemExit) as error:  # a task that calls a command must not end its worker
        reason = " ".join(traceback.format_exception_only(error)[-1].split())
        return json.dumps({"error": reason, "details": traceback.format_exc()})
