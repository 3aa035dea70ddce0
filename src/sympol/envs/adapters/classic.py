"""The classic control tasks, in JAX."""

from __future__ import annotations

from collections.abc import Iterable
from functools import partial

from ..classic.acrobot import Acrobot
from ..classic.cartpole import CartPole
from ..classic.mountain_car import MountainCar, MountainCarContinuous
from ..classic.pendulum import Pendulum
from ..entries import Adapter, Entry
from ..env import Env
from .gymnasium import make

ENVS: dict[str, Env] = {
    "CartPole-v1": CartPole(),
    "Pendulum-v1": Pendulum(),
    "Acrobot-v1": Acrobot(),
    "MountainCar-v0": MountainCar(),
    "MountainCarContinuous-v0": MountainCarContinuous(),
}
"""All of these have a drawing on the report page."""


class Classic(Adapter):
    """The classic control tasks by Gymnasium's ids."""

    def entry(self, env_id: str) -> Entry | None:
        """See `Adapter.entry`."""
        if env_id not in ENVS:
            return None
        return Entry(ENVS[env_id], partial(make, env_id), drawing=env_id)

    def ids(self) -> Iterable[str]:
        """See `Adapter.ids`."""
        return ENVS
