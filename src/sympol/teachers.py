"""From agents to the teachers that trees are distilled from, and from a soft tree to its hard one."""

from __future__ import annotations

from typing import Any

import numpy as np
from jaxtyping import Float32, Float64

from .agents import Agent
from .algos.bounds import kept_bounds
from .distill.discretize import discretize
from .distill.soft_view import SoftView
from .distill.teacher import Teacher
from .policies.soft_tree import SoftTree
from .trees import DecisionTree
from .trees.actions import BoxActions, MultiDiscreteActions


def teacher_of(agent: Agent) -> Teacher:
    """An agent as a teacher: its deterministic actions and, of discrete ones, their log-probabilities.

    Raises:
        RuntimeError: when asked before it has learnt.
    """
    nothing_random = np.random.default_rng(0)

    def act(x: Float32[np.ndarray, "batch features"]) -> np.ndarray:
        return agent.act(x, deterministic=True, rng=nothing_random)

    def log_probabilities(x: Float32[np.ndarray, "batch features"]) -> Float64[np.ndarray, "batch outputs"]:
        logits, actions = agent.outputs(x).astype(np.float64), agent.actions
        parts = actions.split(logits) if isinstance(actions, MultiDiscreteActions) else [logits]
        return np.concatenate([log_softmax(part) for part in parts], axis=1)

    continuous = isinstance(agent.spec.actions, BoxActions)
    return Teacher(agent.spec, act, None if continuous else log_probabilities)


def log_softmax(logits: Float64[np.ndarray, "batch n"]) -> Float64[np.ndarray, "batch n"]:
    """Logarithms of the probabilities, row by row."""
    z = logits - logits.max(axis=1, keepdims=True)
    return z - np.log(np.exp(z).sum(axis=1, keepdims=True))


def discretize_agent(agent: Agent, *, prune: bool = True) -> DecisionTree:
    """The hard tree of an agent whose policy is a soft one, see `discretize`; pruned as `Agent.tree` prunes.

    Raises:
        ValueError: an agent of another policy.
        RuntimeError: before `learn`.
    """
    if not has_soft_tree(agent):
        raise ValueError(
            f"discretize makes a soft decision tree hard and needs a teacher of policy 'sdt', got "
            f"{agent.config.policy!r}; use the method viper, dagger or sa-dt"
        )
    view, features = soft_view(agent), agent.spec.features
    assert agent.state is not None
    low, high = kept_bounds(features, agent.state)
    tree = discretize(
        view.actor,
        view.shift,
        view.scale,
        actions=agent.actions,
        feature_names=features.names,
        feature_low=low,
        feature_high=high,
        groups=features.groups,
    )
    return tree.prune(observations=agent.spec.all_observations()) if prune else tree


def has_soft_tree(agent: Agent) -> bool:
    """Whether the policy is a soft tree, so that `soft_view` can show it."""
    return agent.config.policy == "sdt"


def soft_view(agent: Agent) -> SoftView:
    """The soft tree of an agent, for pictures and text.

    Raises:
        RuntimeError: before `learn`.
    """
    actor: Any = agent.actor
    assert isinstance(actor, SoftTree)
    assert agent.state is not None
    normalizer = agent.state.normalizer
    return SoftView(
        actor,
        np.asarray(normalizer.shift),
        np.asarray(normalizer.scale),
        agent.actions,
        agent.spec.features.names,
    )
