"""The user's verbs: learn, predict, tree, save, load."""

from __future__ import annotations

import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from os import PathLike
from pathlib import Path
from typing import Any

import jax
import numpy as np

from .algos.bounds import kept_bounds, warn_of_bounds
from .algos.config import PPOConfig
from .algos.presets import DEFAULT, preset
from .algos.state import TrainState
from .algos.train import Trainer, make_trainer, stops
from .compilation import use_disk_cache
from .envs.host import EnvironmentFailure
from .envs.registry import resolve
from .envs.spec import Backend, EnvSpec
from .play import acting
from .policies.extract import extract_tree
from .runs.folder import Run
from .runs.progress import ProgressBar
from .trees import DecisionTree, Group
from .trees.actions import BoxActions

POLICIES = ("tree",)


@dataclass(frozen=True)
class Report:
    """What a callback is told after each validation."""

    agent: PPO
    timestep: int
    total_timesteps: int
    metrics: dict[str, float]
    """Under stable-baselines3's names: ``rollout/ep_rew_mean``, ``eval/mean_reward``, ``time/fps``, …"""


Callback = Callable[[Report], bool | None]
"""Called after each validation; returning False ends the training there."""


class PPO:
    """Proximal policy optimisation whose policy is a decision tree.

    Args:
        policy: ``"tree"``.
        env: An id (``"CartPole-v1"``), a Gymnasium environment, a function that makes one, or an environment
            written in JAX (`sympol.envs.env`).
        seed: Of everything random. The same seed on the same machine gives the same tree, bit for bit.
        preset: ``"default"`` or ``"paper"``: the hyperparameters to start from.
        env_kwargs: What to make the environment with, where it is an id or a function.
        feature_names: Names for the features, where the environment's own should not do.
        action_names: Names for the actions, idem.
        groups: Features that are one-hot together, idem.
        backend: ``"auto"`` trains on the environment's pure-JAX form where there is one, else through envpool where
            that has it and is installed, else on Gymnasium; ``"jax"``, ``"envpool"`` and ``"host"`` insist.
        config: Any field of `PPOConfig`, in place of the preset's.

    Raises:
        ConfigError: a hyperparameter that breaks its rule.
        UnknownEnvironment: no environment has this id.
        ValueError: an unsupported space.
    """

    def __init__(
        self,
        policy: str,
        env: Any,
        *,
        seed: int = 0,
        preset: str = DEFAULT,
        env_kwargs: Mapping[str, Any] | None = None,
        feature_names: Sequence[str] | None = None,
        action_names: Sequence[str] | None = None,
        groups: Sequence[Group] | None = None,
        backend: Backend = "auto",
        **config: Any,
    ) -> None:
        if policy not in POLICIES:
            raise ValueError(f"policy must be one of {', '.join(POLICIES)}, got {policy!r}")
        if not isinstance(seed, int | np.integer) or not 0 <= seed < 2**32:
            raise ValueError(f"seed must be a whole number from 0 to 2^32 - 1, got {seed!r}")
        self.spec: EnvSpec = (
            env
            if isinstance(env, EnvSpec)
            else resolve(
                env,
                env_kwargs=env_kwargs,
                feature_names=feature_names,
                action_names=action_names,
                groups=groups,
                backend=backend,
            )
        )
        self.seed = int(seed)
        self.preset = preset
        self.config = _config(self.spec, preset, config)
        self.state: TrainState | None = None
        """Everything trained so far; None before `learn`."""
        self.compile_seconds = 0.0
        """What the last `learn` spent compiling."""
        self._warned = False
        self._rng = np.random.default_rng(self.seed)
        self._trees: dict[tuple[int, bool], DecisionTree] = {}

    @property
    def num_timesteps(self) -> int:
        """Environment steps trained for so far."""
        return 0 if self.state is None else int(self.state.timestep)

    def learn(
        self,
        total_timesteps: int | None = None,
        callback: Callback | Sequence[Callback] | None = None,
        *,
        progress_bar: bool = True,
    ) -> PPO:
        """Train; return the agent itself.

        An interrupted training (Ctrl-C, a callback, an environment that failed, a loaded checkpoint) goes on
        where it was. ``total_timesteps`` sets the whole length; schedules run over it, so it cannot change
        once training has begun.
        """
        if total_timesteps is not None and total_timesteps != self.config.total_timesteps:
            if self.state is not None:
                raise ValueError(
                    f"total_timesteps is {self.config.total_timesteps} and cannot become {total_timesteps} after "
                    f"{self.num_timesteps} steps of training; make a new agent"
                )
            self.config = replace(self.config, total_timesteps=total_timesteps)
        if self.num_timesteps >= self.config.total_timesteps:
            raise ValueError(
                f"this agent has been trained for all its {self.config.total_timesteps} steps; make a new one, with "
                "another seed or more total_timesteps"
            )
        callbacks = [callback] if callable(callback) else list(callback or ())
        use_disk_cache()
        trainer = make_trainer(self.spec, self.config, self.seed)
        try:
            with ProgressBar(self.config.total_timesteps, self.num_timesteps, show=progress_bar) as bar:
                self.compile_seconds = trainer.compile()
                self._learn(trainer, callbacks, bar)
        except BaseException:
            self.state = trainer.latest or self.state
            raise
        finally:
            trainer.close()
        return self

    def _learn(self, trainer: Trainer, callbacks: list[Callback], bar: ProgressBar) -> None:
        began, first = time.perf_counter(), self.num_timesteps
        for stop in stops(self.config):
            if self.num_timesteps >= stop:
                continue
            state = trainer.advance(self.state, stop)
            _require_finite(state, self.num_timesteps)  # waits for the device, too
            self.state = state
            elapsed = time.perf_counter() - began
            self._warned = self._warned or warn_of_bounds(self.spec.name, self.spec.features.names, state)
            metrics = _metrics(self.state, elapsed, (self.num_timesteps - first) / elapsed)
            bar.update(metrics)
            report = Report(self, self.num_timesteps, self.config.total_timesteps, metrics)
            if any([c(report) is False for c in callbacks]):
                return

    def predict(
        self, observation: Any, state: Any = None, episode_start: Any = None, deterministic: bool = True
    ) -> tuple[Any, None]:
        """The action for one observation or a batch of them, as the environment takes it.

        Returns ``(action, None)``, as in stable-baselines3. Sampling (``deterministic=False``) draws from the
        leaf's distribution.

        Raises:
            ValueError: an observation that does not fit the observation space.
        """
        x = self.spec.features.flatten(observation)
        actions = self.act(np.atleast_2d(x), deterministic=deterministic, rng=self._rng)
        return (actions[0] if x.ndim == 1 else actions), None

    @property
    def has_tree(self) -> bool:
        """Whether the policy is a tree, so that `tree` can give it."""
        return True

    def act(self, x: np.ndarray, *, deterministic: bool, rng: np.random.Generator) -> np.ndarray:
        """Actions for flat observations ``[batch, features]``, as the environment takes them."""
        return acting(self.tree(prune=False), self.spec, deterministic, rng)(x)

    def tree(self, *, prune: bool = True) -> DecisionTree:
        """The policy: of the trees validated, the best (``select_best``), or the last.

        Pruning changes no action for any observation within the space's bounds; where all observations there can be
        are listed (MiniGrid's small tasks), for any of those. ``prune=False`` is the complete tree of depth
        ``config.depth``, with the leaf distributions as trained.

        Raises:
            RuntimeError: before `learn`.
        """
        if self.state is None:
            raise RuntimeError("there is no tree yet: call learn() first")
        now = self.num_timesteps
        if (now, False) not in self._trees:
            self._trees = {(now, False): _extract(self.spec, self.config, self.state)}
        if (now, prune) not in self._trees:
            listed = self.spec.all_observations()
            self._trees[now, True] = self._trees[now, False].prune(observations=listed)
        return self._trees[now, prune]

    def save(self, path: str | PathLike[str]) -> None:
        """Write the agent as a run's folder; an earlier run of that name is replaced.

        Raises:
            RunError: a folder of that name that is not a run, or cannot be written.
        """
        run = Run.create(Path(path), self.spec, self.config, self.seed, preset=self.preset, overwrite=True)
        if self.state is not None:
            run.save_checkpoint(self.state)
            run.save_tree(self.tree())


def load(path: str | PathLike[str], env: Any = None) -> PPO:
    """The agent that a run's folder holds, ready to predict and, if it was interrupted, to go on learning.

    ``env`` is needed only where the run's environment has no id: give what it was trained on. Nothing in the
    folder is ever run as code. A run that was stopped before its first checkpoint is an agent that has learnt
    nothing yet.

    Raises:
        RunError: no run there, made by another version, or all its checkpoints are damaged.
    """
    run = Run.open(Path(path))
    agent = PPO("tree", run.resolve_env(env), seed=run.seed)
    agent.preset, agent.config = run.about["preset"], run.config
    trainer = make_trainer(agent.spec, agent.config, agent.seed)
    try:
        agent.state = run.load_checkpoint(trainer.template())
    finally:
        trainer.close()
    return agent


def _config(spec: EnvSpec, name: str, overrides: dict[str, Any]) -> PPOConfig:
    values = preset(spec.name, name)
    if spec.has_one_copy:
        values = {**values, "num_envs": 1}
    return PPOConfig.from_dict({**values, **overrides})


def _extract(spec: EnvSpec, config: PPOConfig, state: TrainState) -> DecisionTree:
    actor = state.validation.best_actor if config.select_best else state.networks.actor
    actions = spec.actions
    if isinstance(actions, BoxActions):
        actions = replace(actions, std=tuple(np.exp(np.asarray(actor.log_std)).tolist()))
    low, high = kept_bounds(spec.features, state)
    return extract_tree(
        actor,
        np.asarray(state.normalizer.shift),
        np.asarray(state.normalizer.scale),
        actions=actions,
        feature_names=spec.features.names,
        feature_low=low,
        feature_high=high,
        groups=spec.features.groups,
    )


def _require_finite(state: TrainState, before: int) -> None:
    numbers = [*jax.tree.leaves(state.networks), state.validation.last_return]
    if not all(np.isfinite(np.asarray(leaf)).all() for leaf in numbers):
        raise EnvironmentFailure(
            f"between training steps {before:,} and {int(state.timestep):,} the training came to NaN or infinity: "
            "the environment returned an observation or a reward that is not finite, or the learning rates are "
            "too high"
        )


def _metrics(state: TrainState, elapsed: float, fps: float) -> dict[str, float]:
    episodes = max(1, int(state.episodes.num_ended))
    nothing = float("nan") if int(state.episodes.num_ended) == 0 else 0.0
    return {
        "time/total_timesteps": int(state.timestep),
        "time/time_elapsed": elapsed,
        "time/fps": fps,
        "rollout/ep_rew_mean": float(state.episodes.sum_return) / episodes + nothing,
        "rollout/ep_len_mean": float(state.episodes.sum_length) / episodes + nothing,
        "eval/mean_reward": float(state.validation.last_return),
        "train/policy_gradient_loss": float(state.losses.policy_loss),
        "train/value_loss": float(state.losses.value_loss),
        "train/entropy": float(state.losses.entropy),
        "train/approx_kl": float(state.losses.approx_kl),
        "train/clip_fraction": float(state.losses.clip_fraction),
    }
