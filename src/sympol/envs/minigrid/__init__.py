"""MiniGrid in pure JAX, step by step what Farama's package does, and the host form of all of its tasks.

A task is one small file: its grids, its starts, what can be seen in it. `core` has the rules, `view` what is
observed, `host` the twin in Gymnasium. ``view_size``, ``planes`` and ``actions`` are options of both forms
(``resolve("MiniGrid-DoorKey-5x5-v0", env_kwargs={"view_size": 5})``).
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import gymnasium

from . import crossing, distshift, doorkey, empty, fourrooms, lavagap
from .core import MiniGrid
from .distshift import random_layouts
from .task import Task
from .view import View

__all__ = ["TASKS", "MiniGrid", "Task", "View", "make", "make_host", "random_layouts", "view_of"]

TASKS: dict[str, Task] = {
    env_id: task
    for family in (empty, doorkey, lavagap, distshift, crossing, fourrooms)
    for env_id, task in family.TASKS.items()
}
"""The tasks written in JAX, by id."""

gymnasium.register(distshift.RANDOM, entry_point="sympol.envs.minigrid.host:DistShiftRandom")


def view_of(
    env_id: str,
    view_size: int = 3,
    planes: Sequence[int] | None = None,
    actions: Sequence[int] | None = None,
) -> View:
    """Return the view of a task.

    Args:
        env_id: The id of any of Farama's tasks or ours.
        view_size: Cells along a side, odd.
        planes: Numbers of the planes; by default those that matter in the task.
        actions: Numbers of the actions; by default those that matter in the task.

    Returns:
        The view.

    Raises:
        ValueError: `View` refuses one of the options.
    """
    task = TASKS.get(env_id)
    default = View() if task is None else task
    known = {} if task is None else {"elsewhere": task.elsewhere, "here": task.here}
    return View(
        view_size=view_size,
        planes=default.planes if planes is None else planes,  # pyright: ignore[reportArgumentType]
        actions=default.actions if actions is None else actions,  # pyright: ignore[reportArgumentType]
        **known,
    )


def make(env_id: str, **options: Any) -> MiniGrid:
    """Make a task in JAX.

    Args:
        env_id: One of `TASKS`.
        options: Arguments of `view_of`.

    Returns:
        The environment.
    """
    return MiniGrid(TASKS[env_id], view_of(env_id, **options))


def make_host(env_id: str, *, render_mode: str | None = None, **options: Any) -> gymnasium.Env:
    """Make a task in Gymnasium.

    Args:
        env_id: The id of any of Farama's tasks or ours.
        render_mode: How it draws itself, as in Gymnasium.
        options: Arguments of `view_of`.

    Returns:
        The environment.
    """
    from . import host

    all_actions = env_id not in TASKS and options.get("actions") is None
    return host.make(env_id, view_of(env_id, **options), all_actions=all_actions, render_mode=render_mode)
