"""State-action decision trees: CART on what the finished teacher did."""

from __future__ import annotations

from ..trees import DecisionTree
from .cart import fit_cart
from .dataset import demonstrations, require_positive
from .teacher import Teacher


def sa_dt(teacher: Teacher, depth: int = 5, num_episodes: int = 25, seed: int = 0) -> DecisionTree:
    """Fit a tree once, on the teacher's own episodes: behavioural cloning.

    The tree never sees where its own mistakes lead; `dagger` and `viper` do. Any action space. The same seed gives
    the same tree, bit for bit.

    Raises:
        ValueError: an argument out of bounds, or a teacher whose answers do not fit.
        ImportError: scikit-learn is not installed.
    """
    require_positive(depth=depth)
    seen = demonstrations(teacher, num_episodes, seed)
    return fit_cart(seen.observations, seen.actions, teacher.spec, depth=depth, seed=seed)
