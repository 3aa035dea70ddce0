"""Distillation: make a decision tree from a teacher."""

from __future__ import annotations

import inspect
from collections.abc import Callable, Mapping
from typing import Any

from ..trees import DecisionTree
from .cart import from_sklearn
from .dagger import dagger
from .dataset import Demonstrations, demonstrations
from .imitate import Iteration
from .sa_dt import sa_dt
from .sb3 import load_sb3
from .teacher import Teacher
from .viper import viper

__all__ = [
    "METHODS",
    "Demonstrations",
    "Iteration",
    "Teacher",
    "dagger",
    "demonstrations",
    "distill",
    "from_sklearn",
    "load_sb3",
    "sa_dt",
    "viper",
]

METHODS: Mapping[str, Callable[..., DecisionTree]] = {"sa-dt": sa_dt, "viper": viper, "dagger": dagger}
"""By name; each takes a teacher, ``depth``, ``max_nodes``, ``seed`` and options of its own."""


def distill(
    teacher: Teacher, method: str = "viper", depth: int | None = None, seed: int = 0, **options: Any
) -> DecisionTree:
    """Make a tree from a teacher by one of the `METHODS`.

    Args:
        teacher: The policy to imitate, with its environment.
        method: ``"viper"`` (discrete actions, and a teacher with action values), ``"dagger"`` (any), or
            ``"sa-dt"`` (any; the teacher's own episodes alone).
        depth: Most comparisons before an answer; by default 5, or any number where ``max_nodes`` is given.
        seed: The same seed gives the same tree, bit for bit.
        options: ``max_nodes``, an odd number: the most nodes, leaves among them; the tree then grows where that gains
            most. And the method's own: ``num_episodes`` of sa_dt; ``num_iterations``, ``episodes_per_iteration``,
            ``max_samples``, ``num_validation_episodes``, ``progress`` and ``play_tree`` of viper and dagger.

    Returns:
        The tree, not pruned.

    Raises:
        ValueError: no such method, an option that it lacks, or an argument that the method refuses.
    """
    if method not in METHODS:
        raise ValueError(f"method must be one of {', '.join(METHODS)}, got {method!r}")
    known = [name for name in inspect.signature(METHODS[method]).parameters if name != "teacher"]
    if unknown := sorted(options.keys() - {*known}):
        raise ValueError(f"{method} has no option {', '.join(unknown)}; it has {', '.join(known)}")
    return METHODS[method](teacher, depth=depth, seed=seed, **options)
