"""Reinforcement learning whose policy is a decision tree you can read.

>>> import sympol
>>> agent = sympol.PPO("tree", "CartPole-v1", seed=0)
>>> agent.learn(total_timesteps=1_000_000)
>>> print(agent.tree())
"""

from __future__ import annotations

import time
from importlib import import_module
from typing import TYPE_CHECKING, Any

from .version import __version__ as __version__

STARTED = time.perf_counter()
"""The time at which sympol was first imported, from which a run's ``wall_seconds`` count."""

if TYPE_CHECKING:
    from .agents import A2C, PPO, load
    from .algorithms.warm_start import Start
    from .envs.functions import from_functions
    from .envs.registry import register, resolve
    from .evaluate import evaluate_policy, watch
    from .serving import RecordDecisions, SymbolicPolicy
    from .teachers import distill_policy
    from .trees import DecisionTree

_HOMES = {
    "A2C": "agents",
    "PPO": "agents",
    "Start": "algorithms.warm_start",
    "from_functions": "envs.functions",
    "load": "agents",
    "register": "envs.registry",
    "resolve": "envs.registry",
    "distill_policy": "teachers",
    "evaluate_policy": "evaluate",
    "watch": "evaluate",
    "RecordDecisions": "serving",
    "SymbolicPolicy": "serving",
    "DecisionTree": "trees",
}

__all__ = [
    "A2C",
    "PPO",
    "DecisionTree",
    "RecordDecisions",
    "Start",
    "SymbolicPolicy",
    "distill_policy",
    "evaluate_policy",
    "from_functions",
    "load",
    "register",
    "resolve",
    "watch",
]


def __getattr__(name: str) -> Any:
    """Import a public name on first use, so that reading a tree does not wait for JAX."""
    if name not in _HOMES:
        raise AttributeError(f"module 'sympol' has no attribute {name!r}; it has {', '.join(__all__)}")
    return getattr(import_module(f".{_HOMES[name]}", __name__), name)
