"""What every trainer can do, and a function that is compiled once."""

from __future__ import annotations

import abc
import time
from collections.abc import Callable
from concurrent.futures import Future, wait
from typing import Any

import jax

from ..compilation import in_own_thread
from .memory import require_room
from .state import TrainState

COMPILER_OPTIONS: dict[str, bool | str] = {
    "xla_backend_optimization_level": "1",
    "xla_llvm_disable_expensive_passes": "True",
}
"""Of LLVM: it compiles in three fifths of the time and, these loops being what they are, runs no slower."""


class Trainer(abc.ABC):
    """Trains one seed, a segment at a time."""

    latest: TrainState | None = None
    """What a segment that failed had come to by its last update, where the host has seen one."""

    limit: int
    """Steps after which validation cuts an episode."""

    was_cut = False
    """Whether the last validation cut one."""

    @abc.abstractmethod
    def compile(self) -> float:
        """Compile, unless this process has done so before; the seconds it took."""

    @abc.abstractmethod
    def advance(self, state: TrainState | None, stop: int) -> TrainState:
        """Train until ``stop`` timesteps and validate; None begins a new training."""

    @abc.abstractmethod
    def template(self) -> TrainState:
        """A state of the right shapes, its values of no meaning."""

    def close(self) -> None:  # noqa: B027  (nothing to close inside a compiled program)
        """Let go of what the host holds; `advance` takes hold of it again."""


class Compiled:
    """A function compiled once, ahead of its first call, for the shapes of one set of arguments."""

    def __init__(self, function: Callable[..., TrainState], template: TrainState, **jit: Any) -> None:
        self._function, self._executable = jax.jit(function, **jit), None
        self._compiling: Future[Any] | None = None
        self.template = template

    def compile(self, *arguments: Any) -> float:
        """Compile for arguments like these, unless that is done; the seconds it took."""
        if self._executable is not None:
            return 0.0
        began = time.perf_counter()
        if self._compiling is None:  # else somebody was interrupted who waited for it
            lowered = self._function.lower(*arguments)
            self._compiling = in_own_thread(lambda: lowered.compile(COMPILER_OPTIONS))
        wait([self._compiling])
        compiling, self._compiling = self._compiling, None
        executable = compiling.result()
        require_room(executable)
        self._executable = executable
        return time.perf_counter() - began

    def __call__(self, *arguments: Any) -> TrainState:
        """Call what was compiled."""
        self.compile(*arguments)
        return self._executable(*arguments)  # pyright: ignore[reportOptionalCall]
