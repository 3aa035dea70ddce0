"""Play whole episodes on Gymnasium, side by side, on seeds that no training uses."""

from __future__ import annotations

from collections import deque
from collections.abc import Callable, Sequence
from itertools import islice
from typing import Any, Literal, NamedTuple, Protocol, TypeAlias, runtime_checkable

import gymnasium
import numpy as np

from .envs.copies import open_copies
from .envs.diagnostics import warn_of_cut, warn_of_same_episodes
from .envs.env import MAX_EPISODE_STEPS
from .envs.host import advance, begin
from .envs.spec import EnvSpec
from .trees import DecisionTree
from .trees.actions import ActionSpec, BoxActions

Purpose: TypeAlias = Literal["test", "validation", "distill", "refine"]
PURPOSE_TAGS: dict[Purpose, int] = {
    "test": 0x7E57,
    "validation": 0x7A11D,
    "distill": 0xD157,
    "refine": 0x5EF1,
}
"""Tags mixed into the seed of every episode played for a purpose, so that no purpose shares episodes with another."""
PLAYED_BY: dict[Purpose, str] = {
    "test": "evaluation",
    "validation": "validation",
    "distill": "distillation",
    "refine": "the search",
}
"""Names, in messages, of the activities that play episodes for each purpose."""
FEW = 5
"""Fewer test episodes may be the same by chance."""

Act: TypeAlias = Callable[[np.ndarray], np.ndarray]
"""A function from flat observations ``[batch, features]`` to as many actions, as the environment takes them."""


@runtime_checkable
class Acting(Protocol):
    """A policy that takes flat observations in batches, as agents do."""

    def act(self, x: np.ndarray, *, deterministic: bool, rng: np.random.Generator) -> np.ndarray:
        """Choose actions.

        Args:
            x: Flat observations ``[batch, features]``.
            deterministic: Whether to choose the best actions instead of sampling.
            rng: The source of randomness to sample with.

        Returns:
            Actions as the environment takes them, one for each row.
        """
        ...


class Episodes(NamedTuple):
    """The results of some episodes.

    Attributes:
        returns: Undiscounted returns ``[episodes]``.
        lengths: Lengths in steps ``[episodes]``.
        observations: The flat observations acted on ``[steps, features]``.
    """

    returns: np.ndarray
    lengths: np.ndarray
    observations: np.ndarray


def play(
    policy: DecisionTree | Acting | Act,
    spec: EnvSpec,
    num_episodes: int,
    *,
    seed: int,
    deterministic: bool = True,
    purpose: Purpose = "test",
) -> Episodes:
    """Play episodes side by side on a bounded number of copies, so that the policy answers them in batches.

    A copy whose episode has ended takes the next one. How many copies there are (`open_copies`) changes nothing for
    a deterministic policy; one that samples draws its noise in the order in which the episodes are played. Warns where
    episodes are cut, and where test episodes of a deterministic policy are all the same.

    Args:
        policy: A tree, an agent, or a function from flat observations to actions.
        spec: The environment.
        num_episodes: The number of episodes.
        seed: The seed; another is another set of episodes.
        deterministic: Whether the policy takes its best actions instead of sampling.
        purpose: What the episodes are for; each purpose has episodes of its own, whatever the seed.

    Returns:
        The results.
    """
    act = acting(policy, spec, deterministic, np.random.default_rng([seed, PURPOSE_TAGS[purpose]]))
    seeds = [episode_seed(seed, episode, purpose) for episode in range(num_episodes)]
    with open_copies(spec, num_episodes) as copies:
        played = play_side_by_side(lambda _, x: act(x), spec, copies, seeds)
    if played.were_cut:
        warn_of_cut(spec.name, PLAYED_BY[purpose], limit_of(spec))
    episodes = Episodes(played.returns, played.lengths, played.step_by_step())
    if deterministic and purpose == "test" and _are_the_same(episodes):
        warn_of_same_episodes(spec.name, num_episodes)
    return episodes


class SideBySide(NamedTuple):
    """The results of episodes that were played side by side, with observations in the order of playing.

    Attributes:
        returns: Undiscounted returns ``[episodes]``.
        lengths: Lengths in steps ``[episodes]``.
        were_cut: Whether an episode was cut at the limit of steps.
        episode: The number of the episode in which each observation was made ``[steps]``.
        observations: The flat observations ``[steps, features]``.
    """

    returns: np.ndarray
    lengths: np.ndarray
    were_cut: bool
    episode: np.ndarray
    observations: np.ndarray

    def step_by_step(self) -> np.ndarray:
        """Sort the observations by step.

        Returns:
            The first observation of every episode, then the second of those that have one, and so on.
        """
        by_episode = np.argsort(self.episode, kind="stable")
        step = np.concatenate([np.arange(length) for length in self.lengths])
        return self.observations[by_episode[np.argsort(step, kind="stable")]]

    def one_by_one(self) -> np.ndarray:
        """Sort the observations by episode.

        Returns:
            The observations of one episode after the other.
        """
        return self.observations[np.argsort(self.episode, kind="stable")]


def play_side_by_side(
    act: Callable[[np.ndarray, np.ndarray], np.ndarray],
    spec: EnvSpec,
    copies: Sequence[gymnasium.Env],
    seeds: Sequence[int],
    *,
    limit: int | None = None,
    watch: bool = True,
) -> SideBySide:
    """Play an episode for each seed; a copy whose episode has ended takes the next one.

    Args:
        act: A function from the numbers of the running episodes and their flat observations to as many actions.
        spec: The environment.
        copies: The copies to play on.
        seeds: The seed of each episode. The number of an episode is its position here.
        limit: The number of steps after which an episode is cut, by default `limit_of`.
        watch: Whether to keep the observations; otherwise there are none.

    Returns:
        The results.
    """
    returns, lengths, were_cut = np.zeros(len(seeds)), np.zeros(len(seeds), int), False
    limit = limit or limit_of(spec)
    waiting, free = iter(range(len(seeds))), deque(copies)
    running: dict[int, gymnasium.Env] = {}
    last: dict[int, Any] = {}
    seen = [(np.zeros(0, int), np.zeros((0, len(spec.features.names)), np.float32))]
    while True:
        for episode in islice(waiting, len(free)):
            running[episode] = env = free.popleft()
            last[episode] = begin(env, seed=seeds[episode])
        if not running:
            break
        episodes = np.array([*running])
        x = spec.features.flatten_each([last[episode] for episode in running])
        if watch:
            seen.append((episodes, x))
        for episode, action in zip(episodes.tolist(), act(episodes, x), strict=True):
            last[episode], reward, terminated, truncated = advance(running[episode], action)
            returns[episode] += reward
            lengths[episode] += 1
            ended = terminated or truncated
            if ended or lengths[episode] >= limit:
                were_cut = were_cut or not ended
                free.append(running.pop(episode))
                del last[episode]
    return SideBySide(
        returns, lengths, were_cut, *(np.concatenate(parts) for parts in zip(*seen, strict=True))
    )


def limit_of(spec: EnvSpec) -> int:
    """Return the number of steps after which an episode is cut in an evaluation.

    Args:
        spec: The environment.

    Returns:
        Its own time limit, or `MAX_EPISODE_STEPS`.
    """
    return spec.max_episode_steps or MAX_EPISODE_STEPS


def are_alike(returns: np.ndarray, lengths: np.ndarray) -> bool:
    """Return whether several episodes have equal lengths and returns, as one and the same would.

    Args:
        returns: The returns.
        lengths: The lengths.

    Returns:
        True if they are equal and there are at least `FEW`.
    """
    return len(returns) >= FEW and not np.ptp(lengths) and not np.ptp(returns)


def _are_the_same(episodes: Episodes) -> bool:
    """Return whether the observations of all episodes are equal, too."""
    if not are_alike(episodes.returns, episodes.lengths):
        return False
    steps = episodes.observations.reshape(episodes.lengths[0], len(episodes.lengths), -1)
    return bool((steps == steps[:, :1]).all())


def acting(policy: Any, spec: EnvSpec, deterministic: bool, rng: np.random.Generator) -> Act:
    """Return a function from flat observations to the actions of a policy.

    Args:
        policy: A tree, an agent, or such a function, which is returned as it is.
        spec: The environment.
        deterministic: Whether to take the best actions instead of sampling.
        rng: The source of randomness to sample with.

    Returns:
        The function; its actions are as the environment takes them.
    """
    if isinstance(policy, DecisionTree):

        def act(x: np.ndarray) -> np.ndarray:
            actions = policy.predict(x) if deterministic else sample_actions(policy, x, rng)
            return fitted_actions(actions, spec.action_space)

        return act
    if isinstance(policy, Acting):
        return lambda x: policy.act(x, deterministic=deterministic, rng=rng)
    return policy


def sample_actions(tree: DecisionTree, x: np.ndarray, rng: np.random.Generator) -> np.ndarray:
    """Draw actions from the distributions of a tree's leaves.

    Args:
        tree: The tree.
        x: Flat observations ``[batch, features]``.
        rng: The source of randomness.

    Returns:
        One action for each observation.
    """
    return draw(tree.outputs(x), tree.actions, rng)


def draw(values: np.ndarray, actions: ActionSpec, rng: np.random.Generator) -> np.ndarray:
    """Draw actions from distributions.

    Args:
        values: Logits or means ``[batch, outputs]``.
        actions: The meaning of the outputs.
        rng: The source of randomness.

    Returns:
        One action for each row.
    """
    if isinstance(actions, BoxActions):
        noise = np.asarray(actions.std or 0, np.float32) * rng.standard_normal(values.shape, np.float32)
    else:
        noise = rng.gumbel(size=values.shape)  # the largest of the noisy logits is a sample
    return actions.decide(values + noise)


def fitted_actions(actions: np.ndarray, space: gymnasium.Space) -> np.ndarray:
    """Convert a tree's actions to the dtype and bounds of a space.

    Rounding a float64 bound to float32 may have moved it outwards, and an environment may check.

    Args:
        actions: The actions, one or a batch.
        space: The action space.

    Returns:
        The actions as the environment takes them.
    """
    actions = np.asarray(actions).astype(space.dtype)[()]  # one category stays a scalar, which can be hashed
    return np.clip(actions, space.low, space.high) if isinstance(space, gymnasium.spaces.Box) else actions


def episode_seed(seed: int, episode: int, purpose: Purpose = "test") -> int:
    """Return the seed of one episode.

    Seeds of test episodes are odd, all others even, also those of a training (`HostEnvs.reset`), so that no test
    episode is ever trained on.

    Args:
        seed: The seed of all episodes.
        episode: The number of the episode, from 0.
        purpose: What the episodes are for.

    Returns:
        The seed, below 2^32.
    """
    word = int(np.random.SeedSequence([seed, PURPOSE_TAGS[purpose], episode]).generate_state(1)[0])
    return word | 1 if purpose == "test" else word & ~1
