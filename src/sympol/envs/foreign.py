"""Environments in JAX of other libraries, behind the protocol `Env`.

`ForeignEnv` does what all of them need: it flattens their observations into named features, casts what they answer,
counts the time limit, and hands them keys as plain arrays, which is what they expect. A subclass in
`sympol.envs.adapters`, one file per library, says how that library starts an episode and takes a step.
"""

from __future__ import annotations

import abc
import contextlib
import dataclasses
import difflib
import importlib
from collections.abc import Iterable, Iterator, Mapping
from functools import partial
from typing import Any, ClassVar, NamedTuple, final

import gymnasium
import jax
import jax.numpy as jnp
import numpy as np
from gymnasium.spaces import Box, Dict, Discrete, MultiBinary, MultiDiscrete, Tuple
from jax import Array
from jaxtyping import Float, Int, PRNGKeyArray

from ..types import Action, Step
from .entries import Adapter, Entry
from .errors import MissingExtra, UnknownEnvironment
from .spaces import Features

NEVER = 2**30
"""A number of steps that no episode has."""


class Counted(NamedTuple):
    """The state of an environment, and the number of steps since its episode began."""

    inner: Any
    time: Int[Array, ""]


class Answer(NamedTuple):
    """The answer of a library to one action, before anything is cast.

    Attributes:
        state: The library's state.
        observation: The observation, in the form that the observation space describes.
        reward: The reward.
        terminated: Whether the task itself ended.
        truncated: Whether the library cut the episode. The time limit need not be counted here.
    """

    state: Any
    observation: Any
    reward: Any
    terminated: Any
    truncated: Any = False


class ForeignEnv(abc.ABC):
    """An environment of another library, in the protocol of `sympol.envs.env.Env`.

    Args:
        name: Its id, ``library:name``.
        observed: The space of the library's observations, which may be nested.
        action_space: The space of the actions.
        max_episode_steps: The time limit, or None.
        feature_names: Names of the features; by default those that the space gives, such as ``agent.position[0]``.
        action_names: Names of the actions; by default ``action 0`` and so on.
    """

    recipe: Mapping[str, Any] | None = None
    """The arguments with which the id alone makes this environment again, or None where that is not known."""

    def __init__(
        self,
        name: str,
        observed: gymnasium.Space,
        action_space: gymnasium.Space,
        max_episode_steps: int | None,
        feature_names: tuple[str, ...] | None = None,
        action_names: tuple[str, ...] | None = None,
    ) -> None:
        features = Features.of(observed, feature_names)
        self.name = name
        self.observed = observed
        self.observation_space = Box(features.low, features.high, dtype=np.float32)
        self.action_space = action_space
        self.max_episode_steps = max_episode_steps
        self.feature_names, self.groups, self.integers = features.names, features.groups, features.integers
        self.action_names = action_names

    @abc.abstractmethod
    def begin(self, key: Array) -> tuple[Any, Any]:
        """Start an episode.

        Args:
            key: A key as a plain array.

        Returns:
            The library's state, and its observation.
        """

    @abc.abstractmethod
    def advance(self, key: Array, state: Any, action: Array) -> Answer:
        """Take one step, without resetting at the end of an episode.

        Args:
            key: A key as a plain array.
            state: The library's state.
            action: An action of the space.

        Returns:
            The answer.
        """

    @final
    def reset(self, key: PRNGKeyArray) -> tuple[Counted, Float[Array, " features"]]:
        """Start an episode.

        Args:
            key: The source of everything random in the start.

        Returns:
            The state, and the first observation ``[features]``, float32.
        """
        with _as_libraries_expect():
            state, observation = self.begin(_plain(key))
        return Counted(state, jnp.int32(0)), flat(self.observed, observation)

    @final
    def step(self, key: PRNGKeyArray, state: Counted, action: Action) -> tuple[Counted, Step]:
        """Take one step, without resetting at the end of an episode.

        Args:
            key: The source of everything random in the step.
            state: The state.
            action: The action, already clipped to the bounds of a ``Box``.

        Returns:
            The new state, and the observation, reward and end of the episode.
        """
        with _as_libraries_expect():
            answer, time = self.advance(_plain(key), state.inner, action), state.time + 1
        truncated = jnp.asarray(answer.truncated).astype(bool).reshape(())
        if self.max_episode_steps is not None:
            truncated |= time >= self.max_episode_steps
        return Counted(answer.state, time), Step(
            flat(self.observed, answer.observation),
            jnp.asarray(answer.reward, jnp.float32).reshape(()),
            jnp.asarray(answer.terminated).astype(bool).reshape(()),
            truncated,
        )


def flat(space: gymnasium.Space, observation: Any) -> Float[Array, " features"]:
    """Turn one observation into features, in the order of `sympol.envs.spaces.Features`.

    Args:
        space: The space of the observation.
        observation: Arrays nested as the space is; where it has a ``Dict``, a mapping or an object with attributes.

    Returns:
        The features, float32.
    """
    return jnp.concatenate([part.astype(jnp.float32) for part in _parts(space, observation)])


def space_like(observation: Any) -> gymnasium.Space:
    """Describe an observation by its shapes and dtypes alone, where a library gives no bounds.

    Args:
        observation: Arrays or their shapes, nested in mappings, tuples or objects with fields.

    Returns:
        A ``Box`` without bounds for numbers, ``MultiBinary`` for booleans, ``Dict`` and ``Tuple`` for what is nested.
    """
    if hasattr(observation, "dtype"):
        if observation.dtype == bool:
            return MultiBinary(observation.shape or 1)
        dtype: Any = np.int32 if np.issubdtype(observation.dtype, np.integer) else np.float32
        low, high = (-np.inf, np.inf) if dtype is np.float32 else (np.iinfo(dtype).min, np.iinfo(dtype).max)
        return Box(low, high, observation.shape, dtype)
    parts = _fields(observation)
    if parts is not None:
        return Dict({str(name): space_like(part) for name, part in parts.items()})
    return Tuple([space_like(part) for part in observation])


class Library(Adapter):
    """The environments of one library, by ids ``library:name`` and as objects.

    The library is imported when an environment is made.
    """

    prefix: ClassVar[str]
    """What ids begin with, without the colon; also the name of the extra that installs the library."""
    package: ClassVar[str]
    """The module in which the library's classes live, at any depth."""

    @abc.abstractmethod
    def names(self) -> Iterable[str]:
        """List the names that the library knows, once it is imported."""

    @abc.abstractmethod
    def make(self, name: str, **kwargs: Any) -> ForeignEnv:
        """Make an environment by name.

        Args:
            name: One of the names.
            kwargs: Arguments of the library's own function.

        Returns:
            The environment.
        """

    @abc.abstractmethod
    def wrap(self, env: Any) -> ForeignEnv:
        """Describe an environment that the user made.

        Args:
            env: The library's object.

        Returns:
            The environment.

        Raises:
            ValueError: It is one that cannot be trained on, such as a wrapper that resets by itself.
        """

    @final
    def entry(self, env_id: str) -> Entry:
        """See `Adapter.entry`."""
        return Entry(partial(self._made, env_id.removeprefix(f"{self.prefix}:")))

    @final
    def adopt(self, env: Any) -> ForeignEnv | None:
        """See `Adapter.adopt`."""
        first = env[0] if isinstance(env, tuple) and env else env
        return self.wrap(env) if is_of(self.package, first) else None

    @final
    def library(self, part: str = "") -> Any:
        """Return the library, imported now.

        Args:
            part: A name in it, or a module of it.

        Returns:
            The module, or the part.

        Raises:
            MissingExtra: It is not installed, or lacks a package itself.
        """
        module = require_library(self.prefix, self.package)
        if part and not hasattr(module, part):
            return require_library(self.prefix, f"{self.package}.{part}")
        return getattr(module, part) if part else module

    def _made(self, name: str, **kwargs: Any) -> ForeignEnv:
        self.library()
        names = list(self.names())
        if name not in names:
            near = difflib.get_close_matches(name, names) or sorted(names)[:5]
            raise UnknownEnvironment(
                f"unknown environment '{self.prefix}:{name}': {self.package} has "
                + " and ".join(f"'{self.prefix}:{other}'" for other in near)
            )
        return self.make(name, **kwargs)


def is_of(module: str, value: object) -> bool:
    """Return whether a value's class, or one that it inherits from, is defined in a module or below it.

    Args:
        module: The module, which is not imported.
        value: The value.

    Returns:
        True if it is.
    """
    return any(f"{kind.__module__}.".startswith(f"{module}.") for kind in type(value).__mro__)


def require_library(extra: str, module: str) -> Any:
    """Import a library or a part of it.

    Args:
        extra: The extra of sympol's that installs it.
        module: The module.

    Returns:
        The module.

    Raises:
        MissingExtra: It is not installed, or lacks a package itself.
    """
    try:
        return importlib.import_module(module)
    except ModuleNotFoundError as error:
        raise MissingExtra(
            f"environments of {module.partition('.')[0]} need a package that is not installed; install it: "
            f"pip install 'sympol[{extra}]' ({error})"
        ) from error


@contextlib.contextmanager
def _as_libraries_expect() -> Iterator[None]:
    """Let dtypes and ranks be promoted, which the user may have forbidden for code of their own."""
    with jax.numpy_dtype_promotion("standard"), jax.numpy_rank_promotion("allow"):
        yield


def _plain(key: PRNGKeyArray) -> Array:
    return jax.random.key_data(key) if jnp.issubdtype(key.dtype, jax.dtypes.prng_key) else key


def _parts(space: gymnasium.Space, observation: Any) -> Iterator[Array]:
    match space:
        case Box() | MultiBinary():
            yield jnp.ravel(jnp.asarray(observation))
        case Discrete():
            yield _one_hot(observation, int(space.start), int(space.n))
        case MultiDiscrete():
            array = jnp.asarray(observation)
            for index in np.ndindex(space.nvec.shape):
                yield _one_hot(array[index], int(space.start[index]), int(space.nvec[index]))
        case Dict():
            parts = _fields(observation)
            assert parts is not None
            for name, part in space.spaces.items():
                yield from _parts(part, parts[name])
        case Tuple():
            for part, value in zip(space.spaces, observation, strict=True):
                yield from _parts(part, value)


def _one_hot(category: Any, start: int, n: int) -> Array:
    return jnp.arange(n) == jnp.asarray(category) - start


def _fields(value: Any) -> Mapping[str, Any] | None:
    """Return the parts of a mapping, a named tuple or a dataclass by name; None for anything else."""
    if isinstance(value, Mapping):
        return value
    if hasattr(value, "_asdict"):
        return value._asdict()
    if dataclasses.is_dataclass(value):
        return {field.name: getattr(value, field.name) for field in dataclasses.fields(value)}
    return None
