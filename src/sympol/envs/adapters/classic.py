"""The classic control tasks, in JAX."""

from __future__ import annotations

from collections.abc import Iterable
from functools import cache, partial
from importlib import import_module

from ..entries import Adapter, Entry
from ..env import Env
from .gymnasium import make

ENVS: dict[str, str] = {
    "CartPole-v1": "cartpole:CartPole",
    "Pendulum-v1": "pendulum:Pendulum",
    "Acrobot-v1": "acrobot:Acrobot",
    "MountainCar-v0": "mountain_car:MountainCar",
    "MountainCarContinuous-v0": "mountain_car:MountainCarContinuous",
}
"""The module and the class of each, imported when the task is asked for; all have a drawing on the report page."""


class Classic(Adapter):
    """The classic control tasks by Gymnasium's ids."""

    def entry(self, env_id: str) -> Entry | None:
        """See `Adapter.entry`."""
        if env_id not in ENVS:
            return None
        return Entry(in_jax(env_id), partial(make, env_id), drawing=env_id)

    def ids(self) -> Iterable[str]:
        """See `Adapter.ids`."""
        return ENVS


@cache
def in_jax(env_id: str) -> Env | None:
    """Return a classic control task in JAX.

    Args:
        env_id: Gymnasium's id.

    Returns:
        The environment, or None for any other id.
    """
    if env_id not in ENVS:
        return None
    module, _, name = ENVS[env_id].partition(":")
    return getattr(import_module(f"sympol.envs.classic.{module}"), name)()
