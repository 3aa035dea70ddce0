"""Evaluators: the returns of trees on shared episodes, by the fastest way to play an environment."""

from __future__ import annotations

from ...envs.spec import EnvSpec
from .base import Evaluator, Purpose, Returns

__all__ = ["Evaluator", "Purpose", "Returns", "make_evaluator"]


def make_evaluator(spec: EnvSpec, seed: int, purpose: Purpose = "refine") -> Evaluator:
    """Return the fastest evaluator an environment has: tabular, compiled in JAX, native, or Gymnasium.

    Args:
        spec: The environment, as `sympol.resolve` returns it.
        seed: The seed of the episodes, between 0 and 2^32 - 1.
        purpose: Episodes to search with, or others to validate with.

    Returns:
        The evaluator; environments and compiled programs are opened when it first plays.

    Raises:
        ValueError: A seed out of range, or an unknown purpose.
    """
    if spec.env is not None:
        if spec.state_graph() is not None:
            from .tabular import TabularEvaluator

            return TabularEvaluator(spec, seed, purpose)
        from .jax import JaxEvaluator

        return JaxEvaluator(spec, seed, purpose)
    if spec.native is not None:
        from .native import NativeEvaluator

        return NativeEvaluator(spec, seed, purpose)
    from .gymnasium import GymnasiumEvaluator

    return GymnasiumEvaluator(spec, seed, purpose)
