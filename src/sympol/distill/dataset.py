"""Observations, and the actions of the teacher in them."""

from __future__ import annotations

from collections.abc import Callable
from typing import NamedTuple

import numpy as np
from jaxtyping import Float32, Float64

from ..play import play
from .teacher import Teacher

Losses = Callable[[np.ndarray], np.ndarray]
"""Map observations ``[samples, features]`` to the possible cost of a wrong action in each."""
DEPTH = 5
"""The depth of a tree by default."""


class Demonstrations(NamedTuple):
    """Observations with the teacher's actions in them."""

    observations: Float32[np.ndarray, "samples features"]
    """Flat observations, whichever policy visited them."""
    actions: np.ndarray
    """As the environment takes them, ``[samples, *shape]``."""
    losses: Float64[np.ndarray, " samples"] | None = None
    """The possible cost of a wrong action in each observation, if it is needed."""

    @property
    def size(self) -> int:
        """Number of observations."""
        return len(self.observations)

    def joined(self, more: Demonstrations) -> Demonstrations:
        """Return these demonstrations followed by others.

        Args:
            more: The demonstrations to append.

        Returns:
            Both; with losses only if both have them.
        """
        losses = None
        if self.losses is not None and more.losses is not None:
            losses = np.concatenate([self.losses, more.losses])
        return Demonstrations(
            np.concatenate([self.observations, more.observations]),
            np.concatenate([self.actions, more.actions]),
            losses,
        )

    def rows(self, index: np.ndarray) -> Demonstrations:
        """Return some of the demonstrations.

        Args:
            index: Row numbers, ``[selected]``; repetitions are allowed.

        Returns:
            The selected rows.
        """
        losses = None if self.losses is None else self.losses[index]
        return Demonstrations(self.observations[index], self.actions[index], losses)


def demonstrations(teacher: Teacher, num_episodes: int = 25, seed: int = 0) -> Demonstrations:
    """Let the teacher play whole episodes, on seeds that nothing else uses (`sympol.play`, purpose "distill").

    Everything is deterministic except the environment.

    Args:
        teacher: The policy to play.
        num_episodes: Number of whole episodes.
        seed: The same seed gives the same episodes.

    Returns:
        All observations of these episodes and the teacher's actions in them.

    Raises:
        ValueError: a number of episodes below one, a negative seed, an environment that cannot be played, or a
            teacher whose answers do not fit.
    """
    require_positive(num_episodes=num_episodes)
    require_seed(seed)
    played = play(teacher, teacher.spec, num_episodes, seed=seed, purpose="distill")
    return labelled(teacher, played.observations)


def labelled(
    teacher: Teacher, x: Float32[np.ndarray, "samples features"], losses: Losses | None = None
) -> Demonstrations:
    """Label observations with the teacher's actions, whichever policy visited them."""
    return Demonstrations(x, teacher.act(x), None if losses is None else losses(x))


def require_positive(**numbers: int) -> None:
    """Raise ValueError, by its name, for a number below one or not whole."""
    for name, number in numbers.items():
        if isinstance(number, bool) or not isinstance(number, int | np.integer) or number < 1:
            raise ValueError(f"{name} must be a whole number of at least 1, got {number!r}")


class Limits(NamedTuple):
    """Limits of a tree's size: most comparisons before an answer, most nodes; None is no limit."""

    depth: int | None
    max_nodes: int | None

    @staticmethod
    def of(depth: int | None, max_nodes: int | None) -> Limits:
        """Return the limits that a user set; a depth of `DEPTH` by default.

        Raises:
            ValueError: a depth below one, or a number of nodes that no tree with a question has.
        """
        if depth is not None:
            require_positive(depth=depth)
        if max_nodes is None:
            return Limits(DEPTH if depth is None else depth, None)
        require_positive(max_nodes=max_nodes)
        if max_nodes < 3 or max_nodes % 2 == 0:
            raise ValueError(
                f"max_nodes must be odd and at least 3, as a tree has one leaf more than it has splits, got {max_nodes}"
            )
        return Limits(depth, max_nodes)


def require_seed(seed: int) -> None:
    """Raise ValueError for what scikit-learn and NumPy do not take as a seed."""
    if isinstance(seed, bool) or not isinstance(seed, int | np.integer) or not 0 <= seed < 2**32:
        raise ValueError(f"seed must be a whole number from 0 to 2^32 - 1, got {seed!r}")
