"""A simulator that is two plain functions, as an environment of Gymnasium: `from_functions`."""

from __future__ import annotations

import inspect
import re
import weakref
from collections.abc import Callable, Mapping, Sequence
from typing import Any, TypeAlias

import gymnasium
import numpy as np
from gymnasium.envs.registration import EnvSpec as GymnasiumSpec
from jaxtyping import Float32

from ..trees.groups import Group
from .plain_spaces import Actions, Observations, Values, describe_actions, describe_observations
from .spaces import describe

Reset: TypeAlias = Callable[..., Any]
Step: TypeAlias = Callable[..., Any]


def from_functions(
    reset: Reset,
    step: Step,
    *,
    observations: Mapping[str, Values],
    actions: Values | Mapping[str, Values],
    observe: Callable[[Any], Any] | None = None,
    max_steps: int | None = None,
    name: str = "Simulator",
) -> FunctionsFactory:
    """Make an environment of a simulator that has never heard of Gymnasium.

    An episode begins with one call of ``reset``. Each step of it is one call of ``step``, with the state that the call
    before returned. After each of these calls the readings are taken from the new state. Nothing else is called. An
    episode ends where ``step`` says that it is done, or after ``max_steps`` steps.

    The state is whatever the simulator needs: a dictionary, an object with attributes, or a simulator that changes
    itself. Many episodes take place side by side, so each ``reset`` must return a state of its own. A state may hold
    more than is observed.

    Args:
        reset: ``reset(rng)`` returns the state in which an episode begins. ``rng`` is a `numpy.random.Generator`, to
            draw everything random from; a function that takes no arguments is called without it.
        step: ``step(state, action, rng)`` returns ``(state, reward)`` or ``(state, reward, done)``: the next state,
            what the step has earned, and whether the task itself has ended, so that nothing more can be earned.
            ``rng`` is left out where the function takes two arguments.
        observations: The readings that the policy sees, by name, each with its values: a range ``(low, high)``, in
            which None stands for a bound that is not known; a list of options, such as ``["off", "on"]``; ``bool``; or
            ``range(11)`` for whole numbers from 0 to 10.
        actions: The values of the one thing that the policy decides, a list of options or a range, or of several
            things by name: ``{"valve": (0, 1)}``. They must all be ranges or all be lists. ``step`` gets the option
            itself, such as ``"on"``, or the number, or a dictionary of them by name.
        observe: ``observe(state)`` returns the readings, a dictionary or an object that has them, where the state has
            them under other names or has to be measured. By default the readings are taken from the state itself.
        max_steps: The number of steps after which an episode is cut, because time is up. Without one, episodes must
            end by ``done``.
        name: The name of the environment.

    Returns:
        A function that makes the environment, for `sympol.PPO`, `sympol.register` and, in a file of yours, for
        ``sympol train plant.py:NAME``.

    Raises:
        ValueError: A description of observations or actions cannot be understood, or ``max_steps`` is below 1.
        TypeError: ``reset`` or ``step`` does not take the arguments.

    Examples:
        A tank that fills and is emptied by a pump, whose level is to stay at 5 m:

        >>> import sympol
        >>> def reset(rng):
        ...     return {"level": rng.uniform(2, 8), "pump": "off"}
        >>> def step(state, action, rng):
        ...     level = state["level"] + rng.uniform(0, 0.4) - (0.5 if action == "on" else 0.0)
        ...     level = min(max(level, 0.0), 10.0)
        ...     return {"level": level, "pump": action}, -abs(level - 5)
        >>> tank = sympol.from_functions(
        ...     reset,
        ...     step,
        ...     observations={"level": (0, 10), "pump": ["off", "on"]},
        ...     actions=["off", "on"],
        ...     max_steps=200,
        ... )
        >>> spec = sympol.resolve(tank)
        >>> spec.features.names, spec.actions.names
        (('level', 'pump is off', 'pump is on'), ('off', 'on'))
    """
    limit = max_steps
    if limit is not None and (isinstance(limit, bool) or not isinstance(limit, int) or limit < 1):
        raise ValueError(
            f"max_steps must be a whole number of at least 1, or None for no limit, got {limit!r}"
        )
    if observe is not None and not callable(observe):
        raise TypeError(f"observe must be a function of the state, got {describe(observe)}")
    if not isinstance(name, str) or not re.fullmatch(r"[\w.-]+", name):
        raise ValueError(f"name must be a word of letters, digits, '-', '_' and '.', got {name!r}")
    return FunctionsFactory(
        _with_rng(reset, "reset", 0),
        _with_rng(step, "step", 2),
        describe_observations(observations),
        describe_actions(actions),
        observe,
        limit,
        name,
    )


class FunctionsFactory:
    """A function that makes the environment of two functions; `from_functions` makes it.

    It can be sent to another process if the functions can.
    """

    def __init__(
        self,
        reset: Reset,
        step: Step,
        observations: Observations,
        actions: Actions,
        observe: Callable[[Any], Any] | None,
        max_steps: int | None,
        name: str,
    ) -> None:
        self._parts = reset, step, observations, actions, observe
        self._max_steps, self._name = max_steps, name

    def __repr__(self) -> str:
        """Return the name, for messages."""
        return self._name

    def __call__(self, **kwargs: Any) -> FunctionsEnv:
        """Make an environment.

        Args:
            kwargs: None are taken.

        Returns:
            The environment.

        Raises:
            TypeError: There are arguments.
        """
        if kwargs:
            raise TypeError(f"an environment of two functions takes no arguments, got {kwargs}")
        made = FunctionsEnv(*self._parts, self._max_steps)
        made.spec = GymnasiumSpec(self._name, entry_point=self, max_episode_steps=self._max_steps)
        return made


_LIVE: weakref.WeakSet[FunctionsEnv] = weakref.WeakSet()
"""The environments that are there, none of which may share its state with another."""


class FunctionsEnv(gymnasium.Env[Float32[np.ndarray, " features"], Any]):
    """The environment of two functions; `from_functions` describes it."""

    def __init__(
        self,
        reset: Reset,
        step: Step,
        observations: Observations,
        actions: Actions,
        observe: Callable[[Any], Any] | None,
        max_steps: int | None,
    ) -> None:
        self._reset, self._step, self._observe = reset, step, observe
        self._observations, self._actions, self._max_steps = observations, actions, max_steps
        self._state, self._steps = None, 0
        self.observation_space, self.action_space = observations.space, actions.space
        self.feature_names: Sequence[str] = observations.names
        self.groups: Sequence[Group] = observations.groups
        self.integers: Sequence[int] = observations.integers
        self.action_names: Sequence[str] = actions.names
        self.action_options: Sequence[Sequence[str]] = actions.options
        _LIVE.add(self)

    def reset(
        self, *, seed: int | None = None, options: dict[str, Any] | None = None
    ) -> tuple[Float32[np.ndarray, " features"], dict[str, Any]]:
        """Begin an episode.

        Args:
            seed: The seed of the random generator that the functions get.
            options: Ignored.

        Returns:
            The observation, and an empty ``info``.
        """
        super().reset(seed=seed)
        self._state, self._steps = None, 0
        state = self._reset(self.np_random)
        if state is None:
            raise TypeError("reset must return the state in which an episode begins, got None")
        if _can_change(state) and any(
            state is other._state for other in _LIVE if other._reset is self._reset
        ):
            raise TypeError(
                "reset must return a state of its own for each episode, got the same object that another episode "
                "beside this one has: make a new one in reset (copy.deepcopy makes one of it); where there can be only "
                "one simulator, give the environment itself, which is what a call of this function makes"
            )
        self._state = state
        return self._read("reset"), {}

    def step(self, action: Any) -> tuple[Float32[np.ndarray, " features"], float, bool, bool, dict[str, Any]]:
        """Take one step.

        Args:
            action: An action of the space.

        Returns:
            Observation, reward, terminated, truncated, and an empty ``info``.
        """
        answer = self._step(self._state, self._actions.value(action), self.np_random)
        if not isinstance(answer, tuple) or len(answer) not in (2, 3):
            got = f"{len(answer)} values" if isinstance(answer, tuple) else describe(answer)
            raise TypeError(f"step must return (state, reward) or (state, reward, done), got {got}")
        self._state, reward, done = answer if len(answer) == 3 else (*answer, False)
        if self._state is None:
            raise TypeError("step must return the next state first, got None in its place")
        self._steps += 1
        late = self._max_steps is not None and self._steps >= self._max_steps
        return self._read("step"), _number(reward), _flag(done), late, {}

    def close(self) -> None:
        """Let go of the state."""
        self._state = None

    def _read(self, after: str) -> Float32[np.ndarray, " features"]:
        readings = self._state if self._observe is None else self._observe(self._state)
        where = f"the state that {after} returned" if self._observe is None else "what observe returned"
        return self._observations.read(readings, where)


def _with_rng(function: Any, name: str, arguments: int) -> Callable[..., Any]:
    """Return a function as it is called, with the random generator as its last argument."""
    shown = {"reset": "reset(rng)", "step": "step(state, action, rng)"}[name]
    if not callable(function):
        raise TypeError(f"{name} must be a function, {shown}, got {describe(function)}")
    try:
        signature = inspect.signature(function)
    except (TypeError, ValueError):  # some built-in ones have none
        return function
    given = (None,) * arguments
    for others in ((None,), ()):
        try:
            signature.bind(*given, *others)
        except TypeError:
            continue
        return function if others else _WithoutRng(function)
    raise TypeError(f"{name} must be a function that is called as {shown}, got one that takes {signature}")


class _WithoutRng:
    """A function that draws no random numbers, called as if it did."""

    def __init__(self, function: Callable[..., Any]) -> None:
        self._function = function

    def __call__(self, *arguments: Any) -> Any:
        return self._function(*arguments[:-1])


def _can_change(state: object) -> bool:
    """Return whether two episodes that share a state would disturb each other."""
    is_frozen = getattr(getattr(type(state), "__dataclass_params__", None), "frozen", False)
    return not is_frozen and (
        isinstance(state, dict | list | set | np.ndarray)
        or (hasattr(state, "__dict__") and not callable(state))
    )


def _number(reward: Any) -> float:
    try:
        return float(reward)
    except (TypeError, ValueError):
        raise TypeError(f"step must return a reward that is a number, got {describe(reward)}") from None


def _flag(done: Any) -> bool:
    if isinstance(done, bool | np.bool_) or (isinstance(done, int) and done in (0, 1)):
        return bool(done)
    raise TypeError(f"step must return a done that is True or False, got {describe(done)}")
