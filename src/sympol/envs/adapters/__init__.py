"""Kinds of environments: a module for each, and the table of the ids that it answers for."""

from __future__ import annotations

import contextlib
from collections.abc import Iterator
from functools import cache
from importlib import import_module
from typing import Any

from ..entries import Adapter, Entry
from ..env import Env
from ..libraries import ADAPTER_OF

ADAPTERS: dict[str, str | type[Adapter]] = {
    "CartPole-": "sympol.envs.adapters.classic:Classic",
    "Acrobot-": "sympol.envs.adapters.classic:Classic",
    "Pendulum-": "sympol.envs.adapters.classic:Classic",
    "MountainCar": "sympol.envs.adapters.classic:Classic",
    "LunarLander": "sympol.envs.adapters.lunar_lander:LunarLander",
    "MiniGrid-": "sympol.envs.adapters.minigrid:MiniGrid",
    "BabyAI-": "sympol.envs.adapters.minigrid:MiniGrid",
    "sympol/DistShift-": "sympol.envs.adapters.minigrid:MiniGrid",
    "phys2d/": "sympol.envs.adapters.functional:Functional",
    "tabular/": "sympol.envs.adapters.functional:Functional",
    **{f"{library}:": adapter for library, adapter in ADAPTER_OF.items()},
    "": "sympol.envs.adapters.gymnasium:Gymnasium",
}
"""How ids begin, and the subclass of `Adapter` for them, or the module and name to import it from.

The longest beginning is asked first. A new kind of environment is one module and one line here.
"""


def built_in(env_id: str) -> Entry:
    """Return what the adapters know of an id.

    Args:
        env_id: The id.

    Returns:
        The entry of the first adapter that has one, which may be for an environment that does not exist.
    """
    for beginning in sorted(ADAPTERS, key=len, reverse=True):
        if env_id.startswith(beginning) and (entry := load(ADAPTERS[beginning]).entry(env_id)) is not None:
            return entry
    return Entry()


def lists(env_id: str) -> bool:
    """Return whether an adapter lists an id as one of its own.

    Args:
        env_id: The id.

    Returns:
        True if one does.
    """
    return any(
        env_id.startswith(beginning) and env_id in load(adapter).ids()
        for beginning, adapter in ADAPTERS.items()
    )


def all_ids() -> Iterator[str]:
    """List the ids of all adapters.

    Yields:
        The ids.
    """
    for adapter in dict.fromkeys(ADAPTERS.values()):
        yield from load(adapter).ids()


def adopt(env: Any) -> Env | None:
    """Return an object of another library in the protocol of `Env`.

    Args:
        env: The object.

    Returns:
        The environment, or None where no adapter knows its class.
    """
    adapters = (load(adapter) for adapter in dict.fromkeys(ADAPTERS.values()))
    return next((adopted for adapter in adapters if (adopted := adapter.adopt(env)) is not None), None)


def import_for(env_id: str) -> None:
    """Import the package that may register an id; nothing if it is not installed.

    Args:
        env_id: The id, in whatever case it is written.
    """
    for beginning, adapter in ADAPTERS.items():
        stem = beginning.rstrip("-/").lower()
        if stem and env_id.lower().startswith(stem) and (module := load(adapter).registers):
            with contextlib.suppress(ImportError):
                import_module(module)


@cache
def load(adapter: str | type[Adapter]) -> Adapter:
    """Return an adapter, imported when it is first used.

    Args:
        adapter: A value of `ADAPTERS`.

    Returns:
        The adapter.
    """
    if isinstance(adapter, str):
        module, _, name = adapter.partition(":")
        return getattr(import_module(module), name)()
    return adapter()
