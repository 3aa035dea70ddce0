"""State-action decision trees: CART on the actions of a finished teacher."""

from __future__ import annotations

from ..trees import DecisionTree
from .cart import fit_cart
from .dataset import Limits, demonstrations
from .teacher import Teacher


def sa_dt(
    teacher: Teacher,
    depth: int | None = None,
    num_episodes: int = 25,
    seed: int = 0,
    max_nodes: int | None = None,
) -> DecisionTree:
    """Fit a tree once, on the teacher's own episodes: behavioural cloning.

    The tree never sees where its own mistakes lead; with `dagger` and `viper` it does. Any action space is supported.

    Args:
        teacher: The policy to imitate.
        depth: Most comparisons before an answer; see `sympol.distill.distill`.
        num_episodes: Whole episodes that the teacher plays.
        seed: The same seed gives the same tree, bit for bit.
        max_nodes: Most nodes, leaves included; odd.

    Returns:
        The fitted tree, not pruned.

    Raises:
        ValueError: an argument out of bounds, or a teacher whose answers do not fit.
    """
    limits = Limits.of(depth, max_nodes)
    seen = demonstrations(teacher, num_episodes, seed)
    return fit_cart(seen.observations, seen.actions, teacher.spec, seed=seed, **limits._asdict())
