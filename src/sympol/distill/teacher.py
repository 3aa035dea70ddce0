"""Teachers: policies that take flat observations and whose answers are checked."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import partial
from typing import Any, TypeAlias

import numpy as np
from jaxtyping import Float, Float32
from numpy.typing import ArrayLike

from ..envs.spec import EnvSpec
from ..play import fitted_actions
from ..trees.actions import BoxActions
from .answers import check_spaces, checked_actions, checked_values
from .observations import unflatten

Ask: TypeAlias = Callable[[Float32[np.ndarray, "batch features"]], ArrayLike]
"""A function from flat raw observations to one row for each of them."""

TINY = float(np.finfo(np.float32).smallest_normal)
"""The least probability whose logarithm is taken; one that became zero in float32 was no larger."""


@dataclass(frozen=True)
class Teacher:
    """A policy that a tree learns from.

    Args:
        spec: The environment it acts in.
        act: From flat raw observations ``[batch, features]`` to deterministic actions as `DecisionTree.predict`
            answers and the environment takes them: integers ``[batch]`` for ``Discrete``, ``[batch, components]``
            for ``MultiDiscrete``, floats ``[batch, *shape]`` for ``Box``. Every answer is checked, and clipped to
            the bounds. A teacher thereby plays wherever an agent does (`sympol.evaluate_policy`).
        action_values: From the same to a value for each action ``[batch, n]``: Q-values, or the log-probabilities
            of a policy; those of several components in turn. None where the teacher has none; `viper` needs them.

    Raises:
        ValueError: at every call, if what it answers does not fit, naming the observation.
    """

    spec: EnvSpec
    act: Callable[..., np.ndarray]
    action_values: Callable[..., Float[np.ndarray, "batch n"]] | None = None

    def __post_init__(self) -> None:
        """Put the checks before the answers."""
        act, values, spec = self.act, self.action_values, self.spec
        if values is not None and isinstance(spec.actions, BoxActions):
            raise ValueError(
                f"the actions of {spec.name} are continuous, they cannot be listed with a value each; leave "
                "action_values out"
            )

        def checked_act(
            x: np.ndarray, *, deterministic: bool = True, rng: np.random.Generator | None = None
        ) -> np.ndarray:
            return checked_actions(act(x), x, spec.action_space)

        object.__setattr__(self, "act", checked_act)
        if values is not None:
            n_values = spec.actions.n_outputs
            object.__setattr__(self, "action_values", lambda x: checked_values(values(x), x, n_values))

    @classmethod
    def from_callable(
        cls,
        function: Callable[[Any], Any],
        spec: EnvSpec,
        action_values: Callable[[Any], ArrayLike] | None = None,
        *,
        action_probabilities: Callable[[Any], ArrayLike] | None = None,
        batched: bool = False,
    ) -> Teacher:
        """Make a teacher of any function from an observation of the environment to an action.

        It is called with one observation at a time, just as the environment returns it. With ``batched=True`` it is
        called with a batch (leading axis on every array), which is faster. Guessing which of the two it takes would
        go wrong silently where both run.

        Args:
            function: Maps an observation, as the environment returns it, to an action.
            spec: The environment it acts in.
            action_values: Maps an observation to one value for each action, called in the same way.
            action_probabilities: Maps an observation to the probability of each action, instead of values.
            batched: Whether all of these take batches.

        Returns:
            The teacher.

        Raises:
            TypeError: what is not callable.
            ValueError: values and probabilities both.
        """
        given = {
            "function": function,
            "action_values": action_values,
            "action_probabilities": action_probabilities,
        }
        for name, asked in given.items():
            if not (callable(asked) or (asked is None and name != "function")):
                raise TypeError(f"{name} must be callable with an observation, got {asked!r}")
        if action_values is not None and action_probabilities is not None:
            raise ValueError("give action_values or action_probabilities, not both: they mean the same")

        def ask(asked: Callable[[Any], Any], x: np.ndarray) -> Any:
            if batched:
                return asked(unflatten(spec.observation_space, x))
            return [asked(unflatten(spec.observation_space, row)) for row in x]

        values = action_values or action_probabilities
        if values is not None:
            values = partial(ask, values)
        if values is not None and action_probabilities is not None:
            values = partial(_log_of, values)
        return cls(spec, partial(ask, function), values)

    @classmethod
    def from_outputs(cls, spec: EnvSpec, outputs: Callable[[np.ndarray], np.ndarray]) -> Teacher:
        """Make a teacher of the outputs of an actor of ours.

        Args:
            spec: The environment it acts in.
            outputs: Maps flat observations to logits, or to means of continuous actions, ``[batch, outputs]``.

        Returns:
            A teacher with the deterministic actions and, if they are discrete, their log-probabilities.
        """
        actions = spec.actions

        def act(x: np.ndarray) -> np.ndarray:
            return fitted_actions(actions.decide(outputs(x)), spec.action_space)

        def log_probabilities(x: np.ndarray) -> np.ndarray:
            assert not isinstance(actions, BoxActions)
            parts = actions.split(outputs(x).astype(np.float64))
            return np.concatenate([log_softmax(part) for part in parts], axis=1)

        return cls(spec, act, None if isinstance(actions, BoxActions) else log_probabilities)

    @classmethod
    def from_model(cls, model: Any, spec: EnvSpec) -> Teacher:
        """Make a teacher of anything with stable-baselines3's ``predict`` for batches of observations.

        A model of stable-baselines3 gives its action values, too: DQN its Q-values, PPO and A2C with discrete actions
        their log-probabilities.

        Args:
            model: The model.
            spec: The environment it acts in.

        Returns:
            The teacher.

        Raises:
            TypeError: no ``predict``.
            ValueError: the model says which spaces it is for, and they are not the environment's.
        """
        if not callable(getattr(model, "predict", None)):
            raise TypeError(f"a model needs a predict(observation, deterministic=True), got {model!r}")
        its = [getattr(model, name, None) for name in ("observation_space", "action_space")]
        if None not in its:
            check_spaces(spec, *its)

        def act(x: np.ndarray) -> Any:
            return model.predict(unflatten(spec.observation_space, x), deterministic=True)[0]

        values = None if isinstance(spec.actions, BoxActions) else find_action_values(model)
        asked = values and (lambda x: values(unflatten(spec.observation_space, x)))
        return cls(spec, act, asked)


def log_softmax(logits: Float[np.ndarray, "batch n"]) -> Float[np.ndarray, "batch n"]:
    """Compute the logarithms of probabilities, row by row.

    Args:
        logits: The logits.

    Returns:
        Log-probabilities of the same shape.
    """
    z = logits - logits.max(axis=1, keepdims=True)
    return z - np.log(np.exp(z).sum(axis=1, keepdims=True))


def find_action_values(model: Any) -> Callable[[Any], np.ndarray] | None:
    """Return a function that computes a stable-baselines3 model's action values.

    Those of DQN are Q-values, those of PPO, A2C and the like with discrete actions log-probabilities, of several
    components in turn.

    Args:
        model: The model.

    Returns:
        A function from a batch of observations to the values, or None if the model has none.
    """
    policy: Any = getattr(model, "policy", None)
    q_net: Any = getattr(model, "q_net", None)
    get_distribution: Any = getattr(policy, "get_distribution", None)
    if not callable(getattr(policy, "obs_to_tensor", None)) or not (q_net or get_distribution):
        return None

    def values(observations: Any) -> np.ndarray:
        policy.set_training_mode(False)
        tensors, _ = policy.obs_to_tensor(observations)
        if q_net is not None:
            return q_net(tensors).detach().cpu().numpy()
        parts = get_distribution(tensors).distribution
        parts = parts if isinstance(parts, list | tuple) else [parts]
        # the logits of torch's Categorical are normalised: they are log-probabilities
        return np.concatenate([part.logits.detach().cpu().numpy() for part in parts], axis=1)

    return values


def _log_of(probabilities: Ask, x: np.ndarray) -> np.ndarray:
    """Compute logarithms of probabilities, of which none may be negative or more than one (and some float error)."""
    chances = np.asarray(probabilities(x), np.float64)
    if (chances < 0).any() or (chances > 1 + 1e-3).any():
        worst = chances.flat[np.argmax(np.abs(chances - 0.5))]
        raise ValueError(
            f"probabilities must be from 0 to 1, got {worst}; are they logits? then give them as action_values"
        )
    return np.log(np.maximum(chances, TINY))
