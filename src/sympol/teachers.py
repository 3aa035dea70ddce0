"""Make teachers of agents, models and functions, and trees of teachers; write soft trees for readers."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from . import files
from .agents import Agent
from .distill import METHODS, distill
from .distill.answers import check_spaces
from .distill.discretize import discretize
from .distill.picture import DEEPEST, plot_soft_tree
from .distill.soft_text import soft_text
from .distill.soft_view import SoftView
from .distill.teacher import Teacher
from .envs.registry import resolve
from .envs.spec import EnvSpec
from .policies.soft_tree import SoftTree
from .trees import DecisionTree

DISCRETIZE = "discretize"
ALL_METHODS = (*METHODS, DISCRETIZE)


def distill_policy(
    teacher: Any,
    method: str | None = None,
    depth: int | None = None,
    *,
    env: Any = None,
    seed: int = 0,
    prune: bool = True,
    **options: Any,
) -> DecisionTree:
    """Make a decision tree from another policy, or a smaller one from a tree.

    Args:
        teacher: An agent, a `Teacher`, anything with stable-baselines3's ``predict``, or a function from one
            observation, as the environment returns it, to an action. Its ``action_values`` or
            ``action_probabilities``, if it has these, are asked in the same way.
        method: ``"viper"``, ``"dagger"``, ``"sa-dt"``, or ``"discretize"`` for a soft decision tree. By default
            `default_method`.
        depth: Most comparisons before an answer, 5 by default, any number where ``max_nodes`` is given; a soft tree
            that is discretized keeps its own.
        env: Where the teacher acts: an id, a Gymnasium environment, or a function that makes one. Only agents and
            a `Teacher` know by themselves.
        seed: The same seed gives the same tree, bit for bit.
        prune: Leave out what changes no action, as `Agent.tree` does.
        options: ``max_nodes``, and the method's own; see `sympol.distill.distill`.

    Returns:
        The tree, pruned unless ``prune`` is False.

    Raises:
        ValueError: The method does not fit the teacher, the teacher does not fit the environment or returns invalid
            actions, or an option is out of bounds.
        TypeError: The object cannot be a teacher.
        RuntimeError: The agent has learnt nothing yet.
    """
    asked = as_teacher(teacher, env)
    method = default_method(teacher, asked) if method is None else method
    if method == DISCRETIZE:
        tree = _discretized(teacher, depth, options)
    elif method not in ALL_METHODS:
        raise ValueError(f"method must be one of {', '.join(ALL_METHODS)}, got {method!r}")
    else:
        tree = distill(asked, method, depth, seed, **options)
    return tree.prune(observations=asked.spec.all_observations()) if prune else tree


def default_method(teacher: Any, asked: Teacher) -> str:
    """Return the default method: discretize for a soft tree, VIPER with action values, otherwise DAgger.

    Args:
        teacher: What `distill_policy` was given.
        asked: The same as a `Teacher`.

    Returns:
        One of `ALL_METHODS`.
    """
    if isinstance(teacher, Agent) and has_soft_tree(teacher):
        return DISCRETIZE
    return "dagger" if asked.action_values is None else "viper"


def _discretized(teacher: Any, depth: int | None, options: dict[str, Any]) -> DecisionTree:
    if not isinstance(teacher, Agent):
        raise ValueError(
            f"discretize makes a soft decision tree hard and needs an agent of policy 'sdt', got {teacher!r}; use the "
            "method viper, dagger or sa-dt"
        )
    if options:
        raise ValueError(f"discretize has no options, got {', '.join(options)}: nothing is played or fitted")
    if depth is not None and has_soft_tree(teacher) and depth != teacher.config.depth:
        raise ValueError(
            f"depth must be the soft tree's own {teacher.config.depth} or left out, got {depth}: discretize keeps its "
            "nodes; for another depth use the method viper, dagger or sa-dt"
        )
    return discretize_agent(teacher, prune=False)


def as_teacher(teacher: Any, env: Any = None) -> Teacher:
    """Turn what `distill_policy` takes into a `Teacher`.

    Args:
        teacher: An agent, a `Teacher`, a model with ``predict``, or a function.
        env: Where it acts; its spaces must be those of the teacher.

    Returns:
        The teacher.

    Raises:
        ValueError: The spaces do not fit, or there is no ``env`` where it is needed.
        TypeError: The object cannot be a teacher.
    """
    spec = env if isinstance(env, EnvSpec) or env is None else resolve(env, backend="host")
    if isinstance(teacher, Agent | Teacher):
        own = teacher if isinstance(teacher, Teacher) else teacher_of(teacher)
        if spec is None or spec is own.spec:
            return own
        check_spaces(spec, own.spec.observation_space, own.spec.action_space)
        return Teacher(spec, own.act, own.action_values)
    if not callable(teacher) and not callable(getattr(teacher, "predict", None)):
        raise TypeError(
            f"a teacher is an agent, a Teacher, a model with predict, or a function from an observation to an action, "
            f"got {teacher!r}"
        )
    if spec is None:
        raise ValueError("env must be given: only an agent knows by itself where it acts")
    if callable(getattr(teacher, "predict", None)):
        return Teacher.from_model(teacher, spec)
    values, chances = (getattr(teacher, name, None) for name in ("action_values", "action_probabilities"))
    return Teacher.from_callable(teacher, spec, values, action_probabilities=chances)


def teacher_of(agent: Agent) -> Teacher:
    """Turn an agent into a teacher.

    Args:
        agent: The agent; the teacher raises RuntimeError before it has learnt.

    Returns:
        A teacher with its deterministic actions and, if they are discrete, their log-probabilities.
    """
    return Teacher.from_outputs(agent.spec, agent.outputs)


def discretize_agent(agent: Agent, *, prune: bool = True) -> DecisionTree:
    """Return the hard tree of an agent whose policy is a soft one; see `discretize`.

    Args:
        agent: The agent.
        prune: Whether to prune it as `Agent.tree` does.

    Returns:
        The tree.

    Raises:
        ValueError: The agent has another policy.
        RuntimeError: There is no policy before `learn`.
    """
    if not has_soft_tree(agent):
        raise ValueError(
            f"discretize makes a soft decision tree hard and needs a teacher of policy 'sdt', got "
            f"{agent.config.policy!r}; use the method viper, dagger or sa-dt"
        )
    view = soft_view(agent)
    tree = discretize(view.actor, view.shift, view.scale, **agent.metadata())
    return tree.prune(observations=agent.spec.all_observations()) if prune else tree


def has_soft_tree(agent: Agent) -> bool:
    """Return whether the policy is a soft tree, so that `soft_view` can show it.

    Args:
        agent: The agent.

    Returns:
        True if it is.
    """
    return agent.config.policy == "sdt"


def soft_view(agent: Agent) -> SoftView:
    """Return the soft tree of an agent, for pictures and text.

    Args:
        agent: The agent, whose policy is a soft tree.

    Returns:
        The soft tree with its scaling and names.

    Raises:
        RuntimeError: There is no policy before `learn`.
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


def keep_soft_tree(agent: Agent, folder: Path, seen: np.ndarray | None) -> dict[str, Any]:
    """Write the soft tree into its run as text and as a picture.

    Args:
        agent: The agent.
        folder: The run's folder.
        seen: Observations to count the leaves' shares from, if there are any.

    Returns:
        The fields to add to the summary.
    """
    view = soft_view(agent)
    view = view if seen is None else view.with_shares_of(seen)
    files.write(folder / "tree.txt", soft_text(view) + "\n")
    if agent.config.depth <= DEEPEST:
        plot_soft_tree(view, folder / "tree.svg")
    return {} if view.shares is None else {"leaf_shares": [round(float(share), 6) for share in view.shares]}


def kept_soft_view(agent: Agent, summary: dict[str, Any] | None) -> SoftView:
    """Return the soft tree of a run, with the shares that its summary holds.

    Args:
        agent: The agent of the run.
        summary: The summary, if there is one.

    Returns:
        The soft tree.
    """
    shares = (summary or {}).get("leaf_shares")
    return replace(soft_view(agent), shares=None if shares is None else np.asarray(shares, np.float64))
