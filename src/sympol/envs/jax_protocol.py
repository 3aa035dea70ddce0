"""Check environments in JAX: what a user wrote is made to keep the protocol of `sympol.envs.env`, or refused.

Nothing is computed here: JAX only says which shapes and dtypes ``reset`` and ``step`` return.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Any, NamedTuple

import gymnasium
import jax
import jax.numpy as jnp
import numpy as np
from jax import Array
from jaxtyping import Float, PRNGKeyArray

from ..types import Action, Step
from .env import Env
from .foreign import ForeignEnv
from .spaces import action_spec, describe


class _Leaf(NamedTuple):
    """One array of a state; ``impl`` says which keys of `jax.random` it holds, None where it holds numbers."""

    path: str
    shape: tuple[int, ...]
    dtype: Any
    impl: Any = None


@dataclass(frozen=True)
class _Answers:
    """The shapes and dtypes that an environment returns."""

    state: tuple[_Leaf, ...]
    keeps_protocol: bool


@dataclass(frozen=True)
class JaxEnv:
    """A user's environment, made to keep the protocol: numbers are cast, and the keys in its state are plain arrays."""

    env: Any
    _answers: _Answers = field(compare=False, repr=False)

    @property
    def observation_space(self) -> gymnasium.spaces.Box:
        """See `Env`."""
        return self.env.observation_space

    @property
    def action_space(self) -> gymnasium.Space:
        """See `Env`."""
        return self.env.action_space

    def reset(self, key: PRNGKeyArray) -> tuple[Any, Float[Array, " features"]]:
        """See `Env`."""
        state, observation = self.env.reset(key)
        return self._without_keys(state), jnp.asarray(observation, jnp.float32)

    def step(self, key: PRNGKeyArray, state: Any, action: Action) -> tuple[Any, Step]:
        """See `Env`."""
        state, answer = self.env.step(key, self._with_keys(state), action)
        observation, reward, terminated, truncated = answer
        return self._without_keys(state), Step(
            jnp.asarray(observation, jnp.float32),
            jnp.asarray(reward, jnp.float32).reshape(()),
            jnp.asarray(terminated).astype(bool).reshape(()),
            jnp.asarray(truncated).astype(bool).reshape(()),
        )

    def __getattr__(self, name: str) -> Any:
        """Whatever else the environment has, such as ``feature_names``."""
        if name.startswith("__") or name == "env":
            raise AttributeError(name)
        if name == "max_episode_steps" and (limit := time_limit(self.env)) is not None:
            return limit
        if name == "max_episode_steps":
            raise AttributeError(name)
        return getattr(self.env, name)

    def _without_keys(self, state: Any) -> Any:
        def plain(array: Any, leaf: _Leaf) -> Any:
            return jnp.asarray(array, leaf.dtype) if leaf.impl is None else jax.random.key_data(array)

        return self._mapped(plain, state)

    def _with_keys(self, state: Any) -> Any:
        def own(array: Any, leaf: _Leaf) -> Any:
            return array if leaf.impl is None else jax.random.wrap_key_data(array, impl=leaf.impl)

        return self._mapped(own, state)

    def _mapped(self, function: Callable[[Any, _Leaf], Any], state: Any) -> Any:
        arrays, structure = jax.tree.flatten(state)
        leaves = map(function, arrays, self._answers.state)
        return jax.tree.unflatten(structure, leaves)


def kept_to_protocol(env: Env) -> Env:
    """Return the environment itself where it keeps the protocol of `Env`, else one around it that does.

    Integer rewards, Python's own bools and numbers, observations of another dtype, keys of `jax.random` in the state
    and ``max_episode_steps = None`` are made to fit.

    Args:
        env: The environment.

    Returns:
        An environment that keeps the protocol.

    Raises:
        ValueError: No cast makes it fit; the message, of one line, names what does not.
    """
    of_ours = type(env).__module__.startswith(f"{__name__.partition('.')[0]}.")
    if of_ours and not isinstance(env, ForeignEnv):
        return env  # our own keep it: tests/envs/test_protocol.py
    answers = _answers_of(env)
    limit = getattr(env, "max_episode_steps", 1)
    return env if answers.keeps_protocol and type(limit) is int else JaxEnv(env, answers)


def time_limit(env: Any) -> int | None:
    """Return the time limit that an environment declares as its ``max_episode_steps``.

    Args:
        env: The environment.

    Returns:
        The number of steps, or None where it has no limit.

    Raises:
        ValueError: It is no positive whole number.
    """
    limit = getattr(env, "max_episode_steps", None)
    if limit is None:
        return None
    number = np.asarray(limit)
    if (
        number.size != 1
        or number.dtype.kind not in "iuf"
        or number.item() != number.item() // 1
        or number.item() < 1
    ):
        raise ValueError(
            f"max_episode_steps of {type(env).__name__} must be a positive whole number, or None for no limit, got "
            f"{describe(limit)}"
        )
    return int(number.item())


def _answers_of(env: Env) -> _Answers:
    name = type(env).__name__
    time_limit(env)
    action_spec(env.action_space)
    shape = env.observation_space.shape
    impls: dict[str, list[Any]] = {}

    def traced(where: str, function: Callable[..., Any], *arguments: Any) -> Any:
        """Return the shapes that a function returns, and note the keys in its state."""

        def noting(*given: Any) -> Any:
            answer = function(*given)
            if not isinstance(answer, tuple) or len(answer) != 2:
                wanted = "(state, observation)" if where == "reset" else "(state, Step(...))"
                raise _Misfit(f"{where}() of {name} must return {wanted}, got {_kind(answer)}")
            impls[where] = [_impl(array) for array in jax.tree.leaves(answer[0])]
            return answer

        try:
            return jax.eval_shape(noting, *arguments)
        except _Misfit:
            raise
        except Exception as error:
            first = (str(error).strip().splitlines() or [""])[0]
            raise ValueError(
                f"{where}() of {name} must be a function that JAX can trace, and it raised {type(error).__name__}: "
                f"{first}"
            ) from error

    key = jax.eval_shape(lambda: jax.random.key(0))
    state, observation = traced("reset", env.reset, key)
    _require_observation(f"the observation that reset() of {name} returns", observation, shape)
    state_after, answer = traced("step", env.step, key, state, _an_action(env.action_space))
    if not isinstance(answer, tuple) or len(answer) != len(Step._fields):
        raise ValueError(
            f"step() of {name} must return (state, Step({', '.join(Step._fields)})), got (state, {_kind(answer)})"
        )
    step = Step(*answer)
    _require_observation(f"the observation that step() of {name} returns", step.observation, shape)
    for what in ("reward", "terminated", "truncated"):
        _require_number(f"the {what} that step() of {name} returns", getattr(step, what))
    begun, gone_on = _leaves(state, impls["reset"]), _leaves(state_after, impls["step"])
    _require_same(name, (begun, jax.tree.structure(state)), (gone_on, jax.tree.structure(state_after)))
    dtypes = [
        np.dtype(np.float32),
        np.dtype(np.float32),
        np.dtype(np.float32),
        np.dtype(bool),
        np.dtype(bool),
    ]
    numbers = [observation, *step]
    return _Answers(
        state=begun,
        keeps_protocol=isinstance(answer, Step)
        and not any(array.weak_type for array in jax.tree.leaves((state, state_after, numbers)))
        and all(leaf.impl is None for leaf in begun)
        and [array.dtype for array in numbers] == dtypes
        and all(number.shape == () for number in step[1:]),
    )


class _Misfit(ValueError):
    """Raised while JAX traces; the message is complete."""


def _require_observation(what: str, array: Any, shape: tuple[int, ...]) -> None:
    if not _is_number(array) or array.shape != shape:
        raise ValueError(
            f"{what} must be an array of numbers of shape {shape}, as in observation_space, got {_kind(array)}"
        )


def _require_number(what: str, array: Any) -> None:
    if not _is_number(array) or np.prod(array.shape, dtype=int) != 1:
        raise ValueError(f"{what} must be one number, of shape (), got {_kind(array)}")


def _require_same(name: str, begun: tuple[Any, Any], gone_on: tuple[Any, Any]) -> None:
    """Raise ValueError where a state changes its structure, or a part of it its shape or dtype."""
    before, after = ({leaf.path: leaf for leaf in leaves} for leaves, _ in (begun, gone_on))
    for path in [*before, *(path for path in after if path not in before)]:
        if before.get(path) != after.get(path):
            raise ValueError(
                f"the state that step() of {name} returns must be of the structure, shapes and dtypes of that of "
                f"reset(), but state{path} is {_said(after.get(path))} after step() and {_said(before.get(path))} "
                "after reset()"
            )
    if begun[1] != gone_on[1]:
        raise ValueError(
            f"the state that step() of {name} returns must be of the structure of that of reset(), but it is "
            f"{gone_on[1]} after step() and {begun[1]} after reset()"
        )


def _leaves(state: Any, impls: list[Any]) -> tuple[_Leaf, ...]:
    paths = jax.tree_util.tree_flatten_with_path(state)[0]
    return tuple(
        _Leaf(jax.tree_util.keystr(path), array.shape, array.dtype, impl)
        for (path, array), impl in zip(paths, impls, strict=True)
    )


def _impl(array: Any) -> Any:
    is_key = hasattr(array, "dtype") and jnp.issubdtype(array.dtype, jax.dtypes.prng_key)
    return jax.random.key_impl(array) if is_key else None


def _is_number(array: Any) -> bool:
    dtype = getattr(array, "dtype", None)
    return dtype is not None and (
        jnp.issubdtype(dtype, np.bool_)
        or jnp.issubdtype(dtype, np.integer)
        or jnp.issubdtype(dtype, np.floating)
    )


def _an_action(space: gymnasium.Space) -> jax.ShapeDtypeStruct:
    is_box = isinstance(space, gymnasium.spaces.Box)
    return jax.ShapeDtypeStruct(space.shape or (), np.float32 if is_box else np.int32)


def _kind(value: Any) -> str:
    if hasattr(value, "shape") and hasattr(value, "dtype"):
        return f"{value.dtype} of shape {tuple(value.shape)}"
    if isinstance(value, tuple):
        return f"a tuple of {len(value)} values"
    return type(value).__name__


def _said(leaf: _Leaf | None) -> str:
    return "not there" if leaf is None else f"{leaf.dtype} of shape {leaf.shape}"
