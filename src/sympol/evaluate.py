"""Evaluate policies on Gymnasium, on seeds that training never used."""

from __future__ import annotations

from collections.abc import Callable
from copy import deepcopy
from dataclasses import replace
from os import PathLike
from typing import TYPE_CHECKING, Any, Protocol

import gymnasium
import numpy as np
from gymnasium.utils.env_checker import data_equivalence

from .envs.copies import open_copies
from .envs.diagnostics import warn_of_cut, warn_of_same_episodes
from .envs.host import advance, begin
from .envs.registry import resolve
from .envs.spec import EnvSpec
from .play import (
    PLAYED_BY,
    PURPOSE_TAGS,
    Acting,
    Episodes,
    acting,
    are_alike,
    episode_seed,
    limit_of,
    play,
)
from .trees import DecisionTree

if TYPE_CHECKING:
    from .film.record import Recording


class Policy(Protocol):
    """Anything with stable-baselines3's ``predict``."""

    def predict(self, observation: Any, *, deterministic: bool = True) -> tuple[Any, Any]:
        """Choose an action.

        Args:
            observation: An observation of the environment.
            deterministic: Whether to take the best action instead of sampling one.

        Returns:
            The action, and a state that is not used.
        """
        ...


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

    The episodes are played on a bounded number of copies of the environment: no more than 16, nor than an agent was
    trained on in Gymnasium (``num_envs``), nor than can be open at once. Where an environment does not end an episode,
    it is cut after its time limit, or else after 10,000 steps, and a warning says so.

    Args:
        model: An agent, a `DecisionTree`, or anything with stable-baselines3's ``predict``.
        env: What to play on: an id, a Gymnasium environment or a function that makes one.
        n_eval_episodes: Number of episodes; each has its own seed out of ``seed``.
        deterministic: Whether the policy takes its best action or samples.
        seed: Another seed, other episodes. No training or validation uses any of them.
        return_episode_rewards: Return the lists of returns and lengths instead.
        render: Write a film of the first episode there, as `watch` does.

    Returns:
        Mean and standard deviation of the return over the episodes.

    Raises:
        ValueError: There is less than one episode, the seed is negative, or the policy does not fit the environment.
    """
    if n_eval_episodes < 1:
        raise ValueError(f"n_eval_episodes must be at least 1, got {n_eval_episodes}")
    if seed < 0:
        raise ValueError(f"seed must not be negative, got {seed}")
    spec = env if isinstance(env, EnvSpec) else resolve(env, backend="host")
    trained_on = getattr(model, "spec", None)
    if isinstance(trained_on, EnvSpec):
        spec = replace(spec, most_copies=min(spec.most_copies, trained_on.most_copies))
    if render is not None:
        watch(model, spec, render, seed=seed, deterministic=deterministic)
    if isinstance(model, DecisionTree | Acting):
        episodes = play(model, spec, n_eval_episodes, seed=seed, deterministic=deterministic)
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
    """Play test episodes and write a film: the environment beside the tree, with the path highlighted.

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
        progress: Called with a description of each step of the work.

    Returns:
        What was written, and what was left out.

    Raises:
        ValueError: The environment draws no pictures, or an argument is out of bounds.
        ImportError: The file is .mp4 and no program that writes it is installed.
        OSError: The file cannot be written.
    """
    from .film.record import record

    env = getattr(model, "spec", None) if env is None else env
    if env is None:
        raise ValueError("env must be given: only an agent knows by itself what to play on")
    if seed < 0:
        raise ValueError(f"seed must not be negative, got {seed}")
    spec = env if isinstance(env, EnvSpec) else resolve(env, backend="host")
    # an agent may also act by something that is no tree
    shown = model.tree() if getattr(model, "has_tree", False) else model  # pyright: ignore[reportAttributeAccessIssue]
    return record(
        _answers(model, spec, deterministic, np.random.default_rng([seed, PURPOSE_TAGS["test"]])),
        spec,
        [episode_seed(seed, episode) for episode in range(episodes)],
        path,
        tree=shown if isinstance(shown, DecisionTree) else None,
        fps=fps,
        max_steps=max_steps,
        progress=progress,
    )


def _answers(
    model: Policy | DecisionTree, spec: EnvSpec, deterministic: bool, rng: np.random.Generator
) -> Callable[[Any], Any]:
    """Return a function from an observation of an environment to an action that it takes."""
    if not isinstance(model, DecisionTree | Acting):
        return lambda observation: model.predict(observation, deterministic=deterministic)[0]
    act = acting(model, spec, deterministic, rng)
    return lambda observation: act(spec.features.flatten(observation)[None])[0]


def _play_one_by_one(
    model: Policy, spec: EnvSpec, num_episodes: int, *, seed: int, deterministic: bool
) -> Episodes:
    limit, were_cut = limit_of(spec), False
    returns, lengths = np.zeros(num_episodes), np.zeros(num_episodes, int)
    ends: list[Any] = []
    with open_copies(spec, 1) as (env,):
        for i in range(num_episodes):
            observation = begin(env, seed=episode_seed(seed, i))
            first, ended = deepcopy(observation), False
            while not (ended or lengths[i] >= limit):
                action, _ = model.predict(observation, deterministic=deterministic)
                observation, reward, terminated, truncated = advance(env, action)
                returns[i] += reward
                lengths[i] += 1
                ended = terminated or truncated
            were_cut = were_cut or not ended
            ends.append((first, deepcopy(observation)))
    if were_cut:
        warn_of_cut(spec.name, PLAYED_BY["test"], limit)
    if deterministic and are_alike(returns, lengths) and all(data_equivalence(ends[0], end) for end in ends):
        warn_of_same_episodes(spec.name, num_episodes)
    return Episodes(returns, lengths, np.zeros((0, len(spec.features.names)), np.float32))
