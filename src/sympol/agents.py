"""Agents: train a policy, ask it for actions, extract its tree, save and load it."""

from __future__ import annotations

import abc
import time
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import asdict, dataclass
from os import PathLike
from pathlib import Path
from typing import Any, ClassVar, Self, final

import numpy as np

from .algorithms.config import Config
from .algorithms.knobs import whole
from .algorithms.memory import require_memory
from .algorithms.metrics import metrics_of, require_finite
from .algorithms.normalization import warn_of_bounds
from .algorithms.presets import DEFAULT, preset
from .algorithms.registry import algorithm_class
from .algorithms.state import TrainState
from .algorithms.trainer import Trainer
from .algorithms.warm_start import Start, start_of
from .algorithms.work import stops
from .compilation import use_disk_cache
from .envs.diagnostics import warn_of_cut
from .envs.registry import resolve
from .envs.spec import Backend, EnvSpec, warn_of_one_copy
from .guided import GuidedTrainer, saved_template, trainer_of
from .play import draw, fitted_actions
from .policies.actor import Actor
from .runs.progress import ProgressBar
from .runs.run import Run
from .search.size_limit import is_due, mask_state
from .trained_policy import TrainedPolicy
from .trees import DecisionTree, Group
from .trees.actions import ActionSpec


@dataclass(frozen=True)
class Report:
    """The state of a training after a validation, as a callback gets it."""

    agent: Agent
    """The agent that is being trained."""
    timestep: int
    """Environment steps so far."""
    total_timesteps: int
    """Environment steps of the whole training."""
    metrics: dict[str, float]
    """Metrics under stable-baselines3's names: ``rollout/ep_rew_mean``, ``eval/mean_reward``, ``time/fps``, …"""


Callback = Callable[[Report], bool | None]
"""Called after each validation; returning False ends the training there."""


def _ends_training(answer: object) -> bool:
    return isinstance(answer, bool | np.bool_) and not answer


class Agent(abc.ABC):
    """The interface of all agents: a policy, an environment, and the training of one on the other.

    Args:
        policy: ``"tree"``, or a baseline: ``"mlp"``, a multilayer perceptron; ``"sdt"``, a soft decision tree.
        env: An id (``"CartPole-v1"``), a Gymnasium environment, a class or function that makes one, the name of one in
            a file or a module (``"tank.py:Tank"``), or an environment written in JAX (`sympol.envs.env`).
        seed: The seed of everything random, from 0 to 2^32 - 1. On one machine equal seeds give equal policies, bit for
            bit.
        preset: ``"default"``, ``"paper"`` or a TOML file: the hyperparameters to start from.
        env_kwargs: Arguments to make the environment with, where it is an id or a function.
        feature_names: Names of the features, in place of the environment's own.
        action_names: Names of the actions, in place of the environment's own.
        groups: Features that are one-hot together, in place of the environment's own.
        backend: ``"auto"`` trains on the environment's pure-JAX form where there is one, else on its machine code
            where Numba is installed, else on Gymnasium; ``"jax"``, ``"native"`` and ``"host"`` choose one.
        env_workers: The number of processes that step the copies of a Gymnasium environment, for one whose steps take
            a millisecond or more; 0 steps them here. The result is the same to the bit.
        start: A tree to start from, instead of a random one; or a `Start`, which holds more. The depth is by default
            that of the preset or, if greater, that of the tree.
        freeze: Nodes of the tree to start from that stay as they are; or a condition, such as ``"pole angle > 0.1"``:
            wherever it holds, the policy acts to the end as that tree does.
        config: Any field of `Config`, in place of the preset's.

    Raises:
        ConfigError: A hyperparameter breaks its rule.
        UnknownEnvironment: No environment has this id.
        ValueError: The seed is out of range, a space is unsupported, or the tree to start from is not for this
            environment.
    """

    algorithm: ClassVar[str]
    """The name of the algorithm, as in ``Config.algorithm``."""

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
        env_workers: int = 0,
        start: DecisionTree | Start | None = None,
        freeze: Iterable[int] | str = (),
        **config: Any,
    ) -> None:
        number = _checked_seed(seed)
        spec = (
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
        spec = spec.stepped_by(env_workers) if env_workers else spec
        begins_with = start_of(start, freeze, spec)
        values = {"algorithm": self.algorithm, "policy": policy, **config}
        if "num_envs" not in config:
            warn_of_one_copy(spec)
        self._set(spec, _config(spec, preset, values, begins_with), number, preset, begins_with)
        self._given = values

    def _set(self, spec: EnvSpec, config: Config, seed: int, preset: str, start: Start | None) -> None:
        """Set the attributes of an agent that has learnt nothing."""
        self.spec = spec.trained_with(config.num_envs)
        self.config = config
        self._given: Mapping[str, Any] = asdict(config)
        self.seed = seed
        self.preset = preset
        self.start = start
        """The tree that training begins with; None where it begins with a random policy."""
        self.state: TrainState | None = None
        """Everything trained so far; None before `learn`."""
        self.compile_seconds = 0.0
        """Seconds that the last `learn` spent compiling."""
        self.is_training = False
        """Whether `learn` has compiled its program and takes steps."""
        self._warned = self._said_cut = False
        self._rng = np.random.default_rng(seed)
        self._policy: TrainedPolicy | None = None

    @property
    def num_timesteps(self) -> int:
        """Environment steps trained for so far."""
        return 0 if self.state is None else int(self.state.timestep)

    def learn(
        self,
        total_timesteps: float | None = None,
        callback: Callback | Sequence[Callback] | None = None,
        *,
        progress_bar: bool = True,
    ) -> Self:
        """Train the policy, or resume a training that was interrupted.

        A training may be interrupted by Ctrl-C, a callback, an environment that fails, or a checkpoint.

        Args:
            total_timesteps: Environment steps of the whole training, in place of the config's. Schedules run over
                them, and defaults without a preset follow them, so the number cannot change once training has begun.
            callback: One or several functions that get a `Report` after each validation; if one returns False,
                training ends there.
            progress_bar: Whether to show progress on the terminal.

        Returns:
            The agent itself. With method "auto" there is no tree before the teacher is trained (`has_tree`), and the
            first reports are about the teacher.

        Raises:
            ConfigError: The training does not fit into memory; nothing has been trained.
            EnvironmentFailure: The environment failed; the agent keeps the last state before it.
            RuntimeError: This process was forked from one in which JAX had computed.
            ValueError: The training is complete, or ``total_timesteps`` differs from that of its beginning.
        """
        if total_timesteps is not None and total_timesteps != self.config.total_timesteps:
            if self.state is not None:
                raise ValueError(
                    f"total_timesteps is {self.config.total_timesteps} and cannot become {total_timesteps} after "
                    f"{self.num_timesteps} steps of training; make a new agent"
                )
            given = {**self._given, "total_timesteps": total_timesteps}
            self.config = _config(self.spec, self.preset, given, self.start)
            self.spec = self.spec.trained_with(self.config.num_envs)
        if self.num_timesteps >= self.config.total_timesteps:
            raise ValueError(
                f"this agent has been trained for all its {self.config.total_timesteps} steps; make a new one, with "
                "another seed or more total_timesteps"
            )
        callbacks = [callback] if callable(callback) else list(callback or ())
        use_disk_cache()
        require_memory(self.spec, self.config)
        trainer = trainer_of(self.spec, self.config, self.seed, self.start)
        try:
            with ProgressBar(self.config.total_timesteps, self.num_timesteps, show=progress_bar) as bar:
                if isinstance(trainer, GuidedTrainer):
                    trainer.say = bar.say
                self.compile_seconds = trainer.compile()
                self.is_training = True
                self._learn(trainer, callbacks, bar)
        except BaseException:
            self.state = trainer.latest or self.state
            raise
        finally:
            self.is_training = False
            trainer.close()
        return self

    def _learn(self, trainer: Trainer | GuidedTrainer, callbacks: list[Callback], bar: ProgressBar) -> None:
        began, first = time.perf_counter(), self.num_timesteps
        at_once = () if self.start is None else (1,)  # what is begun with is the first to be validated
        for stop in (*at_once, *stops(self.config)):
            if self.num_timesteps >= stop:
                continue
            state = trainer.advance(self.state, stop)
            require_finite(state, self.num_timesteps, self.spec.features.names)  # waits for the device, too
            if is_due(self.config, self.num_timesteps, int(state.timestep)):
                bar.say("pruning by what it earns")
                state = self._within_limit(trainer, state)
            self.state = state
            elapsed = time.perf_counter() - began
            self._warned = self._warned or warn_of_bounds(self.spec.name, self.spec.features.names, state)
            if trainer.was_cut and not self._said_cut:
                warn_of_cut(self.spec.name, "validation", trainer.limit)
                self._said_cut = True
            metrics = metrics_of(self.state, elapsed, (self.num_timesteps - first) / elapsed)
            bar.update(metrics, "" if self.has_tree or self.config.method == "direct" else "teacher's ")
            report = Report(self, self.num_timesteps, self.config.total_timesteps, metrics)
            if any([_ends_training(c(report)) for c in callbacks]):
                return

    def _within_limit(self, trainer: Trainer | GuidedTrainer, state: TrainState) -> TrainState:
        """Return the state in the shape of a tree that is small enough, validated."""
        trainer.close()  # there may be no more copies of the environment than it has open
        full = TrainedPolicy(self.spec, self.config, self.seed, state).extracted_tree
        small = mask_state(state, full, self.spec, self.config, self.seed)
        validated = trainer.advance(small, int(small.timestep))
        return validated._replace(episodes=state.episodes)  # still to be reported

    def predict(
        self, observation: Any, state: Any = None, episode_start: Any = None, deterministic: bool = True
    ) -> tuple[Any, None]:
        """Choose the action for one observation or a batch of them, with the signature of stable-baselines3.

        Args:
            observation: An observation of the environment, or a batch of them.
            state: Ignored; the policy has no memory.
            episode_start: Ignored.
            deterministic: Whether to choose the best action instead of drawing one from the distribution.

        Returns:
            The action, or a batch of them, as the environment takes it; and None for the state.

        Raises:
            RuntimeError: There is no policy before `learn`.
            ValueError: An observation does not fit the observation space.
        """
        x = self.spec.features.flatten(observation)
        actions = self.act(np.atleast_2d(x), deterministic=deterministic, rng=self._rng)
        return (actions[0] if x.ndim == 1 else actions), None

    def act(self, x: np.ndarray, *, deterministic: bool, rng: np.random.Generator) -> np.ndarray:
        """Choose actions for flat observations.

        Args:
            x: Observations ``[batch, features]``.
            deterministic: Whether to choose the best actions instead of drawing from the distribution.
            rng: The source of randomness to draw with.

        Returns:
            The actions ``[batch, ...]``, as the environment takes them.
        """
        values, actions = self.outputs(x), self.actions
        chosen = actions.decide(values) if deterministic else draw(values, actions, rng)
        return fitted_actions(chosen, self.spec.action_space)

    def outputs(self, x: np.ndarray) -> np.ndarray:
        """Compute the actor's outputs for flat observations.

        Args:
            x: Observations ``[batch, features]``.

        Returns:
            Logits, or means of continuous actions, ``[batch, outputs]``.

        Raises:
            RuntimeError: There is no policy before `learn`.
        """
        return self.policy.outputs(x)

    @property
    def policy(self) -> TrainedPolicy:
        """The policy that training has reached."""
        if self._policy is None or not self._policy.is_of(self.state):
            self._policy = TrainedPolicy(self.spec, self.config, self.seed, self.state, self.start)
        return self._policy

    @property
    def actor(self) -> Actor:
        """The actor that is the policy: the best one validated, or without ``select_best`` the last."""
        return self.policy.actor

    @property
    def actions(self) -> ActionSpec:
        """The meaning of the outputs, with the standard deviation of continuous actions."""
        return self.policy.actions

    @property
    def has_tree(self) -> bool:
        """True where the policy is a tree, so that `tree` returns it; with method "auto" not before it is distilled."""
        return self.policy.is_tree

    def tree(self, *, prune: bool = True) -> DecisionTree:
        """Return the policy as a tree: the best one validated, or without ``select_best`` the last.

        With ``max_nodes`` or ``node_price`` the tree is never larger than they allow, whatever ``prune`` is. In the
        first part of a training that takes a while, as the tree is pruned by return when this method is called.

        Args:
            prune: Whether to remove splits that change no action for any observation within the space's bounds or,
                where the environment lists its observations, for any of those. Otherwise the result is the complete
                tree of depth ``config.depth``, with the leaf distributions as trained.

        Returns:
            The tree; before `learn`, the one to start from.

        Raises:
            RuntimeError: There is neither a trained policy nor a tree to start from, or the policy is no tree.
        """
        return self.policy.pruned_tree if prune else self.policy.full_tree

    def save(self, path: str | PathLike[str]) -> None:
        """Write the agent as a run's folder; an earlier run of that name is replaced.

        Args:
            path: The folder.

        Raises:
            RunError: The folder is not a run's, another process writes in it, or it cannot be written.
        """
        with Run.create(
            Path(path),
            self.spec,
            self.config,
            self.seed,
            preset=self.preset,
            overwrite=True,
            start=self.start,
            flag="path",
        ) as run:
            run.way_on = "save it again, there or elsewhere"
            if self.state is not None:
                run.save_checkpoint(self.state)
                if self.has_tree:
                    run.save_tree(self.tree())

    def metadata(self) -> dict[str, Any]:
        """Return the fields of a `DecisionTree` made of this policy that describe its features and actions.

        Returns:
            Keyword arguments of `DecisionTree`: actions, names and bounds of the features, groups.

        Raises:
            RuntimeError: There is no policy before `learn`.
        """
        return self.policy.metadata()


@final
class PPO(Agent):
    """Proximal policy optimization; see `Agent` for the arguments."""

    algorithm = "ppo"
    """The name in `Config`."""


@final
class A2C(Agent):
    """Advantage actor-critic: one update a rollout; see `Agent` for the arguments."""

    algorithm = "a2c"
    """The name in `Config`."""


def agent_class(algorithm: str) -> type[Agent]:
    """Return the agent of an algorithm: `PPO`, `A2C`, or a class made for one that was added to `ALGORITHMS`.

    Args:
        algorithm: The name of the algorithm, as in ``Config.algorithm``.

    Returns:
        The class.

    Raises:
        KeyError: There is no algorithm of this name.
    """
    named = {agent.algorithm: agent for agent in (PPO, A2C)}
    if algorithm in named:
        return named[algorithm]
    implementation = algorithm_class(algorithm)
    return type(
        implementation.__name__, (Agent,), {"algorithm": algorithm, "__doc__": implementation.__doc__}
    )


def agent_of(
    spec: EnvSpec, config: Config, seed: int, start: Start | None = None, *, preset: str = DEFAULT
) -> Agent:
    """Return an untrained agent with exactly this config.

    Args:
        spec: The environment.
        config: The config, which also names the algorithm and the policy.
        seed: The seed of everything random.
        start: The tree to start from, if there is one.
        preset: The preset that the config is from.

    Returns:
        The agent.

    Raises:
        ConfigError: The tree to start from does not fit the config.
        ValueError: The seed is out of range, or the tree to start from does not fit the environment.
    """
    if start is not None:
        start.check(config)
        start = start.fitted(spec)
    kind = agent_class(config.algorithm)
    agent = kind.__new__(kind)
    agent._set(spec, config, _checked_seed(seed), preset, start)
    return agent


def load(path: str | PathLike[str], env: Any = None, *, env_workers: int = 0) -> Agent:
    """Return the agent that a run's folder holds, ready to predict and, if it was interrupted, to resume learning.

    Nothing in the folder is ever run as code, and no module that it names is imported. A run that was stopped before
    its first checkpoint is an agent that has learnt nothing yet.

    Args:
        path: The run's folder.
        env: What it was trained on, as in `Agent`. It is needed where the folder cannot make the environment again:
            the environment has no id, needs a module to be imported, was changed after it was made, or is wrapped in
            something that a folder cannot keep.
        env_workers: The number of processes that step the environment should the training be resumed, as in `Agent`.

    Returns:
        The agent.

    Raises:
        RunError: There is no run there, another version made it, all its checkpoints are damaged, or ``env`` is
            needed.
    """
    agent = load_run(Run.open(Path(path), env))
    agent.spec = agent.spec.stepped_by(env_workers) if env_workers else agent.spec
    return agent


def load_run(run: Run) -> Agent:
    """Return the agent of a run that is open; see `load`."""
    run.require_training()
    agent = agent_of(run.resolve_env(), run.config, run.seed, run.load_start(), preset=run.metadata["preset"])
    agent.state = run.load_checkpoint(
        lambda timestep: saved_template(agent.spec, agent.config, agent.start, timestep)
    )
    return agent


def _checked_seed(seed: object) -> int:
    number = whole(seed)
    if number is None or not 0 <= number < 2**32:
        raise ValueError(f"seed must be a whole number from 0 to 2^32 - 1, got {seed!r}")
    return number


def _config(spec: EnvSpec, name: str, overrides: dict[str, Any], start: Start | None) -> Config:
    if not spec.can_be_copied:
        overrides = {"num_envs": 1, **overrides}
    if spec.vector is not None:
        overrides = {"num_envs": spec.vector.num_envs, **overrides}
    values = preset(
        spec.preset_id,
        name,
        policy=overrides["policy"],
        algorithm=overrides["algorithm"],
        given=overrides,
        from_tree=start is not None,
    )
    if start is not None and overrides["policy"] == "tree":
        values = start.deepened(values)
    config = Config.from_dict({**values, **overrides})
    if start is not None:
        start.check(config)
    return config
