"""MiniGrid and BabyAI: some tasks in JAX, all of them in Gymnasium through Farama's package."""

from __future__ import annotations

import importlib.util
from collections.abc import Callable, Iterable
from functools import partial
from typing import Any, TypeVar

from ..entries import Adapter, Entry
from ..errors import MissingExtra
from ..minigrid import TASKS, make, make_host
from .gymnasium import require_known

Made = TypeVar("Made")


class MiniGrid(Adapter):
    """MiniGrid's and BabyAI's tasks by Farama's ids, and our randomised DistShift."""

    registers = "minigrid"

    def entry(self, env_id: str) -> Entry:
        """See `Adapter.entry`."""
        env = partial(_made_by, make, env_id) if env_id in TASKS else None
        return Entry(env, partial(_made_by, make_host, env_id), entry_points=("minigrid.", "sympol."))

    def ids(self) -> Iterable[str]:
        """See `Adapter.ids`."""
        return TASKS


def _made_by(function: Callable[..., Made], env_id: str, **kwargs: Any) -> Made:
    """Make a task in either form; both need Farama's package, on which policies are evaluated."""
    if importlib.util.find_spec("minigrid") is None:
        raise MissingExtra(
            f"{env_id} needs a package that is not installed; install it: pip install 'sympol[minigrid]'"
        )
    if env_id not in TASKS:
        require_known(env_id)
    return function(env_id, **kwargs)
