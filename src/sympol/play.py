"""Whole episodes on Gymnasium itself, side by side, on seeds that no training ever saw."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any, Literal, NamedTuple, Protocol, TypeAlias, runtime_checkable

import gymnasium
import numpy as np

from .envs.env import MAX_EPISODE_STEPS
from .envs.spec import EnvSpec
from .trees import DecisionTree
from .trees.actions import ActionSpec, BoxActions

TEST = 0x7E57
"""Part of every seed of test episodes and of no other."""
Purpose: TypeAlias = Literal["test", "validation", "distill", "refine"]
WORDS: dict[Purpose, int] = {"test": TEST, "validation": 0x7A11D, "distill": 0xD157, "refine": 0x5EF1}
"""Part of every seed of episodes played for that."""

Act: TypeAlias = Callable[[np.ndarray], np.ndarray]
"""From flat observations ``[batch, features]`` to as many actions, as the environment takes them."""


@runtime_checkable
class Acting(Protocol):
    """Whatever answers flat observations in batches, as agents do."""

    def act(self, x: np.ndarray, *, deterministic: bool, rng: np.random.Generator) -> np.ndarray:
        """Actions as the environment takes them, one for each row of ``x``."""
        ...


class Episodes(NamedTuple):
    """What a number of episodes brought."""

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
    """Play episodes side by side, one environment each, so that the policy answers them in batches.

    Another ``purpose`` is another set of episodes, whatever the seed.
    """
    require_host(spec)
    act = acting(policy, spec, deterministic, np.random.default_rng([seed, WORDS[purpose]]))
    seeds = [episode_seed(seed, episode, purpose) for episode in range(num_episodes)]
    if spec.has_one_copy:
        one = [_play(act, spec, [episode]) for episode in seeds]
        return Episodes(*(np.concatenate(parts) for parts in zip(*one, strict=True)))
    return _play(act, spec, seeds)


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


def _play(act: Act, spec: EnvSpec, seeds: Sequence[int]) -> Episodes:
    assert spec.make_host is not None
    envs = [spec.make_host() for _ in seeds]
    observations = [env.reset(seed=seed)[0] for env, seed in zip(envs, seeds, strict=True)]
    returns, lengths = np.zeros(len(envs)), np.zeros(len(envs), int)
    limit = spec.max_episode_steps or MAX_EPISODE_STEPS
    running, seen = list(range(len(envs))), []
    while running:
        x = spec.features.flatten_each([observations[i] for i in running])
        seen.append(x)
        still = []
        for i, action in zip(running, act(x), strict=True):
            observations[i], reward, terminated, truncated, _ = envs[i].step(action)
            returns[i] += float(reward)
            lengths[i] += 1
            if not (terminated or truncated or lengths[i] >= limit):
                still.append(i)
        running = still
    if not spec.has_one_copy:
        for env in envs:
            env.close()
    return Episodes(returns, lengths, np.concatenate(seen))


def sample_actions(tree: DecisionTree, x: np.ndarray, rng: np.random.Generator) -> np.ndarray:
    """Actions drawn from the leaves' distributions, for flat observations ``[batch, features]``."""
    return draw(tree.value[tree.apply(x)], tree.actions, rng)


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
    word = int(np.random.SeedSequence([seed, WORDS[purpose], episode]).generate_state(1)[0])
    return word | 1 if purpose == "test" else word & ~1
