"""One Gymnasium environment on the host: its answers are checked, and its failures named."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, NamedTuple, SupportsFloat

import gymnasium
import numpy as np
from jaxtyping import Float32
from numpy import ndarray

from .errors import EnvironmentFailure
from .spaces import LARGEST, describe


def require_finite(what: str, values: Float32[ndarray, "envs ..."]) -> None:
    """Refuse NaN and infinity.

    Args:
        what: The name of the values, for the message.
        values: The values of each environment.

    Raises:
        EnvironmentFailure: A value is not finite; the message names the environment.
    """
    if np.isfinite(values).all():
        return
    index = np.argwhere(~np.isfinite(values))[0][0]
    raise EnvironmentFailure(
        f"environment {index} returned {what} that is not finite in float32: {values[index]}"
    )


def require_held(what: str, observations: Float32[ndarray, "envs features"], names: Sequence[str]) -> None:
    """Refuse observations that are not finite, or too large to be scaled in float32.

    Args:
        what: The name of the observations, for the message.
        observations: The observation of each environment.
        names: The names of the features.

    Raises:
        EnvironmentFailure: A feature breaks the rule; the message names it and the environment.
    """
    if (np.abs(observations) <= LARGEST).all():
        return
    require_finite(what, observations)
    index, feature = map(int, np.argwhere(np.abs(observations) > LARGEST)[0])
    raise EnvironmentFailure(
        f"environment {index} returned {what} with {names[feature]} = {observations[index, feature]:g}; "
        f"{too_large([names[feature]])}"
    )


def too_large(names: Sequence[str]) -> str:
    """Return the part of a message that says what to do about features beyond `LARGEST`.

    Args:
        names: The names of the features.

    Returns:
        The rule and the remedy.
    """
    return (
        f"{', '.join(names)} must be at most {LARGEST:.2g} in magnitude, as larger numbers cannot be scaled in "
        "float32: give it in a larger unit, or its logarithm (gymnasium.wrappers.TransformObservation)"
    )


class StepResult(NamedTuple):
    """The answer of one Gymnasium environment to an action, without its ``info``."""

    observation: Any
    reward: float
    terminated: bool
    truncated: bool


def begin(env: gymnasium.Env, who: str = "", **options: Any) -> Any:
    """Start an episode of one environment.

    Args:
        env: The environment.
        who: Its name in messages, by default that of its class.
        options: Arguments of its ``reset``.

    Returns:
        The first observation, as the environment gave it.

    Raises:
        EnvironmentFailure: It raised an error, such as a TypeError, or did not return ``(observation, info)``.
    """
    try:
        answer: Any = env.reset(**options)
        if not isinstance(answer, tuple) or len(answer) != 2:
            raise TypeError(
                f"reset() must return (observation, info), got {describe(answer)}; the older Gym interface has the "
                "observation alone: return an empty dict beside it"
            )
    except Exception as error:
        raise failure(env, who, "reset()", error) from error
    return answer[0]


def advance(env: gymnasium.Env, action: Any, who: str = "") -> StepResult:
    """Take one step in one environment.

    A reward or flag may also be an array that holds one number, such as one of shape (1,).

    Args:
        env: The environment.
        action: The action, as the environment takes it.
        who: Its name in messages, by default that of its class.

    Returns:
        The result.

    Raises:
        EnvironmentFailure: It raised an error, such as a TypeError, or did not return
            ``(observation, reward, terminated, truncated, info)``.
    """
    try:
        answer: Any = env.step(action)
        if not isinstance(answer, tuple) or len(answer) != 5:
            values = f"{len(answer)} values" if isinstance(answer, tuple) else describe(answer)
            raise TypeError(
                f"step() must return (observation, reward, terminated, truncated, info), got {values}; the older Gym "
                "interface has one flag, done: say whether the task itself ended (terminated) or only the time was up "
                "(truncated)"
            )
        observation, reward, terminated, truncated, _ = answer
        if type(reward) is not float:
            reward = float(_single("reward", "a number", reward))
        if type(terminated) is not bool:
            terminated = bool(_single("terminated", "true or false", terminated))
        if type(truncated) is not bool:
            truncated = bool(_single("truncated", "true or false", truncated))
        return StepResult(observation, reward, terminated, truncated)
    except Exception as error:
        raise failure(env, who, f"step({action!r})", error) from error


def failure(env: gymnasium.Env, who: str, where: str, error: Exception) -> EnvironmentFailure:
    """Return the error that names an environment and what it failed in.

    Args:
        env: The environment.
        who: Its name in messages, by default that of its class.
        where: The call.
        error: What was raised.

    Returns:
        The error to raise.
    """
    who = who or type(env.unwrapped).__name__
    hint = ""
    if isinstance(error, ValueError) and "to unpack" in str(error):  # by a wrapper, such as TimeLimit
        hint = (
            "; if the environment has the older Gym interface: reset() must return (observation, info), and step() "
            "(observation, reward, terminated, truncated, info)"
        )
    return EnvironmentFailure(f"{who} failed in {where}: {type(error).__name__}: {error}{hint}")


def _single(what: str, kind: str, value: Any) -> Any:
    """Return the one number that a value is or holds."""
    if isinstance(value, bool | int | float):
        return value
    try:
        array = np.asarray(value)
        number = array.item() if array.size == 1 else None
        if isinstance(number, SupportsFloat):
            return number
    except ValueError:  # ragged
        pass
    raise TypeError(f"{what} must be {kind}, got {describe(value)}")
