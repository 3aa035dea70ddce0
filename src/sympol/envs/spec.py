"""What learners and readers need to know of an environment, however it was named."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, replace
from typing import Any, Literal, TypeAlias

import gymnasium
import numpy as np
from jaxtyping import Float32

from ..trees.actions import ActionSpec
from .env import Env
from .host import HostEnvs
from .native import NativeEnvs
from .spaces import Features

HostFactory: TypeAlias = Callable[..., gymnasium.Env]
Backend: TypeAlias = Literal["auto", "jax", "native", "host"]


def not_listed() -> None:
    """All observations of an environment that nobody can list."""


@dataclass(frozen=True)
class EnvSpec:
    """One environment, as `sympol.resolve` found it.

    ``env`` is its form in JAX, to train on inside the compiled program, or None where only the host has it.
    ``make_host`` makes it in Gymnasium; None where it exists in JAX alone. ``is_native`` says that our own
    machine code steps it. ``env_kwargs`` is what it was made with, beside its name. ``all_observations``
    lists all there can be; it returns None where nobody can.
    """

    name: str
    env: Env | None
    make_host: HostFactory | None
    observation_space: gymnasium.Space
    action_space: gymnasium.Space
    features: Features
    actions: ActionSpec
    max_episode_steps: int | None
    has_one_copy: bool = False  # make_host returns the user's own object, each time
    most_copies: int = 16  # open at once where whole episodes are played
    env_kwargs: Mapping[str, Any] = field(default_factory=dict)
    is_native: bool = False
    all_observations: Callable[[], Float32[np.ndarray, "batch features"] | None] = not_listed

    @property
    def backend(self) -> Backend:
        """What it is trained on."""
        if self.env is not None:
            return "jax"
        return "native" if self.is_native else "host"

    def trained_with(self, num_envs: int) -> EnvSpec:
        """The same environment for whoever trains on ``num_envs`` copies: no more of them are ever open at once.

        Where it is not Gymnasium that is trained on, their number says nothing about Gymnasium's.
        """
        return replace(self, most_copies=min(self.most_copies, num_envs)) if self.backend == "host" else self

    def host_envs(self, num_envs: int) -> HostEnvs | NativeEnvs:
        """Make copies to step together on the host. Raises ValueError where that many cannot be made."""
        if self.is_native:
            return NativeEnvs(num_envs)
        if self.make_host is None:
            raise ValueError(f"{self.name} is written in JAX and has no form in Gymnasium")
        if self.has_one_copy and num_envs > 1:
            raise ValueError(
                f"num_envs must be 1, got {num_envs}: {self.name} is an object that cannot be remade from "
                "its spec; give a function that makes one instead, for as many copies as you like"
            )
        return HostEnvs(self.make_host, num_envs, self.features)
