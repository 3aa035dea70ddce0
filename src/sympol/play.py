"""Whole episodes on Gymnasium itself, side by side, on seeds that no training ever saw."""

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
    """Whatever answers flat observations in batches, as agents do."""

    def act(self, x: np.ndarray, *, deterministic: bool, rng: np.random.Generator) -> np.ndarray:
        """Actions as the environment takes them, one for each row of ``x``."""
        ...


class Episodes(NamedTuple):
    """The returns, lengths and observations of episodes."""

    returns: np.ndarray
    lengths: np.ndarray
    observations: np.ndarray
    """The flat observations acted on, ``[steps, features]``."""


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
    a deterministic policy; one that samples draws its noise in the order in which the episodes are played.

    Another ``purpose`` is another set of episodes, whatever the seed. Warns where episodes are cut, and where test
    episodes of a deterministic policy are all the same.
    """
    require_host(spec)
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
    """The results of episodes that were played side by side, with observations in the order of playing."""

    returns: np.ndarray
    lengths: np.ndarray
    were_cut: bool
    episode: np.ndarray
    """Of each observation, the episode that it was made in."""
    observations: np.ndarray

    def step_by_step(self) -> np.ndarray:
        """The observations: the first of every episode, then the second of those that have one, and so on."""
        by_episode = np.argsort(self.episode, kind="stable")
        step = np.concatenate([np.arange(length) for length in self.lengths])
        return self.observations[by_episode[np.argsort(step, kind="stable")]]

    def one_by_one(self) -> np.ndarray:
        """The observations, one episode after the other."""
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
        act: From the numbers of the episodes that are going on, and their flat observations, to as many actions.
        spec: What the copies are copies of.
        copies: Where to play.
        seeds: What to reset them with. The numbers of the episodes are their places here.
        limit: Steps after which an episode is cut, by default `limit_of`.
        watch: Whether to keep the observations; without, there are none.
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
    """Steps after which an episode is cut that is only measured."""
    return spec.max_episode_steps or MAX_EPISODE_STEPS


def are_alike(returns: np.ndarray, lengths: np.ndarray) -> bool:
    """Return whether several episodes have equal lengths and returns, as one and the same would."""
    return len(returns) >= FEW and not np.ptp(lengths) and not np.ptp(returns)


def _are_the_same(episodes: Episodes) -> bool:
    """Whether the same was observed, too, step by step."""
    if not are_alike(episodes.returns, episodes.lengths):
        return False
    steps = episodes.observations.reshape(episodes.lengths[0], len(episodes.lengths), -1)
    return bool((steps == steps[:, :1]).all())


def acting(policy: Any, spec: EnvSpec, deterministic: bool, rng: np.random.Generator) -> Act:
    """Return what answers batches as ``policy`` does; a plain function answers for itself."""
    if isinstance(policy, DecisionTree):

        def act(x: np.ndarray) -> np.ndarray:
            actions = policy.predict(x) if deterministic else sample_actions(policy, x, rng)
            return fitted_actions(actions, spec.action_space)

        return act
    if isinstance(policy, Acting):
        return lambda x: policy.act(x, deterministic=deterministic, rng=rng)
    return policy


def require_host(spec: EnvSpec) -> None:
    """Refuse an environment that has no form in Gymnasium."""
    if spec.make_host is None:
        raise ValueError(
            f"{spec.name} is written in JAX and has no form in Gymnasium to be evaluated on; give evaluate_policy "
            "a Gymnasium environment"
        )


def sample_actions(tree: DecisionTree, x: np.ndarray, rng: np.random.Generator) -> np.ndarray:
    """Actions drawn from the leaves' distributions, for flat observations ``[batch, features]``."""
    return draw(tree.outputs(x), tree.actions, rng)


def draw(values: np.ndarray, actions: ActionSpec, rng: np.random.Generator) -> np.ndarray:
    """Actions drawn from the distributions that ``values [batch, outputs]`` are the logits or means of."""
    if isinstance(actions, BoxActions):
        noise = np.asarray(actions.std or 0, np.float32) * rng.standard_normal(values.shape, np.float32)
    else:
        noise = rng.gumbel(size=values.shape)  # the largest of the noisy logits is a sample
    return actions.decide(values + noise)


def fitted_actions(actions: np.ndarray, space: gymnasium.Space) -> np.ndarray:
    """A tree's actions in the space's own dtype and bounds.

    Rounding a float64 bound to float32 may have moved it outwards, and an environment may check.
    """
    actions = np.asarray(actions).astype(space.dtype)[()]  # one category stays a scalar, which can be hashed
    return np.clip(actions, space.low, space.high) if isinstance(space, gymnasium.spaces.Box) else actions


def episode_seed(seed: int, episode: int, purpose: Purpose = "test") -> int:
    """The seed of one episode: odd for tests, even for all else, so that none of theirs is ever a test's.

    Those of a training are even, too (`HostEnvs.reset`).
    """
    word = int(np.random.SeedSequence([seed, PURPOSE_TAGS[purpose], episode]).generate_state(1)[0])
    return word | 1 if purpose == "test" else word & ~1
