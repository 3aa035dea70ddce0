"""Optional capabilities of an environment, beyond `reset` and `step`.

An environment is asked for a capability, never for its name. What an `sympol.envs.env.Env` can offer is listed there;
this module has the values and interfaces that two of those offers return: all states of a small world
(`StateGraph`), and machine code that plays whole episodes (`NativeEngine`).
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, Protocol, runtime_checkable

import numpy as np
from jaxtyping import Bool, Float32, Float64, Int, Int32, Int64, Shaped, UInt64
from numpy import ndarray

from ..types import Step

UNREACHABLE = np.iinfo(np.int32).max
"""Number of steps to a goal that cannot be reached."""


@dataclass(frozen=True, eq=False)
class StateGraph:
    """All S states of a small deterministic environment, and where each of its A actions leads.

    Chance may choose the first state of an episode and nothing else. An episode earns a reward only when it
    terminates in a goal, and that reward depends on the time alone. The clock is no part of a state: it ends an
    episode after as many steps as ``reward_at`` has entries, less one.

    Raises:
        ValueError: shapes that do not fit each other, or an index out of range.
    """

    observations: Float32[ndarray, "observations features"]
    """Every observation there is, each once."""
    observation_of: Int32[ndarray, " states"]
    """The row of ``observations`` that is seen in each state."""
    successor: Int32[ndarray, "states actions"]
    """The state that each action leads to, -1 where it terminates the episode."""
    reaches_goal: Bool[ndarray, "states actions"]
    """Whether an action terminates the episode in a goal."""
    reward_at: Float32[ndarray, " times"]
    """Reward of reaching a goal with the n-th step of an episode, for n from 0 to the time limit."""
    index: Callable[[Any], Int[ndarray, " batch"]]
    """Return the numbers of a batch of the environment's own states, such as `Env.reset` returns; time is ignored."""

    def __post_init__(self) -> None:
        """Check shapes and ranges."""
        states = len(self.successor)
        if self.observation_of.shape != (states,) or self.reaches_goal.shape != self.successor.shape:
            raise ValueError(
                "observation_of must have one entry for each state and reaches_goal the shape of successor "
                f"{self.successor.shape}, got {self.observation_of.shape} and {self.reaches_goal.shape}"
            )
        for name, largest in (("observation_of", len(self.observations)), ("successor", states)):
            values, least = getattr(self, name), -1 if name == "successor" else 0
            if values.size and not (least <= values.min() and values.max() < largest):
                raise ValueError(
                    f"{name} must be from {least} to {largest - 1}, got {values.min()} to {values.max()}"
                )

    @property
    def max_steps(self) -> int:
        """Length of an episode that does not terminate."""
        return len(self.reward_at) - 1

    @property
    def num_actions(self) -> int:
        """Number of actions, A."""
        return self.successor.shape[1]


def steps_to_goal(
    successor: Int32[ndarray, "states actions"], reaches_goal: Bool[ndarray, "states actions"]
) -> Int32[ndarray, " states"]:
    """Return the least number of steps to a goal from each state, `UNREACHABLE` where there is no path to one.

    Args:
        successor: The state that each action leads to, -1 where it terminates the episode.
        reaches_goal: Whether an action terminates the episode in a goal.

    Returns:
        The number of steps, one for each state.
    """
    steps = np.full(len(successor), UNREACHABLE, np.int64)
    while True:
        via = np.where(successor >= 0, steps[successor], UNREACHABLE)
        nearer = np.minimum(np.where(reaches_goal, 0, via).min(axis=1) + 1, UNREACHABLE)
        if (nearer == steps).all():
            return steps.astype(np.int32)
        steps = nearer


class VectorEnvs(Protocol):
    """E copies of an environment that are stepped together on the host and restart by themselves.

    The episodes are numbered: copy i plays those with the numbers i, i + E, i + 2 E and so on, and the seed of each
    follows from its number (`sympol.envs.seeds.nth_episode_seed`), not from what happened before.
    `sympol.envs.host_envs.HostEnvs` is the form for any Gymnasium environment.
    """

    @property
    def num_envs(self) -> int:
        """Number of copies, E."""
        ...

    @property
    def replays(self) -> bool:
        """True where every episode follows from its number and its actions."""
        ...

    @property
    def skipped(self) -> Bool[ndarray, " envs"] | None:
        """The copies for which the last `step` was no step but a reset, if there are any."""
        ...

    @property
    def was_cut(self) -> bool:
        """True where `step` has truncated an episode at its ``max_steps`` since `reset`."""
        ...

    @property
    def episode(self) -> Int64[ndarray, " envs"]:
        """The number of the episode that each copy plays."""
        ...

    def reset(
        self, seed: int, num_episodes: int | None = None, episodes: Int64[ndarray, " envs"] | None = None
    ) -> Float32[ndarray, "envs features"]:
        """Begin an episode in every copy.

        Args:
            seed: The seed that all episodes' seeds are derived from.
            num_episodes: How many episodes there are: those with this number and above do not begin. By default
                there is no end of them.
            episodes: The number of the episode that each copy begins, -1 where it continues its own; by default
                the number of the copy.

        Returns:
            The observations that the next actions answer to; of copies without an episode, zeros.
        """
        ...

    def step(
        self,
        actions: Shaped[ndarray, "envs ..."],
        wanted: Bool[ndarray, " envs"] | None = None,
        max_steps: int | None = None,
    ) -> tuple[Step, Float32[ndarray, "envs features"]]:
        """Take one step in every copy, or in those that are wanted.

        Args:
            actions: One action a copy, as the policy gives it.
            wanted: Which copies to step; rows of the others in the result have no meaning. All by default.
            max_steps: Truncate an episode after as many steps.

        Returns:
            The step, with the true last observation of each episode that ended, and the observation that the next
            actions answer to: where an episode ended, the first one of the next.
        """
        ...

    def close(self) -> None:
        """Close every copy."""
        ...


class TreeArrays(Protocol):
    """T decision trees padded to N nodes; a leaf is its own child. `x[feature] <= threshold` goes left."""

    @property
    def feature(self) -> Int[ndarray, "trees nodes"]:
        """Index of the feature that each node tests."""
        ...

    @property
    def threshold(self) -> Float32[ndarray, "trees nodes"]:
        """Threshold of each node."""
        ...

    @property
    def left(self) -> Int[ndarray, "trees nodes"]:
        """Left child of each node."""
        ...

    @property
    def right(self) -> Int[ndarray, "trees nodes"]:
        """Right child of each node."""
        ...


@runtime_checkable
class NativeEngine(Protocol):
    """Machine code that steps an environment and plays whole episodes with decision trees.

    It does what Gymnasium's form of the environment does, to the bit. A seed is one episode: the same number is the
    same episode everywhere. ``actions`` hold what each node of each tree does if it is a leaf, as the environment
    takes it: int32 ``[T, N]`` for a `Discrete` space, float32 ``[T, N, A]`` for a `Box`.
    """

    @property
    def install_hint(self) -> str:
        """A hint, for messages, on what to install for faster training where `is_installed` is false."""
        ...

    def is_installed(self) -> bool:
        """Return whether the packages that it needs can be imported.

        Returns:
            True where they can.
        """
        ...

    def require_installed(self) -> None:
        """Raise `sympol.envs.errors.MissingExtra`, with the remedy, unless `is_installed`."""
        ...

    def make_envs(self, num_envs: int) -> VectorEnvs:
        """Make copies to train on.

        Args:
            num_envs: The number of copies.

        Returns:
            The copies.
        """
        ...

    def play(
        self,
        trees: TreeArrays,
        actions: Shaped[ndarray, "trees nodes ..."],
        tree_of: Int32[ndarray, " episodes"],
        seeds: UInt64[ndarray, " episodes"],
    ) -> tuple[Float64[ndarray, " episodes"], Int32[ndarray, " episodes"]]:
        """Play each episode with one of the trees.

        Args:
            trees: The trees.
            actions: What each leaf does.
            tree_of: The tree that plays each episode.
            seeds: The seed of each episode.

        Returns:
            Undiscounted returns and lengths in steps.
        """
        ...

    def play_similar(
        self,
        trees: TreeArrays,
        actions: Shaped[ndarray, "trees nodes ..."],
        seeds: UInt64[ndarray, " episodes"],
    ) -> tuple[Float64[ndarray, "trees episodes"], Int32[ndarray, "trees episodes"], int]:
        """Play every episode with every tree, where most trees act mostly like the first one.

        Steps in which trees act alike are taken once.

        Args:
            trees: The trees.
            actions: What each leaf does.
            seeds: The seed of each episode.

        Returns:
            Returns, lengths, and the number of steps that were taken.
        """
        ...

    def observe(
        self,
        trees: TreeArrays,
        actions: Shaped[ndarray, "trees nodes ..."],
        seeds: UInt64[ndarray, " episodes"],
    ) -> Float32[ndarray, "steps features"]:
        """Play episodes with the first tree, and return what it observes.

        Args:
            trees: The trees, of which the first is played.
            actions: What each leaf does.
            seeds: The seed of each episode.

        Returns:
            The observations, one row a step, one episode after the other.
        """
        ...
