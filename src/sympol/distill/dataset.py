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
    """Observations with the teacher's actions in them, and what a wrong action may cost."""

    observations: Float32[np.ndarray, "samples features"]
    """Flat observations, whichever policy visited them."""
    actions: np.ndarray
    """The teacher's actions as the environment takes them, ``[samples, *shape]``."""
    losses: Float64[np.ndarray, " samples"] | None = None
    """The possible cost of a wrong action in each observation, if it is needed."""

    @property
    def size(self) -> int:
        """The number of observations."""
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
    """Label observations with the teacher's actions.

    Args:
        teacher: The teacher.
        x: Flat observations, whichever policy visited them.
        losses: A function that computes losses, if they are needed.

    Returns:
        The demonstrations.
    """
    return Demonstrations(x, teacher.act(x), None if losses is None else losses(x))


def require_positive(**numbers: int) -> None:
    """Check that numbers are whole and at least one.

    Args:
        numbers: The numbers by name.

    Raises:
        ValueError: A number breaks the rule; the message names it.
    """
    for name, number in numbers.items():
        if isinstance(number, bool) or not isinstance(number, int | np.integer) or number < 1:
            raise ValueError(f"{name} must be a whole number of at least 1, got {number!r}")


class Limits(NamedTuple):
    """Limits of a tree's size; None is no limit.

    Attributes:
        depth: The most comparisons before an answer.
        max_nodes: The most nodes.
    """

    depth: int | None
    max_nodes: int | None

    @staticmethod
    def of(depth: int | None, max_nodes: int | None) -> Limits:
        """Return the limits that a user set.

        Args:
            depth: The most comparisons; by default `DEPTH`, or any number where ``max_nodes`` is given.
            max_nodes: The most nodes, if they are limited.

        Returns:
            The limits.

        Raises:
            ValueError: The depth is below one, or no tree with a comparison has so few nodes.
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
    """Check that scikit-learn and NumPy take a seed.

    Args:
        seed: The seed.

    Raises:
        ValueError: It is no whole number from 0 to 2^32 - 1.
    """
    if isinstance(seed, bool) or not isinstance(seed, int | np.integer) or not 0 <= seed < 2**32:
        raise ValueError(f"seed must be a whole number from 0 to 2^32 - 1, got {seed!r}")
