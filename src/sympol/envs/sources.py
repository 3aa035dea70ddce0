"""Sources of environments, as users give them: an object, or a function that makes one."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from functools import cache, partial
from typing import Any, NamedTuple, TypeAlias

import gymnasium
from gymnasium.vector import VectorEnv

from .adapters import adopt
from .env import Env
from .equality import step_limit
from .foreign import ForeignEnv
from .jax_protocol import time_limit
from .origin import Origin
from .recorded import Recorded
from .remake import copier, describe
from .spaces import require_spaces
from .spec import HostFactory, VectorSource, no_copies
from .vector_envs import FirstCopy, single_maker

Remake: TypeAlias = Callable[[str, Mapping[str, Any]], gymnasium.Env]
"""A function that makes an environment by its id and arguments, as loading a run does."""


class Source(NamedTuple):
    """One environment to look at, and how to make more of it in Gymnasium; other fields are those of `EnvSpec`."""

    example: gymnasium.Env | Env | Recorded
    make_host: HostFactory | None
    has_one_copy: bool = False
    find_origin: Callable[[], Origin] = Origin
    find_copies: Callable[[], HostFactory | None] = no_copies
    vector: VectorSource | None = None

    @property
    def name(self) -> str:
        """The id of a Gymnasium environment, or the name of the class."""
        env = self.example
        if isinstance(env, ForeignEnv):
            return env.name
        if self.vector is not None:
            return self.vector.name
        if not isinstance(env, gymnasium.Env):
            return type(env).__name__
        return env.spec.id if env.spec is not None else type(env.unwrapped).__name__

    @property
    def jax_env(self) -> Env | None:
        """The environment if it is written in JAX."""
        return None if isinstance(self.example, gymnasium.Env | Recorded) else self.example

    @property
    def max_episode_steps(self) -> int | None:
        """The time limit, or None."""
        env = self.example
        if isinstance(env, gymnasium.Env):
            limit = step_limit(env)
            return limit if limit is not None or env.spec is None else env.spec.max_episode_steps
        return env.max_episode_steps if isinstance(env, Recorded) else time_limit(env)


def open_source(env: Any, kwargs: dict[str, Any], remake: Remake) -> Source:
    """Make an environment, if need be, and find out what it is.

    Args:
        env: An environment, or a function that makes one.
        kwargs: Arguments of the function.
        remake: What makes an environment again, to compare with.

    Returns:
        The source.

    Raises:
        ValueError: There are arguments for an object, the function does not take them, or a space is missing.
        TypeError: It is no environment.
    """
    makes = is_factory(env)
    if kwargs and not makes:
        raise ValueError(
            f"env_kwargs are for an environment that is made by id or by a function, got {kwargs}"
        )
    try:
        example = env(**kwargs) if makes else env
    except TypeError as error:
        if not kwargs:
            raise
        raise ValueError(f"env_kwargs {kwargs} do not fit this environment: {error}") from error
    if not _has_protocol(example) and (adopted := adopt(example)) is not None:
        example = adopted
    if isinstance(example, VectorEnv):
        return _vector(env if makes else None, kwargs, example)
    if isinstance(example, gymnasium.Env) or (hasattr(example, "reset") and hasattr(example, "step")):
        require_spaces(example)
    if isinstance(example, gymnasium.Env):
        return _made(env, kwargs, example, remake) if makes else _object(example, remake)
    if isinstance(example, Env):
        space = example.observation_space
        if not isinstance(space, gymnasium.spaces.Box) or len(space.shape) != 1:
            raise ValueError(f"an environment in JAX must observe a Box of shape (features,), got {space}")
        if isinstance(example, ForeignEnv) and example.recipe is not None:
            return Source(example, None, find_origin=partial(Origin.of_arguments, example.recipe))
        not_kept = f"an environment in JAX of class {_class(env if not makes else example)}"
        return Source(example, None, find_origin=partial(Origin, kwargs, not_kept=not_kept))
    raise TypeError(
        "env must be an id, a gymnasium.Env, an environment in JAX (see sympol.envs.env), or a function that "
        f"makes one, got {env!r}" + (f", which made {example!r}" if makes else "")
    )


def _vector(function: Any, kwargs: dict[str, Any], example: VectorEnv) -> Source:
    """Describe a vector environment that is the user's own object, or that a function made."""
    single = single_maker(example)
    name = example.spec.id if example.spec is not None else type(example.unwrapped).__name__
    if function is None:
        vector = VectorSource(
            name, lambda: example, example.num_envs, is_object=True, has_single=single is not None
        )
    else:
        make = partial(function, **kwargs) if kwargs else function
        vector = VectorSource(name, make, example.num_envs, is_object=False, has_single=single is not None)
    looked_at = FirstCopy(example)
    if single is None:
        single = (lambda: looked_at) if function is None else (lambda: FirstCopy(vector.make()))
    if function is not None:
        example.close()
    origin = partial(Origin, not_kept=f"a vector environment of class {type(example.unwrapped).__qualname__}")
    one = function is None and not vector.has_single
    return Source(looked_at, single, has_one_copy=one, find_origin=origin, vector=vector)


def _has_protocol(env: Any) -> bool:
    """Return whether an object is Gymnasium's, or has the spaces of `Env`; other libraries have others."""
    if isinstance(env, gymnasium.Env):
        return True
    return isinstance(env, Env) and isinstance(env.observation_space, gymnasium.Space)


def is_factory(env: object) -> bool:
    """Return whether something makes an environment; a class of environments does, whatever attributes it has.

    Args:
        env: What was given.

    Returns:
        True for a function or a class.
    """
    return callable(env) and (isinstance(env, type) or not isinstance(env, gymnasium.Env | Env))


def _object(env: gymnasium.Env, remake: Remake) -> Source:
    """Describe the user's own object; both searches may have to make another one, so they wait until asked for."""
    given_as = f"an object of class {_class(env)}"
    return Source(
        env,
        lambda: env,
        has_one_copy=True,
        find_origin=cache(partial(describe, env, remake, given_as)),
        find_copies=cache(partial(copier, env)),
    )


def _made(function: Any, kwargs: dict[str, Any], example: gymnasium.Env, remake: Remake) -> Source:
    """Describe a Gymnasium environment that a function made."""
    example.close()
    make = partial(function, **kwargs) if kwargs else function
    label = getattr(function, "__qualname__", None) or repr(function)
    return Source(example, make, find_origin=cache(partial(_describe_made, make, label, remake)))


def _describe_made(make: HostFactory, label: str, remake: Remake) -> Origin:
    made = make()
    try:
        return describe(made, remake, f"made by the function {label}")
    finally:
        made.close()


def _class(env: object) -> str:
    kind = type(env.unwrapped if isinstance(env, gymnasium.Env) else env)
    return f"{kind.__module__}.{kind.__qualname__}"
