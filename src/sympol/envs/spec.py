"""The description of an environment that training, evaluation and run folders share."""

from __future__ import annotations

import warnings
from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from functools import partial
from itertools import chain, repeat
from typing import Any, Literal, TypeAlias

import gymnasium
import numpy as np
from gymnasium.vector import VectorEnv
from jaxtyping import Float32

from ..trees.actions import ActionSpec
from .capabilities import NativeEngine, StateGraph, VectorEnvs
from .env import Env
from .env_workers import WorkerPool
from .host_envs import HostEnvs, OwnedHostEnvs
from .origin import Origin, Wrapping
from .spaces import Features
from .vector_envs import GymnasiumVectorEnvs

HostFactory: TypeAlias = Callable[..., gymnasium.Env]
Backend: TypeAlias = Literal["auto", "jax", "native", "host"]


MOST_WORKERS = 1024
"""The most processes that step one environment."""


def not_listed() -> None:
    """Return None, for an environment whose observations cannot be listed."""


def no_copies() -> None:
    """Return None, for an object that cannot be copied."""


@dataclass(frozen=True)
class VectorSource:
    """A vector environment of Gymnasium's that is trained on in place of copies.

    Attributes:
        name: Its id, or the name of its class.
        make: A function that makes it, or returns the user's own object.
        num_envs: The number of its copies.
        is_object: Whether it is the user's own object.
        has_single: Whether single environments like those in it can be made, to validate and evaluate on.
    """

    name: str
    make: Callable[[], VectorEnv]
    num_envs: int
    is_object: bool
    has_single: bool


@dataclass(frozen=True)
class EnvSpec:
    """One environment, as `sympol.resolve` describes it.

    Attributes:
        name: The id, or the name of the class.
        env: The form in JAX, to train on inside the compiled program, or None where there is none.
        make_host: A function that makes it in Gymnasium. An environment that exists in JAX alone is played by
            `sympol.envs.on_host.OnHost`.
        observation_space: The observation space.
        action_space: The action space.
        features: The map from observations to flat features, with their names, bounds and groups.
        actions: The meaning of a policy's outputs.
        max_episode_steps: The time limit, or None.
        has_one_copy: Whether ``make_host`` returns the user's own object each time.
        most_copies: The most copies that are open at once where whole episodes are played.
        native: The machine code that it is trained on, if any.
        speed_hint: What to install for faster training; empty if nothing.
        drawing: The drawing that the report page makes of the observations of the environment as it is registered;
            empty if it shows frames.
        all_observations: A function that lists all possible observations ``[batch, features]``, or returns None.
        find_origin: A function that returns how the environment was made.
        find_copies: A function that returns one that makes copies proven to be the same, or None.
        vector: The vector environment that is trained on in place of copies, or None.
        env_workers: The number of processes that step the copies of Gymnasium's form; 0 is this process.
    """

    name: str
    env: Env | None
    make_host: HostFactory
    observation_space: gymnasium.Space
    action_space: gymnasium.Space
    features: Features
    actions: ActionSpec
    max_episode_steps: int | None
    has_one_copy: bool = False
    most_copies: int = 16
    native: NativeEngine | None = None
    speed_hint: str = ""
    drawing: str = ""
    all_observations: Callable[[], Float32[np.ndarray, "batch features"] | None] = not_listed
    find_origin: Callable[[], Origin] = Origin
    find_copies: Callable[[], HostFactory | None] = no_copies
    vector: VectorSource | None = None
    env_workers: int = 0

    @property
    def origin(self) -> Origin:
        """The arguments it was made with, and whether a run can make it again."""
        return self.find_origin()

    @property
    def env_kwargs(self) -> Mapping[str, Any]:
        """The arguments it was made with, beside its name."""
        return self.origin.env_kwargs

    @property
    def wrappers(self) -> tuple[Wrapping, ...]:
        """The wrappers around it, from the innermost to the outermost."""
        return self.origin.wrappers

    @property
    def short_name(self) -> str:
        """The name without the module or file before it, as folders are called."""
        return self.name.rpartition(":")[2]

    @property
    def preset_id(self) -> str:
        """The id whose presets fit; empty for an environment that is not exactly what its id makes."""
        return self.name if self.origin.is_as_registered else ""

    @property
    def can_be_copied(self) -> bool:
        """True where more than one copy can be stepped together."""
        return self.vector is not None or not self.has_one_copy or self.find_copies() is not None

    @property
    def backend(self) -> Backend:
        """The form that it is trained on."""
        if self.env is not None:
            return "jax"
        return "host" if self.native is None else "native"

    def state_graph(self) -> StateGraph | None:
        """List the states and transitions of a small world written in JAX.

        Returns:
            The graph, or None for any other environment.
        """
        list_states = getattr(self.env, "state_graph", None)
        return None if list_states is None else list_states()

    def trained_with(self, num_envs: int) -> EnvSpec:
        """Return the same environment, of which a training steps a number of copies.

        Args:
            num_envs: The number of copies. If they are Gymnasium's, no more are opened to play whole
                episodes on.

        Returns:
            The description.
        """
        return replace(self, most_copies=min(self.most_copies, num_envs)) if self.backend == "host" else self

    def stepped_by(self, env_workers: int) -> EnvSpec:
        """Return the same environment, of which a training's copies are stepped by worker processes.

        Args:
            env_workers: The number of processes; with 0, the training's own process steps them. It changes no result.

        Returns:
            The description.

        Raises:
            ValueError: The number is negative, or the environment is not stepped through Gymnasium.
        """
        number = env_workers
        if isinstance(number, bool) or not isinstance(number, int) or not 0 <= number <= MOST_WORKERS:
            raise ValueError(
                f"env_workers must be a whole number from 0 to {MOST_WORKERS}, got {env_workers!r}"
            )
        if number and self.vector is not None:
            raise ValueError(
                f"env_workers must be 0 for {self.name}, a vector environment, got {number}; it steps its copies itself"
            )
        if number and self.backend != "host":
            where = "inside the compiled program" if self.backend == "jax" else "in machine code"
            raise ValueError(
                f"env_workers must be 0 for {self.name}, which is stepped {where}, got {number}; backend='host' steps "
                "it through Gymnasium"
            )
        return replace(self, env_workers=number)

    def host_envs(self, num_envs: int) -> VectorEnvs:
        """Make copies to step together on the host.

        Args:
            num_envs: The number of copies.

        Returns:
            The copies.

        Raises:
            ValueError: That many cannot be made.
        """
        if self.native is not None:
            return self.native.make_envs(num_envs)
        if self.vector is not None:
            if num_envs != self.vector.num_envs:
                raise ValueError(
                    f"num_envs must be {self.vector.num_envs}, the number of copies of the vector environment "
                    f"{self.name}, got {num_envs}"
                )
            return self._vector_envs(self.vector)
        if self.env_workers:
            return self._copies_in_workers(num_envs)
        if not self.has_one_copy:
            return self._copies(self.make_host, num_envs)
        own = partial(_Kept, self.make_host())
        if num_envs == 1:
            return self._copies(own, 1)
        copies = self.find_copies()
        if copies is None:
            raise ValueError(
                f"num_envs must be 1, got {num_envs}: {self.name} is an object that cannot be remade from "
                "its spec; give a function that makes one instead, for as many copies as you like"
            )
        makers = chain([own], repeat(copies))
        return self._copies(lambda: next(makers)(), num_envs)

    def validation_envs(self, num_envs: int, beside: VectorEnvs) -> VectorEnvs | None:
        """Make copies beside those of `host_envs`, to validate on while the training episodes wait.

        Args:
            num_envs: The most copies to make. There are fewer where no more can be made, for want of a licence or a
                port for each.
            beside: The copies that are trained on.

        Returns:
            The copies, or None where there is only one object, or no more of them can be made.
        """
        if self.native is not None:
            return self.native.make_envs(num_envs)
        if self.vector is not None and not self.vector.has_single:
            return None if self.vector.is_object else self._vector_envs(self.vector)
        make = self.find_copies() if self.has_one_copy else self.make_host
        if make is None:
            return None
        for number in sorted({num_envs, 1}, reverse=True):
            try:
                envs = self._copies(make, number, beside.workers if isinstance(beside, HostEnvs) else None)
            except Exception:
                continue
            return None if envs.shares_with(beside) else envs
        return None

    def _vector_envs(self, source: VectorSource) -> GymnasiumVectorEnvs:
        vector = source.make()
        close = (lambda: None) if source.is_object else vector.close
        return GymnasiumVectorEnvs(vector, self.features, close)

    def _copies(
        self, make: Callable[[], gymnasium.Env], num_envs: int, workers: WorkerPool | None = None
    ) -> HostEnvs:
        return HostEnvs(make, num_envs, self.features, self.action_space, workers)

    def _copies_in_workers(self, num_envs: int) -> HostEnvs:
        make = self.find_copies() if self.has_one_copy else self.make_host
        if make is None:
            raise ValueError(
                f"env_workers must be 0, got {self.env_workers}: {self.name} is an object that cannot be remade from "
                "its spec; give a function that makes one instead"
            )
        workers = WorkerPool(min(self.env_workers, num_envs))
        try:
            return OwnedHostEnvs(make, num_envs, self.features, self.action_space, workers)
        except BaseException:
            workers.close()
            raise


class OneCopy(UserWarning):
    """An environment object is trained on alone, because no copy of it is proven to be the same."""


def warn_of_one_copy(spec: EnvSpec) -> None:
    """Warn where an object of Gymnasium's could have been expected to be copied, and is not.

    Args:
        spec: The environment.
    """
    if spec.has_one_copy and spec.name in gymnasium.registry and not spec.can_be_copied:
        warnings.warn(
            f"the {spec.name} given is trained on alone (num_envs=1): it differs from what its spec makes, because it "
            "was changed, is wrapped in something that does not record its arguments, or is in use; for more copies "
            "give a function that makes it",
            OneCopy,
            stacklevel=3,
        )


class _Kept(gymnasium.Wrapper):
    """The user's own object, which stays open."""

    def close(self) -> None:
        """Leave it open: the user who made it closes it."""
