"""Check the answers of a teacher: shape, kind of number, range, and that they are finite."""

from __future__ import annotations

from typing import Any

import gymnasium
import numpy as np
from gymnasium.spaces import Box, Discrete, MultiDiscrete
from jaxtyping import Float, Float32
from numpy.typing import ArrayLike

from ..play import fitted_actions

Batch = Float32[np.ndarray, "batch features"]


def checked_actions(answer: ArrayLike, x: Batch, space: gymnasium.Space) -> np.ndarray:
    """Check a teacher's actions and convert them to those that the environment takes.

    Continuous actions are clipped to the bounds, as a tree's and stable-baselines3's are: beyond them the
    environment would do the same, and a regression would learn a difference that there is not.

    Args:
        answer: What the teacher returned.
        x: The observations that it was asked about.
        space: The action space.

    Returns:
        The actions ``[batch, *space.shape]``.

    Raises:
        ValueError: A shape, a kind of number or a category does not fit, or a number is not finite.
    """
    shape = (len(x), *(space.shape or ()))
    actions = _numbers(answer, shape, x, "an action", f"the action space is {space}")
    if not isinstance(space, Discrete | MultiDiscrete):
        return fitted_actions(actions, space)
    if actions.dtype.kind not in "iu":
        raise ValueError(
            f"a teacher's actions for {space} must be integers, got {actions.dtype} {_first(actions)}; round them, "
            "or convert them by int(...)"
        )
    low = np.asarray(space.start)
    high = low + (space.n if isinstance(space, Discrete) else space.nvec) - 1
    outside = (actions < low) | (actions > high)
    if outside.any():
        row = int(np.argwhere(outside)[0][0])
        raise ValueError(
            f"a teacher's actions must be from {low.tolist()} to {high.tolist()}, got {actions[row].tolist()} for "
            f"the observation {x[row].tolist()}; the action space is {space}"
        )
    return fitted_actions(actions, space)


def checked_values(answer: ArrayLike, x: Batch, n_values: int) -> Float[np.ndarray, "batch values"]:
    """Check a teacher's action values.

    Args:
        answer: What the teacher returned.
        x: The observations that it was asked about.
        n_values: The number of values for each.

    Returns:
        The values as float64.

    Raises:
        ValueError: The shape is another, or a number is not finite.
    """
    rule = f"there are {n_values} actions (options of all components), and each has one value"
    return _numbers(answer, (len(x), n_values), x, "action values", rule).astype(np.float64)


def _numbers(answer: ArrayLike, shape: tuple[int, ...], x: Batch, what: str, rule: str) -> np.ndarray:
    try:
        numbers = np.asarray(answer)
    except ValueError:  # ragged
        numbers = np.empty((), object)
    if numbers.dtype.kind not in "fiu":
        raise ValueError(f"a teacher must answer {what} in numbers, got {_first(answer)}; {rule}")
    if numbers.shape != shape:
        raise ValueError(
            f"a teacher must answer {what} of shape {shape[1:]} for each of {len(x)} observations, together {shape}, "
            f"got {numbers.shape}; {rule}"
        )
    wrong = ~np.isfinite(numbers)
    if wrong.any():
        row = int(np.argwhere(wrong)[0][0])
        raise ValueError(
            f"a teacher must answer {what} that is finite, got {numbers[row].tolist()} for the observation "
            f"{x[row].tolist()}; correct the teacher (a log-probability of -inf: clip it)"
        )
    return numbers


def _first(answer: Any) -> str:
    text = repr(answer[0] if np.ndim(answer) else answer) if isinstance(answer, np.ndarray) else repr(answer)
    return text if len(text) <= 60 else text[:57] + "…"


def check_spaces(spec: Any, observation_space: Any, action_space: Any) -> None:
    """Check that a teacher's spaces are those of the environment it is to act in.

    Observations must agree in shape; actions in their number, or in shape and bounds.

    Args:
        spec: The environment.
        observation_space: The teacher's observation space.
        action_space: The teacher's action space.

    Raises:
        ValueError: They do not agree; the message names both.
    """
    pairs = (
        ("observation", observation_space, spec.observation_space, False),
        ("action", action_space, spec.action_space, True),
    )
    for what, its, ours, bounds in pairs:
        if not _fits(its, ours, bounds=bounds):
            raise ValueError(
                f"the teacher's {what} space {its} does not fit that of {spec.name}, {ours}; give the environment "
                "it was trained on"
            )


def _fits(a: Any, b: Any, *, bounds: bool) -> bool:
    match a, b:
        case (Box(), Box()):
            same = a.shape == b.shape
            return same and not (bounds and not (np.allclose(a.low, b.low) and np.allclose(a.high, b.high)))
        case (gymnasium.spaces.Dict(), gymnasium.spaces.Dict()):
            keys = a.spaces.keys() == b.spaces.keys()
            return keys and all(_fits(a[key], b[key], bounds=bounds) for key in a.spaces)
        case (gymnasium.spaces.Tuple(), gymnasium.spaces.Tuple()):
            both = zip(a.spaces, b.spaces, strict=True)
            return len(a) == len(b) and all(_fits(p, q, bounds=bounds) for p, q in both)
    return bool(a == b)
