"""What a policy earns on Gymnasium itself, on seeds that training never saw."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from os import PathLike
from typing import TYPE_CHECKING, Any, NamedTuple, Protocol

import gymnasium
import numpy as np

from .envs.env import MAX_EPISODE_STEPS
from .envs.registry import resolve
from .envs.spec import EnvSpec
from .trees import DecisionTree
from .trees.actions import BoxActions

if TYPE_CHECKING:
    from .film.record import Recording

TEST = 0x7E57
"""Part of every seed used here and of none used in training or validation."""


class Policy(Protocol):
    """Anything with stable-baselines3's ``predict``."""

    def predict(self, observation: Any, *, deterministic: bool = True) -> tuple[Any, Any]:
        """The action for an observation, and a state that is not used."""
        ...


class Episodes(NamedTuple):
    """What a number of episodes brought."""

    returns: np.ndarray
    lengths: np.ndarray
    observations: np.ndarray
    """The flat observations acted on, ``[steps, features]``."""


def evaluate_policy(
    model: Policy | DecisionTree,
    env: str | gymnasium.Env | Callable[[], gymnasium.Env] | EnvSpec,
    n_eval_episodes: int = 10,
    *,
    deterministic: bool = True,
    seed: int = 0,
    return_episode_rewards: bool = False,
    render: str | PathLike[str] | None = None,
) -> Any:
    """Play whole episodes and report the undiscounted return.

    Args:
        model: An agent, a `DecisionTree`, or anything with stable-baselines3's ``predict``.
        env: What to play on: an id, a Gymnasium environment or a function that makes one.
        n_eval_episodes: Number of episodes; each has its own seed out of ``seed``.
        deterministic: Whether the policy does what it thinks best, or samples.
        seed: Another seed, other episodes. No training or validation uses any of them.
        return_episode_rewards: Return the lists of returns and lengths instead.
        render: Write a film of the first episode there, as `watch` does.

    Returns:
        Mean and standard deviation of the return over the episodes.
    """
    if n_eval_episodes < 1:
        raise ValueError(f"n_eval_episodes must be at least 1, got {n_eval_episodes}")
    if seed < 0:
        raise ValueError(f"seed must not be negative, got {seed}")
    spec = env if isinstance(env, EnvSpec) else resolve(env, backend="host")
    if render is not None:
        watch(model, spec, render, seed=seed, deterministic=deterministic)
    if isinstance(model, DecisionTree):
        episodes = play(model, spec, n_eval_episodes, seed=seed, deterministic=deterministic)
    elif hasattr(model, "tree"):
        tree = model.tree(prune=False)  # pyright: ignore[reportAttributeAccessIssue]
        episodes = play(tree, spec, n_eval_episodes, seed=seed, deterministic=deterministic)
    else:
        episodes = _play_one_by_one(model, spec, n_eval_episodes, seed=seed, deterministic=deterministic)
    if return_episode_rewards:
        return episodes.returns.tolist(), episodes.lengths.tolist()
    return float(episodes.returns.mean()), float(episodes.returns.std())


def watch(
    model: Policy | DecisionTree,
    env: str | gymnasium.Env | Callable[..., gymnasium.Env] | EnvSpec | None = None,
    path: str | PathLike[str] = "episode.gif",
    *,
    episodes: int = 1,
    deterministic: bool = True,
    seed: int = 0,
    fps: float | None = None,
    max_steps: int | None = None,
    progress: Callable[[str], None] | None = None,
) -> Recording:
    """Play test episodes and write a film: the environment, and beside it the tree with the way taken lit.

    The episodes are those of `evaluate_policy` with the same seed. Of long ones every n-th step is shown, so that
    the file stays small.

    Args:
        model: An agent, a `DecisionTree`, or anything with ``predict``; without a tree, only what happens is shown.
        env: What to play on, as in `evaluate_policy`, with a ``render_mode`` "rgb_array"; by default what an agent
            was trained on.
        path: What to write: .gif, .webp, or .mp4 (``pip install 'sympol[video]'``).
        episodes: How many, one after another.
        deterministic: Whether the policy does what it thinks best, or samples.
        seed: Another seed, other episodes.
        fps: Steps a second; by default the environment's own pace, slower where there are few.
        max_steps: Cut episodes there.
        progress: Called with what is being done, in words.

    Raises:
        ValueError: an environment that draws no pictures, or an argument out of bounds.
        ImportError: .mp4 without a program that writes it.
        OSError: the file cannot be written.
    """
    from .film.record import record

    env = getattr(model, "spec", None) if env is None else env
    if env is None:
        raise ValueError("env must be given: only an agent knows by itself what to play on")
    if seed < 0:
        raise ValueError(f"seed must not be negative, got {seed}")
    spec = env if isinstance(env, EnvSpec) else resolve(env, backend="host")
    _require_host(spec)
    has_tree = hasattr(model, "tree")
    shown = model.tree() if has_tree else model  # pyright: ignore[reportAttributeAccessIssue]
    acting = model.tree(prune=False) if has_tree else model  # pyright: ignore[reportAttributeAccessIssue]
    return record(
        _acts(acting, spec, deterministic, np.random.default_rng([seed, TEST])),
        spec,
        [episode_seed(seed, episode) for episode in range(episodes)],
        path,
        tree=shown if isinstance(shown, DecisionTree) else None,
        fps=fps,
        max_steps=max_steps,
        progress=progress,
    )


def _acts(
    model: Policy | DecisionTree, spec: EnvSpec, deterministic: bool, rng: np.random.Generator
) -> Callable[[Any], Any]:
    """Return what answers one observation of an environment with an action that it takes."""
    if not isinstance(model, DecisionTree):
        return lambda observation: model.predict(observation, deterministic=deterministic)[0]

    def act(observation: Any) -> Any:
        x = spec.features.flatten(observation)[None]
        actions = model.predict(x) if deterministic else sample_actions(model, x, rng)
        return fitted_actions(actions, spec.action_space)[0]

    return act


def play(
    tree: DecisionTree, spec: EnvSpec, num_episodes: int, *, seed: int, deterministic: bool = True
) -> Episodes:
    """Play episodes side by side, one environment each, so that the tree answers them in batches."""
    _require_host(spec)
    if spec.has_one_copy:
        one = [_play(tree, spec, [episode], seed, deterministic) for episode in range(num_episodes)]
        return Episodes(*(np.concatenate(parts) for parts in zip(*one, strict=True)))
    return _play(tree, spec, range(num_episodes), seed, deterministic)


def _require_host(spec: EnvSpec) -> None:
    if spec.make_host is None:
        raise ValueError(
            f"{spec.name} is written in JAX and has no form in Gymnasium to be evaluated on; give evaluate_policy "
            "a Gymnasium environment"
        )


def _play(
    tree: DecisionTree, spec: EnvSpec, episodes: Sequence[int], seed: int, deterministic: bool
) -> Episodes:
    assert spec.make_host is not None
    rng = np.random.default_rng([seed, TEST])
    envs = [spec.make_host() for _ in episodes]
    observations = [env.reset(seed=episode_seed(seed, i))[0] for env, i in zip(envs, episodes, strict=True)]
    returns, lengths = np.zeros(len(envs)), np.zeros(len(envs), int)
    limit = spec.max_episode_steps or MAX_EPISODE_STEPS
    running, seen = list(range(len(envs))), []
    while running:
        x = np.stack([spec.features.flatten(observations[i]) for i in running])
        seen.append(x)
        actions = tree.predict(x) if deterministic else sample_actions(tree, x, rng)
        actions = fitted_actions(actions, spec.action_space)
        still = []
        for i, action in zip(running, actions, strict=True):
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
    values = tree.value[tree.apply(x)]
    if isinstance(tree.actions, BoxActions):
        noise = np.asarray(tree.actions.std or 0, np.float32) * rng.standard_normal(values.shape, np.float32)
    else:
        noise = rng.gumbel(size=values.shape)  # the largest of the noisy logits is a sample
    return tree.actions.decide(values + noise)


def fitted_actions(actions: np.ndarray, space: gymnasium.Space) -> np.ndarray:
    """A tree's actions in the space's own dtype and bounds.

    Rounding a float64 bound to float32 may have moved it outwards, and an environment may check.
    """
    actions = np.asarray(actions).astype(space.dtype)[()]  # one category stays a scalar, which can be hashed
    return np.clip(actions, space.low, space.high) if isinstance(space, gymnasium.spaces.Box) else actions


def _play_one_by_one(
    model: Policy, spec: EnvSpec, num_episodes: int, *, seed: int, deterministic: bool
) -> Episodes:
    _require_host(spec)
    assert spec.make_host is not None
    env = spec.make_host()
    limit = spec.max_episode_steps or MAX_EPISODE_STEPS
    returns, lengths = np.zeros(num_episodes), np.zeros(num_episodes, int)
    for i in range(num_episodes):
        observation, _ = env.reset(seed=episode_seed(seed, i))
        done = False
        while not done:
            action, _ = model.predict(observation, deterministic=deterministic)
            observation, reward, terminated, truncated, _ = env.step(action)
            returns[i] += float(reward)
            lengths[i] += 1
            done = terminated or truncated or lengths[i] >= limit
    if not spec.has_one_copy:
        env.close()
    return Episodes(returns, lengths, np.zeros((0, len(spec.features.names)), np.float32))


def episode_seed(seed: int, episode: int) -> int:
    """The seed of one test episode. It is odd; those of training and validation are even (`HostEnvs.reset`)."""
    return int(np.random.SeedSequence([seed, TEST, episode]).generate_state(1)[0]) | 1
